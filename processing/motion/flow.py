"""Motion between exposures from the pictures alone: the comparison to the radar's velocity.

Contrast changes with the polarizer's angle, so that brightness is not conserved, on which optical flow relies. What is
conserved is that four exposures of one thing do not contradict each other: the velocity is looked for that takes most
of the contradictions away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.motion.division_of_time import (
    error_image,
    object_at_reference,
    refined_displacement,
    touched,
)

Floats = NDArray[np.float64]

_STEP_PX = 2.0
_MARGIN_PX = 4


def displacement_by_pictures(
    light: ArrayLike, matrix: Floats, time_s: ArrayLike, *, largest_px: float = 24.0
) -> Floats:
    """Steady motion of one object in the picture, (K, 2, rows, columns): down and right against the first exposure.

    Args:
        light: (K, rows, columns), K of 4 or more.
        matrix: (K, 3) measurement matrix.
        time_s: (K,) instants.
        largest_px: longest way from the first to the last exposure that is looked for, pixels.

    Raises:
        DataError: nothing moved, or shapes that do not fit.
    """
    images, time = np.asarray(light, dtype=np.float64), np.asarray(time_s, dtype=np.float64)
    if images.ndim != 3 or time.shape != (len(images),) or not np.ptp(time) > 0:
        raise DataError(f"times of shape {time.shape} for exposures of shape {images.shape}", "give one for each")
    traces = touched(images, matrix)
    if not traces.any():
        raise DataError("nothing moved between the exposures", "there is nothing to correct")
    rows, columns = np.nonzero(traces)
    box = tuple(slice(max(int(at.min()) - _MARGIN_PX, 0), int(at.max()) + _MARGIN_PX + 1) for at in (rows, columns))
    part = images[:, *box]
    share = (time - time[0]) / (time[-1] - time[0])
    # A pixel is worth as much as a contradiction of its own traces' typical size takes away.
    worth = float(np.median(error_image(images, matrix)[traces])) / 2
    best, largest = (0.0, 0.0), -np.inf
    steps = np.arange(-largest_px, largest_px + _STEP_PX / 2, _STEP_PX)
    for down in steps:
        for right in steps:
            if not 1.0 < np.hypot(down, right) <= largest_px:
                continue
            # Read between pixels of the nearest whole ones: the search is coarse.
            way = np.rint(np.outer(share, (down, right)))
            gain = _gain(part, matrix, way, traces[box], worth)
            if gain > largest:
                best, largest = (down, right), gain
    coarse = np.outer(share, best)
    return refined_displacement(images, matrix, coarse, object_at_reference(images, matrix, coarse))


def _gain(part: Floats, matrix: Floats, way: Floats, traces: NDArray[np.bool_], worth: float) -> float:
    """What reading along a way makes of the pixels whose whole way lies within the traces' box and begins or ends in
    one."""
    shape = traces.shape
    moved = np.full_like(part, np.nan)
    ends = np.zeros((len(part), *shape), dtype=np.bool_)
    for k, (down, right) in enumerate(way.astype(int)):
        here = tuple(slice(max(-s, 0), min(n - s, n)) for s, n in zip((down, right), shape, strict=True))
        there = tuple(slice(max(s, 0), min(n + s, n)) for s, n in zip((down, right), shape, strict=True))
        if any(s.start >= s.stop for s in here):
            return -np.inf
        moved[k][here] = part[k][there]
        ends[k][here] = traces[there]
    own = ends.any(axis=0) & np.isfinite(moved).all(axis=0)
    if not own.any():
        return -np.inf
    error = error_image(np.nan_to_num(moved), matrix)[own]
    return float(np.sum(worth - np.minimum(error, 4 * worth)))
