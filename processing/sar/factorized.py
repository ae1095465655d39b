"""Fast factorized back-projection: back-projection's sum for any track, at a cost of N^2 log N.

Small parts of the aperture are back-projected exactly onto coarse polar grids, then merged, part by part, onto finer
ones and at last onto the image (:mod:`processing.sar.factorized_plan`). Interpolation reads eight samples along range
and eight along the angle, by filters of least error over the grids' bands (:mod:`processing.sar.filter_design`); how
finely the grids are sampled follows from the tolerance. All geometry and phase is float64, samples are complex64. It
is measured against :func:`processing.sar.backprojection.backproject_reference`.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.antenna import boresight, pattern_exponent
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.aperture import Pulses, usable_pulses
from processing.sar.continuous import sweep_motion
from processing.sar.factorized_border import gain_sum, off_profiles
from processing.sar.factorized_plan import (
    Level,
    Settings,
    Track,
    plan_levels,
    scene_border,
    track_order,
)
from processing.sar.factorized_settings import settings_for
from processing.sar.grid import Grid, check_grid
from processing.sar.patch_sum import COLUMNS, ROWS, column_table, row_table
from processing.sar.paths import channel_groups

DEFAULT_TOLERANCE_DB = -50.0


def factorized(
    profiles: RangeProfiles,
    grid: Grid,
    *,
    tolerance_db: float = DEFAULT_TOLERANCE_DB,
    settings: Settings | None = None,
    weights: NDArray[np.floating] | None = None,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
) -> NDArray[np.complex64]:
    """Focus all channels by factorized back-projection, with the scale and phase of back-projection.

    Args:
        profiles: (channels, positions, bins), any track, one or two antennas for each channel; profiles that are NaN
            throughout count as missing.
        grid: where to form the image: a plane, all of it on one side of the track.
        tolerance_db: largest error, dB below the image; -70 is reached with range profiles of three bins per cell.
        settings: instead of those that the tolerance asks for.
        weights: (positions,) window along the aperture; rectangular where left out.
        beamwidth_rad: half-power beam width of one antenna for pattern compensation; none where left out.
        depression_rad: angle of the antennas' axes below horizontal; they look along +y.

    Returns:
        (channels, rows, columns) complex64; NaN where a pulse's range is off its profile or within the reach of the
        interpolation of its ends, and where no pulse illuminates the pixel.

    Raises:
        DataError: unusable profiles, weights, grid, beam width or tolerance; single NaN samples, a grid that is no
            plane or reaches abreast of the track, or motion within the sweeps that matters (advises back-projection).
    """
    pulses = usable_pulses(profiles, weights)
    check_grid(grid)
    _check(profiles, pulses)
    x, y, hidden, z = _plane(grid)
    oversampling = profiles.resolution_m / profiles.range_step_m
    if settings is None:
        settings = settings_for(tolerance_db, len(pulses.antenna_m), oversampling).settings
    exponent = 0.0 if beamwidth_rad is None else pattern_exponent(beamwidth_rad)
    border = scene_border(x, y)
    order = track_order(pulses.antenna_m, border)
    image = np.empty((len(pulses.values), *grid.shape), dtype=np.complex64)
    for pair, channels in channel_groups(profiles):
        track = Track(
            pulses.antenna_m[order] + pair.transmit_m,
            pulses.antenna_m[order] + pair.receive_m,
            pulses.start_m[order],
            profiles.centre_hz,
            profiles.bandwidth_hz,
        )
        levels = plan_levels(track, border, z, settings, x.size)
        axis = boresight(depression_rad)
        whole = len(channels) == len(image)
        formed = image if whole else np.empty((len(channels), *grid.shape), dtype=np.complex64)
        _form(profiles, pulses, channels, order, track, levels, settings, (x, y, z), axis, exponent, formed)
        reach = sum(COLUMNS / 2 * float(level.step[:, 0].max()) for level in levels)
        last = profiles.range_step_m * (len(profiles.range_m) - 1)
        formed[:, off_profiles(track, levels[0], x, y, z, last, reach)] = np.nan
        if not whole:
            image[channels] = formed
        for c in channels:
            if beamwidth_rad is None:
                image[c] /= np.float32(pulses.weights[c].sum())
            else:
                image[c] /= gain_sum(track, pulses.weights[c, order], x, y, z, axis, exponent)
    if hidden.any():
        image[:, hidden] = np.nan
    return image


def _check(profiles: RangeProfiles, pulses: Pulses) -> None:
    if len(profiles.range_m) < COLUMNS + 2:
        raise DataError(f"{len(profiles.range_m)} range bins are too few to interpolate", "keep a longer range axis")
    if np.isnan(pulses.values.sum()):
        raise DataError("profiles hold single NaN samples", "focus by back-projection, which keeps them local")
    moving = sweep_motion(profiles)
    if moving.modelled:
        raise DataError(f"{moving.reason}, which factorized back-projection does not model", "focus by back-projection")


def _plane(grid: Grid) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], float]:
    """x and y of all pixels, which of them have no place, and the plane's height."""
    x, y, z = grid.places_m()
    hidden = ~(np.isfinite(x) & np.isfinite(y) & np.isfinite(z))
    if hidden.all():
        raise DataError("no pixel of the image grid has a place", "give a grid that meets its plane")
    if np.nanmax(z) != np.nanmin(z):
        raise DataError("the image grid is no plane", "focus by back-projection, which takes any heights")
    if hidden.any():
        x, y = (np.where(hidden, axis[~hidden].flat[0], axis) for axis in (x, y))
    return x, y, hidden, float(np.nanmax(z))


def _form(
    profiles: RangeProfiles,
    pulses: Pulses,
    channels: list[int],
    order: NDArray[np.int64],
    track: Track,
    levels: list[Level],
    settings: Settings,
    places: tuple[NDArray[np.float64], NDArray[np.float64], float],
    axis: NDArray[np.float64],
    exponent: float,
    image: NDArray[np.complex64],
) -> None:
    """Weighted sums of a group's channels at all pixels, put into ``image`` (channels, rows, columns)."""
    from processing.sar.factorized_kernel import form, merge
    from processing.sar.factorized_parts import form_parts

    x, y, z = places
    turns = 2 * profiles.centre_hz / SPEED_OF_LIGHT_M_S
    chosen = pulses.values if len(channels) == len(pulses.values) else pulses.values[channels]
    count = len(channels)
    samples = form_parts(
        chosen, pulses.weights[channels], order, track, levels[0], step_m=profiles.range_step_m, axis=axis,
        exponent=exponent, z_m=z,
    )  # fmt: skip
    del chosen
    filters = (
        row_table(ROWS, settings.angle_oversampling).ravel(),
        column_table(settings.range_oversampling).ravel(),
    )
    for finer, level in itertools.pairwise(levels):
        merged = np.empty(level.samples * count, np.complex64)
        merge(
            count, level.children, *_tables(finer), _flat(samples), turns, *filters, z, *_tables(level), _jobs(level),
            _flat(merged),
        )  # fmt: skip
        samples = merged
    form(*_tables(levels[-1]), _flat(samples), turns, *filters, x, y, z, image)


def _flat(samples: NDArray[np.complex64]) -> NDArray[np.float32]:
    return samples.view(np.float32).reshape(-1)


def _tables(level: Level) -> tuple[Any, Any]:
    """(parts, 11) centre, axis, ahead, R and its step, s and its step; (parts, 3) first sample, rows, columns."""
    grids = np.column_stack([level.start[:, 0], level.step[:, 0], level.start[:, 1], level.step[:, 1]])
    frame = np.concatenate([level.centre_m, level.axis, level.ahead, grids], axis=1)
    return np.ascontiguousarray(frame), np.ascontiguousarray(np.column_stack([level.offset, level.shape]))


def _jobs(level: Level) -> NDArray[np.int64]:
    """(lines, 2) part and row of every line of a level's grids."""
    rows = level.shape[:, 0]
    part = np.repeat(np.arange(len(rows)), rows)
    row = np.arange(rows.sum()) - np.repeat(np.cumsum(rows) - rows, rows)
    return np.column_stack([part, row])
