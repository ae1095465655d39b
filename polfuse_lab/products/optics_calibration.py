"""Calibrations of a camera from sessions of its own: flat field, linearity, analysers. Each is a stage of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.products.optics_frames import camera_of, refuse_changes, stacked, usable_frames
from polfuse_lab.products.optics_source import SourceSeries
from polfuse_lab.products.store import Products
from polfuse_lab.session import open_session
from processing.optics.analyser_calibration import AnalyserCalibration, fit_analysers
from processing.optics.flat import Corrections, Linearity, fit_linearity, flat_field
from processing.optics.mosaic import parse_mosaic

FLAT, LINEARITY, ANALYSER = "flat", "linearity", "analyser"
"""Names of the stages."""


@dataclass(frozen=True)
class CalibrationMade:
    """A stage that was written, and what is to be told of it."""

    products: Path
    stage: str
    frames: int
    values: dict[str, Any]
    """Numbers by name; angles in degrees."""


def calibrate_flat(session_path: Path | str, products_path: Path | str) -> CalibrationMade:
    """Stage "flat": each pixel's response, from frames of a uniform source (any polarizer angles, dark frames too).

    With a mosaic, pixels are compared with those behind the same angle, so that the source may be polarized. Array
    ``response`` (rows, columns), NaN for dead and hot pixels.

    Raises:
        PolfuseError: a file that cannot be used.
        DataError: no light.
    """
    with open_session(session_path) as session:
        camera = camera_of(session)
        refuse_changes(session)
        means = stacked(session, camera, usable_frames(session)).means(together=True)
        light = np.where(means.saturated, np.nan, means.light[0])
        linear = _linearity_in(products_path).light(light)
        response = flat_field(linear, parse_mosaic(camera.mosaic) if camera.has_mosaic else None)
        noise = camera.read_noise_counts**2 + float(np.nanmean(light)) / camera.electrons_per_count
        sd = math.sqrt(noise / means.frames[0]) / float(np.nanmean(light))
    values = {
        "response_sd": float(np.nanstd(response)),
        "response_noise_sd": sd,
        "bad_pixels": int(np.count_nonzero(np.isnan(response))),
    }
    _write(products_path, FLAT, {"response": response.astype(np.float32)}, values, session_path, {"response": "1"})
    return CalibrationMade(Path(products_path), FLAT, means.frames[0], values)


def calibrate_linearity(session_path: Path | str, products_path: Path | str, *, order: int = 2) -> CalibrationMade:
    """Stage "linearity": from frames of one constant light at several exposures, polarizer at one angle.

    Array ``coefficients`` (order,), see :class:`processing.optics.flat.Linearity`. Saturated pixels and those within a
    twentieth of saturation on average are left out at that exposure.

    Raises:
        PolfuseError: a file that cannot be used.
        DataError: too few exposures.
    """
    with open_session(session_path) as session:
        camera = camera_of(session)
        refuse_changes(session, ("gain_db",))
        rows, usable = session.frames, usable_frames(session)
        dark = [index for index in usable if rows[index]["dark"]]
        counts, exposures, frames = [], [], 0
        for exposure in np.unique(rows["exposure_s"]):
            lit = [i for i in usable if rows[i]["exposure_s"] == exposure and not rows[i]["dark"]]
            if not lit:
                continue
            means = stacked(session, camera, [*lit, *(i for i in dark if rows[i]["exposure_s"] == exposure)])
            found = means.means(together=True)
            if found.saturated.any():
                continue
            counts.append(float(np.mean(found.light, dtype=np.float64)))
            exposures.append(float(exposure))
            frames += found.frames[0]
    fit = fit_linearity(counts, exposures, order=order)
    values = {
        "exposures": len(counts),
        "until_counts": fit.until_counts,
        "residual": fit.residual,
        "correction_at_top": float(fit.light(fit.until_counts) / fit.until_counts - 1),
    }
    _write(products_path, LINEARITY, {"coefficients": np.array(fit.coefficients)}, values, session_path, {})
    return CalibrationMade(Path(products_path), LINEARITY, frames, values)


def calibrate_analysers(
    session_path: Path | str, products_path: Path | str, *, region_px: int | None = None
) -> CalibrationMade:
    """Stage "analyser": angles and transmittances from a session of the active mode that looks at its own source.

    The source's polarizer stands at four or more angles spread over 180 degrees, the camera's at each angle that will
    be used (a mosaic's are where they are). Frames of ambient light are subtracted. Linearity and flat field in the
    products file are applied. Arrays: ``rows`` (K, 3, R, C), ``angle_sd_rad`` and ``transmittance_sd`` (K, R, C).

    Args:
        session_path: the session.
        products_path: the products file.
        region_px: side of the regions that are calibrated on their own, pixels; the whole sensor when left out.

    Raises:
        PolfuseError: a file that cannot be used, or a session without source angles.
        DataError: angles that do not determine an analyser.
    """
    with open_session(session_path) as session:
        camera = camera_of(session)
        series = SourceSeries(session, camera, load_corrections(products_path)[0])
    light = series.light.astype(np.float64)
    if series.ambient is not None:
        light -= series.ambient
    light[..., series.saturated] = np.nan
    # A mosaic's are where they are made; of a turning polarizer the readings are what later series will be told by.
    found = fit_analysers(
        light,
        series.source_rad,
        series.sensor_rad,
        source_extinction=series.source_extinction,
        region_px=region_px,
    )
    values = {
        "angles_deg": [math.degrees(angle) for angle in found.nominal_rad],
        "offsets_deg": [float(np.degrees(np.mean(plane))) for plane in found.offset_rad],
        "offset_sd_deg": [float(np.degrees(np.mean(plane))) for plane in found.angle_sd_rad],
        "transmittance": [float(np.mean(plane)) for plane in found.transmittance],
        "extinction_ratio": [float(np.median(plane)) for plane in found.extinction_ratio],
        "regions": list(found.rows.shape[2:]),
    }
    arrays = {"rows": found.rows, "angle_sd_rad": found.angle_sd_rad, "transmittance_sd": found.transmittance_sd}
    settings = {**values, "nominal_rad": list(found.nominal_rad), "shape": list(found.shape)}
    _write(products_path, ANALYSER, arrays, settings, session_path, {"angle_sd_rad": "rad"})
    return CalibrationMade(Path(products_path), ANALYSER, series.frames_taken, values)


def load_corrections(path: Path | str) -> tuple[Corrections, AnalyserCalibration | None]:
    """What a products file holds of linearity, flat field and analysers; nothing of it where there is no such file."""
    products = Products(path)
    stages = products.stages()
    flat = products.read(FLAT)["response"] if FLAT in stages else None
    analysers = None
    if ANALYSER in stages:
        settings, arrays = products.settings(ANALYSER), products.read(ANALYSER)
        rows, columns = settings["shape"]
        analysers = AnalyserCalibration(
            tuple(settings["nominal_rad"]), arrays["rows"], arrays["angle_sd_rad"], arrays["transmittance_sd"],
            (rows, columns),
        )  # fmt: skip
    return Corrections(_linearity_in(path), flat), analysers


def _linearity_in(path: Path | str) -> Linearity:
    products = Products(path)
    if LINEARITY not in products.stages():
        return Linearity()
    settings = products.settings(LINEARITY)
    coefficients = products.read(LINEARITY)["coefficients"]
    return Linearity(tuple(map(float, coefficients)), settings["until_counts"], settings["residual"])


def _write(
    path: Path | str,
    stage: str,
    arrays: dict[str, NDArray[Any]],
    values: dict[str, Any],
    session: Path | str,
    units: dict[str, str],
) -> None:
    Products(path).write(stage, arrays, settings=values, inputs=[Path(session)], units=units)
