"""The report's table of numbers: what each stage found, with its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from polfuse_lab.products.store import Products
from polfuse_lab.report.calibration import crosstalk_numbers
from polfuse_lab.report.text import Number


def stage_numbers(products: Products) -> list[Number]:
    """The table of numbers, from the stages present."""
    present = products.stages()
    return [number for name, describe in _NUMBERS.items() if name in present for number in describe(products)]


def _number(settings: Mapping[str, Any], key: str) -> float:
    """A number from settings, where undefined ones are null."""
    return float("nan") if settings.get(key) is None else float(settings[key])


def _sd(settings: Mapping[str, Any], result: str) -> float | None:
    """Standard uncertainty of a calibration's result, where its budget tells one."""
    told = settings.get("uncertainty", {}).get(result, {}).get("sd")
    return None if told is None else float(told)


def _ranging(products: Products) -> list[Number]:
    """How well the devices' times compare; nothing for products made before that was stored."""
    sync = products.settings("ranging").get("sync", {"devices": {}, "pairs": {}})
    found = [
        Number(
            f"Clock of the {name}",
            float(item["drift_ppm"]),
            "ppm",
            float(item["drift_sd_ppm"]),
            f"drift against the computer, from {item['pairs']} readings"
            + (f", in {len(item['jumps_s']) + 1} pieces" if item["jumps_s"] else ""),
        )
        for name, item in sync["devices"].items()
        if "drift_ppm" in item
    ]
    for name, rms_s in sync["pairs"].items():
        first, second = name.split("-")
        if rms_s is not None and second in ("camera", "trolley"):
            note = "standard uncertainty of the time between records of the two"
            found.append(Number(f"Sync, {first} to {second}", 1e3 * float(rms_s), "ms", note=note))
    return found


def _focus(products: Products) -> list[Number]:
    settings = products.settings("focus")
    x = products.read("ranging")["antenna_m"][:, 0]
    return [
        Number("Positions", len(x), note="of the trolley along the rail"),
        Number("Aperture", float(np.ptp(x)), "m", note="from the first position to the last"),
        Number(
            "Focusing error",
            _number(settings, "predicted_error_db"),
            "dB",
            note=f"predicted for {settings['method']}, {settings['interpolator']}, against the exact matched filter",
        ),
    ]


def _calibration(products: Products) -> list[Number]:
    settings = products.settings("calibration")
    arrays = products.read("calibration")
    kind = settings["target"]["kind"]
    found = [
        Number(
            "Calibration constant",
            _number(settings, "constant_db"),
            "dB",
            _number(settings, "constant_sd_db"),
            f"RCS minus image power, from the {kind}",
        ),
        Number(
            "Imbalance, amplitude",
            _number(settings, "imbalance_db"),
            "dB",
            _sd(settings, "co_imbalance_db"),
            f"VV over HH of the {kind}",
        ),
        Number(
            "Imbalance, phase",
            _number(settings, "imbalance_deg"),
            "°",
            _sd(settings, "co_imbalance_deg"),
            f"VV against HH of the {kind}",
        ),
        *crosstalk_numbers(settings),
    ]
    for channel, value in sorted(settings["crosstalk_db"].items()):
        found.append(Number(f"Crosstalk {channel}", float(value), "dB", note=f"cross over co return of the {kind}"))
    row = int(np.argmin(np.abs(arrays["y_m"] - settings["target"]["y_m"])))
    noise = arrays["noise_equivalent_rcs_m2"][settings["channels"].index("HH"), row]
    found.append(
        Number(
            "Noise-equivalent RCS, HH",
            float(10 * np.log10(noise)) if noise > 0 else float("nan"),
            "dBsm",
            settings.get("noise_sd_db"),
            f"at {arrays['y_m'][row]:.1f} m ground range, from the {settings['noise_source']}",
        )
    )
    return found


def _analysis(products: Products) -> list[Number]:
    settings = products.settings("analysis")
    repeats = f"mean of {settings['repeats']}" if settings["repeats"] > 1 else "one measurement"
    note = f"peak of the strip of {100 * settings['strip_m']:.0f} cm at the target, {repeats}"
    found = []
    for name, peak in settings["peaks"].items():
        key, unit = ("rcs_dbsm", "dBsm") if settings["calibrated"] else ("power_db", "dB")
        found.append(Number(f"Target in {name}", _number(peak, key), unit, peak.get("sd_db"), note))
    near = settings["near_field"]
    if near is not None and near["distance_m"] < near["far_field_m"]:
        told = f"target at {near['distance_m']:.1f} m, far field from {near['far_field_m']:.1f} m; over the closed form"
        found += [Number(f"Near field in {k}", float(v), "dB", note=told) for k, v in near["correction_db"].items()]
    return found


def _optics(products: Products) -> list[Number]:
    arrays, settings = products.read("optics"), products.settings("optics")
    defined = np.isfinite(arrays["dolp"])
    if not defined.any():
        return []
    return [
        Number(
            "Median DOLP",
            float(np.median(arrays["dolp"][defined])),
            sd=float(np.median(arrays["dolp_sd"][defined])),
            note="degree of linear polarization, debiased; ± is the median pixel's noise",
        ),
        Number("Masked pixels", 100 * float(np.mean(~defined)), "%", note="reasons are in the flag plane"),
        Number(
            "Condition number",
            _number(settings, "condition_number"),
            note="of the polarizer's angles; 1.41 is the best there is",
        ),
    ]


def _fusion(products: Products) -> list[Number]:
    settings = products.settings("fusion")
    arrays = products.read("fusion")
    error = arrays["registration_error_px"][np.isfinite(arrays["features"][0])]
    found = [
        Number(
            "Fused pixels",
            float(np.isfinite(arrays["features"]).all(axis=0).sum()),
            note="on the ground, defined in radar and camera pictures",
        )
    ]
    if error.size:
        note = "median standard deviation of a radar pixel's place in the camera picture"
        found.append(Number("Registration", float(np.median(error)), "px", note=note))
    for pair, distance in settings["bhattacharyya"].items():
        upper = 100 * float(settings["bayes_bounds"][pair][1])
        confused = "below 10⁻⁶ %" if upper < 1e-6 else f"at most {upper:.2g} %"
        note = f"Bhattacharyya distance (thesis 7.2), {distance['pauli']:.2f} by radar alone; Bayes error {confused}"
        found.append(Number(f"Separation {pair}", float(distance["pauli_dolp"]), note=note))
    return found


_NUMBERS: dict[str, Callable[[Products], list[Number]]] = {
    "ranging": _ranging,
    "focus": _focus,
    "calibration": _calibration,
    "analysis": _analysis,
    "optics": _optics,
    "fusion": _fusion,
}
