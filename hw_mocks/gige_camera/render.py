"""What the camera sees: frames of the scene through the polarizer as it really moved, or through the sensor's own."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hw_mocks.gige_camera.pixel_packing import Image
from hw_mocks.sensor import Sensor, setting_of
from hw_mocks.world import World
from processing.optics.analyser import measurement_matrix
from processing.optics.camera_model import Pinhole
from processing.optics.mosaic import Mosaic, parse_mosaic, through_mosaic
from processing.scene.model import Scene
from processing.scene.optical import stokes_image

SONY_MOSAIC = parse_mosaic("90-45-135-0")
"""Polarizers on the pixels of Sony's polarization sensors."""

_INSTANTS = 33
_CACHED = 64


@dataclass(frozen=True)
class Exposure:
    """One frame to be taken."""

    number: int
    """Frames since power-up, from 0."""
    start_ns: int
    """Host's monotonic time at which the exposure began, ns."""
    duration_s: float
    gain: float
    """Amplification, a factor."""
    rows: slice
    columns: slice


class FrameSource(Protocol):
    """Where a simulated camera has its frames from."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the whole sensor."""
        ...

    def take(self, exposure: Exposure) -> Image:
        """The frame, uint16 (rows, columns) of the region; called after the exposure is over."""
        ...


class Pattern:
    """A test pattern that no two frames and hardly two pixels share: (7 column + 13 row + 16 number) modulo 65536.

    Args:
        rows: rows of the sensor.
        columns: columns of the sensor.
    """

    def __init__(self, rows: int, columns: int) -> None:
        self._first = np.add.outer(np.arange(rows) * 13, np.arange(columns) * 7).astype(np.uint16)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self._first.shape[0], self._first.shape[1]

    def take(self, exposure: Exposure) -> Image:
        """The pattern of that frame."""
        region: Image = self._first[exposure.rows, exposure.columns] + np.uint16(exposure.number * 16 & 0xFFFF)
        return region


class SceneView:
    """The scene as a sensor sees it.

    A monochrome sensor looks through the rig's polarizer: a frame is the mean over its exposure of what the polarizer
    passed at each instant, wherever it stood or turned. A sensor with a mosaic of polarizers on its pixels looks at
    the scene directly; the rig's polarizer is not in its way.

    A frame's noise depends on the seed, the polarizer's setting and how many frames were taken at that setting before,
    as with :class:`hw_mocks.scene_camera.SceneCamera`, whose frames these are at the same settings.

    Args:
        scene: what there is to see.
        world: the simulated rig, which knows how the polarizer moved.
        pinhole: the optics.
        sensor: noise and limits.
        reference_exposure_s: exposure for which the scene's counts hold, s.
        extinction_ratio: of the polarizers, maximum over minimum transmittance.
        mosaic: polarizers on the pixels, or None for a monochrome sensor.
        seed: of the noise.
        repeat_after: number of different frames at one setting after which they come again in turn, 0 for never.
            Noise takes some 50 ms for a frame of 782 x 582; repeated frames take none.
    """

    def __init__(
        self,
        scene: Scene,
        world: World,
        pinhole: Pinhole,
        sensor: Sensor,
        *,
        reference_exposure_s: float,
        extinction_ratio: float,
        mosaic: Mosaic | None,
        seed: int,
        repeat_after: int,
    ) -> None:
        stokes, _ = stokes_image(scene, pinhole)
        self._counts = stokes * scene.sun_counts
        self._world, self._sensor = world, sensor
        self._reference_s, self._extinction = reference_exposure_s, extinction_ratio
        self._seed, self._repeat_after = seed, repeat_after
        self._mosaic = None if mosaic is None else through_mosaic(self._counts, mosaic, extinction_ratio)
        self._taken: dict[int, int] = {}
        self._cache: OrderedDict[tuple[object, ...], Image] = OrderedDict()

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the sensor."""
        return self._counts.shape[1], self._counts.shape[2]

    def take(self, exposure: Exposure) -> Image:
        """One frame with the noise that belongs to it."""
        row, setting = self._analyser(exposure)
        taken = self._taken.get(setting, 0)
        self._taken[setting] = taken + 1
        if not self._repeat_after:
            return self._expose(exposure, row, setting, taken)
        taken %= self._repeat_after
        region = (exposure.rows.start, exposure.rows.stop, exposure.columns.start, exposure.columns.stop)
        key = (setting, taken, exposure.duration_s, exposure.gain, *region)
        if key not in self._cache:
            self._cache[key] = self._expose(exposure, row, setting, taken)
            if len(self._cache) > _CACHED:
                self._cache.popitem(last=False)
        return self._cache[key]

    def _analyser(self, exposure: Exposure) -> tuple[NDArray[np.float64], int]:
        """What the polarizer passed of (S0, S1, S2), mean over the exposure, and its setting as a noise key."""
        if self._mosaic is not None:
            return np.zeros(3), 0
        instants = exposure.start_ns + np.linspace(0, exposure.duration_s * 1e9, _INSTANTS).astype(np.int64)
        angles = self._world.polarizer_rad.at_many(instants)
        # Trapezoidal rule: between instants cos 2t is nearly straight, at the 400 degrees per second of a fast mount.
        weights = np.ones(_INSTANTS)
        weights[[0, -1]] = 0.5
        if np.all(angles == angles[0]):
            return measurement_matrix([float(angles[0])], self._extinction)[0], setting_of(float(angles[0]))
        rows = measurement_matrix(angles, self._extinction)
        return np.average(rows, axis=0, weights=weights), setting_of(float(np.average(angles, weights=weights)))

    def _expose(self, exposure: Exposure, row: NDArray[np.float64], setting: int, taken: int) -> Image:
        rows, columns = exposure.rows, exposure.columns
        if self._mosaic is None:
            light = np.tensordot(row, self._counts[:, rows, columns], axes=1)
        else:
            light = self._mosaic[rows, columns]
        light = light * (exposure.duration_s / self._reference_s)
        return self._sensor.expose(light, [self._seed, setting, taken], gain=exposure.gain)
