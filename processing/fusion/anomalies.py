"""What stands out, and what looks like a known target: RX, local RX, constrained energy minimisation, matched filter.

Features are stacked planes (d, rows, columns), such as the fused vector; pixels with a NaN get NaN everywhere.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.fusion.separability import SINGULAR, Statistics, class_statistics

Floats = NDArray[np.float64]

SAMPLES_PER_FEATURE = 5
"""Fewest samples of a ring for each feature: an inverse covariance of fewer is mostly noise (Reed, Mallett and
Brennan 1974: twice as many cost 3 dB)."""


def reed_xiaoli(features: ArrayLike, background: Statistics | None = None) -> Floats:
    """RX anomaly score ``(x - mu)^T C^-1 (x - mu)`` of every pixel.

    Args:
        features: (d, ...) feature planes; NaN pixels get NaN.
        background: the background's statistics; those of all defined pixels if left out. For normal data the scores
            then follow a chi-square distribution with d degrees of freedom.

    Returns:
        (...) scores.

    Raises:
        DataError: a singular covariance.
    """
    planes, samples = _samples(features)
    known = class_statistics(samples, "background") if background is None else background
    whitened = np.linalg.solve(_factor(known, len(planes)), (samples - known.mean).T)
    return np.asarray(np.sum(whitened**2, axis=0).reshape(planes.shape[1:]))


def local_reed_xiaoli(features: ArrayLike, *, guard: int = 2, reach: int = 8) -> Floats:
    """RX against the ring around each pixel: what differs from its own neighbourhood.

    The ring's mean and covariance are estimated from ``m`` samples, so that for normal data the score times
    ``m (m - d) / ((m^2 - 1) d)`` follows an F distribution with d and m - d degrees of freedom (Hotelling).

    Args:
        features: (d, rows, columns).
        guard: half the width of the square left out around the pixel, pixels: larger than a target.
        reach: half the width of the outer square, pixels.

    Returns:
        (rows, columns) scores; NaN where fewer than :data:`SAMPLES_PER_FEATURE` samples for each feature are defined in
        the ring, or where their covariance is singular.

    Raises:
        DataError: no image, or a ring without pixels.
    """
    planes = np.ascontiguousarray(features, dtype=np.float64)
    if planes.ndim != 3 or not 0 <= guard < reach:
        raise DataError(
            f"features of shape {planes.shape}, a guard of {guard} and a reach of {reach} pixels",
            "give (d, rows, columns) and a reach larger than the guard",
        )
    scores = np.empty(planes.shape[1:])
    _local(planes, guard, reach, SAMPLES_PER_FEATURE * len(planes), scores)
    return scores


def local_reed_xiaoli_reference(features: ArrayLike, *, guard: int = 2, reach: int = 8) -> Floats:
    """:func:`local_reed_xiaoli` in plain NumPy, pixel by pixel."""
    planes = np.asarray(features, dtype=np.float64)
    dimensions, rows, columns = planes.shape
    scores = np.full((rows, columns), np.nan)
    for r in range(rows):
        for c in range(columns):
            here = planes[:, r, c]
            top, left = max(r - reach, 0), max(c - reach, 0)
            window = planes[:, top : r + reach + 1, left : c + reach + 1].copy()
            window[
                :, max(r - guard - top, 0) : r - top + guard + 1, max(c - guard - left, 0) : c - left + guard + 1
            ] = np.nan
            ring = window.reshape(dimensions, -1)
            ring = ring[:, np.isfinite(ring).all(axis=0)]
            if not np.isfinite(here).all() or ring.shape[1] < SAMPLES_PER_FEATURE * dimensions:
                continue
            covariance = np.atleast_2d(np.cov(ring))
            try:
                factor = np.linalg.cholesky(covariance)
            except np.linalg.LinAlgError:
                continue
            scores[r, c] = np.sum(np.linalg.solve(factor, here - ring.mean(axis=1)) ** 2)
    return scores


def constrained_energy(features: ArrayLike, target: ArrayLike) -> Floats:
    """Constrained energy minimisation: the filter that answers 1 to a target, else little (thesis 3.3.1, SPOT).

    ``w = R^-1 d / (d^T R^-1 d)`` with the correlation matrix R of all defined pixels (Harsanyi 1993).

    Args:
        features: (d, ...).
        target: (d,) the target's features.

    Returns:
        (...) answers.

    Raises:
        DataError: a target of another length or without any feature, or features that depend on each other.
    """
    planes, samples = _samples(features)
    wanted = _target(target, len(planes))
    defined = samples[np.isfinite(samples).all(axis=1)]
    if len(defined) < len(planes):
        raise DataError(f"{len(defined)} defined pixels for {len(planes)} features", "use a larger image")
    correlation = Statistics("image", np.zeros(len(planes)), defined.T @ defined / len(defined), len(defined))
    factor = _factor(correlation, len(planes))
    white = np.linalg.solve(factor, wanted)
    answers = (white @ np.linalg.solve(factor, samples.T)) / (white @ white)
    return np.asarray(answers.reshape(planes.shape[1:]))


def matched_filter(features: ArrayLike, target: ArrayLike, background: Statistics | None = None) -> Floats:
    """Matched filter for a known target in normal clutter: 0 at the background's mean, 1 at the target.

    ``(d - mu)^T C^-1 (x - mu) / ((d - mu)^T C^-1 (d - mu))``; over clutter its standard deviation is 1 over the
    target's Mahalanobis distance (Manolakis and Shaw 2002).

    Args:
        features: (d, ...).
        target: (d,) the target's features.
        background: statistics of the clutter; of all defined pixels if left out.

    Returns:
        (...) answers.

    Raises:
        DataError: a target of another length or equal to the background, or a singular covariance.
    """
    planes, samples = _samples(features)
    wanted = _target(target, len(planes))
    known = class_statistics(samples, "background") if background is None else background
    factor = _factor(known, len(planes))
    white = np.linalg.solve(factor, wanted - known.mean)
    power = float(white @ white)
    if power == 0:
        raise DataError("the target is the background's mean", "choose a target that differs from it")
    answers = white @ np.linalg.solve(factor, (samples - known.mean).T) / power
    return np.asarray(answers.reshape(planes.shape[1:]))


def _samples(features: ArrayLike) -> tuple[Floats, Floats]:
    """Planes (d, ...) and samples (n, d); a NaN in one feature is one in all."""
    planes = np.asarray(features, dtype=np.float64)
    samples = planes.reshape(len(planes), -1).T.copy()
    samples[~np.isfinite(samples).all(axis=1)] = np.nan
    return planes, samples


def _target(target: ArrayLike, dimensions: int) -> Floats:
    wanted = np.asarray(target, dtype=np.float64)
    if wanted.shape != (dimensions,) or not np.isfinite(wanted).all() or not wanted.any():
        raise DataError(
            f"a target {wanted} for {dimensions} features", "give one finite number a feature, not all zero"
        )
    return wanted


def _factor(known: Statistics, dimensions: int) -> Floats:
    if known.mean.shape != (dimensions,):
        raise DataError(f"{dimensions} features, background has {len(known.mean)}", "use the same features")
    eigenvalues = np.linalg.eigvalsh(known.covariance)
    if not eigenvalues[0] > SINGULAR * eigenvalues[-1]:
        raise DataError("the background's covariance is not positive definite", "use a larger background")
    return np.asarray(np.linalg.cholesky(known.covariance))


@njit(cache=True, nogil=True)
def _local(planes: NDArray[Any], guard: int, reach: int, least: int, scores: NDArray[Any]) -> None:
    dimensions, rows, columns = planes.shape
    for r in range(rows):
        total = np.empty(dimensions)
        products = np.empty((dimensions, dimensions))
        away = np.empty(dimensions)
        for c in range(columns):
            scores[r, c] = np.nan
            total[:] = 0.0
            products[:] = 0.0
            count = 0
            for row in range(max(r - reach, 0), min(r + reach + 1, rows)):
                for column in range(max(c - reach, 0), min(c + reach + 1, columns)):
                    if abs(row - r) <= guard and abs(column - c) <= guard:
                        continue
                    sound = True
                    for i in range(dimensions):
                        # From the pixel itself, so that little cancels where the image hardly varies.
                        away[i] = planes[i, row, column] - planes[i, r, c]
                        sound &= np.isfinite(away[i])
                    if not sound:
                        continue
                    count += 1
                    for i in range(dimensions):
                        total[i] += away[i]
                        for j in range(i + 1):
                            products[i, j] += away[i] * away[j]
            if count < least:
                continue
            scores[r, c] = _distance(total / count, products, count)


@njit(cache=True, nogil=True)
def _distance(mean: NDArray[Any], products: NDArray[Any], count: int) -> float:
    """Squared Mahalanobis distance of the mean from zero, with the covariance of sums of products about zero."""
    dimensions = len(mean)
    factor = np.zeros((dimensions, dimensions))
    white = np.zeros(dimensions)
    score = 0.0
    for i in range(dimensions):
        for j in range(i + 1):
            value = (products[i, j] - count * mean[i] * mean[j]) / (count - 1)
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            if i > j:
                factor[i, j] = value / factor[j, j]
            elif not value > 1e-14 * products[i, i]:
                return np.nan
            else:
                factor[i, i] = np.sqrt(value)
        value = mean[i]
        for k in range(i):
            value -= factor[i, k] * white[k]
        white[i] = value / factor[i, i]
        score += white[i] ** 2
    return score
