"""Measure a calibration target by itself, then calibrate the picture of a scene with it.

polfuse sim examples/scenes/field.toml --rig-out rig.toml      (in another terminal)
python examples/calibration_series.py rig.toml out
"""

import sys
from pathlib import Path

import numpy as np

import polfuse_lab as pf
from polfuse_lab.engine import EngineClient, Prompt
from polfuse_lab.plans import CalibrationSeriesPlan, RailSarPlan, SeriesTarget


def confirm(client: EngineClient, prompt: Prompt) -> None:
    """Say that it is done: the simulated targets stand in their places."""
    print(prompt.text)
    client.answer(prompt.ticket)


def main(rig: str, out: Path) -> None:
    """Collect the series and the scene, focus both, and carry the constant over."""
    corner = SeriesTarget(name="corner", kind="trihedral_square", edge_m=0.61, range_m=8.6, x_m=1.2, height_m=0.469,
                          azimuth_deg=45, elevation_deg=35.264, angle_sd_deg=2)  # fmt: skip
    series = CalibrationSeriesPlan(targets=(corner,), aperture_m=0.2032, repeats=2, channels=("HH", "VV"))
    scene = RailSarPlan(aperture_m=0.3048, channels=("HH", "VV"), channel_order="alternate")
    print("series", pf.collect(rig, series, out / "series.h5", on_prompt=confirm).state)
    print("scene", pf.collect(rig, scene, out / "scene.h5").state)
    pf.focus(out / "series.h5", out / "reference.h5", target="corner")  # its repeats averaged
    pf.focus(out / "scene.h5", out / "products.h5")
    result = pf.calibrate(out / "products.h5", pf.TargetSpec.of(corner), reference=out / "reference.h5")
    hh = pf.Products(out / "products.h5").read("calibration")["scattering"][0]  # complex, sqrt(m^2)
    print(f"constant {result.constant_db:.2f} dB, strongest in HH: {20 * np.log10(np.nanmax(abs(hh))):.1f} dBsm")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
