"""The polarimetric refined Lee filter: one weight for all elements, from the span in a half of the window that an edge
leaves on the pixel's own side.

Source: Lee, Grunes and de Grandi 1999, IEEE TGRS 37(5) 2363; the edge's direction and side as in Lee 1981, CGIP 15(4)
380: of four gradients between nine sub-windows the largest tells the direction, and that side is taken whose sub-window
is nearer to the middle one. (PolSARpro and its followers always take the darker side.) Every element is averaged over
the same pixels with the same real weight, so that what comes out is a mixture of matrices and stays positive.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from processing.errors import DataError
from processing.polarimetry.matrices import Planes, as_planes

_SIDES = ((1, 2, 1, 0), (0, 2, 2, 0), (0, 1, 2, 1), (0, 0, 2, 2))
"""Row and column of the sub-windows at both ends of the gradients: across, up the diagonal, along, down it."""


_BAND = 16
"""Rows that one thread takes at a time."""


def refined_lee(planes: Planes, window: int = 7, *, looks: float) -> Planes:
    """T or C planes (9, rows, columns) with less speckle and kept edges; compiled.

    Pixels outside the image and pixels with a NaN in any plane are left out of all means; a pixel that is itself
    undefined stays NaN in every plane. Sums are float64, rounded to the type of the planes.

    Args:
        planes: see :data:`processing.polarimetry.matrices.PLANES`.
        window: odd width, 5 to 31 pixels.
        looks: equivalent number of looks of the span, (mean / deviation)^2 where the ground is even; see
            :func:`processing.polarimetry.speckle.quality.estimated_looks`.

    Raises:
        DataError: an unfit window or number of looks, or planes of another shape.
    """
    given, span, defined = _prepared(planes, window, looks)
    sub = _sub_window(window)
    means = np.empty_like(span)
    _sub_means(span, defined, sub // 2, means)
    first, last = _halves(window)
    made = np.empty_like(given)
    _image(given, span, defined, means, (window - sub) // 2, first, last, 1.0 / looks, made)
    return made


def refined_lee_reference(planes: Planes, window: int = 7, *, looks: float) -> NDArray[np.float64]:
    """The definition of :func:`refined_lee` in NumPy and float64."""
    given, span, defined = _prepared(planes, window, looks)
    sub = _sub_window(window)
    shift = (window - sub) // 2
    counts = _windows(defined.astype(float), sub).sum(axis=(-2, -1))
    with np.errstate(invalid="ignore", divide="ignore"):
        means = _windows(span, sub).sum(axis=(-2, -1)) / counts
        around = np.pad(means, shift, constant_values=np.nan)
        rows, columns = span.shape
        m = np.array([[around[i * shift :, j * shift :][:rows, :columns] for j in range(3)] for i in range(3)])
        m = np.where(np.isnan(m), means, m)
        gradients = np.stack(
            [
                m[:, 2].sum(axis=0) - m[:, 0].sum(axis=0),
                m[0, 1] + m[0, 2] + m[1, 2] - m[1, 0] - m[2, 0] - m[2, 1],
                m[0].sum(axis=0) - m[2].sum(axis=0),
                m[0, 0] + m[0, 1] + m[1, 0] - m[1, 2] - m[2, 1] - m[2, 2],
            ]
        )
        direction = np.abs(np.where(np.isnan(gradients), 0.0, gradients)).argmax(axis=0)
        ends = np.array([(np.abs(m[a, b] - m[1, 1]), np.abs(m[c, d] - m[1, 1])) for a, b, c, d in _SIDES])
        near, far = np.take_along_axis(ends, direction[None, None], axis=0)[0]
        half = direction + np.where(near <= far, 0, 4)
        found = np.full(given.shape, np.nan)
        for number, mask in enumerate(_masks(window)):
            total = (_windows(defined.astype(float), window) * mask).sum(axis=(-2, -1))
            mean = (_windows(span, window) * mask).sum(axis=(-2, -1)) / total
            square = (_windows(defined, window) * mask * (_windows(span, window) - mean[..., None, None]) ** 2).sum(
                axis=(-2, -1)
            )
            relative = square / total / mean**2
            weight = np.clip((relative - 1 / looks) / (relative * (1 + 1 / looks)), 0, 1)
            weight = np.where((mean > 0) & (relative > 0), weight, 0.0)
            chosen = defined & (half == number)
            for plane, values in zip(found, given.astype(np.float64), strict=True):
                average = (_windows(np.where(defined, values, 0.0), window) * mask).sum(axis=(-2, -1)) / total
                plane[chosen] = (average + weight * (values - average))[chosen]
    return found


def _prepared(planes: Planes, window: int, looks: float) -> tuple[Planes, NDArray[np.float64], NDArray[np.bool_]]:
    if window % 2 == 0 or not 5 <= window <= 31:
        raise DataError(f"a window of {window} pixels cannot be halved along edges", "take an odd number from 5 to 31")
    if not (np.isfinite(looks) and looks > 0):
        raise DataError(f"{looks:g} looks are no speckle", "give a positive number, 1 for single-look images")
    given = as_planes(planes)
    defined = np.asarray(np.isfinite(given).all(axis=0))
    span = np.where(defined, given[0].astype(np.float64) + given[5] + given[8], 0.0)
    return given, span, defined


def _sub_window(window: int) -> int:
    """Width of the nine sub-windows, which together are as wide as the window (3 of 5 and 7, 5 of 9 and 11)."""
    return 2 * (window // 4) + 1


def _halves(window: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last column offset (8, window) of each row of the eight halves; each holds the line of the edge."""
    reach = window // 2
    first, last = np.full((8, window), -reach), np.full((8, window), reach)
    for line, row in enumerate(range(-reach, reach + 1)):
        first[0, line], last[4, line] = 0, 0
        first[1, line], last[5, line] = row, row
        last[3, line], first[7, line] = -row, -row
        if row > 0:
            last[2, line] = -reach - 1
        if row < 0:
            last[6, line] = -reach - 1
    return first, last


def _masks(window: int) -> list[NDArray[np.float64]]:
    reach = window // 2
    row, column = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    halves = (
        column >= 0,
        column >= row,
        row <= 0,
        column <= -row,
        column <= 0,
        column <= row,
        row >= 0,
        column >= -row,
    )
    return [half.astype(np.float64) for half in halves]


def _windows(values: NDArray[Any], window: int) -> NDArray[Any]:
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, window // 2), (window, window))


@njit(cache=True, nogil=True, parallel=True)
def _sub_means(
    span: NDArray[np.float64], defined: NDArray[np.bool_], reach: int, means: NDArray[np.float64]
) -> None:  # fmt: skip
    rows, columns = span.shape
    for row in prange(rows):
        for column in range(columns):
            total, count = 0.0, 0
            for r in range(max(row - reach, 0), min(row + reach + 1, rows)):
                for c in range(max(column - reach, 0), min(column + reach + 1, columns)):
                    total += span[r, c]
                    count += 1 if defined[r, c] else 0
            means[row, column] = total / count if count else np.nan


@njit(cache=True, nogil=True, parallel=True)
def _image(
    planes: NDArray[Any], span: NDArray[np.float64], defined: NDArray[np.bool_], means: NDArray[np.float64],
    shift: int, first: NDArray[np.int64], last: NDArray[np.int64], noise: float, made: NDArray[Any],
) -> None:  # fmt: skip
    for band in prange(-(-planes.shape[1] // _BAND)):
        _rows(planes, span, defined, means, shift, first, last, noise, made, band * _BAND)


@njit(cache=True, nogil=True, error_model="numpy")
def _rows(
    planes: NDArray[Any], span: NDArray[np.float64], defined: NDArray[np.bool_], means: NDArray[np.float64],
    shift: int, first: NDArray[np.int64], last: NDArray[np.int64], noise: float, made: NDArray[Any], begin: int,
) -> None:  # fmt: skip
    _, rows, columns = planes.shape
    reach = first.shape[1] // 2
    end = min(begin + _BAND, rows)
    lowest, highest = max(begin - reach, 0), min(end + reach, rows)
    # The planes of one pixel side by side, zero where it is undefined; the tenth tells that it is defined.
    near = np.zeros((highest - lowest, columns, 10))
    for r in range(lowest, highest):
        for plane in range(9):
            for c in range(columns):
                near[r - lowest, c, plane] = planes[plane, r, c] if defined[r, c] else 0.0
        for c in range(columns):
            near[r - lowest, c, 9] = 1.0 if defined[r, c] else 0.0
    sums = np.empty(10)
    for row in range(begin, end):
        for column in range(columns):
            if not defined[row, column]:
                for plane in range(9):
                    made[plane, row, column] = np.nan
                continue
            half = _half(means, shift, row, column)
            above, below = max(row - reach, 0), min(row + reach, rows - 1)
            a0 = a1 = a2 = a3 = a4 = a5 = a6 = a7 = a8 = a9 = 0.0
            for r in range(above, below + 1):
                line, at = r - row + reach, r - lowest
                for c in range(max(column + first[half, line], 0), min(column + last[half, line], columns - 1) + 1):
                    a0 += near[at, c, 0]
                    a1 += near[at, c, 1]
                    a2 += near[at, c, 2]
                    a3 += near[at, c, 3]
                    a4 += near[at, c, 4]
                    a5 += near[at, c, 5]
                    a6 += near[at, c, 6]
                    a7 += near[at, c, 7]
                    a8 += near[at, c, 8]
                    a9 += near[at, c, 9]
            sums[0], sums[1], sums[2], sums[3], sums[4] = a0, a1, a2, a3, a4
            sums[5], sums[6], sums[7], sums[8], sums[9] = a5, a6, a7, a8, a9
            mean = (a0 + a5 + a8) / a9
            square = 0.0
            for r in range(above, below + 1):
                line, at = r - row + reach, r - lowest
                for c in range(max(column + first[half, line], 0), min(column + last[half, line], columns - 1) + 1):
                    square += near[at, c, 9] * (span[r, c] - mean) ** 2
            relative = square / a9 / (mean * mean)
            weight = 0.0
            if mean > 0.0 and relative > noise:
                weight = min((relative - noise) / (relative * (1.0 + noise)), 1.0)
            for plane in range(9):
                average = sums[plane] / a9
                made[plane, row, column] = average + weight * (planes[plane, row, column] - average)


@njit(cache=True, nogil=True)
def _half(means: NDArray[np.float64], shift: int, row: int, column: int) -> int:
    """Which of the eight halves lies on the pixel's side of the strongest edge."""
    rows, columns = means.shape
    middle = means[row, column]
    m = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            r, c = row + (i - 1) * shift, column + (j - 1) * shift
            inside = 0 <= r < rows and 0 <= c < columns
            value = means[r, c] if inside else np.nan
            m[i, j] = middle if np.isnan(value) else value
    gradients = (
        m[0, 2] + m[1, 2] + m[2, 2] - m[0, 0] - m[1, 0] - m[2, 0],
        m[0, 1] + m[0, 2] + m[1, 2] - m[1, 0] - m[2, 0] - m[2, 1],
        m[0, 0] + m[0, 1] + m[0, 2] - m[2, 0] - m[2, 1] - m[2, 2],
        m[0, 0] + m[0, 1] + m[1, 0] - m[1, 2] - m[2, 1] - m[2, 2],
    )
    direction = 0
    for k in range(1, 4):
        if abs(gradients[k]) > abs(gradients[direction]):
            direction = k
    if direction == 0:
        near, far = m[1, 2], m[1, 0]
    elif direction == 1:
        near, far = m[0, 2], m[2, 0]
    elif direction == 2:
        near, far = m[0, 1], m[2, 1]
    else:
        near, far = m[0, 0], m[2, 2]
    return direction if abs(near - middle) <= abs(far - middle) else direction + 4
