"""A calibration's outcome as JSON values and as lines for people."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from polfuse_lab.products.calibrate import CalibrationResult

COLUMNS = (("constant_db", "constant dB"), ("co_imbalance_db", "VV/HH dB"), ("co_imbalance_deg", "VV/HH deg"))
"""Results shown in the table of uncertainties for people; all are in the JSON."""


def values(made: CalibrationResult) -> dict[str, object]:
    """The command's JSON object."""
    found: dict[str, object] = {
        **made.summary(),
        "crosstalk_db": made.worst_crosstalk_db,
        "crosstalk_by_channel_db": made.crosstalk_db,
        "cross_imbalance_known": made.cross_imbalance is not None,
        "target": {
            "x_m": made.target.x_m,
            "y_m": made.target.y_m,
            "snr_db": made.target.snr_db,
            "expected_dbsm": made.expected_dbsm,
        },
        "noise_equivalent_dbsm": made.noise_equivalent_dbsm,
        "noise_source": made.noise_source,
        "check": None,
        "products": made.products,
    }
    if made.check is not None:
        found["check"] = {
            "rcs_dbsm": made.check.rcs_dbsm,
            "expected_dbsm": made.check.expected_dbsm,
            "error_db": made.check.error_db,
            "thesis_accuracy_percent": made.check.thesis_accuracy_percent,
            "sd_db": made.check.sd_db,
            "channel": made.check.channel,
            "x_m": made.check.x_m,
            "y_m": made.check.y_m,
        }
    return found


def lines(made: CalibrationResult) -> list[str]:
    """What people read."""
    target = made.target
    found = [
        f"{target.spec.label} at ({target.x_m:.2f}, {target.y_m:.2f}) m, {target.snr_db:.1f} dB above the "
        f"background, expected {made.expected_dbsm:.2f} dBsm",
        f"constant {made.constant_db:.2f} +- {made.constant_sd_db:.2f} dB, noise-equivalent RCS there "
        f"{made.noise_equivalent_dbsm:.1f} dBsm ({made.noise_source})",
        f"VV over HH {made.imbalance_db:+.2f} dB {made.imbalance_deg:+.1f} deg, crosstalk "
        + (", ".join(f"{name} {value:.1f} dB" for name, value in made.crosstalk_db.items()) or "not measured"),
    ]
    if made.distortion.has_crosstalk:
        paths = ", ".join(f"{name} {path['db']:.1f} dB" for name, path in made.paths().items())
        found.append(f"crosstalk taken off ({made.method}): {paths}")
    else:
        found.append("crosstalk is left in: give a dihedral and one at 45 degrees as well to take it off")
    if made.cross_imbalance is None:
        found.append("no reciprocal cross-polarized target: receive and transmit imbalance are taken as alike")
    found += _table(made)
    if made.check is not None:
        check = made.check
        found.append(
            f"check: {check.rcs_dbsm:.2f} dBsm in {check.channel}, expected {check.expected_dbsm:.2f}: "
            f"{check.error_db:+.2f} +- {check.sd_db:.2f} dB "
            f"({check.thesis_accuracy_percent:.2f} % in the thesis's measure)"
        )
    return [*found, f"products: {made.products}"]


def _table(made: CalibrationResult) -> list[str]:
    """The budget: a line for each cause that has a share, and the sums."""
    heads = [(name, words) for name, words in COLUMNS if name in made.budget.results]
    rows = [f"{'cause of uncertainty':34s}{'size':>12s}  " + "".join(f"{words:>13s}" for _, words in heads)]

    def row(cause: str, size: str, shares: dict[str, Any]) -> str:
        return f"{cause:34s}{size:>12s}  " + "".join(f"{shares[name]:13.3f}" for name, _ in heads)

    rows += [
        row(line.cause, f"{line.sd:.3g} {line.unit}", line.contributions)
        for line in made.budget.lines
        if any(line.contributions.get(name) for name, _ in heads)
    ]
    rows.append(row("all, first order", "", made.budget.first_order_sd))
    rows.append(row(f"all, {made.budget.draws} draws", "", made.budget.drawn_sd))
    rows.append(row("expanded (95 %)", "", {name: made.budget.expanded(name) for name, _ in heads}))
    return rows
