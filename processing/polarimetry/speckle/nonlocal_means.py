"""Polarimetric non-local means: averages over those pixels around whose surroundings look alike.

Two patches are compared by the likelihood ratio of complex Wishart matrices that one matrix made both (Chen, Chen, Wang
and Xiao 2011, IEEE TGRS 49(5) 1811). For two averages A and B of equally many looks it depends on

    d = 2 ln |A + B| - ln |A| - ln |B| - 6 ln 2  >= 0,

averaged over the patch. d does not change when both matrices are brought to another basis or to the identity, so that
one distribution of d between equal patches holds for every kind of ground. It is found by simulation for the number of
looks at hand (as in Deledalle et al. 2015, IEEE TGRS 53(4) 2021), and turned into weights: 1 below its median, 0 above
``1 - level``, linear between. So ``level`` is how rarely equal ground is refused. Whole elements are averaged with the
same real weights.

Single-look matrices are singular; therefore pixels are compared by their 3 x 3 averages. Averages get a part
:data:`FLOOR` of their power in all directions, so that one-mechanism ground (rank 1) has a determinant.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from processing.errors import DataError
from processing.polarimetry.averaging import window_average
from processing.polarimetry.matrices import Planes, as_planes, matrix_of_planes
from processing.polarimetry.speckle.simulation import speckled

FLOOR = 1e-5
"""Part of a third of the span that is added to the diagonal before matrices are compared."""
_BAND = 8
"""Rows that one thread takes at a time."""
_LOG64 = 6 * float(np.log(2.0))


def nonlocal_means(planes: Planes, *, looks: int = 1, search: int = 15, patch: int = 3, level: float = 0.01) -> Planes:
    """T or C planes (9, rows, columns) averaged over similar surroundings; compiled.

    Pixels with a NaN in any plane are NaN in every plane and are left out of all others' means and comparisons; so are
    pixels without power around them, which stay as they are.

    Args:
        planes: see :data:`processing.polarimetry.matrices.PLANES`.
        looks: independent looks in the matrices as they come; pixels are taken to be independent of their neighbours.
        search: odd width of the window in which similar pixels are looked for, pixels.
        patch: odd width of what is compared, pixels.
        level: how rarely a patch of equal ground is left out, 0 to 0.5; smaller smooths more.

    Raises:
        DataError: unfit settings, or planes of another shape.
    """
    given, means, defined = _prepared(planes, looks, search, patch, level)
    likely, largest = calibration(looks, patch, level)
    made = np.full_like(given, np.nan)
    _image(given, means, _determinants(means), defined, search // 2, patch // 2, likely, largest, made)
    return _with_powerless(given, means, made)


def nonlocal_means_reference(
    planes: Planes, *, looks: int = 1, search: int = 15, patch: int = 3, level: float = 0.01
) -> NDArray[np.float64]:
    """The definition of :func:`nonlocal_means` in NumPy and float64."""
    given, means, defined = _prepared(planes, looks, search, patch, level)
    likely, largest = calibration(looks, patch, level)
    reach, edge, (rows, columns) = search // 2, patch // 2, defined.shape
    sums, weights = np.zeros(given.shape), np.zeros(defined.shape)
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            here = slice(max(-down, 0), rows - max(down, 0)), slice(max(-right, 0), columns - max(right, 0))
            there = slice(max(down, 0), rows - max(-down, 0)), slice(max(right, 0), columns - max(-right, 0))
            both = defined[here] & defined[there]
            if not both.any():
                continue
            found = _dissimilarity(means[:, *here], means[:, *there])
            around = ((edge, edge), (edge, edge))
            views = np.lib.stride_tricks.sliding_window_view
            total = views(np.pad(np.where(both, found, 0.0), around), (patch, patch)).sum(axis=(-2, -1))
            count = views(np.pad(both.astype(float), around), (patch, patch)).sum(axis=(-2, -1))
            distance = total / np.maximum(count, 1)
            weight = np.where(both, np.clip((largest - distance) / (largest - likely), 0, 1), 0.0)
            sums[:, *here] += weight * np.where(both, given[:, *there], 0.0)
            weights[here] += weight
    with np.errstate(invalid="ignore"):
        made = np.where(defined, sums / weights, np.nan)
    return np.asarray(_with_powerless(given, means, made), dtype=np.float64)


@functools.lru_cache(maxsize=32)
def calibration(looks: int, patch: int, level: float) -> tuple[float, float]:
    """Median and ``1 - level`` quantile of the patches' mean dissimilarity on even ground, from simulated speckle.

    Deterministic. The patches lie apart by more than they are wide, as almost all patches of a search window do.
    """
    generator = np.random.default_rng(20_150_401)
    width = 160
    truth = np.zeros((9, width, width))
    truth[[0, 5, 8]] = 1.0
    means = _floored(window_average(speckled(truth, looks, generator), 3))[:, 2:-2, 2:-2]
    apart = patch + 4
    distances = []
    views = np.lib.stride_tricks.sliding_window_view
    for down, right in ((0, apart), (apart, 0), (apart, apart)):
        one, other = means[:, down:, right:], means[:, : means.shape[1] - down, : means.shape[2] - right]
        distances.append(views(_dissimilarity(one, other), (patch, patch)).mean(axis=(-2, -1)).ravel())
    likely, largest = np.quantile(np.concatenate(distances), [0.5, 1 - level])
    return float(likely), float(largest)


def _prepared(
    planes: Planes, looks: int, search: int, patch: int, level: float
) -> tuple[Planes, NDArray[np.float64], NDArray[np.bool_]]:
    for width, name in ((search, "search window"), (patch, "patch")):
        if width < 1 or width % 2 == 0:
            raise DataError(f"a {name} of {width} pixels has no centre", "take an odd number such as 3, 7 or 15")
    if looks < 1:
        raise DataError(f"{looks} looks are no image", "give one or more")
    if not 0 < level < 0.5:
        raise DataError(f"a level of {level:g} leaves no weights", "take a number between 0 and 0.5 such as 0.01")
    given = as_planes(planes)
    means = _floored(window_average(given.astype(np.float64), 3))
    defined = np.asarray(np.isfinite(means).all(axis=0) & (means[0] + means[5] + means[8] > 0))
    return given, np.where(defined, means, np.nan), defined


def _floored(means: Planes) -> NDArray[np.float64]:
    made = means.astype(np.float64)
    made[[0, 5, 8]] += FLOOR / 3 * (means[0] + means[5] + means[8])
    return made


def _with_powerless(given: Planes, means: NDArray[np.float64], made: Planes) -> Planes:
    left = np.isnan(means[0]) & np.isfinite(given).all(axis=0)
    return np.where(left, given, made)


def _dissimilarity(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    logarithms = [np.linalg.slogdet(matrix_of_planes(np.nan_to_num(m)))[1] for m in (one + other, one, other)]
    with np.errstate(invalid="ignore"):
        return np.asarray(2 * logarithms[0] - logarithms[1] - logarithms[2] - _LOG64)


def _determinants(means: NDArray[np.float64]) -> NDArray[np.float64]:
    found = np.empty(means.shape[1:])
    _determinant_image(means, found)
    return found


@njit(cache=True, nogil=True)
def _determinant(
    a: float, dr: float, di: float, er: float, ei: float, b: float, fr: float, fi: float, c: float
) -> float:  # fmt: skip
    # Re(d f conj(e)) of the elements 12, 23 and 13.
    triple = (dr * fr - di * fi) * er + (dr * fi + di * fr) * ei
    return (
        a * b * c + 2.0 * triple - a * (fr * fr + fi * fi) - b * (er * er + ei * ei) - c * (dr * dr + di * di)
    )  # fmt: skip


@njit(cache=True, nogil=True, parallel=True)
def _determinant_image(m: NDArray[np.float64], found: NDArray[np.float64]) -> None:
    for row in prange(m.shape[1]):
        for column in range(m.shape[2]):
            found[row, column] = _determinant(
                m[0, row, column], m[1, row, column], m[2, row, column], m[3, row, column], m[4, row, column],
                m[5, row, column], m[6, row, column], m[7, row, column], m[8, row, column],
            )  # fmt: skip


@njit(cache=True, nogil=True, parallel=True)
def _image(
    planes: NDArray[Any], means: NDArray[np.float64], determinants: NDArray[np.float64], defined: NDArray[np.bool_],
    reach: int, edge: int, likely: float, largest: float, made: NDArray[Any],
) -> None:  # fmt: skip
    bands = -(-planes.shape[1] // _BAND)
    for band in prange(bands):
        _rows(planes, means, determinants, defined, reach, edge, likely, largest, made, band * _BAND)


@njit(cache=True, nogil=True, error_model="numpy")
def _rows(
    planes: NDArray[Any], means: NDArray[np.float64], determinants: NDArray[np.float64], defined: NDArray[np.bool_],
    reach: int, edge: int, likely: float, largest: float, made: NDArray[Any], begin: int,
) -> None:  # fmt: skip
    count, rows, columns = planes.shape
    end = min(begin + _BAND, rows)
    first, last = max(begin - edge, 0), min(end + edge, rows)
    sums, weights = np.zeros((count, end - begin, columns)), np.zeros((end - begin, columns))
    # Sums over the patch's width of dissimilarities and of pairs, for each row that a patch of this band touches.
    pair, number = np.empty(columns), np.empty(columns)
    wide, counts = np.zeros((last - first, columns)), np.zeros((last - first, columns))
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            for r in range(first, last):
                if 0 <= r + down < rows:
                    _pairs(means, determinants, defined, r, down, right, pair, number)
                    _widen(pair, number, edge, wide[r - first], counts[r - first])
                else:
                    wide[r - first] = 0.0
                    counts[r - first] = 0.0
            for r in range(max(begin, -down), min(end, rows - down)):
                for c in range(max(0, -right), min(columns, columns - right)):
                    if not (defined[r, c] and defined[r + down, c + right]):
                        continue
                    total, pairs = 0.0, 0.0
                    for line in range(max(r - edge, first), min(r + edge + 1, last)):
                        total += wide[line - first, c]
                        pairs += counts[line - first, c]
                    weight = min((largest - total / pairs) / (largest - likely), 1.0)
                    if weight > 0.0:
                        weights[r - begin, c] += weight
                        for plane in range(count):
                            sums[plane, r - begin, c] += weight * planes[plane, r + down, c + right]
    for plane in range(count):
        for r in range(begin, end):
            for c in range(columns):
                if weights[r - begin, c] > 0.0:
                    made[plane, r, c] = sums[plane, r - begin, c] / weights[r - begin, c]


@njit(cache=True, nogil=True, error_model="numpy")
def _pairs(
    m: NDArray[np.float64], determinants: NDArray[np.float64], defined: NDArray[np.bool_], row: int, down: int,
    right: int, pair: NDArray[np.float64], number: NDArray[np.float64],
) -> None:  # fmt: skip
    """Dissimilarity of each pixel of a row and the one that is so far away; 0 and no pair where one is undefined."""
    columns = m.shape[2]
    other = row + down
    pair[:] = 0.0
    number[:] = 0.0
    for c in range(max(0, -right), min(columns, columns - right)):
        d = c + right
        if defined[row, c] and defined[other, d]:
            both = _determinant(
                m[0, row, c] + m[0, other, d], m[1, row, c] + m[1, other, d], m[2, row, c] + m[2, other, d],
                m[3, row, c] + m[3, other, d], m[4, row, c] + m[4, other, d], m[5, row, c] + m[5, other, d],
                m[6, row, c] + m[6, other, d], m[7, row, c] + m[7, other, d], m[8, row, c] + m[8, other, d],
            )  # fmt: skip
            pair[c] = np.log((both / determinants[row, c]) * (both / determinants[other, d])) - _LOG64
            number[c] = 1.0


@njit(cache=True, nogil=True)
def _widen(
    pair: NDArray[np.float64], number: NDArray[np.float64], edge: int, wide: NDArray[np.float64],
    counts: NDArray[np.float64],
) -> None:  # fmt: skip
    columns = len(pair)
    for c in range(columns):
        total, pairs = 0.0, 0.0
        for k in range(max(c - edge, 0), min(c + edge + 1, columns)):
            total += pair[k]
            pairs += number[k]
        wide[c] = total
        counts[c] = pairs
