"""The report's tables on a calibration: the targets that were looked at, and the budget of uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from polfuse_lab.products.store import Products
from polfuse_lab.report.text import Number, value_text

RESULTS = (
    ("constant_db", "Constant [dB]"),
    ("co_imbalance_db", "VV/HH [dB]"),
    ("co_imbalance_deg", "VV/HH [°]"),
    ("receive_imbalance_db", "Receive V/H [dB]"),
    ("receive_imbalance_deg", "Receive V/H [°]"),
)
"""Columns of the budget; the product and the JSON hold all results."""

PATHS = {
    "receive_h": "V wave in the H receiver",
    "receive_v": "H wave in the V receiver",
    "transmit_h": "V wave of the H transmitter",
    "transmit_v": "H wave of the V transmitter",
}


@dataclass(frozen=True)
class Table:
    """A table of the report."""

    title: str
    note: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    """Texts; the first of each row is its name."""


def calibration_tables(products: Products) -> list[Table]:
    """Tables of the stage "calibration"; none where it is missing or older than they are."""
    if "calibration" not in products.stages():
        return []
    settings = products.settings("calibration")
    if "budget" not in settings:
        return []
    return [_targets(settings), _budget(settings)]


def crosstalk_numbers(settings: Mapping[str, Any]) -> list[Number]:
    """Crosstalk that was taken off, path by path; none where antennas were taken as isolated.

    Args:
        settings: of the stage "calibration".
    """
    found = []
    for path, words in PATHS.items():
        told = settings.get("crosstalk_paths", {}).get(path, {})
        if told.get("db") is None:
            continue
        sd = told.get("sd")
        # Relative error of the amplitude, as the budget has it over the co-polarized gain, in dB.
        sd_db = None if sd is None else float(20 / np.log(10) * sd / 10 ** (told["db"] / 20))
        found.append(Number(f"Crosstalk taken off, {path.replace('_', ' ')}", told["db"], "dB", sd_db, words))
    return found


def _targets(settings: Mapping[str, Any]) -> Table:
    def text(item: Mapping[str, Any], key: str) -> str:
        return "—" if item.get(key) is None else value_text(round(float(item[key]), 3))

    rows = [
        (
            str(item["name"]),
            str(item["kind"]).replace("_", " "),
            "used" if item["ok"] else f"refused: {item['reason']}",
            text(item, "x_m"),
            text(item, "y_m"),
            text(item, "snr_db"),
            str(item["repeats"]),
            text(item, "rcs_error_db"),
        )
        for item in settings["targets"]
    ]
    misfit = settings.get("misfit")
    fit = "" if misfit is None else f" What the fit leaves unexplained is {float(misfit):.2f} times the noise."
    return Table(
        "Calibration targets",
        "RCS against the target that gives the constant." + fit,
        ("Target", "Kind", "Verdict", "x [m]", "y [m]", "SNR [dB]", "Repeats", "RCS error [dB]"),
        tuple(rows),
    )


def _budget(settings: Mapping[str, Any]) -> Table:
    results = [(name, words) for name, words in RESULTS if name in settings["uncertainty"]]

    def shares(of: Mapping[str, Any]) -> tuple[str, ...]:
        return tuple(_share(of.get(name)) for name, _ in results)

    rows = [
        (
            str(line["cause"]),
            f"{value_text(round(float(line['sd'] or 0.0), 4))} {line['unit']}",
            line["basis"],
            *shares(line),
        )
        for line in settings["budget"]
    ]
    for words, key in (
        ("All, first order", "first_order_sd"),
        ("All, Monte Carlo", "monte_carlo_sd"),
        ("Expanded (95 %)", "expanded"),
    ):
        told = {name: values[key] for name, values in settings["uncertainty"].items()}
        rows.append((words, "", "", *shares(told)))
    return Table(
        "Uncertainty of the calibration",
        "Standard uncertainty of each result from each cause. A: from repeated measurements; B: stated.",
        ("Cause", "Size", "Basis", *(words for _, words in results)),
        tuple(rows),
    )


def _share(value: Any) -> str:
    if value is None:
        return "—"
    return "0" if value == 0 else f"{float(value):.2g}" if abs(value) < 0.095 else f"{float(value):.2f}"
