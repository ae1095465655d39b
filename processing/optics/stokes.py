"""From intensities behind a polarizer to Stokes parameters, DOLP and AOP, with their errors and what to mistrust.

:func:`stokes_planes` is the fast way (one pass, numba); :func:`stokes_planes_reference` is its definition in plain
float64 NumPy.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.optics.series import PolarizerSeries

Floats = NDArray[np.float64]

PLANES = ("s0", "s1", "s2", "s0_sd", "dolp", "dolp_raw", "dolp_sd", "aop", "aop_sd")
"""Order of the planes that both implementations fill."""

SHADOW_SNR = 10.0
"""S0 below this many of its standard deviations is shadow: DOLP's own sd would be some 0.14 there."""

AOP_SNR = 2.0
"""Polarized intensity below this many of its standard deviations has no direction."""

_ROUNDING = 1e-12
"""Polarized intensity below this part of S0 is rounding of float64, and has no direction."""

UNKNOWN_ANGLE_SD_RAD = float(np.pi / np.sqrt(12.0))
"""Standard deviation of an angle that is uniform modulo 180 degrees; no AOP is less well known."""


class Flag(enum.IntFlag):
    """Why a pixel is to be mistrusted. Bits of the flag plane (uint8)."""

    SATURATED = 1
    """At or above the saturation level in a frame: everything is NaN."""
    SHADOW = 2
    """S0 too low for its noise: DOLP and AOP are NaN."""
    ABOVE_ONE = 4
    """Debiased DOLP above 1, which no light has: DOLP is NaN, the raw one is kept."""
    UNPOLARIZED = 8
    """Polarized intensity lost in noise: AOP is NaN."""
    INCOMPLETE = 16
    """An angle has no usable frame here: solved from the others, or NaN where an intensity is undefined."""


@dataclass(frozen=True)
class StokesImage:
    """Stokes parameters (counts above black), DOLP and AOP (radians) of every pixel: float32 planes (rows, columns).

    ``dolp`` is debiased, ``dolp_raw`` is not; ``*_sd`` are standard deviations from random noise. Undefined values are
    NaN, with the reason in ``flags`` (:class:`Flag`).
    """

    s0: NDArray[np.floating]
    s1: NDArray[np.floating]
    s2: NDArray[np.floating]
    s0_sd: NDArray[np.floating]
    dolp: NDArray[np.floating]
    dolp_raw: NDArray[np.floating]
    dolp_sd: NDArray[np.floating]
    aop: NDArray[np.floating]
    aop_sd: NDArray[np.floating]
    flags: NDArray[np.uint8]

    @property
    def masked_fraction(self) -> float:
        """Fraction of pixels whose DOLP is undefined."""
        return float(np.mean(~np.isfinite(self.dolp)))

    @property
    def dolp_median(self) -> float:
        """Median of the defined DOLP; NaN when none is."""
        defined = self.dolp[np.isfinite(self.dolp)]
        return float(np.median(defined)) if defined.size else float("nan")


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
        less = np.where((b2 > 0) & (p > 0), -b2 * np.expm1(-p * p / b2) / (2 * p), 0.0)
    estimate: Floats = p - np.where(np.isnan(b2), np.nan, less)
    return estimate


def polarization(stokes: ArrayLike, covariance: ArrayLike) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
    """Degree and angle of linear polarization with their first-order errors (thesis 2.12, 2.14).

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
        zero = p <= _ROUNDING * np.abs(s0)
        along, across = np.where(zero, mean, along), np.where(zero, mean, across)
        with_s0 = np.where(zero, 0.0, with_s0)
        usable = np.where(s0 != 0, s0, np.nan)
        raw = p / usable
        sd = np.sqrt(np.maximum(along + raw * raw * c[..., 0, 0] - 2 * raw * with_s0, 0.0)) / np.abs(usable)
        aop = 0.5 * np.arctan2(s2, s1)
        aop = np.where(aop <= -np.pi / 2, np.pi / 2, aop)
        aop = np.where(zero, np.nan, aop)
        aop_sd = np.minimum(np.sqrt(np.maximum(across, 0.0)) / (2 * p), UNKNOWN_ANGLE_SD_RAD)
    return debias(p, across) / usable, raw, sd, aop, aop_sd, np.sqrt(np.maximum(along, 0.0))


def stokes_planes_reference(
    light: NDArray[np.floating], saturated: NDArray[np.bool_], series: PolarizerSeries, *, incomplete: bool = False
) -> tuple[Floats, NDArray[np.uint8]]:
    """Plain float64 definition of :func:`stokes_planes`; same arguments and results, in float64."""
    _check(light, saturated, series)
    solution = series.solution()
    images = np.moveaxis(np.asarray(light, dtype=np.float64), 0, -1)
    stokes = images @ solution.T
    variance = series.noise.variance(images) / np.asarray(series.frames)
    common = solution.sum(axis=1)
    covariance = np.einsum("ik,...k,jk->...ij", solution, variance, solution)
    covariance = covariance + series.dark_variance * np.outer(common, common)
    s0_sd = np.sqrt(covariance[..., 0, 0])
    dolp, raw, dolp_sd, aop, aop_sd, p_sd = polarization(stokes, covariance)
    p = np.hypot(stokes[..., 1], stokes[..., 2])

    undefined = ~np.isfinite(images).all(axis=-1)
    lost = saturated | undefined
    shadow = ~lost & ~(stokes[..., 0] > SHADOW_SNR * s0_sd)
    dark = lost | shadow
    above = ~dark & (dolp > 1)
    unpolarized = ~dark & ~(p > AOP_SNR * p_sd)
    flags = np.zeros(saturated.shape, dtype=np.uint8)
    for where, flag in (
        (saturated, Flag.SATURATED),
        (shadow, Flag.SHADOW),
        (above, Flag.ABOVE_ONE),
        (unpolarized, Flag.UNPOLARIZED),
        (undefined | incomplete, Flag.INCOMPLETE),
    ):
        flags[where] |= flag.value
    planes = np.stack([*np.moveaxis(stokes, -1, 0), s0_sd, dolp, raw, dolp_sd, aop, aop_sd])
    planes[:, lost] = np.nan
    planes[4:, shadow] = np.nan
    planes[4, above] = np.nan
    planes[7:, unpolarized] = np.nan
    return planes, flags


def stokes_planes(
    light: NDArray[np.floating], saturated: NDArray[np.bool_], series: PolarizerSeries, *, incomplete: bool = False
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Stokes parameters, DOLP, AOP, their errors and flags of every pixel in one pass over memory.

    Args:
        light: (K, rows, columns) mean counts above black at each angle of ``series``; float32 or float64.
        saturated: (rows, columns) whether any frame reached the saturation level there.
        series: angles, frames, extinction and noise.
        incomplete: an angle of the plan has no usable frame (marks every pixel).

    Returns:
        Planes (9, rows, columns) float32 in the order of :data:`PLANES`, and flags (rows, columns) uint8
        (:class:`Flag`).

    Raises:
        DataError: shapes that do not fit each other, or integer images (whose differences would wrap).
    """
    _check(light, saturated, series)
    planes = np.empty((len(PLANES), *saturated.shape), dtype=np.float32)
    flags = np.empty(saturated.shape, dtype=np.uint8)
    _kernel(
        light,
        saturated,
        series.solution(),
        np.asarray(series.frames, dtype=np.float64),
        series.noise.floor,
        1.0 / series.noise.electrons_per_count,
        series.dark_variance,
        incomplete,
        planes,
        flags,
    )
    return planes, flags


def stokes_image(
    light: NDArray[np.floating], saturated: NDArray[np.bool_], series: PolarizerSeries, *, incomplete: bool = False
) -> StokesImage:
    """:func:`stokes_planes` with names."""
    planes, flags = stokes_planes(light, saturated, series, incomplete=incomplete)
    return StokesImage(**dict(zip(PLANES, planes, strict=True)), flags=flags)


def _check(light: NDArray[np.floating], saturated: NDArray[np.bool_], series: PolarizerSeries) -> None:
    if not np.issubdtype(light.dtype, np.floating):
        raise DataError(f"intensities are {light.dtype}", "convert them to float32: unsigned differences wrap round")
    expected = (len(series.angles_rad), *saturated.shape)
    if saturated.ndim != 2 or light.shape != expected:
        raise DataError(f"intensities have shape {light.shape}", f"give one image for each angle: {expected}")


@numba.njit(cache=True, nogil=True)
def _kernel(
    light: NDArray[np.floating],
    saturated: NDArray[np.bool_],
    solution: Floats,
    frames: Floats,
    floor: float,
    shot: float,
    dark_variance: float,
    incomplete: bool,
    planes: NDArray[np.float32],
    flags: NDArray[np.uint8],
) -> None:
    count, rows, columns = light.shape
    sums = np.zeros(3)
    for k in range(count):
        for i in range(3):
            sums[i] += solution[i, k]
    for row in range(rows):
        for column in range(columns):
            s0 = s1 = s2 = 0.0
            c00 = c11 = c22 = c01 = c02 = c12 = 0.0
            for k in range(count):
                value = np.float64(light[k, row, column])
                a0, a1, a2 = solution[0, k], solution[1, k], solution[2, k]
                s0 += a0 * value
                s1 += a1 * value
                s2 += a2 * value
                variance = (floor + max(value, 0.0) * shot) / frames[k]
                c00 += a0 * a0 * variance
                c11 += a1 * a1 * variance
                c22 += a2 * a2 * variance
                c01 += a0 * a1 * variance
                c02 += a0 * a2 * variance
                c12 += a1 * a2 * variance
            c00 += sums[0] * sums[0] * dark_variance
            c11 += sums[1] * sums[1] * dark_variance
            c22 += sums[2] * sums[2] * dark_variance
            c01 += sums[0] * sums[1] * dark_variance
            c02 += sums[0] * sums[2] * dark_variance
            c12 += sums[1] * sums[2] * dark_variance

            flag = 16 if incomplete else 0
            lost = False
            if saturated[row, column]:
                flag |= 1
                lost = True
            # A NaN or infinite intensity leaves no finite S0.
            if not np.isfinite(s0):
                flag |= 16
                lost = True
            if lost:
                for plane in range(9):
                    planes[plane, row, column] = np.nan
                flags[row, column] = flag
                continue
            s0_sd = np.sqrt(c00)
            planes[0, row, column] = s0
            planes[1, row, column] = s1
            planes[2, row, column] = s2
            planes[3, row, column] = s0_sd
            if not s0 > SHADOW_SNR * s0_sd:
                for plane in range(4, 9):
                    planes[plane, row, column] = np.nan
                flags[row, column] = flag | 2
                continue
            p = np.sqrt(s1 * s1 + s2 * s2)
            if p > _ROUNDING * s0:
                x, y = s1 / p, s2 / p
                along = x * x * c11 + y * y * c22 + 2 * x * y * c12
                across = y * y * c11 + x * x * c22 - 2 * x * y * c12
                with_s0 = x * c01 + y * c02
                less = -across * np.expm1(-p * p / across) / (2 * p) if across > 0.0 else 0.0
            else:
                along = across = (c11 + c22) / 2
                with_s0 = less = 0.0
            raw = p / s0
            dolp = (p - less) / s0
            if dolp > 1.0:
                flag |= 4
                dolp = np.nan
            planes[4, row, column] = dolp
            planes[5, row, column] = raw
            planes[6, row, column] = np.sqrt(max(along + raw * raw * c00 - 2 * raw * with_s0, 0.0)) / s0
            if p > AOP_SNR * np.sqrt(max(along, 0.0)):
                aop = 0.5 * np.arctan2(s2, s1)
                planes[7, row, column] = aop if aop > -np.pi / 2 else np.pi / 2
                planes[8, row, column] = min(np.sqrt(max(across, 0.0)) / (2 * p), UNKNOWN_ANGLE_SD_RAD)
            else:
                flag |= 8
                planes[7, row, column] = np.nan
                planes[8, row, column] = np.nan
            flags[row, column] = flag
