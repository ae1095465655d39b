"""What the page says about each stage: its numbers with their uncertainty, and its pictures with captions."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from polfuse_lab.products.store import Products
from polfuse_lab.report.builder import Picture
from polfuse_lab.report.text import Number

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def page_title(products: Products) -> str:
    """Heading of the page: what was looked at with both eyes, or with which one."""
    stages = set(products.stages())
    kind = "Radar and light" if {"focus", "optics"} <= stages else "Radar" if "focus" in stages else "Light"
    return f"{kind}: {products.path.stem}"


def lead(products: Products) -> str:
    """The page's first sentence."""
    stages = products.stages()
    newest = max(products.provenance(name)["time_utc"] for name in stages)
    return f"{products.path.name}, stages {', '.join(stages)}; last changed {newest.replace('T', ' ')}."


def stage_numbers(products: Products) -> list[Number]:
    """The table of numbers, from the stages present."""
    return [item for name in products.stages() if name in _NUMBERS for item in _NUMBERS[name](products)]


def stage_pictures(products: Products) -> list[Picture]:
    """The pictures, drawn from the stages present."""
    return [item for name in products.stages() if name in _PICTURES for item in _PICTURES[name](products)]


def _picture(name: str, title: str, caption: str, figure: Figure) -> Picture:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", metadata={"Software": None})
    return Picture(name, title, caption, stream.getvalue())


def _optics_numbers(products: Products) -> list[Number]:
    arrays = products.read("optics")
    settings = products.settings("optics")
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
        Number(
            "Masked pixels",
            100 * float(np.mean(~defined)),
            "%",
            note="saturated, in shadow, incomplete or above 1; reasons are in the flag plane",
        ),
        Number(
            "Condition number",
            float(settings["condition_number"]),
            note="of the polarizer angles; 1.41 is the best there is",
        ),
    ]


def _optics_pictures(products: Products) -> list[Picture]:
    from polfuse_lab.products.figures_optics import optics_figure
    from polfuse_lab.products.optics import UNITS, series_of
    from processing.optics.stokes import StokesImage

    arrays = products.read("optics")
    image = StokesImage(**{name: arrays[name] for name in UNITS})
    caption = (
        "Stokes parameters of the polarizer series in the camera's frame, the degree of linear polarization without "
        "its noise bias, the angle of polarization from horizontal, and why pixels are masked (grey)."
    )
    return [_picture("optics", "Light", caption, optics_figure(image, series_of(products.settings("optics"))))]


def _calibration_numbers(products: Products) -> list[Number]:
    settings = products.settings("calibration")
    found = [
        Number(
            "Calibration constant",
            settings["constant_db"],
            "dB",
            settings["constant_sd_db"],
            f"RCS minus image power, from the {settings['target']['kind']}",
        )
    ]
    for name, note in (
        ("imbalance_db", "VV over HH on the calibration target"),
        ("imbalance_deg", "VV against HH on the calibration target"),
    ):
        if settings[name] is not None:
            unit = "dB" if name.endswith("_db") else "°"
            found.append(
                Number(
                    f"Channel imbalance, {'amplitude' if unit == 'dB' else 'phase'}", settings[name], unit, note=note
                )
            )
    for channel, value in sorted(settings["crosstalk_db"].items()):
        found.append(Number(f"Crosstalk {channel}", value, "dB", note="cross over co on the calibration target"))
    return found


_NUMBERS: dict[str, Callable[[Products], list[Number]]] = {
    "optics": _optics_numbers,
    "calibration": _calibration_numbers,
}
_PICTURES: dict[str, Callable[[Products], list[Picture]]] = {"optics": _optics_pictures}
