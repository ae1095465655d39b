"""From a session to a calibrated, fused picture of the scene, and a report.

Run it on what 'polfuse demo --out demo' left behind:

    python examples/focus_session.py demo/session.h5 demo/sky.h5
"""

import math
import sys

import polfuse_lab as pf


def main(session: str, sky: str, products: str = "products.h5") -> None:
    """Focus, calibrate on the demo's trihedral, check on its dihedral, add the camera, and write a page."""
    focused = pf.focus(session, products, sky=sky)
    for peak in focused.peaks[:5]:
        print(f"peak at x = {peak.x_m:6.2f} m, y = {peak.y_m:6.2f} m: {peak.level_db:6.1f} dB")

    trihedral = pf.TargetSpec("trihedral", 1.2, 8.6, 0.61, math.radians(45), math.radians(35.264), height_m=0.469)
    dihedral = pf.TargetSpec("dihedral", -1.8, 11.2, 0.61, fold_rad=math.radians(90), height_m=0.319)
    calibrated = pf.calibrate(products, trihedral, sky=sky, check=dihedral)
    print(f"constant {calibrated.constant_db:.2f} ± {calibrated.constant_sd_db:.2f} dB")
    print(f"dihedral {calibrated.check.rcs_dbsm:.2f} dBsm, {calibrated.check.error_db:+.2f} dB from theory")

    light = pf.optics(session, products)
    print(f"median DOLP {light.dolp_median:.3f}")

    fused = pf.fuse(products)
    for pair, separability in fused.pairs.items():
        print(f"{pair}: Bhattacharyya distance {separability.distance['pauli_dolp']:.2f}")
    print(f"report: {pf.write_report(products, 'report.html')}")


if __name__ == "__main__":
    main(*sys.argv[1:])
