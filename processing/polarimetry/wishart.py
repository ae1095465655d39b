"""Classes of coherency matrices by the complex Wishart distribution: nearest centre, and centres found by iteration.

The distance of T from a class with mean matrix V is ``ln |V| + tr(V^-1 T)`` (Lee, Grunes and Kwok 1994, Int. J. Remote
Sensing 15(11) 2299). Iteration from the zones of entropy and alpha: Lee, Grunes, Ainsworth, Du, Schuler and Cloude
1999, IEEE TGRS 37(5) 2249. The sum of distances falls with each step, so that iteration ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.polarimetry.detection.filters import CONDITION
from processing.polarimetry.matrices import Planes, as_planes, matrix_of_planes, planes_of_matrix
from processing.polarimetry.pauli import Floats

_BAND = 16
"""Rows whose sums are made by one thread."""


@dataclass(frozen=True)
class WishartClasses:
    """What classification found."""

    classes: NDArray[np.uint8]
    """(rows, columns), from 1; 0 where undefined."""
    centres: Floats
    """(9, classes) planes of the mean matrices; NaN of a class that lost all pixels."""
    pixels: NDArray[np.int64]
    """(classes,)."""
    changed: tuple[float, ...]
    """Part of the pixels that changed their class in each iteration."""
    distance: tuple[float, ...]
    """Mean distance to the class's own centre in each iteration."""


def wishart_classify(
    planes: Planes, initial: ArrayLike, *, iterations: int = 20, least_change: float = 0.01
) -> WishartClasses:
    """Classes of T or C planes (9, rows, columns), from initial classes on, until few pixels change.

    Undefined pixels and pixels without power are in class 0. A class that is left without pixels, or whose mean matrix
    is singular (one mechanism without any noise), is given up and its pixels go to others.

    Args:
        planes: averages, see :data:`processing.polarimetry.matrices.PLANES`.
        initial: (rows, columns) class numbers from 1, up to 255; 0 for pixels that have none yet.
        iterations: at most.
        least_change: part of the pixels; iteration ends when no more than these change their class.

    Raises:
        DataError: shapes that do not fit, no initial class with a regular mean matrix, or settings that cannot be.
    """
    given = as_planes(planes)
    classes = np.array(initial, dtype=np.int64)
    if classes.shape != given.shape[1:] or classes.min(initial=0) < 0 or classes.max(initial=0) > 255:
        raise DataError(
            f"initial classes {classes.shape} do not fit an image {given.shape[1:]}", "give 0 to 255 for each pixel"
        )
    if iterations < 1 or not 0 <= least_change < 1:
        raise DataError(f"{iterations} iterations to {least_change:g}", "take one or more, and a part below 1")
    defined = _defined(given)
    classes = np.where(defined, classes, 0)
    number = int(classes.max(initial=0))
    total = max(int(defined.sum()), 1)
    changed, distances = [], []
    centres, pixels = _centres(given, classes, number)
    for _ in range(iterations):
        fresh, distance = wishart_assign(given, centres)
        changed.append(float((fresh != classes).sum() / total))
        distances.append(float(np.nansum(distance) / total))
        classes = fresh.astype(np.int64)
        centres, pixels = _centres(given, classes, number)
        if changed[-1] <= least_change:
            break
    return WishartClasses(classes.astype(np.uint8), centres, pixels, tuple(changed), tuple(distances))


def wishart_assign(planes: Planes, centres: ArrayLike) -> tuple[NDArray[np.uint8], Floats]:
    """Class (rows, columns) from 1 with the least distance, and that distance; compiled.

    Args:
        planes: (9, rows, columns); undefined pixels and those without power get class 0 and distance NaN.
        centres: (9, classes) planes of the classes' mean matrices, up to 255; those with NaN or singular ones are
            never chosen.

    Raises:
        DataError: other shapes, or no regular centre.
    """
    given, weights, constants = _assignable(planes, centres)
    classes, distance = np.zeros(given.shape[1:], dtype=np.uint8), np.full(given.shape[1:], np.nan)
    _assign(given, _defined(given), weights, constants, classes, distance)
    return classes, distance


def wishart_assign_reference(planes: Planes, centres: ArrayLike) -> tuple[NDArray[np.uint8], Floats]:
    """The definition of :func:`wishart_assign` in NumPy and float64."""
    given, weights, constants = _assignable(planes, centres)
    defined = _defined(given)
    distances = np.tensordot(weights, np.where(defined, given, 0.0).astype(np.float64), axes=(1, 0))
    distances += constants[:, None, None]
    least = np.where(defined, distances.min(axis=0), np.nan)
    return np.where(defined, distances.argmin(axis=0) + 1, 0).astype(np.uint8), least


def _defined(planes: Planes) -> NDArray[np.bool_]:
    power = planes[0].astype(np.float64) + planes[5] + planes[8]
    return np.asarray(np.isfinite(planes).all(axis=0) & (power > 0))


def _assignable(planes: Planes, centres: ArrayLike) -> tuple[Planes, Floats, Floats]:
    """Planes, weights (classes, 9) whose product with planes is tr(V^-1 T), and ln |V|; infinite where not to be."""
    given, means = as_planes(planes), np.asarray(centres, dtype=np.float64)
    if means.ndim != 2 or means.shape[0] != 9 or not 1 <= means.shape[1] <= 255:
        raise DataError(f"centres of shape {means.shape} are no classes", "give planes (9, classes) of 1 to 255")
    weights, constants = np.zeros((means.shape[1], 9)), np.full(means.shape[1], np.inf)
    for n, mean in enumerate(means.T):
        third = (mean[0] + mean[5] + mean[8]) / 3
        if not (np.isfinite(mean).all() and third > 0):
            continue
        matrix = matrix_of_planes(mean / third)
        determinant = np.linalg.det(matrix).real
        if determinant > CONDITION:
            # The trace counts each element beside the diagonal twice, as real part of a product with a conjugate.
            weights[n] = planes_of_matrix(np.linalg.inv(matrix)) * [1, 2, 2, 2, 2, 1, 2, 2, 1] / third
            constants[n] = np.log(determinant) + 3 * np.log(third)
    if not np.isfinite(constants).any():
        raise DataError(
            "no class has a regular mean matrix",
            "average over more looks, or begin with larger classes",
        )
    return given, weights, constants


def _centres(planes: Planes, classes: NDArray[np.int64], number: int) -> tuple[Floats, NDArray[np.int64]]:
    bands = -(-planes.shape[1] // _BAND)
    sums, counts = np.zeros((bands, number + 1, 9)), np.zeros((bands, number + 1), dtype=np.int64)
    _sums(planes, classes, sums, counts)
    total, pixels = sums.sum(axis=0)[1:], counts.sum(axis=0)[1:]
    with np.errstate(invalid="ignore"):
        return np.asarray((total / pixels[:, None]).T), pixels


@njit(cache=True, nogil=True, parallel=True)
def _assign(
    planes: NDArray[Any], defined: NDArray[np.bool_], weights: NDArray[np.float64], constants: NDArray[np.float64],
    classes: NDArray[np.uint8], distance: NDArray[np.float64],
) -> None:  # fmt: skip
    for row in prange(planes.shape[1]):
        for column in range(planes.shape[2]):
            if not defined[row, column]:
                continue
            best, least = 0, np.inf
            for n in range(len(constants)):
                if constants[n] == np.inf:
                    continue
                total = constants[n]
                for plane in range(9):
                    total += weights[n, plane] * planes[plane, row, column]
                if total < least:
                    best, least = n + 1, total
            classes[row, column] = best
            distance[row, column] = least


@njit(cache=True, nogil=True, parallel=True)
def _sums(
    planes: NDArray[Any], classes: NDArray[np.int64], sums: NDArray[np.float64], counts: NDArray[np.int64]
) -> None:  # fmt: skip
    for band in prange(sums.shape[0]):
        for row in range(band * _BAND, min((band + 1) * _BAND, planes.shape[1])):
            for column in range(planes.shape[2]):
                n = classes[row, column]
                counts[band, n] += 1
                if n > 0:
                    for plane in range(9):
                        sums[band, n, plane] += planes[plane, row, column]
