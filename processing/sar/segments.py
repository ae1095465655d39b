"""Range profiles as polynomials between bins, so that kernels interpolate with any filter at the cost of a polynomial.

A filter's weights are smooth functions of the place between two bins. Written as polynomials in it and summed over the
taps once for every bin, they leave one complex polynomial for each segment from bin to bin (Farrow 1988): what a kernel
evaluates costs by the polynomial's degree, whatever the number of taps. Linear, cubic and Lagrange filters are such
polynomials, and so is the filter of eight taps that was designed for it; Kaiser-windowed sincs are fitted closely
enough that their own error is not changed.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.polynomial import Polynomial, chebyshev
from numpy.typing import NDArray

from processing.sar.interpolation import sinc8_polynomials, tap_weights, taps_of
from processing.simd import fma, load, splat, store, to_float32

MARGIN = 64
"""Undefined segments on either side of a table: what lies off the range axis is read from them."""

FIT_MARGIN_DB = 26.0
"""How far the error of the fit stays below the filter's own."""

FLOOR_DB = -150.0
"""No fit is made finer than float32 tables can hold."""

LARGEST_DEGREE = 9

_EXACT = {"linear": 1, "cubic": 3, "lagrange4": 3}


@functools.lru_cache(maxsize=64)
def segment_polynomials(interpolator: str, oversampling: float) -> NDArray[np.float64]:
    """Coefficients (degree + 1, taps) of a filter's weights in ``w = place - bin - 1/2``, lowest power first.

    Args:
        interpolator: as in :func:`processing.sar.interpolation.tap_weights`.
        oversampling: bins per resolution cell.

    Raises:
        DataError: there is no interpolator of that name.
    """
    taps_of(interpolator)
    if interpolator == "sinc8":
        return sinc8_polynomials(oversampling)
    own = filter_error_db(interpolator, oversampling)
    for degree in range(_EXACT.get(interpolator, 1), LARGEST_DEGREE + 1):
        fitted = _fit(interpolator, oversampling, degree)
        wanted = max(own - FIT_MARGIN_DB, FLOOR_DB)
        if interpolator in _EXACT or _response_db(interpolator, oversampling, fitted) <= wanted:
            break
    fitted.setflags(write=False)
    return fitted


@functools.lru_cache(maxsize=64)
def filter_error_db(interpolator: str, oversampling: float) -> float:
    """Root mean square error of a filter over an evenly filled band, dB: what back-projection with it errs by.

    Raises:
        DataError: there is no interpolator of that name.
    """
    return _response_db(interpolator, oversampling, None)


def _fit(interpolator: str, oversampling: float, degree: int) -> NDArray[np.float64]:
    """Least squares at Chebyshev places, which is close to the smallest largest error."""
    u = np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    series = chebyshev.chebfit(u, tap_weights(interpolator, (u + 1) / 2, oversampling), degree)
    scaled = np.zeros((degree + 1, series.shape[1]))
    for tap in range(series.shape[1]):
        powers = Polynomial(chebyshev.cheb2poly(series[:, tap]))(Polynomial([0.0, 2.0])).coef
        scaled[: len(powers), tap] = powers
    return scaled


def _response_db(interpolator: str, oversampling: float, fitted: NDArray[np.float64] | None) -> float:
    """Error over the band of a filter against the exact shift, or of its fit against it, dB."""
    w = np.linspace(0, 1, 65)
    taps = tap_weights(interpolator, w, oversampling)
    bins = np.arange(1 - taps.shape[1] // 2, taps.shape[1] // 2 + 1)
    cycles = np.linspace(-0.5, 0.5, 65) / max(oversampling, 1.0)
    if fitted is None:
        error = taps @ np.exp(2j * np.pi * np.outer(bins, cycles)) - np.exp(2j * np.pi * np.outer(w, cycles))
    else:
        error = (np.vander(w - 0.5, len(fitted), increasing=True) @ fitted - taps) @ np.exp(
            2j * np.pi * np.outer(bins, cycles)
        )
    return float(20 * np.log10(np.sqrt(np.mean(np.abs(error) ** 2)) + 1e-300))


def table_stride(bins: int) -> int:
    """Floats from one row of a table to the next: an odd number of cache lines, so that rows do not collide."""
    lines = -(-(bins - 1 + 2 * MARGIN) // 16)
    return 16 * (lines | 1)


def segment_tables(
    values: NDArray[np.complexfloating], weights: NDArray[np.float64], polynomials: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Tables of weighted profiles, flat float32: (pulses, channels, powers from the highest, re and im, stride).

    Row entry ``MARGIN + n`` is the segment from bin n to n + 1; NaN where a tap is undefined or off the axis.

    Args:
        values: (channels, pulses, bins).
        weights: (channels, pulses) factors.
        polynomials: (degree + 1, taps) of :func:`segment_polynomials`.
    """
    channels, pulses, bins = values.shape
    table = np.empty(pulses * channels * 2 * len(polynomials) * table_stride(bins), dtype=np.float32)
    _fill(values, weights, np.ascontiguousarray(polynomials), table_stride(bins), table)
    return table


@njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _fill(values: Any, weights: Any, polynomials: Any, stride: int, table: Any) -> None:
    channels, pulses, bins = values.shape
    powers, taps = polynomials.shape
    segments = max(bins - taps + 1, 0)
    first = MARGIN + taps // 2 - 1
    for job in prange(pulses * channels):
        pulse, channel = job // channels, job % channels
        # Sixteen sums at a time: some beyond the end are read, and put where NaN comes afterwards.
        re, im = np.zeros(bins + 16), np.zeros(bins + 16)
        for n in range(bins):
            value = values[channel, pulse, n]
            re[n] = value.real * weights[channel, pulse]
            im[n] = value.imag * weights[channel, pulse]
        for row in range(2 * powers):
            part = re if row % 2 == 0 else im
            power = powers - 1 - row // 2
            start = (job * 2 * powers + row) * stride
            for n in range(0, segments, 16):
                total = splat(polynomials[power, 0]) * load(part, n)
                for tap in range(1, taps):
                    total = fma(splat(polynomials[power, tap]), load(part, n + tap), total)
                store(table, start + first + n, to_float32(total))
            for n in range(first):
                table[start + n] = np.nan
            for n in range(first + segments, stride):
                table[start + n] = np.nan
