"""A frame of a mosaic of polarizers to Stokes parameters, DOLP and AOP at full size, in one pass over memory.

For the live view and for whole recordings: no error planes (:func:`processing.optics.stokes.stokes_planes` has them).
:func:`mosaic_stokes` is the fast way (numba); :func:`mosaic_stokes_reference` is its definition in plain float64 NumPy.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.optics.analyser import transmittances
from processing.optics.demosaic import demosaic_reference
from processing.optics.mosaic import ANGLES_DEG, Mosaic, check_mosaic_image
from processing.simd import LANES, fma, load, splat, sqrt, store, to_float32, to_float64, where_positive

Floats = NDArray[np.float64]

PLANES = ("s0", "s1", "s2", "dolp", "aop")
"""Order of the planes that both implementations fill."""

_TAN_EIGHTH = np.float32(math.tan(math.pi / 8))
_QUARTER, _HALF, _WHOLE = np.float32(math.pi / 4), np.float32(math.pi / 2), np.float32(math.pi)
_ABOVE_LOWEST = np.nextafter(-_HALF, np.float32(0))
_NAN = np.float32(np.nan)


def ideal_solution(extinction_ratio: float = math.inf) -> Floats:
    """(3, 4): from the intensities behind 0, 45, 90 and 135 degrees to S0, S1 and S2 (thesis 6.1 to 6.3).

    The least-squares solution in closed form: its zeros are exact, so that equal intensities give S1 = S2 = 0.
    """
    q, r = transmittances(extinction_ratio)
    sums = np.array([[0.5, 0.5, 0.5, 0.5], [1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]])
    solution: Floats = sums / np.array([[q + r], [q - r], [q - r]])
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
        out: (5, rows, columns) float32 to fill instead of a new array.

    Returns:
        (5, rows, columns) float32 in the order of :data:`PLANES`; AOP in radians, in (-pi/2, pi/2]. DOLP and AOP are
        NaN where S0 is not positive, AOP also where S1 and S2 vanish.

    Raises:
        DataError: not an image of even size, another type, or a solution or an ``out`` of another shape.
    """
    weights = _checked(image, solution, black_level)
    if image.dtype not in (np.uint8, np.uint16, np.float32):
        raise DataError(f"a mosaic frame is {image.dtype}", "give uint8, uint16 or float32")
    if threads < 1:
        raise DataError(f"{threads} threads", "give 1 or more")
    if out is None:
        out = np.empty((len(PLANES), *image.shape), dtype=np.float32)
    elif out.shape != (len(PLANES), *image.shape) or out.dtype != np.float32 or not out.flags.c_contiguous:
        raise DataError(
            f"the array to fill is {out.dtype} {out.shape}", f"give contiguous float32 {(len(PLANES), *image.shape)}"
        )
    # By the row's parity, [row, S, place]: the angles in the row at even and odd columns, then those in its neighbours.
    by_row = np.empty((2, 3, 4))
    for column, angle in enumerate(ANGLES_DEG):
        i, k = mosaic.place(angle)
        by_row[i, :, k] = by_row[1 - i, :, 2 + k] = weights[:, column]
    rows, columns = image.shape
    if columns < LANES:
        # Mirrored to where a vector ends: as at the border, the columns' parity goes on.
        wide = np.pad(image, ((0, 0), (0, LANES - columns)), mode="reflect")
        out[:] = mosaic_stokes(
            wide, mosaic, solution=weights, black_level=black_level, saturation=saturation, threads=threads
        )[..., :columns]
        return out
    frame, offset = np.ascontiguousarray(image), black_level * weights.sum(axis=1)
    bands = [(rows * band // threads, rows * (band + 1) // threads) for band in range(threads)]
    with ThreadPoolExecutor(threads) if threads > 1 else nullcontext() as pool:
        run = map if pool is None else pool.map
        list(run(lambda band: _band(frame, by_row, offset, saturation, band[0], band[1], out), bands))
    return out


def _checked(image: NDArray[Any], solution: ArrayLike | None, black_level: float) -> Floats:
    check_mosaic_image(image)
    weights = ideal_solution() if solution is None else np.asarray(solution, dtype=np.float64)
    if weights.shape != (3, len(ANGLES_DEG)) or not np.all(np.isfinite(weights)):
        raise DataError(f"a solution has shape {weights.shape}", "give (3, 4) finite numbers")
    if not math.isfinite(black_level):
        raise DataError(f"the black level is {black_level}", "give a finite number of counts")
    return weights


@numba.njit(cache=True, nogil=True)
def _band(
    image: NDArray[Any],
    weights: Floats,
    offset: Floats,
    saturation: float,
    first: int,
    end: int,
    out: NDArray[np.float32],
) -> None:
    """Rows ``first`` to ``end``; 16 columns or more."""
    rows, columns = image.shape
    # Three lines of the image with a pixel more at each end, mirrored at the border: no line is converted twice.
    width = columns + 2
    above, here, below = np.zeros(width, np.float32), np.zeros(width, np.float32), np.zeros(width, np.float32)
    _fill(image[first - 1 if first > 0 else 1], saturation, above)
    _fill(image[first], saturation, here)
    for row in range(first, end):
        _fill(image[row + 1 if row + 1 < rows else row - 1], saturation, below)
        i = row % 2
        _row(above, here, below, weights[i], offset, out[0, row], out[1, row], out[2, row], out[3, row], out[4, row])
        above, here, below = here, below, above


@numba.njit(cache=True, nogil=True)
def _fill(counts: NDArray[Any], saturation: float, line: NDArray[np.float32]) -> None:
    """A line of the image as float32, saturated pixels undefined, mirrored at both ends."""
    columns = counts.size
    for column in range(columns):
        value = np.float32(counts[column])
        line[column + 1] = _NAN if value >= saturation else value
    line[0] = line[2]
    line[columns + 1] = line[columns - 1]


@numba.njit(cache=True, nogil=True)
def _row(
    above: NDArray[np.float32],
    here: NDArray[np.float32],
    below: NDArray[np.float32],
    weights: Floats,
    offset: Floats,
    o0: NDArray[np.float32],
    o1: NDArray[np.float32],
    o2: NDArray[np.float32],
    o3: NDArray[np.float32],
    o4: NDArray[np.float32],
) -> None:
    """A row; ``weights`` (3, 4): of S by its angles at even and odd columns, and by its neighbours' at such columns."""
    columns = o0.size
    even = np.empty(LANES, dtype=np.float32)
    for lane in range(LANES):
        even[lane] = 1 - 2 * (lane % 2)
    lanes = load(even, 0)
    # Read before the loop: for all the compiler knows, storing results might change them.
    a = (weights[0, 0], weights[0, 1], weights[0, 2], weights[0, 3], -offset[0])
    b = (weights[1, 0], weights[1, 1], weights[1, 2], weights[1, 3], -offset[1])
    c = (weights[2, 0], weights[2, 1], weights[2, 2], weights[2, 3], -offset[2])
    for start in range(0, columns + LANES - 1, LANES):
        # The last sixteen may overlap those before; as columns are even, it begins in an even one.
        k = min(start, columns - LANES)
        _sixteen(above, here, below, k, lanes, a, b, c, o0, o1, o2, o3, o4)


@numba.njit(nogil=True)
def _sixteen(
    above: NDArray[np.float32],
    here: NDArray[np.float32],
    below: NDArray[np.float32],
    k: int,
    even: Any,
    a: Any,
    b: Any,
    c: Any,
    o0: NDArray[np.float32],
    o1: NDArray[np.float32],
    o2: NDArray[np.float32],
    o3: NDArray[np.float32],
    o4: NDArray[np.float32],
) -> None:
    """Sixteen pixels of a row from the even column ``k`` on; ``a``, ``b``, ``c`` weigh its angles for S0, S1, S2."""
    half, whole = splat(_HALF), splat(_WHOLE)
    two, four, nan = splat(np.float32(0.5)), splat(np.float32(0.25)), splat(_NAN)
    pixel = load(here, k + 1)
    beside = (load(here, k) + load(here, k + 2)) * two
    over = (load(above, k + 1) + load(below, k + 1)) * two
    across = ((load(above, k) + load(above, k + 2)) + (load(below, k) + load(below, k + 2))) * four
    i00 = to_float64(where_positive(even, pixel, beside))
    i01 = to_float64(where_positive(even, beside, pixel))
    i10 = to_float64(where_positive(even, over, across))
    i11 = to_float64(where_positive(even, across, over))
    s0 = _mixed(i00, i01, i10, i11, a)
    s1 = _mixed(i00, i01, i10, i11, b)
    s2 = _mixed(i00, i01, i10, i11, c)
    store(o0, k, s0)
    store(o1, k, s1)
    store(o2, k, s2)
    store(o3, k, where_positive(s0, sqrt(fma(s1, s1, s2 * s2)) / s0, nan))
    # Half the arctangent by octants: within tan(pi / 8) an odd polynomial (Cephes atanf, 2e-7 relative).
    x, y = where_positive(s1, s1, -s1), where_positive(s2, s2, -s2)
    steep = y - x
    large, small = where_positive(steep, y, x), where_positive(steep, x, y)
    beyond = small - large * splat(_TAN_EIGHTH)
    ratio = where_positive(beyond, small - large, small) / where_positive(beyond, small + large, large)
    z = ratio * ratio
    series = fma(splat(np.float32(8.05374449538e-2)), z, splat(np.float32(-1.38776856032e-1)))
    series = fma(series, z, splat(np.float32(1.99777106478e-1)))
    series = fma(series, z, splat(np.float32(-3.33329491539e-1)))
    angle = fma(series * z, ratio, ratio)
    angle = where_positive(beyond, angle + splat(_QUARTER), angle)
    angle = where_positive(steep, half - angle, angle)
    angle = where_positive(s1, angle, whole - angle)
    angle = where_positive(s2, angle, -angle) * two
    angle = where_positive(splat(_ABOVE_LOWEST) - angle, half, angle)
    store(o4, k, where_positive(s0, angle, nan))


@numba.njit(nogil=True)
def _mixed(i00: Any, i01: Any, i10: Any, i11: Any, weights: Any) -> Any:
    total = fma(i00, splat(weights[0]), splat(weights[4]))
    total = fma(i01, splat(weights[1]), total)
    total = fma(i10, splat(weights[2]), total)
    return to_float32(fma(i11, splat(weights[3]), total))
