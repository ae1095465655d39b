"""How much speckle there is, and what a filter does to edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError, undefined_is_nan


def equivalent_looks(intensity: ArrayLike) -> float:
    """(mean / deviation)^2 of intensities over even ground, NaN left out; infinite where they are all the same.

    Raises:
        DataError: fewer than two defined pixels, or no power.
    """
    values = np.asarray(intensity, dtype=np.float64).ravel()
    values = values[np.isfinite(values)]
    if values.size < 2 or not values.mean() > 0:
        raise DataError("no looks can be counted without power in two pixels or more", "choose a larger region")
    variance = values.var(ddof=1)
    return float(values.mean() ** 2 / variance) if variance > 0 else float("inf")


def matrix_looks(planes: ArrayLike) -> float:
    """Looks of the matrices (9, ...) over even ground, by their trace moments; NaN pixels left out.

    ``(tr S)^2 / (<tr T T> - tr S S)`` with S the mean: all elements count, so that it varies less than the looks of
    one intensity (Anfinsen, Doulgeris and Eltoft 2009, IEEE TGRS 47(11) 3795).

    Raises:
        DataError: fewer than two defined pixels, or no power.
    """
    given = np.asarray(planes, dtype=np.float64).reshape(9, -1)
    given = given[:, np.isfinite(given).all(axis=0)]
    if given.shape[1] < 2:
        raise DataError("no looks can be counted in fewer than two pixels", "choose a larger region")
    # tr T T of a Hermitian matrix is the sum of all squared moduli.
    weights = np.array([1, 2, 2, 2, 2, 1, 2, 2, 1], dtype=np.float64)
    mean = given.mean(axis=1)
    trace = mean[0] + mean[5] + mean[8]
    if not trace > 0:
        raise DataError("no looks can be counted without power", "choose another region")
    excess = float(weights @ ((given - mean[:, None]) ** 2).mean(axis=1))
    return float(trace**2 / excess) if excess > 0 else float("inf")


@undefined_is_nan
def estimated_looks(intensity: ArrayLike, window: int = 7) -> float:
    """Equivalent looks of an image whose even regions are not known: the most frequent of its windows' own looks.

    The mode, as the half-sample mode (Bickel and Frühwirth 2006), because windows with texture or edges have too few
    looks and are many. Windows do not overlap; those with a NaN or without power are left out.

    Args:
        intensity: (rows, columns), such as the span.
        window: width, pixels.

    Raises:
        DataError: fewer than eight whole windows.
    """
    values = np.asarray(intensity, dtype=np.float64)
    rows, columns = (n // window * window for n in values.shape)
    blocks = values[:rows, :columns].reshape(rows // window, window, columns // window, window)
    tiles = blocks.transpose(0, 2, 1, 3).reshape(-1, window**2)
    mean, variance = tiles.mean(axis=1), tiles.var(axis=1, ddof=1)
    sound = np.isfinite(mean) & np.isfinite(variance) & (mean > 0) & (variance > 0)
    if sound.sum() < 8:
        raise DataError(
            f"the looks of {values.shape[0]} x {values.shape[1]} pixels cannot be estimated",
            f"give the number of looks, or an image with eight windows of {window} x {window} defined pixels",
        )
    logarithms = np.sort(np.log(mean[sound] ** 2 / variance[sound]))
    return float(np.exp(_half_sample_mode(logarithms)))


def edge_kept(filtered: ArrayLike, truth: ArrayLike, edge: int) -> float:
    """How much of a straight edge's step is left between the two columns beside it: 1 all, about 1 / window of a mean.

    Args:
        filtered: intensity (rows, columns) of a filtered image.
        truth: intensity without speckle, constant on both sides.
        edge: first column of the right side.

    Raises:
        DataError: there is no step at that column.
    """
    image, known = (np.asarray(part, dtype=np.float64) for part in (filtered, truth))
    step = np.mean(known[:, edge] - known[:, edge - 1])
    if not abs(step) > 0:
        raise DataError(f"there is no edge at column {edge}", "give the first column behind the edge")
    return float(np.nanmean(image[:, edge] - image[:, edge - 1]) / step)


def _half_sample_mode(ordered: NDArray[np.float64]) -> float:
    while len(ordered) > 2:
        half = -(-len(ordered) // 2)
        widths = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
        begin = int(widths.argmin())
        ordered = ordered[begin : begin + half]
    return float(ordered.mean())
