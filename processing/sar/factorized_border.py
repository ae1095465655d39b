"""What factorized back-projection needs of every pulse at every pixel, without the cost of asking each."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from processing.sar.factorized_plan import BORDER, Level, Track, scene_border
from processing.sar.patch_sum import PLACES, types

PULSES = 64
"""Pulses whose ranges to the border are in memory at a time."""

GAIN_NODES = 49
"""Rows and columns at which the sum of squared patterns is evaluated; between them its logarithm is a cubic spline."""


def off_profiles(
    track: Track,
    finest: Level,
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    z_m: float,
    last_m: float,
    reach_m: float,
) -> NDArray[np.bool_]:
    """Pixels, (rows, columns), whose range is off the profiles for any pulse.

    A part's centre and extent decide for all its pulses at once; only where they leave it open is each pulse asked.

    Args:
        track: the aperture.
        finest: its smallest parts.
        x_m: of the pixels, (rows, columns).
        y_m: of the pixels.
        z_m: their height.
        last_m: length of a profile.
        reach_m: what is wanted at either end of it.
    """
    if _all_on_profiles(track, x_m, y_m, z_m, last_m, reach_m):
        return np.zeros(x_m.shape, dtype=np.bool_)
    place = 0.5 * (track.transmit_m + track.receive_m)
    apart = 0.5 * np.linalg.norm(track.transmit_m - track.receive_m, axis=1)
    part = np.repeat(np.arange(len(finest.centre_m)), np.diff(finest.first))
    # Half the path differs from the distance to the middle by no more than half the antennas' distance.
    away = np.linalg.norm(place - finest.centre_m[part], axis=1) + apart
    starts = finest.first[:-1]
    spread = np.maximum.reduceat(away, starts)
    bounds = np.minimum.reduceat(track.start_m, starts), np.maximum.reduceat(track.start_m, starts)
    off = np.empty(x_m.shape, dtype=np.bool_)
    _kernel()(
        track.transmit_m, track.receive_m, track.start_m, finest.first, finest.centre_m, spread, *bounds, x_m, y_m, z_m,
        last_m, reach_m, off,
    )  # fmt: skip
    return off


def _all_on_profiles(
    track: Track,
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    z_m: float,
    last_m: float,
    reach_m: float,
) -> bool:
    """Whether the image's border tells that no pixel is off: no place within it is nearer or further than the border,
    but for half the way between the places that are asked, since the track is outside."""
    border = scene_border(x_m, y_m)
    # From any pixel to the next place asked: half the diagonal of the lattice's cells at most.
    apart = [
        float(np.hypot(*np.diff([axis.take(chosen, index) for axis in (x_m, y_m)], axis=index + 1)).max(initial=0.0))
        for index, chosen in (
            (0, np.unique(np.linspace(0, x_m.shape[0] - 1, BORDER).round().astype(int))),
            (1, np.unique(np.linspace(0, x_m.shape[1] - 1, BORDER).round().astype(int))),
        )
    ]
    slack = 0.5 * sum(apart)
    for first in range(0, len(track.start_m), PULSES):
        some = slice(first, first + PULSES)
        there, back = (
            np.sqrt(np.sum((border - antenna[some, None, :2]) ** 2, axis=2) + (z_m - antenna[some, None, 2]) ** 2)
            for antenna in (track.transmit_m, track.receive_m)
        )
        path = 0.5 * (there + back) - track.start_m[some, None]
        if path.min() - slack < reach_m or path.max() + slack > last_m - reach_m:
            return False
    return True


@functools.cache
def _kernel() -> Callable[..., None]:
    points, line = types.float64[:, ::1], types.float64[::1]

    # Written out, so that places may be read-only views of any layout without compiling anew.
    @njit(
        types.void(
            points, points, line, types.int64[::1], points, line, line, line, PLACES, PLACES, types.float64,
            types.float64, types.float64, types.boolean[:, ::1],
        ),
        parallel=True, cache=True, nogil=True, error_model="numpy",
    )  # fmt: skip
    def kernel(
        transmit: Any, receive: Any, start: Any, first: Any, centre: Any, spread: Any, earliest: Any, latest: Any,
        x: Any, y: Any, z: float, last: float, reach: float, off: Any,
    ) -> None:  # fmt: skip
        rows, columns = x.shape
        for row in prange(rows):
            for column in range(columns):
                px, py = x[row, column], y[row, column]
                found = False
                for part in range(len(centre)):
                    dx, dy, dz = px - centre[part, 0], py - centre[part, 1], z - centre[part, 2]
                    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
                    near, far = distance - spread[part], distance + spread[part]
                    if near - latest[part] >= reach and far - earliest[part] <= last - reach:
                        continue
                    for n in range(first[part], first[part + 1]):
                        tx, ty, tz = px - transmit[n, 0], py - transmit[n, 1], z - transmit[n, 2]
                        rx, ry, rz = px - receive[n, 0], py - receive[n, 1], z - receive[n, 2]
                        path = 0.5 * (math.sqrt(tx * tx + ty * ty + tz * tz) + math.sqrt(rx * rx + ry * ry + rz * rz))
                        if path - start[n] < reach or path - start[n] > last - reach:
                            found = True
                            break
                    if found:
                        break
                off[row, column] = found

    compiled: Callable[..., None] = kernel
    return compiled


def gain_sum(
    track: Track,
    weights: NDArray[np.float64],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    z_m: float,
    axis: NDArray[np.float64],
    exponent: float,
) -> NDArray[np.float32]:
    """``sum w g^2`` at every pixel, (rows, columns); NaN where no pulse illuminates it.

    Args:
        track: the aperture.
        weights: (pulses,).
        x_m: of the pixels, (rows, columns).
        y_m: of the pixels.
        z_m: their height.
        axis: (3,) the antennas' axis.
        exponent: of their two-way amplitude pattern, a power of the cosine.
    """
    nodes = [np.unique(np.linspace(0, n - 1, min(n, GAIN_NODES)).round().astype(int)) for n in x_m.shape]
    at = np.ix_(*nodes)
    total = np.zeros((len(nodes[0]), len(nodes[1])))
    nodes_m = x_m[at], y_m[at], z_m
    for transmit, receive, weight in zip(track.transmit_m, track.receive_m, weights, strict=True):
        total += weight * _cosine(transmit, *nodes_m, axis) ** exponent * _cosine(receive, *nodes_m, axis) ** exponent
    level = np.log(np.maximum(total, 1e-30))
    if min(level.shape) < 4:
        # Few rows or columns are nodes all of them; a spline needs four.
        degree = [min(3, n - 1) for n in level.shape]
        repeated = [max(n, 2) for n in level.shape]
        level = np.resize(level, repeated) if min(level.shape) > 1 else np.broadcast_to(level, repeated)
        axes = [nodes[i] if len(nodes[i]) > 1 else np.array([0, 1]) for i in (0, 1)]
        spline = RectBivariateSpline(*axes, level, kx=max(degree[0], 1), ky=max(degree[1], 1))
    else:
        spline = RectBivariateSpline(*nodes, level)
    between = spline(np.arange(x_m.shape[0]), np.arange(x_m.shape[1]))
    return np.where(between < math.log(1e-25), np.nan, np.exp(between)).astype(np.float32)


def _cosine(
    antenna_m: NDArray[np.float64], x_m: NDArray[np.float64], y_m: NDArray[np.float64], z_m: float,
    axis: NDArray[np.float64],
) -> NDArray[np.float64]:  # fmt: skip
    """Cosine of the angle at which an antenna sees places, 0 behind it."""
    dx, dy, dz = x_m - antenna_m[0], y_m - antenna_m[1], z_m - antenna_m[2]
    cosine = (axis[0] * dx + axis[1] * dy + axis[2] * dz) / np.sqrt(dx**2 + dy**2 + dz**2)
    return np.asarray(np.clip(cosine, 0.0, 1.0))
