"""One scene in both eyes on one ground grid: a focused quad-polarized picture, Stokes parameters, and the truth.

The airborne geometry of the thesis (Tables 7.1 and 7.2): the camera stands in the middle of the radar's straight track
and looks along the same line of sight.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.fusion.registration import ground_to_camera, sample_bilinear
from processing.optics.camera_model import Pinhole
from processing.optics.debias import debias
from processing.radar.phase_history import history_profiles
from processing.raytrace.backward import backward
from processing.raytrace.bvh import build
from processing.raytrace.picture import Picture
from processing.raytrace.sources import RayleighSky, Source, Sun
from processing.raytrace.view import View
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid
from processing.scattering.history import Sweep
from processing.scattering.shooting import Density
from processing.scene.radar_simulation import MECHANISMS, RadarLook, Simulated, simulate_radar, straight_track
from processing.scene.solids import SolidScene

Floats = NDArray[np.float64]

CHANNELS = ("HH", "HV", "VH", "VV")


@dataclass(frozen=True)
class Airborne:
    """Where both eyes fly and what they are (thesis Tables 7.1 and 7.2)."""

    altitude_m: float = 15_000.0
    look_rad: float = math.pi / 4
    """From straight down to the line of sight, across the track."""
    centre_hz: float = 15e9
    bandwidth_hz: float = 0.75e9
    pulses: int = 600
    track_m: float = 300.0
    """600 pulses at 400 Hz and 200 m/s."""
    frequencies: int = 512
    focal_length_m: float = 1.110
    pixel_pitch_m: float = 30e-6
    noise_equivalent_db: float = -30.0
    """Radar's noise as the backscatter coefficient that it looks like; typical of airborne sets."""
    electrons: float = 10_500.0
    """Of a pixel at full scale behind each polarizer, for shot noise (a Sony IMX250MZR's saturation)."""
    frames: int = 30
    """Pictures that are averaged: 20 a second while the radar records its 1.5 s."""

    @property
    def platform_m(self) -> tuple[float, float, float]:
        """Middle of the track, the scene's middle being the origin."""
        return 0.0, -self.altitude_m * math.tan(self.look_rad), self.altitude_m


@dataclass(frozen=True)
class RadarPicture:
    """What the radar sees on the ground grid."""

    channels: NDArray[np.complex128]
    """(4, ny, nx) HH, HV, VH, VV with noise, sqrt(m^2)."""
    powers: Floats
    """(3, ny, nx) span that each of ``MECHANISMS`` alone returns, m^2."""
    noise: float
    """Expected span of noise alone, m^2."""
    simulated: Simulated


@dataclass(frozen=True)
class OpticalPicture:
    """What the camera sees, brought to the ground grid."""

    s0: Floats
    """(ny, nx), of a white surface that faces the sun."""
    s1: Floats
    """(ny, nx), as ``s0``, in the camera's frame (x horizontal)."""
    s2: Floats
    dolp: Floats
    """(ny, nx), with shot noise, its bias taken off."""
    dolp_sd: Floats
    """(ny, nx) standard deviation of DOLP by shot noise."""
    picture: Picture
    """As it was traced, without noise."""


def radar_picture(
    scene: SolidScene,
    grid: ImageGrid,
    how: Airborne | None = None,
    *,
    density: Density | None = None,
    points_per_m2: float = 20.0,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> RadarPicture:
    """Simulate the radar and focus its echoes by back-projection, with Hann's window in range and along the track.

    Args:
        scene: bodies.
        grid: the pixels.
        how: flight and radar; the thesis's by default.
        density: of rays.
        points_per_m2: scatterers of rough ground.
        seed: of rough ground and noise.
        progress: called with the fraction done.

    Raises:
        DataError: a scene or grid that cannot be simulated.
    """
    air = how or Airborne()
    track = straight_track(air.platform_m, air.track_m, air.pulses)
    sweep = Sweep(air.centre_hz, air.bandwidth_hz, air.frequencies)
    look = RadarLook(track, (0.0, 0.0, 0.0), sweep, density or Density(0.15, 2, 3), points_per_m2, seed=seed)
    simulated = simulate_radar(scene, look, progress=progress)
    slant = float(np.linalg.norm(air.platform_m))
    # Hann's window without the zeros at its ends.
    weights = np.hanning(air.pulses + 2)[1:-1]
    focused = (
        np.stack(
            [
                backproject(history_profiles(simulated.histories[name], window="hann"), grid, weights=weights)
                for name in MECHANISMS
            ]
        ).astype(np.complex128)
        * slant**2
    )
    # A noise coefficient fills a resolution cell of the ground (Hann broadens each side by half).
    cell = 1.5**2 * _cell_m2(air, slant)
    noise = 10 ** (air.noise_equivalent_db / 10) * cell
    random = np.random.default_rng(seed + 1)
    shape = (4, *grid.shape)
    thermal = random.standard_normal(shape) + 1j * random.standard_normal(shape)
    powers = np.sum(np.abs(focused) ** 2, axis=1)
    return RadarPicture(focused.sum(axis=0) + math.sqrt(noise / 2) * thermal, powers, 3 * noise, simulated)


def _cell_m2(air: Airborne, slant_m: float) -> float:
    from processing.radar.profiles import SPEED_OF_LIGHT_M_S

    ground = SPEED_OF_LIGHT_M_S / (2 * air.bandwidth_hz * math.sin(air.look_rad))
    return ground * slant_m * SPEED_OF_LIGHT_M_S / air.centre_hz / (2 * air.track_m)


def sunlight(sun_azimuth_rad: float, sun_zenith_rad: float, sky_share: float = 0.2) -> tuple[Source, ...]:
    """Sun and sky; azimuth from the sensor's, so that 0 has the sun behind the camera.

    Args:
        sun_azimuth_rad, sun_zenith_rad: where the sun stands.
        sky_share: irradiance of the sky on level ground over the sun's; 0.2 is a clear day's.
    """
    across = math.sin(sun_zenith_rad)
    towards = (
        across * math.sin(sun_azimuth_rad), -across * math.cos(sun_azimuth_rad), math.cos(sun_zenith_rad)
    )  # fmt: skip
    radiance = sky_share * math.cos(sun_zenith_rad) / math.pi
    return Sun(towards), RayleighSky(towards, radiance)


def optical_picture(
    scene: SolidScene,
    grid: ImageGrid,
    lights: Sequence[Source],
    how: Airborne | None = None,
    *,
    samples: int = 1000,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> OpticalPicture:
    """Trace the camera's picture, add shot noise, and read it at the ground grid's pixels.

    Args:
        scene: bodies.
        grid: the pixels.
        lights: such as :func:`sunlight`.
        how: flight and camera; the thesis's by default.
        samples: rays for each of the camera's pixels.
        seed: of rays and noise.
        progress: called with the fraction done.

    Raises:
        DataError: a scene without light, or a grid off the ground plane z = 0.
    """
    if grid.z_m != 0:
        raise DataError(f"the ground grid lies at {grid.z_m} m", "this geometry has the ground at z = 0")
    air = how or Airborne()
    pixel = float(np.linalg.norm(air.platform_m)) * air.pixel_pitch_m / air.focal_length_m
    wide = 2 * math.ceil((float(np.abs(grid.x_m).max()) / pixel) + 3)
    high = 2 * math.ceil((float(np.abs(grid.y_m).max()) * math.cos(air.look_rad) / pixel) + 3)
    focal = air.focal_length_m / air.pixel_pitch_m
    view = View(air.platform_m, (0.0, 0.0, 0.0), wide, high, 2 * math.atan(wide / 2 / focal))
    picture = backward(scene.world(lights), view, samples=samples, leave_out=False, seed=seed, progress=progress)
    # Full scale is a white surface (radiance 1 / pi) that faces the sun, half of it behind each polarizer.
    per_unit = 2 * air.electrons * air.frames * math.pi
    counts = np.maximum(picture.stokes[..., 0], 0) * per_unit
    random = np.random.default_rng(seed + 2)
    # Two pairs of crossed polarizers: S1 and S2 have the variance of their counts, S0 (the mean of both pairs) half.
    noisy = [
        picture.stokes[..., k] + random.standard_normal(counts.shape) * np.sqrt(counts * share) / per_unit
        for k, share in enumerate((0.5, 1.0, 1.0))
    ]
    depression = math.pi / 2 - air.look_rad
    camera = Pinhole(air.focal_length_m, air.pixel_pitch_m, wide, high, air.platform_m, depression)
    u, v = ground_to_camera(camera, grid.x_m, grid.y_m, grid.z_m)
    s0, s1, s2 = (sample_bilinear(plane, u, v) for plane in noisy)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.maximum(s0, 0) / per_unit
        dolp = debias(np.hypot(s1, s2), variance) / s0
        spread = np.sqrt(variance) / s0
    lit = s0 > 0
    return OpticalPicture(
        s0=s0 * math.pi,
        s1=s1 * math.pi,
        s2=s2 * math.pi,
        dolp=np.where(lit, dolp, np.nan),
        dolp_sd=np.where(lit, spread, np.nan),
        picture=picture,
    )


def bodies_from_above(scene: SolidScene, grid: ImageGrid) -> NDArray[np.int64]:
    """Which body (ny, nx) stands on each ground pixel: the first that a ray from straight above meets; -1: none."""
    mesh, owner = scene.mesh()
    x, y = np.meshgrid(grid.x_m, grid.y_m)
    top = float(mesh.vertices_m[:, 2].max()) + 1.0
    origin = np.stack([x.ravel(), y.ravel(), np.full(x.size, top)], axis=1)
    met = build(mesh).closest(origin, np.tile([0.0, 0.0, -1.0], (x.size, 1))).triangle
    return np.where(met >= 0, owner[met], -1).reshape(grid.shape)
