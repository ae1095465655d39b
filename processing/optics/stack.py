"""Frames of a polarizer series, averaged as they come: memory for one image an angle, whatever the number of frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.optics.demosaic import SAMPLES_PER_PIXEL, demosaic
from processing.optics.mosaic import ANGLES_DEG, Mosaic, spread
from processing.optics.series import PolarizerSeries, SensorNoise

SAME_ANGLE_RAD = 1e-4
"""Frames whose angles differ by less were taken at one setting of the polarizer (0.006 degrees)."""


@dataclass
class _Angle:
    angle_rad: float
    sd_rad: float
    total: NDArray[np.uint64]
    frames: int = 0


@dataclass(frozen=True)
class AveragedSeries:
    """Mean light of each angle and what is needed to make Stokes parameters of it."""

    light: NDArray[np.float32]
    """(K, rows, columns) mean counts above black."""
    saturated: NDArray[np.bool_]
    """(rows, columns) saturated in any frame."""
    series: PolarizerSeries
    incomplete: bool
    """An angle of the plan has no complete frame."""


class FrameStack:
    """Collects the frames of one polarizer series.

    Sums are whole numbers, so that the mean does not depend on the order of the frames, and unsigned counts are never
    subtracted from one another.

    Args:
        saturation_counts: counts at and above which a pixel is saturated.
        black_level_counts: counts without light, used when there is no dark frame.
    """

    def __init__(self, *, saturation_counts: int, black_level_counts: float = 0.0) -> None:
        if not (math.isfinite(black_level_counts) and 0 <= black_level_counts < saturation_counts):
            raise DataError(
                f"black level {black_level_counts} and saturation {saturation_counts} leave no counts for light",
                "correct both in the rig file's [camera]",
            )
        self._saturation = saturation_counts
        self._black = black_level_counts
        self._angles: list[_Angle] = []
        self._dark: _Angle | None = None
        self._saturated: NDArray[np.bool_] | None = None
        self.incomplete_frames = 0

    def add(
        self,
        image: NDArray[np.unsignedinteger],
        angle_rad: float,
        *,
        angle_sd_rad: float = 0.0,
        dark: bool = False,
        incomplete: bool = False,
    ) -> None:
        """Add one frame. A frame that is incomplete is counted and otherwise left out.

        Args:
            image: (rows, columns) unsigned counts.
            angle_rad: polarizer's transmission axis from horizontal, radians (no matter for dark frames).
            angle_sd_rad: its standard deviation, radians.
            dark: taken with the lens covered.
            incomplete: parts of the frame were lost.

        Raises:
            DataError: not unsigned counts, another shape than the frames before, or an angle that is not finite.
        """
        if image.ndim != 2 or not np.issubdtype(image.dtype, np.unsignedinteger):
            raise DataError(f"a frame is {image.dtype} of shape {image.shape}", "give rows and columns of raw counts")
        if self._saturated is None:
            self._saturated = np.zeros(image.shape, dtype=np.bool_)
        if image.shape != self._saturated.shape:
            raise DataError(
                f"a frame has shape {image.shape}, those before it {self._saturated.shape}",
                "take one series with one region of the sensor",
            )
        group = self._dark if dark else self._group(angle_rad)
        if group is None:
            group = _Angle(angle_rad, angle_sd_rad, np.zeros(image.shape, dtype=np.uint64))
            if dark:
                self._dark = group
            else:
                self._angles.append(group)
        if incomplete:
            self.incomplete_frames += 1
            return
        group.total += image
        group.frames += 1
        group.sd_rad = max(group.sd_rad, angle_sd_rad)
        if not dark:
            self._saturated |= image >= self._saturation

    def averaged(
        self,
        *,
        noise: SensorNoise | None = None,
        extinction_ratio: float = math.inf,
        zero_sd_rad: float = 0.0,
        intensity_stability: float = 1e-3,
    ) -> AveragedSeries:
        """Mean light of each angle, in ascending order of angle.

        The dark frames' mean is subtracted where there are any, else the black level; differences may be negative.

        Args:
            noise: noise of one pixel in one frame; rounding and shot noise at one electron a count when left out.
            extinction_ratio: of the polarizer.
            zero_sd_rad: standard deviation of the polarizer's zero mark, radians.
            intensity_stability: relative sd of light and exposure between angles.

        Raises:
            DataError: no complete frame, or angles that do not determine S0, S1 and S2.
        """
        whole = sorted((group for group in self._angles if group.frames), key=lambda group: group.angle_rad)
        light = self._light(whole)
        assert self._saturated is not None
        series = PolarizerSeries(
            angles_rad=tuple(group.angle_rad for group in whole),
            frames=tuple(group.frames for group in whole),
            angle_sd_rad=tuple(group.sd_rad for group in whole),
            extinction_ratio=extinction_ratio,
            noise=noise or SensorNoise(),
            dark_frames=self._dark_frames,
            zero_sd_rad=zero_sd_rad,
            intensity_stability=intensity_stability,
        )
        return AveragedSeries(light, self._saturated.copy(), series, len(whole) < len(self._angles))

    def averaged_mosaic(
        self,
        mosaic: Mosaic,
        *,
        noise: SensorNoise | None = None,
        extinction_ratio: float = math.inf,
        zero_sd_rad: float = 0.0,
        response_sd: float = 1e-3,
    ) -> AveragedSeries:
        """Mean light behind each angle of a sensor with polarizers on its pixels, at full size (bilinear).

        All frames are averaged, whatever their polarizer angle, then interpolated
        (:func:`processing.optics.demosaic.demosaic`). A saturated pixel spoils its neighbours too. Per-pixel errors are
        those of a pixel's own sample: an interpolated one, mean of two or four, is up to twice as good.

        Args:
            mosaic: polarizers on the pixels.
            noise: as :meth:`averaged`.
            extinction_ratio: of these polarizers.
            zero_sd_rad: standard deviation of the sensor's orientation, radians.
            response_sd: relative sd of the response of pixels behind one angle against that behind another.

        Raises:
            DataError: no complete frame, or an odd number of rows or columns.
        """
        whole = [group for group in self._angles if group.frames]
        (mean,) = self._light(whole, together=True)
        assert self._saturated is not None
        frames = sum(group.frames for group in whole)
        series = PolarizerSeries(
            angles_rad=tuple(math.radians(angle) for angle in ANGLES_DEG),
            frames=(frames,) * len(ANGLES_DEG),
            angle_sd_rad=(0.0,) * len(ANGLES_DEG),
            extinction_ratio=extinction_ratio,
            noise=noise or SensorNoise(),
            dark_frames=self._dark_frames,
            zero_sd_rad=zero_sd_rad,
            intensity_stability=response_sd,
            samples_per_pixel=SAMPLES_PER_PIXEL,
        )
        return AveragedSeries(demosaic(mean, mosaic), spread(self._saturated), series, False)

    @property
    def _dark_frames(self) -> int:
        return self._dark.frames if self._dark is not None else 0

    def _light(self, groups: list[_Angle], *, together: bool = False) -> NDArray[np.float32]:
        """(K, rows, columns) mean counts above black of each group, or (1, ...) of all of them ``together``."""
        if self._saturated is None or not groups:
            raise DataError("there is no complete frame of a polarizer series", "collect with [optics] in the plan")
        black = self._dark.total / self._dark.frames if self._dark is not None and self._dark.frames else self._black
        batches = [groups] if together else [[group] for group in groups]
        light = np.empty((len(batches), *self._saturated.shape), dtype=np.float32)
        for image, batch in zip(light, batches, strict=True):
            total = batch[0].total if len(batch) == 1 else np.sum([group.total for group in batch], axis=0)
            image[:] = total / sum(group.frames for group in batch) - black
        return light

    def _group(self, angle_rad: float) -> _Angle | None:
        if not math.isfinite(angle_rad):
            raise DataError(f"a frame's polarizer angle is {angle_rad}", "look at the polarizer's readings")
        for group in self._angles:
            if abs(group.angle_rad - angle_rad) < SAME_ANGLE_RAD:
                return group
        return None
