"""A frame of a mosaic of polarizers to Stokes parameters, DOLP and AOP at full size, in one pass over memory.

For the live view and for whole recordings: no error planes (:func:`processing.optics.stokes.stokes_planes` has them).
:func:`mosaic_stokes` is the fast way (numba); :func:`mosaic_stokes_reference` is its definition in plain float64 NumPy.
"""

from __future__ import annotations

import math
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
    return sums / np.array([[q + r], [q - r], [q - r]])


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

    Sums are exact or in float64; results are rounded to float32 once. DOLP is not debiased.

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
    if out is None:
        out = np.empty((len(PLANES), *image.shape), dtype=np.float32)
    elif out.shape != (len(PLANES), *image.shape) or out.dtype != np.float32 or not out.flags.c_contiguous:
        raise DataError(
            f"the array to fill is {out.dtype} {out.shape}", f"give contiguous float32 {(len(PLANES), *image.shape)}"
        )
    # Columns of the weights by place in the 2 x 2 cell: [3, row, column].
    by_place = np.empty((3, 2, 2))
    for column, angle in enumerate(ANGLES_DEG):
        by_place[:, *mosaic.place(angle)] = weights[:, column]
    offset = black_level * weights.sum(axis=1)
    run = _kernel if threads == 1 else _kernel_threads
    run(np.ascontiguousarray(image), by_place, offset, saturation, threads, out)
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
def _kernel(
    image: NDArray[Any], weights: Floats, offset: Floats, saturation: float, bands: int, out: NDArray[np.float32]
) -> None:
    rows = image.shape[0]
    for band in numba.prange(bands):
        _band(image, weights, offset, saturation, rows * band // bands, rows * (band + 1) // bands, out)


_kernel_threads = numba.njit(cache=True, nogil=True, parallel=True)(_kernel.py_func)


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
    """Rows ``first`` to ``end``."""
    rows, columns = image.shape
    # Three lines of the image with a pixel more at each end, mirrored at the border: no line is converted twice.
    width = max(columns, LANES) + 2
    above, here, below = np.zeros(width, np.float32), np.zeros(width, np.float32), np.zeros(width, np.float32)
    narrow = np.empty((5, LANES), dtype=np.float32)
    even = np.empty(LANES, dtype=np.float32)
    for lane in range(LANES):
        even[lane] = 1 - 2 * (lane % 2)
    _fill(image[first - 1 if first > 0 else 1], saturation, above)
    _fill(image[first], saturation, here)
    for row in range(first, end):
        _fill(image[row + 1 if row + 1 < rows else row - 1], saturation, below)
        places = (weights[:, row % 2], weights[:, 1 - row % 2])
        if columns < LANES:
            _sixteen(above, here, below, 0, places, offset, even, narrow[0], narrow[1], narrow[2], narrow[3], narrow[4])
            out[:, row] = narrow[:, :columns]
        else:
            o0, o1, o2, o3, o4 = out[0, row], out[1, row], out[2, row], out[3, row], out[4, row]
            for start in range(0, columns - LANES + 1, LANES):
                _sixteen(above, here, below, start, places, offset, even, o0, o1, o2, o3, o4)
            # The last sixteen may overlap those before; as columns are even, it begins in an even one.
            if columns % LANES:
                _sixteen(above, here, below, columns - LANES, places, offset, even, o0, o1, o2, o3, o4)
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


@numba.njit(inline="always")
def _sixteen(
    above: NDArray[np.float32],
    here: NDArray[np.float32],
    below: NDArray[np.float32],
    k: int,
    weights: tuple[Floats, Floats],
    offset: Floats,
    even: NDArray[np.float32],
    o0: NDArray[np.float32],
    o1: NDArray[np.float32],
    o2: NDArray[np.float32],
    o3: NDArray[np.float32],
    o4: NDArray[np.float32],
) -> None:
    """Sixteen pixels of a row from the even column ``k`` on.

    ``weights`` are those of the angles in the row and in its neighbours, [S, even or odd column].
    """
    half, whole = splat(_HALF), splat(_WHOLE)
    two, four, nan = splat(np.float32(0.5)), splat(np.float32(0.25)), splat(_NAN)
    lane = load(even, 0)
    pixel = load(here, k + 1)
    beside = (load(here, k) + load(here, k + 2)) * two
    over = (load(above, k + 1) + load(below, k + 1)) * two
    across = ((load(above, k) + load(above, k + 2)) + (load(below, k) + load(below, k + 2))) * four
    i00 = to_float64(where_positive(lane, pixel, beside))
    i01 = to_float64(where_positive(lane, beside, pixel))
    i10 = to_float64(where_positive(lane, over, across))
    i11 = to_float64(where_positive(lane, across, over))
    s0 = _mixed(i00, i01, i10, i11, weights, 0, offset)
    s1 = _mixed(i00, i01, i10, i11, weights, 1, offset)
    s2 = _mixed(i00, i01, i10, i11, weights, 2, offset)
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


@numba.njit(inline="always")
def _mixed(i00: Any, i01: Any, i10: Any, i11: Any, weights: tuple[Floats, Floats], i: int, offset: Floats) -> Any:
    total = fma(i00, splat(weights[0][i, 0]), splat(-offset[i]))
    total = fma(i01, splat(weights[0][i, 1]), total)
    total = fma(i10, splat(weights[1][i, 0]), total)
    return to_float32(fma(i11, splat(weights[1][i, 1]), total))
