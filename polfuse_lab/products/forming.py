"""Forming images by the method chosen, also from passes, in which each channel has positions of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.products.passes import spacing_weights
from processing.errors import DataError
from processing.radar.profiles import RangeProfiles
from processing.sar.aperture import aperture_window
from processing.sar.backprojection import backproject, backproject_reference
from processing.sar.continuous import Motion, sweep_motion
from processing.sar.factorized import factorized
from processing.sar.grid import Grid, ImageGrid
from processing.sar.planner import Choice
from processing.sar.polar_format import polar_format
from processing.sar.range_migration import range_migration


def own_positions(profiles: RangeProfiles) -> NDArray[np.bool_] | None:
    """(channels, positions) which profiles there are, where each position belongs to one channel only (passes)."""
    present = ~np.isnan(profiles.values).all(axis=2)
    return present if len(present) == 1 or (present.sum(axis=0) == 1).all() else None


def position_weights(profiles: RangeProfiles, aperture: str, *, passes: bool) -> NDArray[np.float64]:
    """(positions,) the aperture's window; with ``passes``, whose places are uneven, at each place and times the length
    of rail that it stands for. Raises :class:`DataError` for an unknown window."""
    x = profiles.antenna_m[:, 0]
    weights = aperture_window(aperture, len(x))
    if not passes:
        return weights
    present = ~np.isnan(profiles.values).all(axis=2)
    even = np.linspace(x[0], x[-1], len(x))
    weighted: NDArray[np.float64] = np.interp(x, even, weights) * spacing_weights(profiles.antenna_m, present)
    return weighted


def motion_model(profiles: RangeProfiles) -> Motion:
    """``"moving"`` or ``"still"``: decided by all positions, so that parts of them are not treated differently."""
    return "moving" if sweep_motion(profiles).modelled else "still"


def form_channels(
    profiles: RangeProfiles,
    grid: Grid,
    choice: Choice,
    weights: NDArray[np.float64],
    beamwidth_rad: float | None,
    depression_rad: float,
) -> NDArray[np.complexfloating]:
    """(channels, ny, nx) complex64 image by the method chosen; where no two channels share a position, each channel
    from its own positions alone. Raises :class:`DataError` as the method does."""
    motion = motion_model(profiles)
    present = own_positions(profiles)
    if present is None or len(present) == 1:
        return _form(profiles, grid, choice, weights, beamwidth_rad, depression_rad, motion)
    images = []
    for channel, own in enumerate(present):
        here = profiles.at_positions(own)
        alone = replace(
            here,
            values=here.values[channel : channel + 1],
            channels=(here.channels[channel],),
            noise=None if here.noise is None else here.noise[channel : channel + 1],
            pairs=None if here.pairs is None else here.pairs[channel : channel + 1],
        )
        images.append(_form(alone, grid, choice, weights[own], beamwidth_rad, depression_rad, motion))
    return np.concatenate(images)


def _form(
    profiles: RangeProfiles,
    grid: Grid,
    choice: Choice,
    weights: NDArray[np.float64],
    beamwidth_rad: float | None,
    depression_rad: float,
    motion: Motion,
) -> NDArray[np.complexfloating]:
    pattern: dict[str, Any] = {"beamwidth_rad": beamwidth_rad, "depression_rad": depression_rad}
    if choice.method == "rma":
        if not isinstance(grid, ImageGrid):
            raise DataError("range migration forms images on a plane, in x and y", "focus by back-projection")
        return range_migration(profiles, grid, weights=weights, **pattern)
    if choice.method == "pfa":
        if beamwidth_rad is not None:
            raise DataError("polar format does not compensate the antennas' pattern", "leave that out, or choose bp")
        return polar_format(profiles, grid, weights=weights)
    if choice.method == "ffbp":
        tolerance = choice.settings_db or choice.predicted_error_db
        return factorized(profiles, grid, tolerance_db=tolerance, weights=weights, **pattern)
    if choice.method == "reference":
        exact = backproject_reference(
            profiles, grid, interpolator=choice.interpolator, weights=weights, motion=motion, **pattern
        )
        return exact.astype(np.complex64)
    return backproject(profiles, grid, interpolator=choice.interpolator, weights=weights, motion=motion, **pattern)
