"""A frame of a mosaic of polarizers to Stokes parameters, DOLP and AOP at full size, in one pass over memory.

For the live view and for whole recordings: no error planes (:func:`processing.optics.stokes.stokes_planes` has them).
:func:`mosaic_stokes` is the fast way (numba); :func:`mosaic_stokes_reference` is its definition in plain float64 NumPy.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.optics.analyser import transmittances
from processing.optics.demosaic import demosaic_reference
from processing.optics.mosaic import ANGLES_DEG, Mosaic, check_mosaic_image
from processing.optics.mosaic_kernel import weighted_band, whole_band
from processing.simd import LANES, STREAM_BYTES

Floats = NDArray[np.float64]

PLANES = ("s0", "s1", "s2", "dolp", "aop")
"""Order of the planes that both implementations fill."""

STREAMED_BYTES = 1 << 25
"""Results that are larger go past the caches, which would not keep them until they are read."""

_LEAST_GAIN = 1e-6
"""Of S beside the counts, and its inverse: between them the squares of differences neither vanish nor overflow."""

_SUMS = np.array([[0.5, 0.5, 0.5, 0.5], [1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]])


def ideal_solution(extinction_ratio: float = math.inf) -> Floats:
    """(3, 4): from the intensities behind 0, 45, 90 and 135 degrees to S0, S1 and S2 (thesis 6.1 to 6.3).

    The least-squares solution in closed form: its zeros are exact, so that equal intensities give S1 = S2 = 0.
    """
    q, r = transmittances(extinction_ratio)
    solution: Floats = _SUMS / np.array([[q + r], [q - r], [q - r]])
    return solution


def mosaic_stokes_reference(
    image: NDArray[Any],
    mosaic: Mosaic,
    *,
    solution: ArrayLike | None = None,
    black_level: float = 0.0,
    saturation: float = math.inf,
) -> Floats:
    """Plain float64 definition of :func:`mosaic_stokes`; same arguments and result, in float64."""
    weights = _checked(image, solution, black_level)
    counts = np.where(image >= saturation, np.nan, image.astype(np.float64)) - black_level
    stokes = np.tensordot(weights, demosaic_reference(counts, mosaic), axes=1)
    s0, s1, s2 = stokes
    lit = s0 > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        dolp = np.where(lit, np.hypot(s1, s2) / s0, np.nan)
    aop = 0.5 * np.arctan2(s2, s1)
    aop = np.where(aop <= -np.pi / 2, np.pi / 2, aop)
    aop = np.where(lit & ((s1 != 0) | (s2 != 0)), aop, np.nan)
    return np.stack([s0, s1, s2, dolp, aop])


def mosaic_stokes(
    image: NDArray[Any],
    mosaic: Mosaic,
    *,
    solution: ArrayLike | None = None,
    black_level: float = 0.0,
    saturation: float = math.inf,
    threads: int = 1,
    out: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Stokes parameters, DOLP and AOP of every pixel of one frame, interpolated as by
    :func:`processing.optics.demosaic.demosaic`.

    Sums of whole counts are exact or in float64, and results are rounded to float32 once: they are within 1e-6 of the
    definition where S0 > 0. Of float32 frames, means of neighbours are rounded to float32 as well. DOLP is not
    debiased.

    Args:
        image: (rows, columns) uint8, uint16 or float32; both even.
        mosaic: its polarizers.
        solution: (3, 4) from intensities in the order of :data:`processing.optics.mosaic.ANGLES_DEG` to S0, S1, S2,
            such as a calibration gives; :func:`ideal_solution` when left out.
        black_level: counts without light.
        saturation: counts at and above which a pixel is saturated; all that is interpolated from it is NaN.
        threads: how many threads share the rows; one leaves the other cores to the acquisition.
        out: (5, rows, columns) float32 to fill instead of a new array, which costs as long again. An earlier result
            is best: it begins where memory can be written past the caches.

    Returns:
        (5, rows, columns) float32 in the order of :data:`PLANES`; AOP in radians, in (-pi/2, pi/2]. DOLP and AOP are
        NaN where S0 is not positive, AOP also where S1 and S2 vanish.

    Raises:
        DataError: not an image of even size, another type, or a solution or an ``out`` of another shape.
    """
    weights = _checked(image, solution, black_level)
    if not image.dtype.isnative:
        image = image.astype(image.dtype.newbyteorder("="))
    if image.dtype not in (np.uint8, np.uint16, np.float32):
        raise DataError(f"a mosaic frame is {image.dtype}", "give uint8, uint16 or float32")
    if threads < 1:
        raise DataError(f"{threads} threads", "give 1 or more")
    if out is None:
        out = _aligned((len(PLANES), *image.shape))
    elif out.shape != (len(PLANES), *image.shape) or out.dtype != np.float32 or not out.flags.c_contiguous:
        raise DataError(
            f"the array to fill is {out.dtype} {out.shape}", f"give contiguous float32 {(len(PLANES), *image.shape)}"
        )
    rows, columns = image.shape
    if columns < LANES:
        # Mirrored to where a vector ends: as at the border, the columns' parity goes on.
        wide = np.pad(image, ((0, 0), (0, LANES - columns)), mode="reflect")
        out[:] = mosaic_stokes(
            wide, mosaic, solution=weights, black_level=black_level, saturation=saturation, threads=threads
        )[..., :columns]
        return out
    work = _work(np.ascontiguousarray(image), mosaic, weights, black_level, saturation, out)
    bands = [(rows * band // threads, rows * (band + 1) // threads) for band in range(threads)]
    run = map if threads == 1 else _pool(threads, os.getpid()).map
    list(run(lambda band: work(*band), bands))
    return out


@functools.lru_cache(maxsize=4)
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    """Threads that are kept: to begin new ones takes a fifth of the time of a frame. A forked process has its own."""
    return ThreadPoolExecutor(threads, thread_name_prefix="mosaic")


def _aligned(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """An empty array that begins where :func:`processing.simd.stream` may write."""
    more = STREAM_BYTES // 4
    space = np.empty(math.prod(shape) + more, dtype=np.float32)
    begin = -space.ctypes.data % STREAM_BYTES // 4
    return space[begin : begin + math.prod(shape)].reshape(shape)


def _work(
    frame: NDArray[Any],
    mosaic: Mosaic,
    weights: Floats,
    black_level: float,
    saturation: float,
    out: NDArray[np.float32],
) -> Callable[[int, int], None]:
    """What fills rows from one to another: by sums and differences where float32 holds them exactly."""
    gains = np.array([2 * weights[0, 0], weights[1, 0], weights[2, 1]])
    usual = bool(np.all((np.abs(gains) > _LEAST_GAIN) & (np.abs(gains) < 1 / _LEAST_GAIN)))
    plain = frame.dtype != np.float32 and abs(black_level) < 65536 and np.array_equal(weights, gains[:, None] * _SUMS)
    if not (plain and usual):
        by_row = _by_row(mosaic, weights)
        offset = black_level * weights.sum(axis=1)
        return lambda first, end: weighted_band(frame, by_row, offset, saturation, first, end, out)
    lanes, shares = _signs(mosaic, gains)
    four = 4 * black_level
    coarse = round(four * 4) / 4
    level = np.array([coarse, four - coarse, weights[0, 0]], dtype=np.float32)
    places = (out.ctypes.data, *out.strides[:2])
    streamed = out.nbytes > STREAMED_BYTES and all(place % STREAM_BYTES == 0 for place in places)
    return lambda first, end: whole_band(frame, lanes, shares, level, saturation, first, end, streamed, out)


def _by_row(mosaic: Mosaic, weights: Floats) -> Floats:
    """(2, 3, 4) by the row's parity: weights of the angles in it at even and odd columns, and of its neighbours'."""
    by_row = np.empty((2, 3, 4))
    for column, angle in enumerate(ANGLES_DEG):
        i, k = mosaic.place(angle)
        by_row[i, :, k] = by_row[1 - i, :, 2 + k] = weights[:, column]
    return by_row


def _signs(mosaic: Mosaic, gains: Floats) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """``lanes`` and ``shares`` of :func:`processing.optics.mosaic_kernel.whole_band`."""
    (down, right), (other_down, other_right) = mosaic.place(0), mosaic.place(90)
    apart = (int(down != other_down), int(right != other_right))
    # Means of two pixels beside and above or below, and of the four across.
    share = {(0, 1): (0.5, 0.0, 0.0), (1, 0): (0.0, 0.5, 0.0), (1, 1): (0.0, 0.0, 0.25)}
    # The first of the pair that the own angle is not in, and the second.
    first = (0, 1) if apart != (0, 1) else (1, 0)
    second = (first[0] ^ apart[0], first[1] ^ apart[1])
    shares = np.array([np.negative(share[apart]), np.subtract(share[first], share[second])], dtype=np.float32)
    lanes = np.empty((2, 3, LANES), dtype=np.float32)
    for i in (0, 1):
        for k in (0, 1):
            own, other = mosaic.angles_deg[i][k], mosaic.angles_deg[i ^ first[0]][k ^ first[1]]
            of_s1, of_s2 = (own, other) if own in (0, 90) else (other, own)
            lanes[i, 0, k::2] = 1.0 if own in (0, 90) else -1.0
            lanes[i, 1, k::2] = gains[1] if of_s1 == 0 else -gains[1]
            lanes[i, 2, k::2] = gains[2] if of_s2 == 45 else -gains[2]
    return lanes, shares


def _checked(image: NDArray[Any], solution: ArrayLike | None, black_level: float) -> Floats:
    check_mosaic_image(image)
    weights = ideal_solution() if solution is None else np.asarray(solution, dtype=np.float64)
    if weights.shape != (3, len(ANGLES_DEG)) or not np.all(np.isfinite(weights)):
        raise DataError(f"a solution has shape {weights.shape}", "give (3, 4) finite numbers")
    if not math.isfinite(black_level):
        raise DataError(f"the black level is {black_level}", "give a finite number of counts")
    return weights
