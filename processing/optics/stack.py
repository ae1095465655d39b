"""Frames of a polarizer series, averaged as they come: memory for one image an angle, whatever the number of frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.optics.analyser_calibration import AnalyserCalibration
from processing.optics.demosaic import SAMPLES_PER_PIXEL, demosaic_by, variance_share
from processing.optics.demosaic_planner import DemosaicChoice, choose_demosaicer
from processing.optics.flat import Corrections
from processing.optics.mosaic import ANGLES_DEG, Mosaic, spread
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.shift_planner import RegistrationChoice, choose_registration
from processing.optics.shifts import Shift, put_back, registered
from processing.optics.stokes import StokesImage, stokes_image

Floats = NDArray[np.float64]

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
    response: NDArray[np.float64] | None = None
    """(rows, columns) what counts were divided by; None: nothing."""
    share: NDArray[np.float64] | None = None
    """(K, 2, 2) and ``common_share``: variance of interpolated planes over that of a sample; None: not interpolated."""
    common_share: float = 0.0
    shifts: tuple[Shift, ...] = ()
    """Shift of each angle's image against the first one's; empty where it was not measured."""
    shifted_back: tuple[bool, ...] = ()
    """Whether it was undone."""
    demosaicer: DemosaicChoice | None = None
    """Which demosaicer a tolerance chose, and why; None where none was asked for."""
    registration: RegistrationChoice | None = None
    """How a tolerance had the images put in place, and why; None where none was asked for."""

    def stokes(self) -> StokesImage:
        """Stokes parameters, DOLP and AOP with their errors."""
        return stokes_image(
            self.light,
            self.saturated,
            self.series,
            incomplete=self.incomplete,
            response=self.response,
            share=self.share,
            common_share=self.common_share,
        )


@dataclass(frozen=True)
class Means:
    """Mean counts above black of each setting of the polarizer, in ascending order of angle."""

    angles_rad: tuple[float, ...]
    angle_sd_rad: tuple[float, ...]
    frames: tuple[int, ...]
    light: NDArray[np.float32]
    """(K, rows, columns)."""
    saturated: NDArray[np.bool_]
    """(rows, columns) saturated in any frame."""
    dark_frames: int
    incomplete: bool
    """A setting has no complete frame."""


def _noise(series: PolarizerSeries, image: int, means: Means, response: NDArray[np.float64] | None) -> Floats:
    """(rows, columns) variance of one image's noise, counts^2."""
    counts = np.maximum(means.light[image].astype(np.float64), 0.0)
    variance = series.noise.variance(counts) / means.frames[image] + series.dark_variance
    return variance if response is None else np.asarray(variance / response**2)


def _mean_noise(series: PolarizerSeries, image: int, means: Means, response: NDArray[np.float64] | None) -> float:
    """Mean over the pixels that are neither saturated nor dead."""
    variance = _noise(series, image, means, response)[~means.saturated]
    known = variance[np.isfinite(variance)]
    return float(known.mean()) if len(known) else 0.0


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

    def means(self, *, together: bool = False) -> Means:
        """Mean counts above black of each angle, or of all frames ``together``.

        The dark frames' mean is subtracted where there are any, else the black level; differences may be negative.

        Raises:
            DataError: no complete frame.
        """
        whole = sorted((group for group in self._angles if group.frames), key=lambda group: group.angle_rad)
        light = self._light(whole, together=together)
        assert self._saturated is not None
        frames = tuple(group.frames for group in whole)
        return Means(
            tuple(group.angle_rad for group in whole),
            tuple(group.sd_rad for group in whole),
            (sum(frames),) if together else frames,
            light,
            self._saturated.copy(),
            self._dark_frames,
            len(whole) < len(self._angles),
        )

    def averaged(
        self,
        *,
        noise: SensorNoise | None = None,
        extinction_ratio: float = math.inf,
        zero_sd_rad: float = 0.0,
        intensity_stability: float = 1e-3,
        corrections: Corrections | None = None,
        analysers: AnalyserCalibration | None = None,
        register: str = "off",
        tolerance_db: float | None = None,
    ) -> AveragedSeries:
        """Mean light of each angle, in ascending order of angle.

        Dark image, linearity, flat field, shifts and analysers are corrected in this order.

        Args:
            noise: noise of one pixel in one frame; rounding and shot noise at one electron a count when left out.
            extinction_ratio: of the polarizer.
            zero_sd_rad: standard deviation of the polarizer's zero mark, radians.
            intensity_stability: relative sd of light and exposure between angles.
            corrections: linearity and flat field.
            analysers: what the polarizer was found to be at each of these angles; takes the place of
                ``extinction_ratio``.
            register: ``"off"``; ``"auto"``: shifts between the images are measured, and undone where they are
                significant (:meth:`processing.optics.shifts.Shift.significant`); ``"on"``: undone wherever measured.
            tolerance_db: largest error by what is out of place, dB below the images; takes the place of ``register``
                (:func:`processing.optics.shift_planner.choose_registration`).

        Raises:
            DataError: no complete frame, angles that do not determine S0, S1 and S2, or a tolerance that is no negative
                number.
        """
        means = self.means()
        sds = means.angle_sd_rad
        if analysers is not None and len(sds) == len(analysers.nominal_rad):
            # A reading differs from that of the calibration by its own sd.
            sds = tuple(map(math.hypot, sds, analysers.typical_angle_sd_rad))
        series = PolarizerSeries(
            angles_rad=means.angles_rad,
            frames=means.frames,
            angle_sd_rad=sds,
            extinction_ratio=extinction_ratio if analysers is None else math.inf,
            noise=noise or SensorNoise(),
            dark_frames=means.dark_frames,
            zero_sd_rad=zero_sd_rad,
            intensity_stability=intensity_stability,
        )
        light, response = (corrections or Corrections()).apply(means.light)
        choice: RegistrationChoice | None = None
        if tolerance_db is None:
            light, saturated, shifts, undone = registered(light, means.saturated, register)
        else:
            noise_of = [_mean_noise(series, i, means, response) for i in range(len(light))]
            choice = choose_registration(light, means.saturated, tolerance_db, variance=noise_of)
            shifts, undone = choice.shifts, choice.way.undo
            light, saturated = put_back(light, means.saturated, shifts, undone, choice.way.degree or 3)
        if analysers is not None:
            light = analysers.idealised(light, series.angles_rad)
        return AveragedSeries(
            light=light.astype(np.float32),
            saturated=saturated,
            series=series,
            incomplete=means.incomplete,
            response=response,
            shifts=shifts,
            shifted_back=undone,
            registration=choice,
        )

    def averaged_mosaic(
        self,
        mosaic: Mosaic,
        *,
        noise: SensorNoise | None = None,
        extinction_ratio: float = math.inf,
        zero_sd_rad: float = 0.0,
        response_sd: float = 1e-3,
        corrections: Corrections | None = None,
        analysers: AnalyserCalibration | None = None,
        method: str = "bilinear",
        tolerance_db: float | None = None,
    ) -> AveragedSeries:
        """Mean light behind each angle of a sensor with polarizers on its pixels, at full size.

        All frames are averaged, whatever their polarizer angle, then interpolated
        (:func:`processing.optics.demosaic.demosaic_by`). A saturated pixel spoils its neighbours too.

        Args:
            mosaic: polarizers on the pixels.
            noise: as :meth:`averaged`.
            extinction_ratio: of these polarizers.
            zero_sd_rad: standard deviation of the sensor's orientation, radians.
            response_sd: relative sd of the response of pixels behind one angle against that behind another.
            corrections: linearity and flat field.
            analysers: what the mosaic's polarizers were found to be; takes the place of ``extinction_ratio``.
            method: of :data:`processing.optics.demosaic.METHODS`.
            tolerance_db: largest error, dB below the light; chooses the method
                (:func:`processing.optics.demosaic_planner.choose_demosaicer`).

        Raises:
            DataError: no complete frame, an odd number of rows or columns, an unknown method, or a tolerance that is no
                negative number.
        """
        means = self.means(together=True)
        (frames,) = means.frames
        series = PolarizerSeries(
            angles_rad=tuple(math.radians(angle) for angle in ANGLES_DEG),
            frames=(frames,) * len(ANGLES_DEG),
            angle_sd_rad=(0.0,) * len(ANGLES_DEG) if analysers is None else analysers.typical_angle_sd_rad,
            extinction_ratio=extinction_ratio if analysers is None else math.inf,
            noise=noise or SensorNoise(),
            dark_frames=means.dark_frames,
            zero_sd_rad=zero_sd_rad,
            intensity_stability=response_sd,
            samples_per_pixel=SAMPLES_PER_PIXEL,
        )
        light, response = (corrections or Corrections()).apply(means.light)
        # A saturated pixel's counts are no light: methods that look further than a neighbour must not see them.
        light[:, means.saturated] = np.nan
        choice: DemosaicChoice | None = None
        if tolerance_db is not None:
            choice = choose_demosaicer(light[0], mosaic, tolerance_db, variance=_noise(series, 0, means, response))
            method = choice.method
        planes = demosaic_by(method, light[0], mosaic)
        if analysers is not None:
            planes = analysers.idealised(planes).astype(np.float32)
        share, common = variance_share(method, mosaic)
        saturated = spread(means.saturated)
        return AveragedSeries(planes, saturated, series, False, response, share, common, demosaicer=choice)

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
