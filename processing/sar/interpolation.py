"""Interpolation of range profiles between bins: short FIR filters, exact in float64 and as tables for kernels.

A profile that is oversampled by q (bins per resolution cell c / 2B) fills the fraction 1/q of its sampled band. The
finer it is sampled, the shorter a filter may be for the same error; :mod:`processing.sar.planner` holds the measured
trade.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.sar.filter_design import polynomials_for

INTERPOLATOR_TAPS = {"linear": 2, "cubic": 4, "lagrange4": 4, "kaiser8": 8, "sinc8": 8, "sinc16": 16}
"""Bins that each interpolator reads; half of them on either side of the wanted place."""

SINC8_DB = -115.0
"""Error at which eight taps' polynomials are exact enough."""

TABLE_STEPS = 512
"""Intervals per bin of the kernels' tables; with linear interpolation between entries their error is below -118 dB."""


def taps_of(interpolator: str) -> int:
    """Number of bins that an interpolator reads.

    Raises:
        DataError: there is no interpolator of that name.
    """
    if interpolator not in INTERPOLATOR_TAPS:
        raise DataError(
            f"there is no interpolator called {interpolator!r}", f"choose one of {', '.join(INTERPOLATOR_TAPS)}"
        )
    return INTERPOLATOR_TAPS[interpolator]


def check_bins(interpolator: str, bins: int) -> int:
    """Number of bins that an interpolator reads, where a range axis has as many.

    Raises:
        DataError: there is no interpolator of that name, or the axis is too short for it.
    """
    taps = taps_of(interpolator)
    if bins < taps:
        raise DataError(
            f"{bins} range bins are fewer than the {taps} that {interpolator} interpolation reads",
            "keep a longer range axis",
        )
    return taps


def sinc_weights(fraction: ArrayLike, taps: int, oversampling: float) -> NDArray[np.float64]:
    """Weights of a Kaiser-windowed sinc of any even length.

    The window's first null is laid on the first image of the band (Harris 1978), so that the weights suit profiles
    oversampled by ``oversampling``; where the band leaves no room for that, the window is left open.

    Args:
        fraction: place between the two middle bins, 0 to 1, any shape; weights of an undefined one are NaN.
        taps: even number of bins.
        oversampling: bins per resolution cell, at least 1.

    Returns:
        (..., taps) weights of the bins ``floor(t) - taps/2 + 1`` to ``floor(t) + taps/2``.
    """
    half = taps // 2
    beta = max(math.pi * half * (1 - 1 / max(oversampling, 1.0)), 2.5)
    away = _place(fraction)[..., None] - np.arange(1 - half, half + 1)
    window = np.i0(beta * np.sqrt(np.clip(1 - (away / half) ** 2, 0, None))) / np.i0(beta)
    weights: NDArray[np.float64] = np.sinc(away) * window
    return weights


def tap_weights(interpolator: str, fraction: ArrayLike, oversampling: float) -> NDArray[np.float64]:
    """Weights of the bins around a place, in float64; the definition that the kernels' tables follow.

    Args:
        interpolator: ``"linear"``, ``"cubic"`` (Keys 1981, a = -1/2), ``"lagrange4"``, ``"kaiser8"`` and ``"sinc16"``
            (sincs with Kaiser's window), or ``"sinc8"`` (of all eight taps whose weights are polynomials those that
            come closest to the sinc's work on the band, :mod:`processing.sar.filter_design`).
        fraction: place between the two middle bins, 0 to 1, any shape; weights of an undefined one are NaN.
        oversampling: bins per resolution cell; only the sincs depend on it.

    Returns:
        (..., taps) weights of the bins ``floor(t) - taps/2 + 1`` to ``floor(t) + taps/2``.

    Raises:
        DataError: there is no interpolator of that name.
    """
    taps = taps_of(interpolator)
    w = _place(fraction)
    if interpolator == "linear":
        return np.stack([1 - w, w], axis=-1)
    if interpolator == "cubic":
        return np.stack(
            [
                ((-0.5 * w + 1) * w - 0.5) * w,
                (1.5 * w - 2.5) * w * w + 1,
                ((-1.5 * w + 2) * w + 0.5) * w,
                (0.5 * w - 0.5) * w * w,
            ],
            axis=-1,
        )
    if interpolator == "lagrange4":
        return np.stack(
            [
                -w * (w - 1) * (w - 2) / 6,
                (w + 1) * (w - 1) * (w - 2) / 2,
                -(w + 1) * w * (w - 2) / 2,
                (w + 1) * w * (w - 1) / 6,
            ],
            axis=-1,
        )
    if interpolator == "sinc8":
        polynomials = sinc8_polynomials(oversampling)
        weights: NDArray[np.float64] = (w[..., None] - 0.5) ** np.arange(len(polynomials)) @ polynomials
        return weights
    return sinc_weights(w, taps, oversampling)


def _place(fraction: ArrayLike) -> NDArray[np.float64]:
    """Infinity is no place: as NaN it goes through sums, sines and powers without a warning."""
    w = np.asarray(fraction, dtype=np.float64)
    return np.where(np.isfinite(w), w, np.nan)


def sinc8_polynomials(oversampling: float) -> NDArray[np.float64]:
    """The filter ``"sinc8"``: (degree + 1, 8) coefficients in ``fraction - 1/2``, lowest power first."""
    return polynomials_for(INTERPOLATOR_TAPS["sinc8"], max(round(float(oversampling), 9), 1.0), SINC8_DB)


def tap_table(interpolator: str, oversampling: float) -> NDArray[np.float32]:
    """Weights on ``TABLE_STEPS + 1`` equidistant fractions, (TABLE_STEPS + 1, taps) float32, for the kernels."""
    fractions = np.arange(TABLE_STEPS + 1) / TABLE_STEPS
    return tap_weights(interpolator, fractions, oversampling).astype(np.float32)
