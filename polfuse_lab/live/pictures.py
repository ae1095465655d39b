"""Camera frames as they arrive: at display size with what is saturated, and S0, DOLP and AOP of the series so far."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.live.board import Board
from polfuse_lab.records import Exposure, FrameFlag
from polfuse_lab.rig import CameraSection, Rig
from processing.errors import DataError
from processing.optics.binning import bin_factor, bin_frame
from processing.optics.mosaic import ANGLES_DEG, Mosaic, parse_mosaic, split
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stokes import StokesImage, stokes_image

DISPLAY_ROWS, DISPLAY_COLUMNS = 480, 640
"""Largest picture for display: what fits beside the rest on a small laptop's screen."""
FULL_EVERY_S = 0.2
"""Full-size frames of one angle are shown so often."""
FULL_BYTES = 256_000_000
"""Memory that full-size frames of all angles may take; angles beyond it are shown at display size only."""
OPTICS_EVERY_S = 0.2
SAME_DEG = 0.25

Floats = NDArray[np.float32]


@dataclass
class _Angle:
    """The frames taken in a row at one angle, summed."""

    angle_rad: float
    sd_rad: float
    total: NDArray[np.float64]
    saturated: NDArray[np.bool_]
    frames: int = 0
    closed: bool = False
    """Another angle has been taken since: frames to come begin anew."""

    @property
    def light(self) -> Floats:
        """Mean counts."""
        return (self.total / self.frames).astype(np.float32)


@dataclass(frozen=True)
class Polarized:
    """The newest Stokes parameters, and how many pixels of the sensor one of theirs is."""

    image: StokesImage
    factor: int
    t_sample_ns: int


@dataclass
class _Series:
    angles: dict[str, _Angle] = field(default_factory=dict)
    dark: _Angle | None = None
    source_rad: float | None = None


class Pictures:
    """Makes pictures of camera frames. Used by one thread.

    Args:
        rig: the rig, with a camera.
        board: where they go.
        angles_deg: polarizer angles of the plan; None where there is none.
        frames_per_angle: frames that the plan takes at each.
    """

    def __init__(
        self, rig: Rig, board: Board, *, angles_deg: tuple[float, ...] | None = None, frames_per_angle: int = 1
    ) -> None:
        assert rig.camera is not None
        self._rig, self._camera, self._board = rig, rig.camera, board
        self._planned = None if angles_deg is None else {_name(math.radians(angle)) for angle in angles_deg}
        self._frames_per_angle = frames_per_angle
        self._mosaic: Mosaic | None = parse_mosaic(self._camera.mosaic) if self._camera.has_mosaic else None
        self._series = _Series()
        self._full_at: dict[str, float] = {}
        self._full_bytes = 0
        self._solved = 0.0
        self.polarized: Polarized | None = None
        """The newest Stokes parameters."""

    def take(self, exposure: Exposure) -> None:
        """Show a frame, and what the series amounts to with it. Raises :class:`DataError` for what is no frame."""
        camera, frame = self._camera, exposure.frame
        shape = frame.image.shape if self._mosaic is None else (frame.image.shape[0] // 2, frame.image.shape[1] // 2)
        factor = bin_factor((shape[0], shape[1]), DISPLAY_ROWS, DISPLAY_COLUMNS)
        if self._mosaic is None:
            planes = [bin_frame(frame.image, factor, camera.saturation_counts)]
            name, across = _name(exposure.angle_rad), factor
        else:
            quarters = split(frame.image, self._mosaic)
            planes = [bin_frame(plane, factor, camera.saturation_counts) for plane in quarters]
            name, across = "mosaic", 2 * factor
        image, saturated = _mean([mean for mean, _ in planes]), _mean([share for _, share in planes])
        values: dict[str, Any] = {
            "angle_deg": math.degrees(exposure.angle_rad),
            "exposure_s": frame.exposure_s,
            "saturated_fraction": float(saturated.mean()),
            "brightest": int(frame.image.max()),
            "full_scale": camera.saturation_counts,
            "factor": across,
            "frame": frame.frame_id,
            "dark": exposure.dark,
        }
        units = {"image": "counts", "saturated": "of the pixels", "angle_deg": "deg", "exposure_s": "s"}
        at_ns = frame.t_host_ns
        self._board.put(
            f"camera.{name}", {"image": image, "saturated": saturated}, t_sample_ns=at_ns, units=units, values=values
        )
        self._show_full(name, frame.image, at_ns, units, values)
        if not frame.incomplete and not exposure.flags & FrameFlag.MOVED:
            self._add(exposure, planes)
            self._solve(across, factor, at_ns)

    def _show_full(
        self, name: str, image: NDArray[Any], at_ns: int, units: dict[str, str], values: dict[str, Any]
    ) -> None:
        now = time.monotonic()
        if name not in self._full_at:
            if self._full_bytes + 2 * image.nbytes > FULL_BYTES:
                return
            self._full_bytes += 2 * image.nbytes
        elif now - self._full_at[name] < FULL_EVERY_S:
            return
        self._full_at[name] = now
        self._board.put(f"frame.{name}", {"image": image}, t_sample_ns=at_ns, units=units, values=values, slots=2)

    def _add(self, exposure: Exposure, planes: list[tuple[Floats, Floats]]) -> None:
        series = self._series
        if exposure.source_angle_rad != series.source_rad:
            self._series = series = _Series(dark=series.dark, source_rad=exposure.source_angle_rad)
        light = np.stack([mean for mean, _ in planes]).astype(np.float64)
        saturated = np.stack([share > 0 for _, share in planes])
        if exposure.dark:
            dark = series.dark
            if dark is None or dark.closed or dark.total.shape != light.shape:
                series.dark = dark = _Angle(0.0, 0.0, np.zeros_like(light), np.zeros_like(saturated))
            dark.total += light
            dark.frames += 1
            return
        if series.dark is not None:
            series.dark.closed = True
        name = _name(exposure.angle_rad) if self._mosaic is None else "mosaic"
        for other, angle in series.angles.items():
            angle.closed = angle.closed or other != name
        known = series.angles.get(name)
        if known is None or known.closed or known.total.shape != light.shape or self._mosaic is not None:
            known = _Angle(
                exposure.angle_rad, exposure.angle_sd_rad, np.zeros_like(light), np.zeros_like(saturated)
            )  # fmt: skip
            series.angles[name] = known
        known.total += light
        known.saturated |= saturated
        known.frames += 1

    def _solve(self, across: int, factor: int, at_ns: int) -> None:
        """Stokes parameters of what there is, once three angles are."""
        angles = sorted(self._series.angles.values(), key=lambda angle: angle.angle_rad)
        if self._mosaic is None and len(angles) < 3:
            return
        complete = self._complete()
        now = time.monotonic()
        if not complete and now - self._solved < OPTICS_EVERY_S:
            return
        self._solved = now
        dark = self._series.dark
        try:
            light = np.concatenate([angle.light for angle in angles])
            saturated = np.logical_or.reduce(np.concatenate([angle.saturated for angle in angles]))
            if dark is not None and dark.frames:
                light = light - dark.light
            else:
                light = light - np.float32(self._camera.black_level_counts)
            series = self._described(angles, factor)
            image = stokes_image(np.ascontiguousarray(light, dtype=np.float32), saturated, series)
        except (DataError, ValueError):
            return  # angles that do not determine S0, S1 and S2, or of different sizes: more may come
        self.polarized = Polarized(image, across, at_ns)
        self._board.put(
            "optics",
            {
                "s0": image.s0,
                "dolp": image.dolp,
                "aop_rad": image.aop,
                "dolp_sd": image.dolp_sd,
                "aop_sd_rad": image.aop_sd,
                "flags": image.flags,
            },
            t_sample_ns=at_ns,
            units={"s0": "counts", "dolp": "1", "aop_rad": "rad", "dolp_sd": "1", "aop_sd_rad": "rad", "flags": "bits"},
            values={
                "dolp_median": None if math.isnan(image.dolp_median) else image.dolp_median,
                "masked_fraction": image.masked_fraction,
                "frames": sum(angle.frames for angle in angles),
                "angles_deg": [round(math.degrees(angle), 2) for angle in series.angles_rad],
                "complete": complete,
                "factor": across,
            },
        )

    def _complete(self) -> bool:
        angles = self._series.angles
        if self._mosaic is not None:
            return True
        if self._planned is None:
            return len(angles) >= 3
        return all(name in angles and angles[name].frames >= self._frames_per_angle for name in self._planned)

    def _described(self, angles: list[_Angle], factor: int) -> PolarizerSeries:
        """What the series is known to be; a mean over a block is as good as so many frames more."""
        camera: CameraSection = self._camera
        noise = SensorNoise(camera.read_noise_counts, camera.electrons_per_count)
        block = factor * factor
        dark = 0 if self._series.dark is None else self._series.dark.frames * block
        if self._mosaic is not None:
            count = len(ANGLES_DEG)
            return PolarizerSeries(
                angles_rad=tuple(math.radians(angle) for angle in ANGLES_DEG),
                frames=(angles[0].frames * block,) * count,
                angle_sd_rad=(0.0,) * count,
                extinction_ratio=camera.mosaic_extinction_ratio,
                noise=noise,
                dark_frames=dark,
            )
        assert self._rig.polarizer is not None
        return PolarizerSeries(
            angles_rad=tuple(angle.angle_rad for angle in angles),
            frames=tuple(angle.frames * block for angle in angles),
            angle_sd_rad=tuple(angle.sd_rad for angle in angles),
            extinction_ratio=self._rig.polarizer.extinction_ratio,
            noise=noise,
            dark_frames=dark,
        )


def _mean(planes: list[Floats]) -> Floats:
    return planes[0] if len(planes) == 1 else np.stack(planes).mean(axis=0, dtype=np.float32)


def _name(angle_rad: float) -> str:
    """An angle's stream: degrees modulo 180, to a quarter of a degree, so that readings of one setting are one."""
    degrees = round(math.degrees(angle_rad) / SAME_DEG) * SAME_DEG % 180.0
    return f"{degrees:06.2f}".rstrip("0").ljust(5, "0")
