"""From a session that holds a phase history (an aircraft's, a stepped-frequency radar's) to a complex image."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus_result import FocusResult
from polfuse_lab.products.store import Products
from polfuse_lab.session import Session
from processing.radar.phase_history import PhaseHistory, history_profiles
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.aperture import aperture_window
from processing.sar.footprint import ImageFlag
from processing.sar.grid import ImageGrid
from processing.sar.peak_search import find_peaks
from processing.sar.planner import Task, choose
from processing.sar.planner_words import explain
from processing.sar.polar_format_geometry import polar_forecast
from processing.sar.resolution import point_resolution

PIXELS_PER_CELL = 2.5
"""Pixels in the narrowest -3 dB width, at least: what interpolation between pixels needs."""

SHARE = 0.95
"""Of the extent that is free of ambiguities, the default image's."""


def holds_history(session: Session) -> bool:
    """Whether a session's records are echoes at frequencies instead of a sound card's samples."""
    return "phase_history" in session.config.get("extra", {})


def read_history(session: Session) -> PhaseHistory:
    """The phase history that an import wrote.

    Raises:
        PolfuseError: the session holds none, or its records do not fit its description.
    """
    if not holds_history(session):
        raise PolfuseError("holds no phase history", where=str(session.path), advice="import one, e.g. --as gotcha")
    told = session.config["extra"]["phase_history"]
    table = session.sweeps
    names = sorted({int(code) for code in table["channel"]})
    antenna = np.asarray(told["antenna_m"], dtype=np.float64)
    count = int(table["samples"].max()) if len(table) else 0
    echoes = np.full((len(names), len(antenna), count), np.nan, dtype=np.complex64)
    for index, row in enumerate(table):
        samples = np.ascontiguousarray(session.audio(index))
        if len(samples) != count or int(row["position"]) >= len(antenna):
            raise PolfuseError(
                f"record {index} has {len(samples)} of {count} samples", where=str(session.path),
                advice="import the files again",
            )  # fmt: skip
        echoes[names.index(int(row["channel"])), int(row["position"])] = samples.view(np.complex64)[:, 0]
    if not echoes.size or np.isnan(echoes).any():
        raise PolfuseError("misses pulses", where=str(session.path), advice="import the files again")
    return PhaseHistory(
        echoes,
        float(told["first_hz"]),
        float(told["step_hz"]),
        antenna,
        np.asarray(told["reference_m"], dtype=np.float64),
        tuple(Channel(code).name for code in names),
    )


def scene_grid(
    history: PhaseHistory,
    *,
    x_m: tuple[float, float] | None = None,
    y_m: tuple[float, float] | None = None,
    step_m: tuple[float, float] | None = None,
) -> ImageGrid:
    """A square on the plane z = 0 around the origin, as large as there are no ambiguities, or the extents given.

    Along the line of sight the step of frequency limits it, across it the angle from pulse to pulse:
    ``wavelength / (2 angle)``.

    Raises:
        PolfuseError: empty extents or more than 50 million pixels.
    """
    middle = history.antenna_m.mean(axis=0)
    ground = math.hypot(middle[0], middle[1])
    slope = ground / math.hypot(ground, middle[2])
    azimuth = np.unwrap(np.arctan2(history.antenna_m[:, 1], history.antenna_m[:, 0]))
    centre_hz = history.first_hz + 0.5 * history.bandwidth_hz
    turn = float(np.median(np.abs(np.diff(azimuth)))) if len(azimuth) > 1 else 0.0
    limits = [history.unambiguous_m / max(slope, 0.1)]
    if turn > 0:
        limits.append(SPEED_OF_LIGHT_M_S / centre_hz / (2 * turn * max(slope, 0.1)))
    half = 0.5 * SHARE * min(limits) / math.sqrt(2)
    extents = [(-half, half) if given is None else given for given in (x_m, y_m)]
    if step_m is None:
        cell = point_resolution(
            history.antenna_m, (0.0, 0.0, 0.0), centre_hz=centre_hz, bandwidth_hz=history.bandwidth_hz
        )
        finest = [min(width, 10 * history.unambiguous_m) / PIXELS_PER_CELL for width in (cell.x_m, cell.y_m)]
        step_m = (_plain(finest[0]), _plain(finest[1]))
    if not all(a < b for a, b in extents) or not all(math.isfinite(step) and step > 0 for step in step_m):
        raise PolfuseError("the extents or the pixel are empty", where="image grid", advice="give FROM below TO")
    counts = [math.floor((b - a) / step + 1e-9) + 1 for (a, b), step in zip(extents, step_m, strict=True)]
    if counts[0] * counts[1] > 50_000_000:
        raise PolfuseError(
            f"{counts[0]} x {counts[1]} pixels do not fit in memory", where="image grid", advice="give larger pixels"
        )
    x, y = (
        np.asarray(a + step * np.arange(n), dtype=np.float64)
        for (a, _), step, n in zip(extents, step_m, counts, strict=True)
    )
    return ImageGrid(x, y, 0.0)


def _plain(step: float) -> float:
    """Down to 1, 2, 2.5 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(step))
    return power * max(factor for factor in (1.0, 2.0, 2.5, 5.0) if factor * power <= step * (1 + 1e-9))


def focus_history(
    session: Session,
    products_path: Path | str,
    *,
    method: str = "auto",
    tolerance_db: float = -50.0,
    grid: ImageGrid | None = None,
    window: str = "taylor",
    aperture: str = "taylor",
    oversampling: int = 4,
    peaks: int = 10,
) -> FocusResult:
    """Focus a phase history and write stages "ranging" and "focus" of a products file.

    Args:
        session: an open session with a phase history.
        products_path: file to write to; other stages in it are kept.
        method: ``"auto"``, ``"bp"``, ``"ffbp"``, ``"pfa"`` or ``"reference"``.
        tolerance_db: largest error of the method, dB below the image.
        grid: where to form the image; :func:`scene_grid` where left out.
        window: over frequency.
        aperture: window along the track.
        oversampling: range bins per resolution cell.
        peaks: how many of the strongest peaks to report.

    Raises:
        PolfuseError: the session holds no usable phase history, or files fail.
        DataError: wrong method, window or tolerance, or an image that the method cannot form.
    """
    from polfuse_lab.products.forming import form_channels

    begun = time.perf_counter()
    history = read_history(session)
    grid = scene_grid(history) if grid is None else grid
    profiles = history_profiles(history, window=window, oversampling=oversampling)
    weights = aperture_window(aperture, len(profiles.antenna_m))
    polar = polar_forecast(profiles.antenna_m, grid, profiles.wavelength_m, profiles.bandwidth_hz, weights)
    task = Task(
        pixels=grid.shape[0] * grid.shape[1],
        pulses=len(profiles.antenna_m),
        channels=len(profiles.channels),
        oversampling=oversampling,
        wavelength_m=profiles.wavelength_m,
        furthest_m=float(np.max(history.reference_m)),
        widest_rad=0.0,
        residual_m=None,
        compensated=False,
        polar=polar,
    )
    choice = choose(task, tolerance_db, method)
    image = form_channels(profiles, grid, choice, weights, None, 0.0)
    undefined = ~np.isfinite(image).all(axis=0)
    flags = np.where(undefined, int(ImageFlag.UNDEFINED), 0).astype(np.uint8)
    cell = point_resolution(
        profiles.antenna_m, (0.0, 0.0, 0.0), centre_hz=profiles.centre_hz, bandwidth_hz=profiles.bandwidth_hz
    )
    warnings = []
    if choice.predicted_error_db > tolerance_db:
        warnings.append(f"the error expected, {choice.predicted_error_db:.0f} dB, is above {tolerance_db:g} dB")
    settings: dict[str, Any] = {
        "channels": list(profiles.channels),
        "z_m": grid.z_m,
        "method": choice.method,
        "interpolator": choice.interpolator,
        "reason": choice.reason,
        "tolerance_db": tolerance_db,
        "predicted_error_db": choice.predicted_error_db,
        "window": window,
        "aperture_window": aperture,
        "aperture_weights": weights.tolist(),
        "flags": {flag.name: flag.value for flag in ImageFlag},
        "oversampling": oversampling,
        "range_compensated": False,
        "beamwidth_rad": None,
        "depression_rad": 0.0,
        "centre_hz": profiles.centre_hz,
        "bandwidth_hz": profiles.bandwidth_hz,
        "warnings": warnings,
    }
    _write(Products(products_path), profiles, grid, image, flags, settings, [session.path])
    span = np.sqrt(np.sum(np.abs(np.nan_to_num(image)).astype(np.float64) ** 2, axis=0))
    separation = (4 * min(cell.x_m, 10.0), 4 * min(cell.y_m, 10.0))
    return FocusResult(
        products=Path(products_path),
        image=image,
        grid=grid,
        channels=profiles.channels,
        choice=choice,
        explanation=tuple(explain(task, choice, tolerance_db)),
        settings=settings,
        pulses=len(profiles.antenna_m),
        seconds=time.perf_counter() - begun,
        peaks=find_peaks(span, grid, peaks, separation_m=separation),
        warnings=warnings,
    )


def _write(
    products: Products,
    profiles: RangeProfiles,
    grid: ImageGrid,
    image: NDArray[np.complexfloating],
    flags: NDArray[np.uint8],
    settings: dict[str, Any],
    inputs: list[Path],
) -> None:
    assert profiles.start_m is not None
    ranging = {key: settings[key] for key in ("channels", "window", "oversampling", "range_compensated", "centre_hz")}
    products.write(
        "ranging",
        {
            "profiles": profiles.values,
            "range_m": profiles.range_m,
            "antenna_m": profiles.antenna_m,
            "start_m": profiles.start_m,
        },
        settings=ranging | {"bandwidth_hz": profiles.bandwidth_hz, "coupling": "none"},
        inputs=inputs,
        units={"profiles": "as recorded", "range_m": "m", "antenna_m": "m", "start_m": "m"},
    )
    products.write(
        "focus",
        {"image": image, "flags": flags, "x_m": grid.x_m, "y_m": grid.y_m},
        settings=settings,
        inputs=inputs,
        units={"image": "as recorded", "flags": "bits", "x_m": "m", "y_m": "m"},
    )
