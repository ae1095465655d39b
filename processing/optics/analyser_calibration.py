"""What the analysers of a camera really are: angles and transmittances from a source polarized at known angles.

The source's polarizer is turned; behind each analyser the intensity is a constant plus a sine of twice its angle, and
the three numbers of that are the analyser's row of the measurement matrix (thesis 2.18, first row). For mosaics this is
the calibration of superpixels by Powell and Gruev, Opt. Express 21, 21039 (2013), without their offsets, which are the
black level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from processing.errors import DataError
from processing.optics.analyser import CONDITION_LIMIT, condition_number, least_squares, measurement_matrix

Floats = NDArray[np.float64]

SAME_SETTING_RAD = math.radians(0.5)
"""Readings of a polarizer at one setting agree to within this."""


@dataclass(frozen=True)
class AnalyserCalibration:
    """Rows of the measurement matrix of K analysers in each of R x C regions of the sensor."""

    nominal_rad: tuple[float, ...]
    """Angles that the analysers are meant to have, radians."""
    rows: Floats
    """(K, 3, R, C): intensity behind each analyser from (S0, S1, S2); the mean of the first number over K is 1/2."""
    angle_sd_rad: Floats
    """(K, R, C) standard deviation of each angle, radians."""
    transmittance_sd: Floats
    """(K, R, C) standard deviation of :attr:`transmittance`."""
    shape: tuple[int, int]
    """Rows and columns of the sensor."""

    @property
    def angle_rad(self) -> Floats:
        """(K, R, C) angles found, radians, within 90 degrees of the nominal ones."""
        found = 0.5 * np.arctan2(self.rows[:, 2], self.rows[:, 1])
        nominal = np.asarray(self.nominal_rad)[:, None, None]
        turned: Floats = nominal + np.angle(np.exp(2j * (found - nominal))) / 2
        return turned

    @property
    def typical_angle_sd_rad(self) -> tuple[float, ...]:
        """(K,) sds of the angles, root mean square over the regions, radians; 0 where three readings left none."""
        mean = np.sqrt(np.mean(self.angle_sd_rad**2, axis=(1, 2)))
        return tuple(float(sd) for sd in np.where(np.isfinite(mean), mean, 0.0))

    @property
    def offset_rad(self) -> Floats:
        """(K, R, C) angles found less nominal ones, radians."""
        offset: Floats = self.angle_rad - np.asarray(self.nominal_rad)[:, None, None]
        return offset

    @property
    def transmittance(self) -> Floats:
        """(K, R, C) transmittance for light along each analyser's axis; 1 for the ideal one."""
        found: Floats = self.rows[:, 0] + np.hypot(self.rows[:, 1], self.rows[:, 2])
        return found

    @property
    def extinction_ratio(self) -> Floats:
        """(K, R, C) largest over smallest transmittance; infinite where the smallest is lost in noise."""
        across = self.rows[:, 0] - np.hypot(self.rows[:, 1], self.rows[:, 2])
        with np.errstate(divide="ignore"):
            ratio: Floats = np.where(across > 0, self.transmittance / across, np.inf)
        return ratio

    def idealised(self, light: NDArray[np.floating], angles_rad: Sequence[float] | None = None) -> Floats:
        """Intensities as ideal analysers at the nominal angles would pass them.

        Stokes parameters are solved with the analysers found and passed through the ideal ones. Noise is that of the
        intensities given, as far as analysers are nearly ideal.

        Args:
            light: (K, rows, columns) counts above black.
            angles_rad: (K,) angles at which they were taken, if that may be others than were calibrated.

        Raises:
            DataError: other angles, or another size than that of the sensor.
        """
        count = len(self.nominal_rad)
        taken = self.nominal_rad if angles_rad is None else tuple(angles_rad)
        if len(taken) != count or any(
            abs(math.sin(a - b)) > SAME_SETTING_RAD for a, b in zip(taken, self.nominal_rad, strict=True)
        ):
            known, used = (", ".join(f"{math.degrees(a):.4g}" for a in x) for x in (self.nominal_rad, taken))
            raise DataError(
                f"the analysers were calibrated at {known} degrees, the frames were taken at {used}",
                "calibrate at the angles that are used",
            )
        if light.shape != (count, *self.shape):
            raise DataError(
                f"intensities have shape {light.shape}, the calibration is of {(count, *self.shape)}",
                "calibrate with the angles and the region of the sensor that are used",
            )
        ideal = measurement_matrix(self.nominal_rad)
        inverse = np.linalg.pinv(np.moveaxis(self.rows, (0, 1), (-2, -1)))
        step = ideal @ inverse  # (R, C, K, K)
        found = np.zeros(light.shape)
        for i in range(count):
            for k in range(count):
                found[i] += self._everywhere(step[..., i, k]) * light[k]
        return found

    def _everywhere(self, values: Floats) -> Floats:
        """Values of the regions' middles, (R, C), between them linearly, (rows, columns)."""
        if values.shape == self.shape:
            return values
        if values.size == 1:
            return np.full(self.shape, values.item())
        places = [
            np.clip((np.arange(pixels) + 0.5) * regions / pixels - 0.5, 0, regions - 1)
            for pixels, regions in zip(self.shape, values.shape, strict=True)
        ]
        between: Floats = map_coordinates(values, np.meshgrid(*places, indexing="ij"), order=1, mode="nearest")
        return between


def fit_analysers(
    light: NDArray[np.floating],
    source_rad: ArrayLike,
    nominal_rad: ArrayLike,
    *,
    source_extinction: float = math.inf,
    region_px: int | None = None,
) -> AnalyserCalibration:
    """Calibrate K analysers from J angles of the polarizer of an unpolarized source.

    Args:
        light: (J, K, rows, columns) counts above black; NaN pixels are left out of their region.
        source_rad: (J,) transmission axes of the source's polarizer from horizontal, radians.
        nominal_rad: (K,) angles that the analysers are meant to have, radians.
        source_extinction: maximum over minimum transmittance of the source's polarizer.
        region_px: side of the regions, pixels; 1 for each pixel on its own; the whole sensor when left out.

    Returns:
        Sds are from what the fit leaves, so with J = 3 they are NaN; those of the source's angles are not in them.

    Raises:
        DataError: source angles that do not determine an analyser, shapes that do not fit, or a region without light.
    """
    source, nominal = np.atleast_1d(np.asarray(source_rad, float)), np.atleast_1d(np.asarray(nominal_rad, float))
    if light.ndim != 4 or light.shape[:2] != (len(source), len(nominal)):
        raise DataError(
            f"intensities have shape {light.shape}", f"give ({len(source)}, {len(nominal)}, rows, columns) of them"
        )
    matrix = 2 * measurement_matrix(source, source_extinction)
    if condition_number(matrix) > CONDITION_LIMIT:
        raise DataError(
            f"{len(source)} angles of the source do not determine an analyser",
            "turn the source's polarizer to four or more angles spread over 180 degrees",
        )
    means = _region_means(light, region_px)
    solution = least_squares(matrix)
    rows = np.einsum("ij,jkrc->kirc", solution, means)
    level = 2 * rows[:, 0].mean(axis=0)
    if not np.all(level > 0):
        raise DataError("a region of the calibration has no light", "take it of a bright source that fills the picture")
    residual = means - np.einsum("ji,kirc->jkrc", matrix, rows)
    spare = len(source) - 3
    variance = np.sum(residual**2, axis=0) / spare if spare > 0 else np.full(means.shape[1:], np.nan)
    rows, variance = rows / level, variance / level**2
    covariance = solution @ solution.T
    amplitude = np.hypot(rows[:, 1], rows[:, 2])
    c, s = rows[:, 1] / amplitude, rows[:, 2] / amplitude
    across = s * s * covariance[1, 1] + c * c * covariance[2, 2] - 2 * s * c * covariance[1, 2]
    along = covariance[0, 0] + c * c * covariance[1, 1] + s * s * covariance[2, 2] + 2 * s * c * covariance[1, 2]
    along = along + 2 * (c * covariance[0, 1] + s * covariance[0, 2])
    return AnalyserCalibration(
        nominal_rad=tuple(float(angle) for angle in nominal),
        rows=rows,
        angle_sd_rad=np.sqrt(variance * across) / (2 * amplitude),
        transmittance_sd=np.sqrt(variance * along),
        shape=(light.shape[2], light.shape[3]),
    )


def _region_means(light: NDArray[np.floating], region_px: int | None) -> Floats:
    """(J, K, R, C) means of the defined pixels."""
    rows, columns = light.shape[2:]
    if region_px is not None and region_px < 1:
        raise DataError(f"regions of {region_px} pixels", "give 1 or more")
    side = max(rows, columns) if region_px is None else region_px
    starts = np.arange(0, rows, side), np.arange(0, columns, side)
    defined = np.isfinite(light)
    total = np.where(defined, light, 0.0).astype(np.float64)
    count = defined.astype(np.float64)
    for axis, start in zip((2, 3), starts, strict=True):
        total, count = np.add.reduceat(total, start, axis=axis), np.add.reduceat(count, start, axis=axis)
    if not np.all(count > 0):
        raise DataError(
            "a region of the calibration has no defined pixel", "take larger regions, or a shorter exposure"
        )
    means: Floats = total / count
    return means
