"""What a products file has to show, picture by picture, for any display: values with axes, unit and uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.figures_fusion import pauli_rgb
from polfuse_lab.products.fused_colours import fused_rgb
from polfuse_lab.products.pauli_space import class_names
from polfuse_lab.products.store import Products
from polfuse_lab.products.style import decibels

Kind = Literal["level", "fraction", "angle", "counts", "light", "number", "classes", "colours"]
Arrays = dict[str, NDArray[Any]]
SPAN_DB = 45.0
"""From the brightest to the darkest level of a radar picture, dB."""
WHITE = "of white in the sun"
"""Unit of simulated light."""


@dataclass(frozen=True, eq=False)
class Track:
    """The way of something that moved, in the picture's own axes."""

    x: NDArray[np.float64]
    """(n,) its places in time; an arrow leads from the first to the last."""
    y: NDArray[np.float64]
    words: str
    """Its velocity, or its name and velocity."""


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
    tracks: tuple[Track, ...] = ()
    """What moved."""


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
    if part == "colours":
        colours = np.nan_to_num(fused_rgb(arrays["features"], arrays["s0_on_ground"]) * 255).astype(np.uint8)
        return Picture(name, title, "colours", colours, "", x, y)
    if part == "classes":
        legend = dict(enumerate(class_names(settings, arrays["classes"])))
        return Picture(name, title, "classes", arrays["classes"], "", x, y, legend=legend)
    if part == "dolp_on_ground":
        return Picture(name, title, "fraction", arrays[part], "1", x, y, limits=(0.0, 1.0))
    if part == "s0_on_ground":
        simulated = settings.get("registration") == "identity"
        kind: Kind = "light" if simulated else "counts"
        return Picture(name, title, kind, arrays[part], WHITE if simulated else "counts", x, y)
    unit = "px" if part == "registration_error_px" else "1"
    return Picture(name, title, "number", arrays[part], unit, x, y)


def _moved(arrays: Arrays, settings: dict[str, Any], name: str, part: str, title: str) -> Picture:
    """A polarizer series between whose exposures something moved, with the way of it."""
    tracks = _way(arrays, settings)
    if part == "object":
        return Picture(
            name, title, "classes", arrays[part].astype(np.int8) - 1, legend={0: "what moved"}, tracks=tracks
        )
    if part.startswith("dolp"):
        sd = arrays["dolp_sd"] if part == "dolp" else None
        return Picture(name, title, "fraction", arrays[part], "1", sd=sd, limits=(0.0, 1.0), tracks=tracks)
    # One scale for both, or the correction would not be seen.
    top = float(np.nanpercentile(arrays["error_before"], 99.8))
    return Picture(name, title, "number", arrays[part], "counts", limits=(0.0, max(top, 1e-6)), tracks=tracks)


def _moving(arrays: Arrays, settings: dict[str, Any], name: str, part: str, title: str) -> Picture:
    """What stands, by radar, and from each streak an arrow to where the target that makes it was."""
    power = arrays["power"].astype(np.float64)
    level = (10 * np.log10(np.where(power > 0, power, np.nan))).astype(np.float32)
    middle = float(np.nanmedian(level)) if np.isfinite(level).any() else 0.0
    tracks = tuple(
        Track(
            np.array([target["streak_x_m"], target["x_m"]]),
            np.array([target["streak_y_m"], target["y_m"]]),
            f"{number}: along {target['azimuth_m_s']:+.2f} ± {target['azimuth_sd_m_s']:.2g}, across "
            f"{target['ground_m_s']:+.2f} ± {target['ground_sd_m_s']:.2g} m/s",
        )
        for number, target in enumerate(settings["targets"], start=1)
    )
    return Picture(
        name, title, "level", level - np.float32(middle), "dB over the median", arrays["x_m"], arrays["y_m"],
        limits=(-10.0, 25.0), tracks=tracks,
    )  # fmt: skip


def _way(arrays: Arrays, settings: dict[str, Any]) -> tuple[Track, ...]:
    """From where the object was at the first exposure to where it was at the last."""
    rows, columns = np.nonzero(arrays["object"])
    down, right = np.asarray(settings["displacement_px"], dtype=np.float64).T
    seconds = float(settings["time_s"][-1]) - float(settings["time_s"][0])
    if not len(rows) or not seconds > 0:
        return ()
    if settings["velocity_m_s"] is not None:
        vx, vy = settings["velocity_m_s"]
        words = f"vx {vx:+.2f}, vy {vy:+.2f} m/s"
    else:
        words = f"{(right[-1] - right[0]) / seconds:+.1f} px/s right, {(down[-1] - down[0]) / seconds:+.1f} px/s down"
    return (Track(columns.mean() + right - right[0], rows.mean() + down - down[0], words),)


def _simulated(arrays: Arrays, settings: dict[str, Any], name: str, part: str, title: str) -> Picture:
    """Light and truth of a simulated scene."""
    x, y = arrays["x_m"], arrays["y_m"]
    if part == "body":
        labels, kinds = _kinds(arrays["body"], [str(body["kind"]) for body in settings["bodies"]])
        tracks = _velocities(arrays, settings["bodies"])
        return Picture(name, title, "classes", labels, "", x, y, legend=dict(enumerate(kinds)), tracks=tracks)
    if part == "mechanism":
        from polfuse_lab.simulation.figures import MECHANISM_NAMES, OVER_NOISE

        powers = np.stack([arrays[f"{mechanism}_m2"] for mechanism in MECHANISM_NAMES])
        strong = powers.max(axis=0) > OVER_NOISE * float(settings["noise_span_m2"])
        labels = np.where(strong, powers.argmax(axis=0), -1)
        return Picture(
            name, title, "classes", labels, "", x, y, legend=dict(enumerate(MECHANISM_NAMES.values()))
        )  # fmt: skip
    if part == "dolp":
        return Picture(name, title, "fraction", arrays["dolp"], "1", x, y, sd=arrays["dolp_sd"], limits=(0.0, 1.0))
    if part == "aop":
        return Picture(name, title, "angle", arrays["aop"] * np.float32(180 / np.pi), "°", x, y, limits=(-90.0, 90.0))
    return Picture(name, title, "light", arrays["s0"], WHITE, x, y)


def _kinds(bodies: NDArray[np.integer], kinds: list[str]) -> tuple[NDArray[np.int64], list[str]]:
    """The kind of body on each pixel, -1 for none, and the names of the kinds that there are."""
    present = list(dict.fromkeys(kinds))
    of_body = np.array([*(present.index(kind) for kind in kinds), -1])
    return of_body[np.where(bodies < 0, len(kinds), bodies)], present


def _velocities(arrays: Arrays, bodies: list[dict[str, Any]]) -> tuple[Track, ...]:
    """The way of a second of each body that moves and is seen from above."""
    found = []
    for number, body in enumerate(bodies):
        velocity = np.asarray(body.get("velocity_m_s") or (0.0, 0.0, 0.0), dtype=np.float64)
        rows, columns = np.nonzero(arrays["body"] == number)
        if len(rows) and np.any(velocity):
            x, y = float(arrays["x_m"][columns].mean()), float(arrays["y_m"][rows].mean())
            words = f"{body['name']}: vx {velocity[0]:+.2f}, vy {velocity[1]:+.2f} m/s"
            found.append(Track(np.array([x, x + velocity[0]]), np.array([y, y + velocity[1]]), words))
    return tuple(found)


def _largest(image: NDArray[np.complexfloating]) -> float:
    largest = float(np.nanmax(np.abs(image))) if np.isfinite(image).any() else 0.0
    return largest or 1.0


_TITLES: dict[str, dict[str, str]] = {
    "focus": {"*": "Focused {}"},
    "calibration": {"*": "Calibrated {}"},
    "polarimetry": {"pauli": "Pauli", "span": "Span"},
    "optics": {"s0": "S0", "dolp": "DOLP", "aop": "AOP"},
    "motion": {
        "dolp": "DOLP, motion corrected",
        "dolp_before": "DOLP as taken",
        "error_after": "Error image, corrected",
        "error_before": "Error image as taken",
        "object": "What moved",
    },
    "moving": {"power": "What moves, by radar"},
    "simulation": {
        "s0": "S0, simulated",
        "dolp": "DOLP, simulated",
        "aop": "AOP, simulated",
        "body": "Bodies (truth)",
        "mechanism": "Strongest mechanism (truth)",
    },
    "fusion": {
        "colours": "Pauli over S0 by DOLP",
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
    "motion": _moved,
    "moving": _moving,
    "simulation": _simulated,
    "fusion": _fused,
}
