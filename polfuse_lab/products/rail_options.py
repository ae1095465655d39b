"""How a session of a rail is focused, in one piece or in tiles: what is asked, and what follows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus_parts import furthest_m
from polfuse_lab.products.focus_plan import considered, task_before
from polfuse_lab.products.ranging import range_profiles
from polfuse_lab.products.visits import target_positions
from polfuse_lab.session import Session
from processing.radar.profiles import RangeProfiles
from processing.sar.continuous import sweep_motion
from processing.sar.footprint import ImageFlag
from processing.sar.grid import ImageGrid
from processing.sar.planner import Choice, choose

FAR_MARGIN_CELLS = 10
"""Resolution cells by which profiles reach beyond the image, for interpolation and its edge."""


@dataclass(frozen=True)
class RailOptions:
    """What is asked for; see :func:`polfuse_lab.products.focus.focus`."""

    method: str = "auto"
    tolerance_db: float = -50.0
    window: str = "hann"
    aperture: str = "rectangular"
    oversampling: int | None = None
    """None: the planner's choice."""
    compensate_pattern: bool = True
    sky: Path | str | None = None
    peaks: int = 10
    target: str | None = None
    autofocus: str | None = None


@dataclass(frozen=True)
class RailWork:
    """What follows from the options for one session and image."""

    options: RailOptions
    oversampling: int
    """Range bins per resolution cell."""
    ranging: dict[str, Any]
    """Settings of the stage "ranging" that are known beforehand."""
    profiles: dict[str, Any]
    """Arguments of :func:`polfuse_lab.products.ranging.range_profiles`."""
    beamwidth_rad: float | None
    """None: the pattern is not compensated."""
    depression_rad: float
    inputs: list[Path]


def rail_work(session: Session, grid: ImageGrid, options: RailOptions) -> RailWork:
    """Choose what is left open, and read the sky where there is one.

    Raises:
        PolfuseError: the session has no rig file, its target is unknown, or the sky cannot be read.
        DataError: an unknown window, or no method can work.
    """
    rig = session.rig
    if rig is None:
        raise PolfuseError("has no rig file", where=str(session.path), advice="focus a session collected along a rail")
    reach = furthest_m(session, grid)
    oversampling = options.oversampling
    if oversampling is None:
        ahead = task_before(session, grid, options.window, options.compensate_pattern, reach)
        oversampling = round(choose(ahead, options.tolerance_db, options.method).oversampling)
    ranging: dict[str, Any] = {
        "window": options.window,
        "oversampling": oversampling,
        "max_range_m": reach + FAR_MARGIN_CELLS * rig.waveform.range_resolution_m,
        "range_compensated": True,
    }
    profiles = dict(ranging)
    if options.sky is not None:
        profiles["reference"] = range_profiles(options.sky, **{**ranging, "range_compensated": False})
        profiles["coupling"] = "reference"
    profiles["positions"] = None if options.target is None else target_positions(session, options.target)
    return RailWork(
        options=replace(options, oversampling=oversampling),
        oversampling=oversampling,
        ranging=ranging,
        profiles=profiles,
        beamwidth_rad=math.radians(rig.geometry.beamwidth_deg) if options.compensate_pattern else None,
        depression_rad=math.radians(rig.geometry.antenna_elevation_deg),
        inputs=[session.path] if options.sky is None else [session.path, Path(options.sky)],
    )


def focus_settings(
    work: RailWork,
    profiles: RangeProfiles,
    grid: ImageGrid,
    choice: Choice,
    weights: NDArray[np.float64],
    warnings: list[str],
    autofocus: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Settings of stage "focus", as they are stored; arguments as they were used."""
    options = work.options
    return {
        "channels": list(profiles.channels),
        "z_m": grid.z_m,
        "method": choice.method,
        "interpolator": choice.interpolator,
        "reason": choice.reason,
        "tolerance_db": options.tolerance_db,
        "predicted_error_db": choice.predicted_error_db,
        "considered": considered(choice),
        "precision": choice.precision,
        "autofocus": autofocus,
        "window": options.window,
        "target": options.target,
        "aperture_window": options.aperture,
        "aperture_weights": weights.tolist(),
        "flags": {flag.name: flag.value for flag in ImageFlag},
        "oversampling": work.oversampling,
        "range_compensated": True,
        "antennas_m": None
        if profiles.pairs is None
        else [{"transmit": list(pair.transmit_m), "receive": list(pair.receive_m)} for pair in profiles.pairs],
        "motion": sweep_motion(profiles).reason,
        "beamwidth_rad": work.beamwidth_rad,
        "depression_rad": work.depression_rad,
        "centre_hz": profiles.centre_hz,
        "bandwidth_hz": profiles.bandwidth_hz,
        "warnings": warnings,
    }


def ranging_settings(work: RailWork, profiles: RangeProfiles, session: Session) -> dict[str, Any]:
    """Settings of stage "ranging", as they are stored."""
    return work.ranging | {
        "channels": list(profiles.channels),
        "coupling": "none" if work.options.sky is None else "reference",
        "centre_hz": profiles.centre_hz,
        "bandwidth_hz": profiles.bandwidth_hz,
        "sync": session.sync.summary(),
    }
