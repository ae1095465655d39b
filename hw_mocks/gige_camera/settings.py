"""Settings of the simulated camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from hw_mocks.gige_camera.pixel_packing import PixelFormat
from hw_mocks.gige_camera.sender import Link
from hw_mocks.sensor import Sensor
from processing.optics.camera_model import Pinhole
from processing.optics.mosaic import Mosaic


@dataclass(frozen=True)
class Optics:
    """Lens, place and polarizers of the camera; the defaults are the thesis's camera (782 x 582, 8.3 um, 8 mm)."""

    width_px: int = 782
    height_px: int = 582
    focal_length_m: float = 0.008
    pixel_pitch_m: float = 8.3e-6
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    depression_deg: float = 17.0
    extinction_ratio: float = 800.0
    mosaic: Mosaic | None = None
    """Polarizers on the pixels (:data:`hw_mocks.gige_camera.render.SONY_MOSAIC`); None for
    a monochrome sensor behind the rig's polarizer."""

    def pinhole(self) -> Pinhole:
        """The camera's geometry."""
        return Pinhole(
            self.focal_length_m,
            self.pixel_pitch_m,
            self.width_px,
            self.height_px,
            self.position_m,
            math.radians(self.depression_deg),
        )


@dataclass(frozen=True)
class Settings:
    """The camera's electronics and what is set at power-up."""

    serial: str = "SIM0001"
    user_name: str = ""
    model: str = "SimCam"
    exposure_s: float = 0.002
    """Exposure at power-up, and that for which the scene's counts hold, s."""
    frame_rate_hz: float = 50.0
    formats: tuple[PixelFormat, ...] = (
        PixelFormat.Mono16,
        PixelFormat.Mono8,
        PixelFormat.Mono10,
        PixelFormat.Mono10p,
        PixelFormat.Mono12,
        PixelFormat.Mono12p,
        PixelFormat.Mono12Packed,
    )
    packet_size: int = 1500
    tick_hz: int = 125_000_000
    drift_ppm: float = 0.0
    """How much faster than the host's clock the camera's runs, parts per million."""
    zip_first: bool = True
    """Whether the first URL leads to the zipped description."""
    seed: int = 0
    repeat_after: int = 0
    """See :class:`hw_mocks.gige_camera.render.SceneView`."""
    sensor: Sensor = field(default_factory=Sensor)
    link: Link = field(default_factory=Link)
