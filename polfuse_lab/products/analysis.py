"""The thesis's analysis of a calibration target (its Fig. 5.16 to 5.21): the stage ``"analysis"``.

A strip of 2 ft across range is averaged and drawn against range, in received power and in dBsm; a region of 2 ft by
2 ft gives the scattering matrix relative to HH, from received powers as the thesis has it and from complex amplitudes;
repeated measurements are averaged; and a look at the sky shows the noise against range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.analysis_target import NearFieldEffect, near_field_effect, target_pattern
from polfuse_lab.products.calibration_inputs import SKY_WINDOW_CELLS, read_focused, sky_noise
from polfuse_lab.products.store import Products, is_products
from processing.calibration.noise import noise_floor
from processing.calibration.pattern_measurement import MeasuredPattern
from processing.calibration.rcs import to_dbsm
from processing.calibration.region_analysis import (
    STRIP_M,
    RegionMatrices,
    Repeats,
    mean_of_repeats,
    region_matrices,
    strip_power,
)
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.quality import range_gain

STAGE = "analysis"

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ChannelPeak:
    """The strip's peak near the target, of one channel (found without the range compensation, which moves it)."""

    y_m: float
    """Ground range of it, m."""
    power_db: float
    """Received power, dB over the image's unit."""
    rcs_dbsm: float
    """RCS, dBsm; NaN where the products are not calibrated."""
    sd_db: float
    """Standard deviation of the mean of the repeats there, dB; NaN for a single measurement."""


@dataclass(frozen=True, eq=False)
class Sky:
    """Received power of the sky against range (thesis Fig. 5.21), compensated for range as images are."""

    range_m: Floats
    """(bins,) slant range, m."""
    power: Floats
    """(channels, bins) mean over the positions."""
    floor: Floats
    """(channels, bins) what of it is noise, smooth; near the rail the antennas' coupling stands above it."""


@dataclass(frozen=True, eq=False)
class Analysis:
    """What the analysis found."""

    products: Path
    place_m: tuple[float, float]
    """Where the target was looked for: x, y."""
    channels: tuple[str, ...]
    y_m: Floats
    power: Repeats
    """(channels, ny) received power of the strip."""
    rcs: Repeats | None
    """(channels, ny) RCS of the strip, m^2; None where the products are not calibrated."""
    noise_power: Floats | None
    """(channels, ny) noise power of the image from a look at the sky, where one was given."""
    sky: Sky | None
    """What the look at the sky shows by itself."""
    matrices: RegionMatrices
    """Of the first measurement: of its calibrated image where there is one."""
    calibrated: bool
    peaks: dict[str, ChannelPeak]
    """By channel."""
    near_field: NearFieldEffect | None
    """What the calibration target's distance does to its RCS; None without calibration or for a round target."""
    pattern: tuple[tuple[str, ...], MeasuredPattern] | None
    """Co-polarized channels, and the antennas' two-way pattern that the calibration target shows; None without one."""


def analyse(
    products_path: Path | str,
    at: tuple[float, float] | None = None,
    *,
    repeats: Sequence[Path | str] = (),
    sky: Path | str | None = None,
    strip_m: float = STRIP_M,
    region_m: float = STRIP_M,
    search_m: float = 1.0,
) -> Analysis:
    """Analyse a target as the thesis does, and write the stage ``"analysis"``.

    Args:
        products_path: products file with the stage "focus"; with "calibration", RCS is analysed as well.
        at: place (x, y) of the target in the image, m; left out, the calibration target's.
        repeats: products files of further measurements of the same target, on the same grid.
        sky: session or products file of a look at the clear sky.
        strip_m: width of the strip across range, m.
        region_m: edge of the region, m.
        search_m: how far in range from the place the largest value may be, m.

    Raises:
        PolfuseError: a file without an image, repeats on another grid or not calibrated alike, or no place.
        DataError: strip or region outside the image, or an HH that is zero there.
    """
    first = Products(products_path)
    measured = [first, *(Products(path) for path in repeats)]
    images = [_image(item) for item in measured]
    channels, x, y = images[0]
    for other, found in zip(measured[1:], images[1:], strict=True):
        if found[0] != channels or not (np.array_equal(found[1], x) and np.array_equal(found[2], y)):
            raise PolfuseError(
                "was focused with other channels or on another grid",
                where=str(other.path),
                advice=f"focus it as {first.path.name}",
            )
    place = _place(first) if at is None else (float(at[0]), float(at[1]))
    power = mean_of_repeats([strip_power(item.read("focus")["image"], x, place[0], strip_m) for item in measured])
    calibrated = ["calibration" in item.stages() for item in measured]
    if any(calibrated) and not all(calibrated):
        raise PolfuseError(
            "is not calibrated, but others are",
            where=str(measured[calibrated.index(False)].path),
            advice="calibrate all repeats, or none",
        )
    rcs = None
    if calibrated[0]:
        scattering = [item.read("calibration")["scattering"] for item in measured]
        rcs = mean_of_repeats([strip_power(image, x, place[0], strip_m) for image in scattering])
    subject = first.read("calibration")["scattering"] if calibrated[0] else first.read("focus")["image"]
    matrices = region_matrices(subject, channels, x, y, place, size_m=region_m)
    result = Analysis(
        products=first.path,
        place_m=place,
        channels=channels,
        y_m=y,
        power=power,
        rcs=rcs,
        noise_power=None if sky is None else sky_noise(sky, read_focused(first)),
        matrices=matrices,
        calibrated=calibrated[0],
        sky=None if sky is None else sky_power(sky, first, channels),
        peaks=_peaks(channels, y, place[1], search_m, _row_gain(first, place[0], y), power, rcs),
        near_field=near_field_effect(first) if calibrated[0] else None,
        pattern=target_pattern(first) if calibrated[0] else None,
    )
    inputs: list[Path | str] = [item.path for item in measured]
    _write(first, result, inputs if sky is None else [*inputs, sky], strip_m, region_m)
    return result


def _image(products: Products) -> tuple[tuple[str, ...], Floats, Floats]:
    arrays = products.read("focus")
    channels = tuple(str(name) for name in products.settings("focus")["channels"])
    return channels, arrays["x_m"].astype(np.float64), arrays["y_m"].astype(np.float64)


def _place(products: Products) -> tuple[float, float]:
    """Where the calibration target shows in the image: what stands above the ground lays over towards the rail."""
    if "calibration" not in products.stages():
        raise PolfuseError(
            "is not calibrated, so that the target's place is not known",
            where=str(products.path),
            advice="give its place with --at X,Y",
        )
    settings = products.settings("calibration")
    target, z = settings["target"], float(settings["z_m"])
    squared = float(target["y_m"]) ** 2 + (z + float(target["height_m"])) ** 2 - z**2
    return float(target["x_m"]), float(np.sqrt(squared))


def sky_power(sky: Path | str, products: Products, channels: Sequence[str]) -> Sky:
    """Power of a look at the sky against range, with profiles made as those of ``products``.

    Args:
        sky: a session, or a products file with a stage "ranging".
        products: whose settings of ranging are taken.
        channels: which channels, in their order.

    Raises:
        PolfuseError: the sky lacks a channel, or cannot be read.
    """
    settings = products.settings("ranging")
    if is_products(Path(sky)):
        stage = Products(sky).read("ranging")
        profiles, range_m = stage["profiles"], stage["range_m"].astype(np.float64)
        known = [str(name) for name in Products(sky).settings("ranging")["channels"]]
    else:
        from polfuse_lab.products.ranging import range_profiles
        from polfuse_lab.session import open_session

        same = {name: settings[name] for name in ("window", "oversampling", "max_range_m") if name in settings}
        with open_session(sky) as session:
            made = range_profiles(session, range_compensated=True, **same)
        profiles, range_m, known = made.values, made.range_m, list(made.channels)
    if missing := [name for name in channels if name not in known]:
        raise PolfuseError(
            f"lacks channel {', '.join(missing)}",
            where=str(sky),
            advice="record the sky in all channels of the collect",
        )
    values = profiles[[known.index(name) for name in channels]]
    window_m = SKY_WINDOW_CELLS * SPEED_OF_LIGHT_M_S / (2 * float(products.settings("focus")["bandwidth_hz"]))
    floor = noise_floor(values, range_m, window_m=window_m, range_compensated=True)
    return Sky(range_m, np.asarray(np.nanmean(np.abs(values.astype(np.complex128)) ** 2, axis=1)), floor)


def _row_gain(products: Products, x_m: float, y: Floats) -> Floats:
    """(ny,) gain of the range compensation on power, which moves a wide peak outwards; 1 without compensation."""
    settings, ranging = products.settings("focus"), products.settings("ranging")
    if not ranging.get("range_compensated", settings.get("range_compensated", True)):
        return np.ones(len(y))
    return np.asarray(range_gain(x_m, y, float(settings["z_m"])) ** 2)


def _peaks(
    channels: tuple[str, ...],
    y: Floats,
    place_y: float,
    search_m: float,
    gain: Floats,
    power: Repeats,
    rcs: Repeats | None,
) -> dict[str, ChannelPeak]:
    near = np.abs(y - place_y) <= search_m
    found = {}
    for index, name in enumerate(channels):
        values = np.where(near & np.isfinite(power.mean[index]), power.mean[index] / gain, -np.inf)
        row = int(np.argmax(values))
        defined = bool(values[row] > 0)
        found[name] = ChannelPeak(
            y_m=float(y[row]) if defined else float("nan"),
            power_db=float(to_dbsm(power.mean[index, row])) if defined else float("nan"),
            rcs_dbsm=float(to_dbsm(rcs.mean[index, row])) if defined and rcs is not None else float("nan"),
            sd_db=float(power.mean_sd_db[index, row]) if defined else float("nan"),
        )
    return found


def _write(products: Products, result: Analysis, inputs: Sequence[Path | str], strip_m: float, region_m: float) -> None:
    arrays: dict[str, NDArray[Any]] = {
        "y_m": result.y_m,
        "power": result.power.mean,
        "power_sd_db": result.power.sd_db,
        "matrix_power": result.matrices.power,
        "matrix_complex": result.matrices.complex,
        "matrix_coherence": result.matrices.coherence,
    }
    units = {"y_m": "m", "power_sd_db": "dB"}
    if result.rcs is not None:
        arrays |= {"rcs_m2": result.rcs.mean, "rcs_sd_db": result.rcs.sd_db}
        units |= {"rcs_m2": "m^2", "rcs_sd_db": "dB"}
    if result.noise_power is not None:
        arrays["noise_power"] = result.noise_power
    if result.sky is not None:
        arrays |= {"sky_range_m": result.sky.range_m, "sky_power": result.sky.power, "sky_floor": result.sky.floor}
        units["sky_range_m"] = "m"
    if result.pattern is not None:
        seen = result.pattern[1]
        arrays |= {"azimuth_rad": seen.azimuth_rad, "off_axis_rad": seen.off_axis_rad, "pattern_db": seen.level_db}
        units |= {"azimuth_rad": "rad", "off_axis_rad": "rad", "pattern_db": "dB"}
    products.write(
        STAGE,
        arrays,
        settings={
            "channels": list(result.channels),
            "place_m": list(result.place_m),
            "strip_m": strip_m,
            "region_m": region_m,
            "repeats": result.power.count,
            "calibrated": result.calibrated,
            "calibration_mode": products.settings("calibration").get("mode") if result.calibrated else None,
            "matrices_relative_to": "HH",
            "pixels": result.matrices.pixels,
            "peaks": result.peaks,
            "near_field": result.near_field,
            "pattern_channels": None if result.pattern is None else list(result.pattern[0]),
            "beamwidth_rad": products.settings("focus").get("beamwidth_rad"),
        },
        inputs=inputs,
        units=units,
    )
