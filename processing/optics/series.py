"""A series of polarizer angles: what it measures, how noise and imperfect knowledge of it enter the Stokes vector."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.optics.analyser import condition_number, least_squares, measurement_matrix

Floats = NDArray[np.float64]

QUANTISATION_VARIANCE = 1.0 / 12.0
"""Variance of rounding to whole counts, counts^2."""


@dataclass(frozen=True)
class SensorNoise:
    """Noise of one pixel in one frame: read noise, shot noise and rounding."""

    read_noise_counts: float = 0.0
    electrons_per_count: float = 1.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.read_noise_counts) and self.read_noise_counts >= 0):
            raise DataError(f"read noise is {self.read_noise_counts} counts", "give a number from 0 up")
        if not (math.isfinite(self.electrons_per_count) and self.electrons_per_count > 0):
            raise DataError(f"a count is {self.electrons_per_count} electrons", "give a positive number")

    @property
    def floor(self) -> float:
        """Variance without light, counts^2."""
        return self.read_noise_counts**2 + QUANTISATION_VARIANCE

    def variance(self, light_counts: ArrayLike) -> Floats:
        """Variance of one frame, counts^2, from the counts above black; photo-electrons are Poisson."""
        light = np.asarray(light_counts, dtype=np.float64)
        variance: Floats = self.floor + np.maximum(light, 0.0) / self.electrons_per_count
        return variance


@dataclass(frozen=True)
class PolarizerSeries:
    """K polarizer angles, the frames averaged at each, and how well all of it is known.

    Args:
        angles_rad: transmission axes from horizontal, radians.
        frames: frames averaged at each angle.
        angle_sd_rad: standard deviation of each angle, radians; angles err independently.
        extinction_ratio: maximum over minimum transmittance; may be infinite.
        noise: noise of one pixel in one frame.
        dark_frames: dark frames averaged and subtracted; 0 when a constant black level was.
        zero_sd_rad: standard deviation of the polarizer's zero mark, common to all angles: turns AOP only.
        extinction_relative_sd: relative standard deviation of the extinction ratio.
        intensity_stability: relative standard deviation of light source and exposure between angles. It is what
            division of time costs: no averaging over pixels removes it.
        samples_per_pixel: independent samples of each angle in a pixel; below 1 where planes are interpolated from
            fewer (:data:`processing.optics.demosaic.SAMPLES_PER_PIXEL`). Means over regions count samples, not pixels.

    Raises:
        DataError: lengths that differ, fewer frames than one, a negative sd, or angles that do not determine
            S0, S1 and S2 (see :func:`processing.optics.analyser.least_squares`).
    """

    angles_rad: tuple[float, ...]
    frames: tuple[int, ...]
    angle_sd_rad: tuple[float, ...]
    extinction_ratio: float = math.inf
    noise: SensorNoise = SensorNoise()
    dark_frames: int = 0
    zero_sd_rad: float = 0.0
    extinction_relative_sd: float = 0.1
    intensity_stability: float = 1e-3
    samples_per_pixel: float = 1.0

    def __post_init__(self) -> None:
        if not len(self.angles_rad) == len(self.frames) == len(self.angle_sd_rad):
            raise DataError(
                f"{len(self.angles_rad)} angles, {len(self.frames)} frame counts and {len(self.angle_sd_rad)} sds",
                "give one of each for every polarizer angle",
            )
        sds = (*self.angle_sd_rad, self.zero_sd_rad, self.extinction_relative_sd, self.intensity_stability)
        if not all(math.isfinite(sd) and sd >= 0 for sd in sds):
            raise DataError("a standard deviation of the polarizer series is negative or not finite", "correct it")
        if self.dark_frames < 0:
            raise DataError(f"{self.dark_frames} dark frames", "give 0 or more")
        if not 0 < self.samples_per_pixel <= 1:
            raise DataError(f"a pixel holds {self.samples_per_pixel} samples of each angle", "give up to 1")
        self.solution()

    @property
    def matrix(self) -> Floats:
        """(K, 3) measurement matrix."""
        return measurement_matrix(self.angles_rad, self.extinction_ratio)

    @property
    def condition(self) -> float:
        """Condition number of the measurement matrix."""
        return condition_number(self.matrix)

    def solution(self) -> Floats:
        """(3, K): least squares from K mean images to S0, S1, S2, each angle weighted by its frames."""
        return least_squares(self.matrix, self.frames)

    @property
    def dark_variance(self) -> float:
        """Variance of the subtracted dark image, common to all angles, counts^2."""
        return self.noise.floor / self.dark_frames if self.dark_frames else 0.0

    def random_covariance(self, stokes: ArrayLike) -> Floats:
        """Covariance of one pixel's S0, S1, S2 from read noise, shot noise and rounding.

        Args:
            stokes: (..., 3) Stokes parameters in counts; variances are linear in them as long as no intensity is
                negative, so a region's mean variance is the variance at its mean.

        Returns:
            (..., 3, 3), counts^2.
        """
        solution = self.solution()
        light = np.asarray(stokes, dtype=np.float64) @ self.matrix.T
        variance = self.noise.variance(light) / np.asarray(self.frames)
        common = solution.sum(axis=1)
        covariance: Floats = np.einsum("ik,...k,jk->...ij", solution, variance, solution)
        return covariance + self.dark_variance * np.outer(common, common)

    def systematic_covariance(self, stokes: ArrayLike) -> Floats:
        """Covariance of S0, S1, S2 that averaging over pixels does not reduce: angles and stability of the light.

        Args:
            stokes: (..., 3) Stokes parameters, counts.

        Returns:
            (..., 3, 3), counts^2.
        """
        solution = self.solution()
        vector = np.asarray(stokes, dtype=np.float64)
        light = vector @ self.matrix.T
        # dI/dt of the measurement matrix's rows: (S1, S2) turns by 2 t.
        quarter = self.matrix[:, [2, 1]] * np.array([-2.0, 2.0])
        slope = vector[..., 1:] @ quarter.T
        variance = (slope * np.asarray(self.angle_sd_rad)) ** 2 + (light * self.intensity_stability) ** 2
        covariance: Floats = np.einsum("ik,...k,jk->...ij", solution, variance, solution)
        return covariance

    @property
    def extinction_scale_relative_sd(self) -> float:
        """Relative sd of DOLP from not knowing the extinction ratio E: DOLP goes as (E + 1) / (E - 1)."""
        ratio = self.extinction_ratio
        if math.isinf(ratio):
            return 0.0
        return 2 * ratio * self.extinction_relative_sd / (ratio**2 - 1)
