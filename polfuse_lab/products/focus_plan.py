"""What the focusing planner and autofocus are told of a session, and what a product keeps of their answers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.products.antennas import CHANNELS, antenna_pairs
from polfuse_lab.session import Session
from polfuse_lab.session.runs import gapless_runs
from processing.errors import DataError
from processing.radar.profiles import RangeProfiles
from processing.sar.aperture import widest_angle_rad
from processing.sar.continuous import sweep_motion
from processing.sar.grid import ImageGrid
from processing.sar.planner import Choice, Task
from processing.sar.polar_format_geometry import polar_forecast
from processing.sar.straight_track import straight_track

FINEST_SHOWN = (4, 6, 8, 12, 16)
"""Bins per resolution cell that a session's profiles may have: pictures and calibration read them as well."""


@dataclass(frozen=True)
class Refocused:
    """Profiles after autofocus, and what the product tells of it."""

    profiles: RangeProfiles
    told: dict[str, Any] | None
    """None where none was asked for."""
    warnings: list[str]


def task_of(profiles: RangeProfiles, grid: ImageGrid, oversampling: int | None, compensated: bool) -> Task:
    """The planner's task for profiles that are there."""
    return _task(
        profiles.antenna_m, grid, oversampling, compensated, profiles.window,
        channels=len(profiles.channels), wavelength_m=profiles.wavelength_m, bandwidth_hz=profiles.bandwidth_hz,
        furthest_m=float(profiles.range_m[-1]), apart=profiles.pairs is not None,
        moving=sweep_motion(profiles).modelled,
    )  # fmt: skip


def task_before(session: Session, grid: ImageGrid, window: str, compensated: bool, furthest_m: float) -> Task:
    """The planner's task before there are profiles, to choose their oversampling by."""
    x = np.unique(np.asarray(session.sweeps["x_m"], dtype=np.float64))
    waveform = session.waveform
    return _task(
        np.column_stack([x, np.zeros((len(x), 2))]), grid, None, compensated, window,
        channels=len(np.unique(session.sweeps["channel"])), wavelength_m=waveform.wavelength_m,
        bandwidth_hz=waveform.bandwidth_hz, furthest_m=furthest_m,
        apart=antenna_pairs(session.rig, CHANNELS) is not None, moving=bool(gapless_runs(session)),
    )  # fmt: skip


def _task(
    antenna_m: NDArray[np.float64],
    grid: ImageGrid,
    oversampling: int | None,
    compensated: bool,
    window: str,
    *,
    channels: int,
    wavelength_m: float,
    bandwidth_hz: float,
    furthest_m: float,
    apart: bool,
    moving: bool,
) -> Task:
    try:
        # Antennas apart are no single rail, which is what range migration asks for.
        residual: float | None = None if apart or moving else straight_track(antenna_m, wavelength_m).residual_m
    except DataError:
        residual = None
    return Task(
        pixels=grid.shape[0] * grid.shape[1],
        pulses=len(antenna_m),
        channels=channels,
        oversampling=oversampling,
        wavelength_m=wavelength_m,
        furthest_m=furthest_m,
        widest_rad=widest_angle_rad(antenna_m, grid),
        residual_m=residual,
        compensated=compensated,
        window=window,
        oversamplings=FINEST_SHOWN,
        antenna_m=antenna_m,
        grid=grid,
        bandwidth_hz=bandwidth_hz,
        moving=moving,
        polar=None if apart or moving or compensated else polar_forecast(antenna_m, grid, wavelength_m, bandwidth_hz),
    )


def considered(choice: Choice) -> list[dict[str, Any]]:
    """The ways that were not taken, as plain values."""
    return [
        {
            "method": other.method,
            "interpolator": other.interpolator,
            "oversampling": other.oversampling,
            "predicted_error_db": round(other.predicted_error_db, 1),
            "core_seconds": float(f"{other.seconds:.3g}"),
        }
        for other in choice.considered
    ]


def refocus(
    profiles: RangeProfiles,
    grid: ImageGrid,
    weights: NDArray[np.float64],
    method: str | None,
    beamwidth_rad: float | None,
    depression_rad: float,
) -> Refocused:
    """Autofocus, where it is asked for; a refusal leaves the profiles as they are and is told.

    Raises:
        DataError: unknown method, or too few positions.
    """
    if method is None:
        return Refocused(profiles, None, [])
    from processing.sar.autofocus import autofocus

    found = autofocus(
        profiles, grid, method=method, weights=weights, beamwidth_rad=beamwidth_rad, depression_rad=depression_rad
    )
    told: dict[str, Any] = {
        "method": found.method,
        "applied": found.applied,
        "reason": found.reason,
        "error_rad": found.error_rad,
        "entropy_before": found.entropy_before,
        "entropy_after": _plain(found.entropy_after),
        "largest_move_cells": _plain(found.largest_move_cells),
        "points": found.points,
        "phase_rad": found.phase_rad.tolist(),
        "shift_m": found.shift_m.tolist(),
        "axis": list(found.axis),
    }
    warnings = [] if found.applied else [f"autofocus ({found.method}) changed nothing: {found.reason}"]
    return Refocused(found.corrected(profiles), told, warnings)


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
