"""Frames of a polarizer series, averaged as they come: memory for one image an angle, whatever the number of frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
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
        if self._saturated is None or not whole:
            raise DataError("there is no complete frame of a polarizer series", "collect with [optics] in the plan")
        dark_frames = self._dark.frames if self._dark is not None else 0
        series = PolarizerSeries(
            angles_rad=tuple(group.angle_rad for group in whole),
            frames=tuple(group.frames for group in whole),
            angle_sd_rad=tuple(group.sd_rad for group in whole),
            extinction_ratio=extinction_ratio,
            noise=noise or SensorNoise(),
            dark_frames=dark_frames,
            zero_sd_rad=zero_sd_rad,
            intensity_stability=intensity_stability,
        )
        black = self._dark.total / dark_frames if self._dark is not None and dark_frames else self._black
        light = np.empty((len(whole), *self._saturated.shape), dtype=np.float32)
        for image, group in zip(light, whole, strict=True):
            image[:] = group.total / group.frames - black
        return AveragedSeries(light, self._saturated.copy(), series, len(whole) < len(self._angles))

    def _group(self, angle_rad: float) -> _Angle | None:
        if not math.isfinite(angle_rad):
            raise DataError(f"a frame's polarizer angle is {angle_rad}", "look at the polarizer's readings")
        for group in self._angles:
            if abs(group.angle_rad - angle_rad) < SAME_ANGLE_RAD:
                return group
        return None
