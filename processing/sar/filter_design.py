"""Interpolation filters that are optimal for a band: least squares over all frequencies and places between samples.

A sum of weighted samples has the error ``sum_k w_k(x) exp(j k u) - exp(j x u)`` at the frequency u and the place x.
Windowed sincs (Kaiser's and others) make it small without asking where the band ends; here its mean square over the
band is the smallest that so many samples allow (Oetken, Parks, Schuessler 1975), for weights of any form, or for those
that are polynomials in the place (Farrow 1988), which kernels evaluate at the cost of the polynomial's degree alone.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

NODES = 48
"""Frequencies and places (Gauss-Legendre) of the sums that stand for integrals."""

HARDLY_DB = 1.5
"""A degree is high enough when more of it gains no more than that."""

LARGEST_DEGREE = 9

_POWERS = np.array(
    [np.pad(legendre.leg2poly([0] * n + [1]), (0, LARGEST_DEGREE - n)) for n in range(LARGEST_DEGREE + 1)]
)
"""Coefficients of the Legendre polynomials by powers, a row for each."""


def least_squares_weights(fraction: ArrayLike, taps: int, oversampling: float) -> NDArray[np.float64]:
    """Weights of least mean square error over a band, for every place on its own.

    Args:
        fraction: place between the two middle samples, 0 to 1, any shape.
        taps: even number of samples.
        oversampling: how many times finer than its band the signal is sampled, at least 1.

    Returns:
        (..., taps) weights of the samples ``floor(t) - taps/2 + 1`` to ``floor(t) + taps/2``.
    """
    x = np.asarray(fraction, dtype=np.float64)
    cycles, weight = _band(oversampling)
    solve = _solution(taps, cycles, weight)
    wanted = np.exp(2j * np.pi * np.outer(x.ravel(), cycles)) * weight
    weights: NDArray[np.float64] = (_real(wanted) @ solve).reshape(*x.shape, taps)
    return weights


@functools.lru_cache(maxsize=256)
def least_squares_polynomials(taps: int, oversampling: float, degree: int) -> NDArray[np.float64]:
    """Coefficients (degree + 1, taps), lowest power first, of weights that are polynomials in ``fraction - 1/2``.

    Arguments as in :func:`least_squares_weights`; the mean square error is that over all places.
    """
    u, place_weight = legendre.leggauss(NODES)
    cycles, weight = _band(oversampling)
    solve = _solution(taps, cycles, weight)
    waves = np.exp(2j * np.pi * np.outer((u + 1) / 2, cycles)) * weight
    # Legendre polynomials are orthogonal: the projection onto them is a product.
    basis = legendre.legvander(u, degree)
    series = (np.arange(degree + 1) + 0.5)[:, None] * (basis.T * place_weight) @ (_real(waves) @ solve)
    # The nodes' u is twice the place from the middle.
    scaled: NDArray[np.float64] = 2.0 ** np.arange(degree + 1)[:, None] * (
        _POWERS[: degree + 1, : degree + 1].T @ series
    )
    scaled.setflags(write=False)
    return scaled


@functools.lru_cache(maxsize=64)
def polynomials_for(taps: int, oversampling: float, error_db: float) -> NDArray[np.float64]:
    """:func:`least_squares_polynomials` of the lowest degree whose error is small enough, or hardly gets smaller.

    Where it is smaller than was asked for, the difference is spent on a wider band, for what little there is beside the
    nominal one.

    Args:
        taps: even number of samples.
        oversampling: of the signal.
        error_db: root mean square error that is small enough, dB.
    """
    best = polynomial_error_db(least_squares_polynomials(taps, oversampling, LARGEST_DEGREE), oversampling)
    for degree in range(1, LARGEST_DEGREE + 1):
        found = least_squares_polynomials(taps, oversampling, degree)
        if polynomial_error_db(found, oversampling) <= max(error_db, best + HARDLY_DB):
            break
    narrow, wide = oversampling, 1.0
    for _ in range(10):
        between = 0.5 * (narrow + wide)
        wider = least_squares_polynomials(taps, between, len(found) - 1)
        if polynomial_error_db(wider, oversampling) <= error_db:
            narrow, found = between, wider
        else:
            wide = between
    return found


def polynomial_error_db(polynomials: NDArray[np.float64], oversampling: float) -> float:
    """Root mean square error of such weights over an evenly filled band and all places, dB."""
    u, place_weight = legendre.leggauss(NODES)
    cycles, weight = _band(oversampling)
    degree, taps = polynomials.shape
    made = np.vander(u / 2, degree, increasing=True) @ polynomials @ _waves(taps, cycles)
    error = np.abs(made - np.exp(2j * np.pi * np.outer((u + 1) / 2, cycles))) ** 2
    return 10 * math.log10(float(place_weight @ error @ weight**2) / 2 + 1e-300)


def _band(oversampling: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies of the band in cycles per sample, and roots of their weights, whose squares' sum is 1."""
    u, weight = legendre.leggauss(NODES)
    return u / (2 * max(oversampling, 1.0)), np.sqrt(weight / 2)


def _waves(taps: int, cycles: NDArray[np.float64]) -> NDArray[np.complex128]:
    waves: NDArray[np.complex128] = np.exp(2j * np.pi * np.outer(np.arange(1 - taps // 2, taps // 2 + 1), cycles))
    return waves


def _solution(taps: int, cycles: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """What makes the weights of a wanted wave, (2 frequencies, taps)."""
    # Narrow bands leave combinations of samples that see nothing of them; those stay zero.
    return np.asarray(np.linalg.pinv(_real(_waves(taps, cycles) * weight), rcond=1e-13), dtype=np.float64)


def _real(waves: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.concatenate([waves.real, waves.imag], axis=-1)
