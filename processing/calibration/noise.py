"""The radar's noise as the RCS that it would be taken for (noise-equivalent RCS), from a look at the clear sky."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]


def noise_floor(
    profiles: ArrayLike, range_m: ArrayLike, *, window_m: float, range_compensated: bool
) -> NDArray[np.float64]:
    """Mean noise power against range of profiles that were recorded without a target.

    White noise of the beat has the same power in every range bin; profiles multiplied by R^2 show it growing as R^4
    in power (the thesis, whose processor compensated amplitude by R, finds R^2). The compensation is undone, the power
    is smoothed over ``window_m`` by a median (over ln 2, the median of an exponential distribution over its mean),
    which a stray echo does not move, and the compensation is put back.

    Args:
        profiles: (channels, positions, bins) complex range profiles.
        range_m: (bins,) m.
        window_m: length over which the floor is smooth, m; a few resolution cells.
        range_compensated: whether the profiles were multiplied by R^2.

    Returns:
        (channels, bins) power; NaN where nothing finite is near.

    Raises:
        DataError: shapes that do not fit.
    """
    values = np.asarray(profiles)
    axis = np.asarray(range_m, dtype=np.float64)
    if values.ndim != 3 or values.shape[2] != axis.size or axis.size < 2:
        raise DataError(
            f"sky profiles have shape {values.shape} on {axis.size} ranges", "give (channels, positions, bins)"
        )
    weight = axis**4 if range_compensated else np.ones_like(axis)
    with np.errstate(divide="ignore", invalid="ignore"):
        power = np.abs(values.astype(np.complex128)) ** 2 / weight
    # At range 0 the compensated profile is 0 / 0; powers there say nothing.
    power[..., weight == 0] = np.nan
    half = max(round(float(window_m / (axis[1] - axis[0]) / 2)), 1)
    floor = np.full((values.shape[0], axis.size), np.nan)
    for centre in range(axis.size):
        near = power[:, :, max(centre - half, 0) : centre + half + 1].reshape(values.shape[0], -1)
        for channel, samples in enumerate(near):
            finite = samples[np.isfinite(samples)]
            if finite.size:
                floor[channel, centre] = np.median(finite) / np.log(2)
    return np.asarray(floor * weight)


def focused_noise(
    floor: ArrayLike, range_m: ArrayLike, ground_range_m: ArrayLike, z_m: float, averaging: ArrayLike
) -> NDArray[np.float64]:
    """Noise power in a focused image against ground range, abreast of the rail.

    Args:
        floor: (channels, bins) noise power of one profile.
        range_m: (bins,) slant range, m.
        ground_range_m: (ny,) ground range of the image's rows, m.
        z_m: height of the image plane relative to the antennas, m.
        averaging: noise power in the image over that of one profile, scalar or (ny,); 1 / positions where the image
            is the mean of the positions.

    Returns:
        (channels, ny) power; NaN beyond the ranges of the floor.
    """
    slant = np.hypot(np.asarray(ground_range_m, dtype=np.float64), z_m)
    axis = np.asarray(range_m, dtype=np.float64)
    rows = [np.interp(slant, axis, row, left=np.nan, right=np.nan) for row in np.asarray(floor)]
    return np.asarray(np.stack(rows) * np.asarray(averaging))


def background_by_row(image: ArrayLike) -> NDArray[np.float64]:
    """Upper bound of the noise power by image row, (channels, ny), from an image (channels, ny, nx) itself.

    Median over the row over ln 2; clutter and side lobes raise it. NaN for rows without a finite pixel.
    """
    power = np.abs(np.asarray(image).astype(np.complex128)) ** 2
    found = np.full(power.shape[:2], np.nan)
    for index in np.ndindex(*power.shape[:2]):
        finite = power[index][np.isfinite(power[index])]
        if finite.size:
            found[index] = np.median(finite) / np.log(2)
    return found
