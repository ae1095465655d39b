"""From intensities behind a polarizer to Stokes parameters, DOLP and AOP, with their errors and what to mistrust.

:func:`stokes_planes` is the fast way (one pass, numba); :func:`stokes_planes_reference` is its definition in plain
float64 NumPy.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError, undefined_is_nan
from processing.optics.debias import ROUNDING, UNKNOWN_ANGLE_SD_RAD, WIDER, WIDER_UNTIL, polarization
from processing.optics.series import PolarizerSeries

Floats = NDArray[np.float64]

PLANES = ("s0", "s1", "s2", "s0_sd", "dolp", "dolp_raw", "dolp_sd", "aop", "aop_sd")
"""Order of the planes that both implementations fill."""

SHADOW_SNR = 10.0
"""S0 below this many of its standard deviations is shadow: DOLP's own sd would be some 0.14 there."""

ABOVE_ONE_SDS = 3.0
"""Debiased DOLP above 1 by more than this many of its sds is no noise. Masking all above 1 would bias means below 1."""

AOP_SNR = 2.0
"""Polarized intensity below this many of its standard deviations has no direction."""


class Flag(enum.IntFlag):
    """Why a pixel is to be mistrusted. Bits of the flag plane (uint8)."""

    SATURATED = 1
    """At or above the saturation level in a frame: everything is NaN."""
    SHADOW = 2
    """S0 too low for its noise: DOLP and AOP are NaN."""
    ABOVE_ONE = 4
    """Debiased DOLP above 1 by more than noise explains, which no light has: DOLP is NaN, the raw one is kept."""
    UNPOLARIZED = 8
    """Polarized intensity lost in noise: AOP is NaN."""
    INCOMPLETE = 16
    """An angle has no usable frame here: solved from the others, or NaN where an intensity is undefined."""


@dataclass(frozen=True)
class StokesImage:
    """Stokes parameters (counts above black), DOLP and AOP (radians) of every pixel: float32 planes (rows, columns).

    ``dolp`` is debiased, ``dolp_raw`` is not; ``*_sd`` are standard deviations from random noise: ``dolp`` with 1.96 of
    ``dolp_sd`` covers the truth in 95 % of the pixels or more, however weak the polarization. Undefined values are NaN,
    with the reason in ``flags`` (:class:`Flag`).
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


@undefined_is_nan
def stokes_planes_reference(
    light: NDArray[np.floating],
    saturated: NDArray[np.bool_],
    series: PolarizerSeries,
    *,
    incomplete: bool = False,
    response: NDArray[np.floating] | None = None,
    share: NDArray[np.floating] | None = None,
    common_share: float = 0.0,
) -> tuple[Floats, NDArray[np.uint8]]:
    """Plain float64 definition of :func:`stokes_planes`; same arguments and results, in float64."""
    response, share = _checked(light, saturated, series, response, share)
    solution = series.solution()
    images = np.moveaxis(np.asarray(light, dtype=np.float64), 0, -1)
    stokes = images @ solution.T
    # Counts were divided by the response; in counts as read, noise is that of a pixel like all others.
    variance = series.noise.variance(images * response[..., None]) / response[..., None] ** 2
    rows, columns = saturated.shape
    in_common = series.dark_variance / response**2
    if common_share:
        in_common = in_common + common_share * np.mean(variance / np.asarray(series.frames), axis=-1)
    spread = np.tile(share, (1, rows // 2 + 1, columns // 2 + 1))[:, :rows, :columns]
    variance = variance / np.asarray(series.frames) * np.moveaxis(spread, 0, -1)
    common = solution.sum(axis=1)
    covariance = np.einsum("ik,...k,jk->...ij", solution, variance, solution)
    covariance = covariance + in_common[..., None, None] * np.outer(common, common)
    s0_sd = np.sqrt(covariance[..., 0, 0])
    dolp, raw, dolp_sd, aop, aop_sd, p_sd = polarization(stokes, covariance)
    p = np.hypot(stokes[..., 1], stokes[..., 2])

    undefined = ~np.isfinite(images).all(axis=-1)
    lost = saturated | undefined
    shadow = ~lost & ~(stokes[..., 0] > SHADOW_SNR * s0_sd)
    dark = lost | shadow
    above = ~dark & (dolp - ABOVE_ONE_SDS * dolp_sd > 1)
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
    light: NDArray[np.floating],
    saturated: NDArray[np.bool_],
    series: PolarizerSeries,
    *,
    incomplete: bool = False,
    response: NDArray[np.floating] | None = None,
    share: NDArray[np.floating] | None = None,
    common_share: float = 0.0,
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Stokes parameters, DOLP, AOP, their errors and flags of every pixel in one pass over memory.

    Args:
        light: (K, rows, columns) mean counts above black at each angle of ``series``; float32 or float64.
        saturated: (rows, columns) whether any frame reached the saturation level there.
        series: angles, frames, extinction and noise.
        incomplete: an angle of the plan has no usable frame (marks every pixel).
        response: (rows, columns) what counts as read were divided by to give ``light`` (flat field); 1 when left out.
        share: (K, 2, 2) variance of each angle's plane over that of one pixel's own sample, in the even and odd rows
            and columns; less than 1 where the plane is interpolated
            (:func:`processing.optics.demosaic.variance_share`). 1 when left out.
        common_share: variance that all planes have in common over that of one pixel's own sample.

    Returns:
        Planes (9, rows, columns) float32 in the order of :data:`PLANES`, and flags (rows, columns) uint8
        (:class:`Flag`).

    Raises:
        DataError: shapes that do not fit each other, or integer images (whose differences would wrap).
    """
    response, share = _checked(light, saturated, series, response, share)
    if light.dtype not in (np.float32, np.float64) or not light.dtype.isnative:
        light = light.astype(np.float32 if light.dtype.itemsize <= 4 else np.float64)  # what the kernel is compiled for
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
        response,
        share,
        common_share / len(light),
        incomplete,
        planes,
        flags,
    )
    return planes, flags


def stokes_image(
    light: NDArray[np.floating],
    saturated: NDArray[np.bool_],
    series: PolarizerSeries,
    *,
    incomplete: bool = False,
    response: NDArray[np.floating] | None = None,
    share: NDArray[np.floating] | None = None,
    common_share: float = 0.0,
) -> StokesImage:
    """:func:`stokes_planes` with names."""
    planes, flags = stokes_planes(
        light, saturated, series, incomplete=incomplete, response=response, share=share, common_share=common_share
    )
    return StokesImage(**dict(zip(PLANES, planes, strict=True)), flags=flags)


def _checked(
    light: NDArray[np.floating],
    saturated: NDArray[np.bool_],
    series: PolarizerSeries,
    response: NDArray[np.floating] | None,
    share: NDArray[np.floating] | None,
) -> tuple[Floats, Floats]:
    """Response and share as (rows, columns) and (K, 2, 2), after the shapes were found to fit."""
    if not np.issubdtype(light.dtype, np.floating):
        raise DataError(f"intensities are {light.dtype}", "convert them to float32: unsigned differences wrap round")
    expected = (len(series.angles_rad), *saturated.shape)
    if saturated.ndim != 2 or light.shape != expected:
        raise DataError(f"intensities have shape {light.shape}", f"give one image for each angle: {expected}")
    # Always a view that cannot be written, so that the kernel is compiled for one type.
    found = np.broadcast_to(np.asarray(1.0 if response is None else response, dtype=np.float64), saturated.shape)
    if not np.all(found > 0):
        raise DataError("a pixel's response is not positive", "mask dead pixels as saturated, with response 1")
    shares = np.ones((len(light), 2, 2)) if share is None else np.asarray(share, dtype=np.float64)
    if shares.shape != (len(light), 2, 2):
        raise DataError(f"shares of variance have shape {shares.shape}", f"give ({len(light)}, 2, 2)")
    return found, shares


@numba.njit(cache=True, nogil=True)
def _kernel(
    light: NDArray[np.floating],
    saturated: NDArray[np.bool_],
    solution: Floats,
    frames: Floats,
    floor: float,
    shot: float,
    dark_variance: float,
    response: Floats,
    share: Floats,
    common_share: float,
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
            gain = 1.0 / response[row, column]
            common = dark_variance * gain * gain
            for k in range(count):
                value = np.float64(light[k, row, column])
                a0, a1, a2 = solution[0, k], solution[1, k], solution[2, k]
                s0 += a0 * value
                s1 += a1 * value
                s2 += a2 * value
                variance = (floor * gain + max(value, 0.0) * shot) * gain / frames[k]
                common += variance * common_share
                variance *= share[k, row % 2, column % 2]
                c00 += a0 * a0 * variance
                c11 += a1 * a1 * variance
                c22 += a2 * a2 * variance
                c01 += a0 * a1 * variance
                c02 += a0 * a2 * variance
                c12 += a1 * a2 * variance
            c00 += sums[0] * sums[0] * common
            c11 += sums[1] * sums[1] * common
            c22 += sums[2] * sums[2] * common
            c01 += sums[0] * sums[1] * common
            c02 += sums[0] * sums[2] * common
            c12 += sums[1] * sums[2] * common

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
            if p > ROUNDING * s0:
                x, y = s1 / p, s2 / p
                along = x * x * c11 + y * y * c22 + 2 * x * y * c12
                across = y * y * c11 + x * x * c22 - 2 * x * y * c12
                with_s0 = x * c01 + y * c02
                less = -across * np.expm1(-p * p / across) / (2 * p) if across > 0.0 else 0.0
            else:
                along = across = (c11 + c22) / 2
                with_s0 = less = 0.0
            raw = p / s0
            dolp = max(((p - less) * (1.0 - c00 / (s0 * s0)) + with_s0 / s0) / s0, 0.0)
            dolp_sd = np.sqrt(max(along + raw * raw * c00 - 2 * raw * with_s0, 0.0)) / s0
            if across > 0.0:
                dolp_sd *= 1.0 + WIDER * np.exp(-p * p / (WIDER_UNTIL * across))
            if dolp - ABOVE_ONE_SDS * dolp_sd > 1.0:
                flag |= 4
                dolp = np.nan
            planes[4, row, column] = dolp
            planes[5, row, column] = raw
            planes[6, row, column] = dolp_sd
            if p > AOP_SNR * np.sqrt(max(along, 0.0)):
                aop = 0.5 * np.arctan2(s2, s1)
                planes[7, row, column] = aop if aop > -np.pi / 2 else np.pi / 2
                planes[8, row, column] = min(np.sqrt(max(across, 0.0)) / (2 * p), UNKNOWN_ANGLE_SD_RAD)
            else:
                flag |= 8
                planes[7, row, column] = np.nan
                planes[8, row, column] = np.nan
            flags[row, column] = flag
