"""Focusing what was collected along a rail, in one piece."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.antennas import check_method
from polfuse_lab.products.focus_grids import axes_of, peaks_on, plane_of, told
from polfuse_lab.products.focus_parts import Span, along_the_rail, step_m, warnings_of
from polfuse_lab.products.focus_plan import refocus, task_of
from polfuse_lab.products.focus_result import FocusResult
from polfuse_lab.products.forming import form_channels, position_weights
from polfuse_lab.products.rail_options import RailOptions, focus_settings, rail_work, ranging_settings
from polfuse_lab.products.ranging import range_profiles
from polfuse_lab.products.store import Products
from polfuse_lab.session import Session
from polfuse_lab.session.runs import gapless_runs
from processing.radar.profiles import RangeProfiles
from processing.sar.aperture import alias_free_angle_rad
from processing.sar.footprint import ImageFlag, footprint_flags
from processing.sar.grid import Grid
from processing.sar.planner import choose
from processing.sar.planner_words import explain

if TYPE_CHECKING:
    from polfuse_lab.scale.focus_tiles import Scale


def focus_rail(
    session: Session, products_path: Path | str, form_on: Grid, options: RailOptions, scale: Scale | None
) -> FocusResult:
    """Focus a session that was collected along a rail; :func:`polfuse_lab.products.focus.focus` says how.

    Raises:
        PolfuseError: the session cannot be focused this way.
        DataError: wrong method, window or tolerance, or range migration on an uneven rail.
    """
    begun = time.perf_counter()
    grid = plane_of(form_on)
    if grid is not form_on:
        if scale is not None:
            raise _in_one_piece("polar images and heights are focused in one piece", "image grid")
        options = replace(options, method="bp" if options.method == "auto" else options.method)
    if session.rig is None:
        raise PolfuseError("has no rig file", where=str(session.path), advice="focus a session collected along a rail")
    check_method(session.rig, options.method)
    from polfuse_lab.scale import focus_tiles, plan

    here = grid is form_on and options.method in ("auto", "bp") and options.autofocus is None
    if scale is None and here and plan.needs_tiles(session, grid):
        scale = focus_tiles.Scale()
    if scale is not None:
        if options.autofocus is not None:
            raise _in_one_piece("autofocus looks at the whole image at once", "autofocus")
        return focus_tiles.focus_in_tiles(session, products_path, grid, scale, options)
    work = rail_work(session, grid, options)
    profiles = along_the_rail(range_profiles(session, **work.profiles), session)
    weights = position_weights(profiles, options.aperture, passes=bool(gapless_runs(session)))
    refocused = refocus(profiles, grid, weights, options.autofocus, work.beamwidth_rad, work.depression_rad)
    profiles = refocused.profiles
    task = task_of(profiles, grid, work.oversampling, work.beamwidth_rad is not None)
    choice = choose(task, options.tolerance_db, options.method)
    image = form_channels(profiles, form_on, choice, weights, work.beamwidth_rad, work.depression_rad)
    flags = footprint_flags(
        form_on,
        beamwidth_rad=work.beamwidth_rad,
        depression_rad=work.depression_rad,
        alias_free_rad=alias_free_angle_rad(step_m(profiles), profiles.wavelength_m),
        undefined=~np.isfinite(image).all(axis=0),
    )
    image[:, (flags & ImageFlag.OUTSIDE_BEAM) != 0] = np.nan
    warnings = warnings_of(profiles, grid, choice, options.tolerance_db) + refocused.warnings
    settings = focus_settings(work, profiles, grid, choice, weights, warnings, refocused.told) | told(form_on)
    ranging = ranging_settings(work, profiles, session)
    _write(Products(products_path), profiles, form_on, image, flags, ranging, settings, work.inputs)
    return FocusResult(
        products=Path(products_path),
        image=image,
        grid=grid,
        channels=profiles.channels,
        choice=choice,
        explanation=tuple(explain(task, choice, options.tolerance_db)),
        settings=settings,
        pulses=len(profiles.antenna_m),
        seconds=time.perf_counter() - begun,
        peaks=peaks_on(form_on, Span(image), profiles, options.peaks),
        warnings=warnings,
    )


def _in_one_piece(reason: str, where: str) -> PolfuseError:
    return PolfuseError(reason, where=where, advice="leave limits of memory, tiles and --dask out, or focus without it")


def _write(
    products: Products,
    profiles: RangeProfiles,
    grid: Grid,
    image: NDArray[np.complexfloating],
    flags: NDArray[np.uint8],
    ranging: dict[str, Any],
    settings: dict[str, Any],
    inputs: list[Path],
) -> None:
    products.write(
        "ranging",
        {"profiles": profiles.values, "range_m": profiles.range_m, "antenna_m": profiles.antenna_m},
        settings=ranging,
        inputs=inputs,
        units={"profiles": "full scale * m^2", "range_m": "m", "antenna_m": "m"},
    )
    stage, axes, units = axes_of(grid)
    products.write(
        stage,
        {"image": image, "flags": flags, **axes},
        settings=settings,
        inputs=inputs,
        units={"image": "full scale * m^2", "flags": "bits", **units},
    )
