"""A camera behind a rotating polarizer that looks at a scene: a driver like any other, without hardware.

A camera with a mosaic of polarizers on its pixels looks at the scene directly; the rig's polarizer is not in its way.
The scene is rendered once. Every trigger asks the simulated rig how its polarizer stands, takes the light through it
(Malus' law with a finite extinction ratio), and adds shot noise, read noise, the black level, rounding and clipping.

A frame's noise depends on the seed, the polarizer's angle and how many frames were taken at that angle before, and on
nothing else: two sessions of one seed hold the same frames, whenever they were taken.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused
from drivers.options import checked
from drivers.records import ClockFix, Frame, Identity
from hw_mocks.sensor import FULL_SCALE, Sensor, setting_of
from hw_mocks.world_link import WorldClient
from processing.errors import DataError
from processing.optics.analyser import measurement_matrix
from processing.optics.camera_model import Pinhole
from processing.optics.mosaic import parse_mosaic, through_mosaic
from processing.scene.optical import stokes_image

EXPOSURE_LIMITS_S = (10e-6, 10.0)
"""Shortest and longest exposure, s: those of usual industrial cameras."""


class SceneCamera:
    """Contract :class:`drivers.contracts.Camera`, delivering Mono16 frames of a scene."""

    @dataclass(frozen=True)
    class Options:
        """Settings of the simulated camera; the defaults are the thesis's camera (782 x 582, 8.3 um)."""

        __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

        scene_file: str
        """Scene file."""
        world_url: str
        """Where the simulated rig tells its state, ``tcp://127.0.0.1:PORT?token=...``."""
        width_px: Annotated[int, Gt(0)] = 782
        """Columns."""
        height_px: Annotated[int, Gt(0)] = 582
        """Rows."""
        exposure_s: Annotated[float, Ge(0)] = 0.002
        """Exposure, s; the scene's counts hold for it."""
        focal_length_m: Annotated[float, Gt(0)] = 0.008
        """Focal length, m."""
        pixel_pitch_m: Annotated[float, Gt(0)] = 8.3e-6
        """Distance of neighbouring pixels, m."""
        position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
        """Entrance pupil in rig coordinates, m."""
        depression_deg: float = 17.0
        """Angle of the optical axis below horizontal, degrees."""
        black_level_counts: Annotated[float, Ge(0)] = 0.0
        """Counts without light."""
        electrons_per_count: Annotated[float, Gt(0)] = 1.0
        """Photo-electrons for one count."""
        read_noise_counts: Annotated[float, Ge(0)] = 0.0
        """Read noise, counts rms."""
        saturation_counts: Annotated[int, Gt(0)] = FULL_SCALE
        """Counts at which the sensor clips."""
        extinction_ratio: Annotated[float, Gt(1)] = 800.0
        """Maximum over minimum transmittance of the polarizer, or of the mosaic's."""
        mosaic: str = "none"
        """Polarizers on the sensor's pixels, such as "90-45-135-0"; "none" for a camera behind the rig's polarizer."""
        seed: Annotated[int, Ge(0)] = 0
        """Seed of the noise."""
        picture_file: str = ""
        """What 'polfuse sim' traced of a scene of bodies: Stokes parameters as a NumPy file."""

    def __init__(self, options: Options) -> None:
        self._options = checked(options)
        self._where = f"scene camera ({Path(options.scene_file).name})"
        self._sensor = Sensor(
            options.black_level_counts,
            options.electrons_per_count,
            options.read_noise_counts,
            options.saturation_counts,
        )
        self._world: WorldClient | None = None
        self._exposure_s = options.exposure_s
        self._counts: NDArray[np.float64] | None = None
        self._opened_ns = 0
        self._frames = 0
        self._taken: dict[int, int] = {}
        self._asked: tuple[float, int] | None = None

    def open(self) -> Identity:
        """Render the scene and find the simulated rig.

        Raises:
            DeviceError: the scene file or an option cannot be used.
            DeviceLost: the simulated rig does not run.
        """
        from hw_mocks.scene_file import load_scene

        options = self._options
        self.close()
        try:
            scene = load_scene(options.scene_file)
            if options.picture_file:
                scene = replace(scene, picture=np.load(options.picture_file, allow_pickle=False))
            pinhole = Pinhole(
                options.focal_length_m,
                options.pixel_pitch_m,
                options.width_px,
                options.height_px,
                options.position_m,
                math.radians(options.depression_deg),
            )
            stokes, _ = stokes_image(scene, pinhole)
            mosaic = None if options.mosaic == "none" else parse_mosaic(options.mosaic)
            counts = stokes * scene.sun_counts
            if mosaic is not None:
                counts = through_mosaic(counts, mosaic, options.extinction_ratio)
        except DataError as error:
            raise DeviceError(error.what, where=self._where, advice=error.advice) from error
        except DeviceError:
            raise
        except Exception as error:
            raise DeviceError(
                f"the scene cannot be loaded ({error})", where=self._where, advice="check option scene_file"
            ) from error
        world = WorldClient(options.world_url, timeout_s=1.0)
        world.state()
        self._world = world
        self._counts = counts
        self._exposure_s = options.exposure_s
        self._opened_ns = time.monotonic_ns()
        self._frames = 0
        self._taken = {}
        return Identity(
            "camera", "scene", f"simulated camera looking at '{scene.name}'", f"{options.width_px}x{options.height_px}"
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame."""
        return self._options.height_px, self._options.width_px

    @property
    def lost_frames(self) -> int:
        """Always 0: nothing gets lost here."""
        return 0

    def trigger(self) -> None:
        """Begin an exposure with the polarizer as it stands now."""
        if self._world is None:
            raise self._closed()
        self._asked = None
        state = self._world.state()
        angle = state["polarizer_rad"]
        if not math.isfinite(angle):
            raise DeviceBadAnswer(
                f"the simulated polarizer stands at {angle}", where=self._where, advice="restart 'polfuse sim'"
            )
        self._asked = angle, time.monotonic_ns()

    def poll(self) -> Frame | None:
        """The frame asked for, once its exposure is over; else None."""
        if self._counts is None:
            raise self._closed()
        if self._asked is None:
            return None
        angle, t_ns = self._asked
        if time.monotonic_ns() - t_ns < self._exposure_s * 1e9:
            return None
        self._asked = None
        frame = Frame(
            image=self._expose(angle),
            frame_id=self._frames,
            exposure_s=self._exposure_s,
            gain_db=0.0,
            t_device_s=(t_ns - self._opened_ns) * 1e-9,
            t_host_ns=t_ns,
        )
        self._frames += 1
        return frame

    def clock(self) -> ClockFix | None:
        """The camera's clock, which counts from :meth:`open`, against the host's."""
        if self._world is None:
            return None
        now = time.monotonic_ns()
        return ClockFix("camera", (now - self._opened_ns) * 1e-9, now, 0)

    def exposure_limits(self) -> tuple[float, float]:
        """Shortest and longest exposure, s."""
        return EXPOSURE_LIMITS_S

    def set_exposure(self, seconds: float) -> float:
        """Expose so long from the next trigger on; light grows in proportion.

        Raises:
            DeviceRefused: outside the limits, or exposure_s is 0 and says nothing of the light.
        """
        low, high = EXPOSURE_LIMITS_S
        if not low <= seconds <= high or self._options.exposure_s == 0:
            raise DeviceRefused(
                f"an exposure of {seconds:g} s", where=self._where, advice=f"ask for {low:g} to {high:g} s"
            )
        self._exposure_s = seconds
        return seconds

    def make_safe(self) -> None:
        """Forget the frame asked for."""
        self._asked = None

    def close(self) -> None:
        """Hang up. Idempotent."""
        self._asked = None
        self._counts = None
        if self._world is not None:
            self._world.close()
            self._world = None

    def _expose(self, angle_rad: float) -> NDArray[np.unsignedinteger]:
        """One frame, (rows, columns) uint16, with the noise that belongs to it."""
        options = self._options
        assert self._counts is not None
        # All frames of a mosaic are taken at one setting, wherever the rig's polarizer stands.
        setting = 0 if self._counts.ndim == 2 else setting_of(angle_rad)
        taken = self._taken.get(setting, 0)
        self._taken[setting] = taken + 1
        if self._counts.ndim == 2:
            light = self._counts
        else:
            row = measurement_matrix([angle_rad], options.extinction_ratio)[0]
            light = np.tensordot(row, self._counts, axes=1)
        if self._exposure_s != options.exposure_s:
            light = light * (self._exposure_s / options.exposure_s)
        return self._sensor.expose(light, [options.seed, setting, taken])

    def _closed(self) -> DeviceLost:
        return DeviceLost("is not open", where=self._where, advice="open it first")
