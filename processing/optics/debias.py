"""Degree and angle of linear polarization from noisy Stokes parameters, without the bias of noise, with errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import undefined_is_nan

Floats = NDArray[np.float64]

ROUNDING = 1e-12
"""Polarized intensity below this part of S0 is rounding of float64, and has no direction."""

WIDER, WIDER_UNTIL = 0.7, 4.5
"""How much larger than to first order the sd is where polarization drowns in noise; see :func:`widening`."""

UNKNOWN_ANGLE_SD_RAD = float(np.pi / np.sqrt(12.0))
"""Standard deviation of an angle that is uniform modulo 180 degrees; no AOP is less well known."""


def debias(polarized: ArrayLike, variance: ArrayLike) -> Floats:
    """Polarized intensity sqrt(S1^2 + S2^2) without the bias that noise gives it.

    The modified asymptotic estimator (MAS) of Plaszczynski, Montier, Levrier and Tristram 2014, MNRAS 439, 4048:
    ``p - b^2 (1 - exp(-p^2 / b^2)) / (2 p)``. It is continuous, never negative, and tends to ``p - b^2 / 2p``.

    Args:
        polarized: p, counts.
        variance: b^2, the variance across the direction of (S1, S2), counts^2.
    """
    p, b2 = np.broadcast_arrays(np.asarray(polarized, dtype=np.float64), np.asarray(variance, dtype=np.float64))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # In terms of p^2 / b^2 nothing overflows or vanishes before the estimate itself does.
        ratio = (p / np.sqrt(b2)) ** 2
        share = np.where(ratio > 0, -np.expm1(-ratio) / (2 * ratio), 0.5)
        less = np.where((b2 > 0) & (p > 0), p * share, 0.0)
    estimate: Floats = p - np.where(np.isnan(b2), np.nan, less)
    return estimate


def widening(polarized: ArrayLike, variance: ArrayLike) -> Floats:
    """Factor on the first-order sd with which 1.96 sd cover 95 % at any polarization: ``1 + 0.7 exp(-p^2 / 4.5 b^2)``.

    The polarized intensity is not Gaussian below some three sds: at p = 0 the first-order sd covers 91 % only. With the
    factor, coverage of Rice-distributed p is between 94.9 and 97.6 % (integrated numerically over its density).

    Args:
        polarized: p, counts.
        variance: b^2, the variance across the direction of (S1, S2), counts^2.
    """
    p, b2 = np.asarray(polarized, dtype=np.float64), np.asarray(variance, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        factor: Floats = 1.0 + WIDER * np.exp(-p * p / (WIDER_UNTIL * b2))
    return np.where(b2 > 0, factor, 1.0)


@undefined_is_nan
def polarization(stokes: ArrayLike, covariance: ArrayLike) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
    """Degree and angle of linear polarization with their errors (thesis 2.12, 2.14).

    Errors are of first order, that of DOLP with :func:`widening`; the bias of a quotient by a noisy S0 is taken off to
    second order.

    Args:
        stokes: (..., 3) S0, S1, S2.
        covariance: (..., 3, 3) their covariance.

    Returns:
        ``dolp`` (debiased), ``dolp_raw``, ``dolp_sd``, ``aop`` (radians, in (-pi/2, pi/2]), ``aop_sd`` (at most that of
        an unknown angle), and the sd of the polarized intensity. Where S1 and S2 vanish (to rounding) the direction is
        unknown: variances are means over directions and AOP is NaN. S0 = 0 gives NaN.
    """
    vector, c = np.asarray(stokes, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    s0, s1, s2 = vector[..., 0], vector[..., 1], vector[..., 2]
    p = np.hypot(s1, s2)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = s1 / p, s2 / p
        along = x * x * c[..., 1, 1] + y * y * c[..., 2, 2] + 2 * x * y * c[..., 1, 2]
        across = y * y * c[..., 1, 1] + x * x * c[..., 2, 2] - 2 * x * y * c[..., 1, 2]
        with_s0 = x * c[..., 0, 1] + y * c[..., 0, 2]
        mean = (c[..., 1, 1] + c[..., 2, 2]) / 2
        zero = p <= ROUNDING * np.abs(s0)
        along, across = np.where(zero, mean, along), np.where(zero, mean, across)
        with_s0 = np.where(zero, 0.0, with_s0)
        usable = np.where(s0 != 0, s0, np.nan)
        raw = p / usable
        sd = np.sqrt(np.maximum(along + raw * raw * c[..., 0, 0] - 2 * raw * with_s0, 0.0)) / np.abs(usable)
        sd = sd * widening(p, across)
        # E[p / S0] = (p - cov(p, S0) / S0 + p var(S0) / S0^2) / S0 to second order.
        debiased = (debias(p, across) * (1 - c[..., 0, 0] / usable**2) + with_s0 / usable) / usable
        aop = 0.5 * np.arctan2(s2, s1)
        aop = np.where(aop <= -np.pi / 2, np.pi / 2, aop)
        aop = np.where(zero, np.nan, aop)
        aop_sd = np.minimum(np.sqrt(np.maximum(across, 0.0)) / (2 * p), UNKNOWN_ANGLE_SD_RAD)
    return np.maximum(debiased, 0.0), raw, sd, aop, aop_sd, np.sqrt(np.maximum(along, 0.0))
