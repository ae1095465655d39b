"""What a products file has to show, picture by picture, for any display: values with axes, unit and uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.figures_fusion import pauli_rgb
from polfuse_lab.products.store import Products
from polfuse_lab.products.style import decibels

Kind = Literal["level", "fraction", "angle", "counts", "number", "classes", "colours"]
Arrays = dict[str, NDArray[Any]]
SPAN_DB = 45.0
"""From the brightest to the darkest level of a radar picture, dB."""
QUAD = ("HH", "HV", "VH", "VV")


@dataclass(frozen=True)
class Picture:
    """One picture. ``values`` is (rows, columns), or (rows, columns, 3) uint8 for ``"colours"``; NaN is undefined."""

    name: str
    title: str
    kind: Kind
    values: NDArray[Any]
    unit: str = ""
    x: NDArray[np.float64] | None = None
    """Of the columns, m on the ground; None: pixels of the camera, row 0 at the top."""
    y: NDArray[np.float64] | None = None
    sd: NDArray[np.floating] | None = None
    limits: tuple[float, float] | None = None
    """Sensible limits of a colour scale; None: by percentiles."""
    legend: dict[int, str] = field(default_factory=dict)
    """Names of classes."""


def picture_names(products: Products) -> list[tuple[str, str]]:
    """Names and titles of all pictures of a file, in the order of processing."""
    stages = set(products.stages())
    found: list[tuple[str, str]] = []
    for stage, titles in _TITLES.items():
        if stage in stages:
            channels = [str(c) for c in products.settings(stage).get("channels", ())]
            for name, title in titles.items():
                if name == "*":
                    found += [(f"{stage}.{channel}", title.format(channel)) for channel in channels]
                else:
                    found.append((f"{stage}.{name}", title))
    return found


def load_picture(products: Products, name: str) -> Picture:
    """One picture by its name.

    Raises:
        PolfuseError: the file has no such picture.
    """
    stage, _, part = name.partition(".")
    titles = dict(picture_names(products))
    if name not in titles:
        raise PolfuseError(
            f"has no picture '{name}'", where=str(products.path), advice=f"choose one of {', '.join(titles) or 'none'}"
        )
    return _MAKERS[stage](products.read(stage), products.settings(stage), name, part, titles[name])


def level_db(amplitude: NDArray[np.complexfloating], *, reference: float = 1.0) -> NDArray[np.float32]:
    """``20 log10(|amplitude| / reference)``; NaN where there is nothing or nothing defined."""
    return decibels(amplitude, reference=reference).astype(np.float32)


def _focused(arrays: Arrays, settings: dict[str, Any], name: str, part: str, title: str) -> Picture:
    image = arrays["image"]
    channel = [str(c) for c in settings["channels"]].index(part)
    values = level_db(image[channel], reference=_largest(image))
    return Picture(name, title, "level", values, "dB", arrays["x_m"], arrays["y_m"], limits=(-SPAN_DB, 0.0))


def _calibrated(arrays: Arrays, settings: dict[str, Any], name: str, part: str, title: str) -> Picture:
    scattering = arrays["scattering"]
    channel = [str(c) for c in settings["channels"]].index(part)
    values = level_db(scattering[channel])
    sd_db = settings.get("constant_sd_db")
    sd = None if sd_db is None else np.full(values.shape, float(sd_db), np.float32)
    top = float(np.ceil(20 * np.log10(_largest(scattering))))
    return Picture(
        name, title, "level", values, "dBsm", arrays["x_m"], arrays["y_m"], sd=sd, limits=(top - SPAN_DB, top)
    )


def _polarimetric(arrays: Arrays, settings: dict[str, Any], name: str, part: str, title: str) -> Picture:
    if part == "span":
        with np.errstate(divide="ignore"):
            values = (10 * np.log10(np.where(arrays["span"] > 0, arrays["span"], np.nan))).astype(np.float32)
        return Picture(name, title, "level", values, "dBsm", arrays["x_m"], arrays["y_m"])
    colours = np.nan_to_num(pauli_rgb(arrays["pauli"]) * 255).astype(np.uint8)
    return Picture(name, title, "colours", colours, "", arrays["x_m"], arrays["y_m"])


def _optical(arrays: Arrays, settings: dict[str, Any], name: str, part: str, title: str) -> Picture:
    if part == "s0":
        return Picture(name, title, "counts", arrays["s0"], "counts", sd=arrays["s0_sd"])
    if part == "dolp":
        return Picture(name, title, "fraction", arrays["dolp"], "1", sd=arrays["dolp_sd"], limits=(0.0, 1.0))
    degrees = np.float32(180 / np.pi)
    return Picture(name, title, "angle", arrays["aop"] * degrees, "°", sd=arrays["aop_sd"] * degrees,
                   limits=(-90.0, 90.0))  # fmt: skip


def _fused(arrays: Arrays, settings: dict[str, Any], name: str, part: str, title: str) -> Picture:
    x, y = arrays["x_m"], arrays["y_m"]
    if part == "classes":
        legend = dict(enumerate(settings["classes"]))
        return Picture(name, title, "classes", arrays["classes"], "", x, y, legend=legend)
    if part == "dolp_on_ground":
        return Picture(name, title, "fraction", arrays[part], "1", x, y, limits=(0.0, 1.0))
    light = "1" if settings.get("registration") == "identity" else "counts"
    unit = {"s0_on_ground": light, "registration_error_px": "px"}.get(part, "1")
    return Picture(name, title, "counts" if unit == "counts" else "number", arrays[part], unit, x, y)


def _largest(image: NDArray[np.complexfloating]) -> float:
    largest = float(np.nanmax(np.abs(image))) if np.isfinite(image).any() else 0.0
    return largest or 1.0


_TITLES: dict[str, dict[str, str]] = {
    "focus": {"*": "Focused {}"},
    "calibration": {"*": "Calibrated {}"},
    "polarimetry": {"pauli": "Pauli", "span": "Span"},
    "optics": {"s0": "S0", "dolp": "DOLP", "aop": "AOP"},
    "fusion": {
        "classes": "Classes",
        "dolp_on_ground": "DOLP on the ground",
        "s0_on_ground": "S0 on the ground",
        "rx": "Anomalies (RX)",
        "registration_error_px": "Registration error",
    },
}
_MAKERS: dict[str, Callable[[Arrays, dict[str, Any], str, str, str], Picture]] = {
    "focus": _focused,
    "calibration": _calibrated,
    "polarimetry": _polarimetric,
    "optics": _optical,
    "fusion": _fused,
}
