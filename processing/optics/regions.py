"""Polarization of a region of the image: the mean Stokes vector and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.optics.debias import polarization
from processing.optics.series import PolarizerSeries


@dataclass(frozen=True)
class RegionPolarization:
    """Mean polarization of a region. Stokes parameters in counts, AOP in radians; sds are of the mean.

    ``*_sd`` joins the random part (noise, falls with the number of pixels) and the systematic part (polarizer angles,
    extinction, stability of the light, which does not fall) in quadrature.
    """

    pixels: int
    s0: float
    s1: float
    s2: float
    dolp: float
    dolp_sd: float
    dolp_random_sd: float
    dolp_systematic_sd: float
    aop: float
    aop_sd: float


def region_polarization(
    s0: NDArray[np.floating],
    s1: NDArray[np.floating],
    s2: NDArray[np.floating],
    mask: NDArray[np.bool_],
    series: PolarizerSeries,
) -> RegionPolarization:
    """Average the Stokes parameters of a region, never DOLP or AOP, and propagate all known errors.

    Args:
        s0: (rows, columns) counts; NaN pixels (saturated) are left out.
        s1: as ``s0``.
        s2: as ``s0``.
        mask: (rows, columns) pixels of the region.
        series: how the Stokes parameters were measured.

    Returns:
        DOLP debiased with the covariance of the mean.

    Raises:
        DataError: shapes that differ, no defined pixel in the region, or a region without light.
    """
    if not s0.shape == s1.shape == s2.shape == mask.shape:
        raise DataError(f"the region has shape {mask.shape}, the image {s0.shape}", "draw it on this image")
    defined = mask & np.isfinite(s0) & np.isfinite(s1) & np.isfinite(s2)
    pixels = int(np.count_nonzero(defined))
    if pixels == 0:
        raise DataError("the region has no defined pixel", "choose one that is neither saturated nor outside the image")
    mean = np.array([float(np.mean(plane[defined], dtype=np.float64)) for plane in (s0, s1, s2)])
    if mean[0] <= 0:
        raise DataError(f"the region's mean intensity is {mean[0]:.3g} counts", "choose one that is lit")
    # Noise is independent from pixel to pixel, that of a subtracted dark image too; it is only common to the angles.
    random = series.random_covariance(mean) / max(pixels * series.samples_per_pixel, 1.0)
    systematic = series.systematic_covariance(mean)
    dolp, raw, _, aop, aop_sd, _ = polarization(mean, random + systematic)
    random_sd = float(polarization(mean, random)[2])
    systematic_sd = float(np.hypot(polarization(mean, systematic)[2], raw * series.extinction_scale_relative_sd))
    return RegionPolarization(
        pixels=pixels,
        s0=float(mean[0]),
        s1=float(mean[1]),
        s2=float(mean[2]),
        dolp=float(dolp),
        dolp_sd=float(np.hypot(random_sd, systematic_sd)),
        dolp_random_sd=random_sd,
        dolp_systematic_sd=systematic_sd,
        aop=float(aop),
        aop_sd=float(np.hypot(aop_sd, series.zero_sd_rad)),
    )
