"""One scene in both eyes on one ground grid: a focused quad-polarized picture, Stokes parameters, and the truth.

The airborne geometry of the thesis (Tables 7.1 and 7.2): the camera stands in the middle of the radar's straight track
and looks along the same line of sight.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.fusion.registration import ground_to_camera, sample_bilinear
from processing.optics.analyser import least_squares, measurement_matrix
from processing.optics.camera_model import Pinhole
from processing.optics.debias import debias
from processing.radar.antenna import one_way_gain
from processing.radar.phase_history import PhaseHistory, history_profiles
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.radar.ranging import window_weights
from processing.raytrace.backward import backward
from processing.raytrace.bvh import build
from processing.raytrace.picture import Picture
from processing.raytrace.planner import TracePlan, trace_to
from processing.raytrace.sources import RayleighSky, Source, Sun
from processing.raytrace.view import View
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid
from processing.scattering.contributions import Beam
from processing.scattering.history import Sweep
from processing.scattering.shooting import Density
from processing.scene.radar_planner import RadarPlan, plan_radar
from processing.scene.radar_simulation import MECHANISMS, RadarLook, Simulated, simulate_radar, straight_track
from processing.scene.solids import SolidScene

Floats = NDArray[np.float64]

CHANNELS = ("HH", "HV", "VH", "VV")
ANGLES_RAD = (0.0, math.pi / 4, math.pi / 2, 3 * math.pi / 4)
"""Of the polarizer, in the order of the exposures."""
ANALYSERS = measurement_matrix(ANGLES_RAD)
BOUNCES = 4
"""Of light, where no tolerance chooses them."""


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
    speed_m_s: float = 200.0
    beamwidth_rad: float | None = None
    """Half-power width of one antenna's beam, which looks broadside at the scene's middle from everywhere; None: the
    scene is lit evenly from all of the track."""
    exposure_interval_s: float = 0.0
    """From one of the polarizer's four angles to the next, the first at time 0; 0: all at once."""

    @property
    def platform_m(self) -> tuple[float, float, float]:
        """Middle of the track, the scene's middle being the origin."""
        return 0.0, -self.altitude_m * math.tan(self.look_rad), self.altitude_m

    @property
    def slant_m(self) -> float:
        """From there to the scene's middle."""
        return self.altitude_m / math.cos(self.look_rad)

    @property
    def aperture_m(self) -> float:
        """Part of the track from which a point is seen."""
        if self.beamwidth_rad is None:
            return self.track_m
        return min(self.track_m, 2 * self.slant_m * math.tan(self.beamwidth_rad / 2))

    @property
    def time_s(self) -> Floats:
        """(pulses,) when they are sent: 0 in the middle of the track."""
        return np.asarray(np.linspace(-0.5, 0.5, self.pulses) * self.track_m / self.speed_m_s, dtype=np.float64)


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
    plan: RadarPlan | None = None
    """How a tolerance chose; None where density was told."""


@dataclass(frozen=True)
class Exposures:
    """What a camera takes behind a polarizer that turns: one angle after the other."""

    electrons: Floats
    """(4, rows, columns) of a pixel, mean of the frames, with shot noise; behind 0, 45, 90 and 135 degrees."""
    time_s: tuple[float, ...]
    frames: int
    camera: Pinhole


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
    """As it was traced, without noise; of time 0."""
    exposures: Exposures | None = None
    """Where they were taken one after the other and something moved."""
    plan: TracePlan | None = None
    """How a tolerance chose rays and bounces; None where samples were told."""


def radar_picture(
    scene: SolidScene,
    grid: ImageGrid,
    how: Airborne | None = None,
    *,
    density: Density | None = None,
    tolerance_db: float | None = None,
    points_per_m2: float = 20.0,
    seed: int = 0,
    move_m: float = 1.0,
    progress: Callable[[float], None] | None = None,
) -> RadarPicture:
    """Simulate the radar and focus its echoes, for what stands, by back-projection.

    Windows are Hann's in range and along the track; under a beam its own pattern is the one along the track.

    Args:
        scene: bodies.
        grid: the pixels.
        how: flight and radar; the thesis's by default.
        density: of rays.
        tolerance_db: largest error, dB below the picture: chooses density and segments in place of those told.
        points_per_m2: scatterers of rough ground.
        seed: of rough ground and noise.
        move_m: see :class:`processing.scene.radar_simulation.RadarLook`.
        progress: called with the fraction done.

    Raises:
        DataError: a scene or grid that cannot be simulated.
    """
    air = how or Airborne()
    track = straight_track(air.platform_m, air.track_m, air.pulses)
    sweep = Sweep(air.centre_hz, air.bandwidth_hz, air.frequencies)
    axis = -np.asarray(air.platform_m) / air.slant_m
    beam = None if air.beamwidth_rad is None else Beam(axis, air.beamwidth_rad)
    look = RadarLook(
        track, (0.0, 0.0, 0.0), sweep, density or Density(0.15, 2, 3), points_per_m2, beam=beam, seed=seed,
        time_s=air.time_s, move_m=move_m,
    )  # fmt: skip
    plan = None if tolerance_db is None else plan_radar(scene, look, tolerance_db)
    if plan is not None:
        look = replace(look, density=plan.density, turn_rad=plan.turn_rad)
    simulated = simulate_radar(scene, look, progress=progress)
    focused = np.stack(
        [focus_standing(simulated.histories[name], grid, air) for name in MECHANISMS], dtype=np.complex128
    )
    # A noise coefficient fills a resolution cell of the ground (Hann broadens each side by half).
    cell = 1.5**2 * _cell_m2(air)
    noise = 10 ** (air.noise_equivalent_db / 10) * cell
    random = np.random.default_rng(seed + 1)
    shape = (4, *grid.shape)
    thermal = random.standard_normal(shape) + 1j * random.standard_normal(shape)
    powers = np.sum(np.abs(focused) ** 2, axis=1)
    return RadarPicture(focused.sum(axis=0) + math.sqrt(noise / 2) * thermal, powers, 3 * noise, simulated, plan)


def recorded_echoes(picture: RadarPicture, how: Airborne | None = None, *, seed: int = 0) -> PhaseHistory:
    """All mechanisms' echoes with noise, which is as strong in a focused picture as the picture's own.

    Args:
        picture: of :func:`radar_picture`.
        how: the flight and radar that it was made with.
        seed: of noise.
    """
    air = how or Airborne()
    total = picture.simulated.total
    random = np.random.default_rng(seed + 3)
    level = math.sqrt(picture.noise / 3 / 2 / _noise_gain(air))
    echoes = np.empty(total.echoes.shape, dtype=np.complex64)
    for channel, clean in enumerate(total.echoes):
        thermal = random.standard_normal(clean.shape) + 1j * random.standard_normal(clean.shape)
        echoes[channel] = clean + level * thermal
    return replace(total, echoes=echoes)


def focus_standing(history: PhaseHistory, grid: ImageGrid, air: Airborne) -> NDArray[np.complex64]:
    """Pictures (channels, ny, nx) of what stands, sqrt(m^2), windowed as :func:`radar_picture` tells."""
    profiles = history_profiles(history, window="hann")
    if air.beamwidth_rad is None:
        image = backproject(profiles, grid, weights=_along(air))
    else:
        depression = math.pi / 2 - air.look_rad
        image = backproject(profiles, grid, beamwidth_rad=air.beamwidth_rad, depression_rad=depression)
    return np.asarray(image * np.float32(air.slant_m**2))


def _along(air: Airborne) -> Floats:
    """Hann's window (pulses,) without the zeros at its ends."""
    return np.asarray(np.hanning(air.pulses + 2)[1:-1])


def _noise_gain(air: Airborne) -> float:
    """Variance of a pixel of :func:`focus_standing` over that of white noise in each echo."""
    across = window_weights("hann", (np.arange(air.frequencies) + 0.5) / air.frequencies - 0.5, 1e9)
    if air.beamwidth_rad is None:
        along = _along(air)
        loss = float(np.sum(along**2) / np.sum(along) ** 2)
    else:
        x = np.linspace(-0.5, 0.5, air.pulses) * air.track_m
        gain = one_way_gain(air.slant_m / np.hypot(air.slant_m, x), air.beamwidth_rad)
        loss = float(1 / np.sum(gain**2))
    return air.slant_m**4 * loss * float(np.sum(across**2) / np.sum(across) ** 2)


def _cell_m2(air: Airborne) -> float:
    ground = SPEED_OF_LIGHT_M_S / (2 * air.bandwidth_hz * math.sin(air.look_rad))
    return ground * air.slant_m * SPEED_OF_LIGHT_M_S / air.centre_hz / (2 * air.aperture_m)


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
    tolerance_db: float | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> OpticalPicture:
    """Trace the camera's picture, add shot noise, and read it at the ground grid's pixels.

    With an interval between exposures, what moves is at another place behind each of the polarizer's angles, and all
    four are combined as if it had stood: a polarimeter by division of time (thesis 8.2).

    Args:
        scene: bodies.
        grid: the pixels.
        lights: such as :func:`sunlight`.
        how: flight and camera; the thesis's by default.
        samples: rays for each of the camera's pixels.
        tolerance_db: largest error of tracing, dB below the picture: chooses rays and bounces instead.
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
    moving = air.exposure_interval_s > 0 and scene.speed_m_s > 0
    times = tuple(air.exposure_interval_s * k for k in range(4)) if moving else (0.0,)
    pictures: list[Picture] = []
    bounces, plan = BOUNCES, None
    for number, instant in enumerate(times):

        def told(done: float, number: int = number) -> None:
            if progress:
                progress((number + done) / len(times))

        # The same rays each time: only what moved differs.
        seen = scene.at(instant).world(lights)
        if tolerance_db is not None and plan is None:
            first, plan = trace_to(seen, view, tolerance_db, seed=seed, progress=told)
            samples, bounces = first.samples, plan.bounces
            pictures.append(first)
            continue
        pictures.append(
            backward(seen, view, bounces=bounces, samples=samples, leave_out=False, seed=seed, progress=told)
        )
    picture = pictures[0]
    # Full scale is a white surface (radiance 1 / pi) that faces the sun, half of it behind each polarizer.
    per_unit = 2 * air.electrons * air.frames * math.pi
    random = np.random.default_rng(seed + 2)
    depression = math.pi / 2 - air.look_rad
    camera = Pinhole(air.focal_length_m, air.pixel_pitch_m, wide, high, air.platform_m, depression)
    exposures = _exposures(pictures, times, air, camera, random) if moving else None
    counts = np.maximum(picture.stokes[..., 0], 0) * per_unit
    # Two pairs of crossed polarizers: S1 and S2 have the variance of their counts, S0 (the mean of both pairs) half.
    noisy = [
        picture.stokes[..., k] + random.standard_normal(counts.shape) * np.sqrt(counts * share) / per_unit
        for k, share in enumerate((0.5, 1.0, 1.0))
    ]
    if exposures is not None:
        noisy = list(np.tensordot(least_squares(ANALYSERS), exposures.electrons, 1) * air.frames / per_unit)
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
        exposures=exposures,
        plan=plan,
    )


def _exposures(
    pictures: Sequence[Picture], times: tuple[float, ...], air: Airborne, camera: Pinhole, random: np.random.Generator
) -> Exposures:
    """What each angle of the polarizer lets through at its own time."""
    full = 2 * air.electrons * math.pi
    through = [np.maximum(one.stokes[..., :3] @ row, 0) * full for one, row in zip(pictures, ANALYSERS, strict=True)]
    light = np.stack(through)
    taken = light + random.standard_normal(light.shape) * np.sqrt(light / air.frames)
    return Exposures(taken, times, air.frames, camera)


def bodies_from_above(scene: SolidScene, grid: ImageGrid) -> NDArray[np.int64]:
    """Which body (ny, nx) stands on each ground pixel: the first that a ray from straight above meets; -1: none."""
    mesh, owner = scene.mesh()
    x, y = np.meshgrid(grid.x_m, grid.y_m)
    top = float(mesh.vertices_m[:, 2].max()) + 1.0
    origin = np.stack([x.ravel(), y.ravel(), np.full(x.size, top)], axis=1)
    met = build(mesh).closest(origin, np.tile([0.0, 0.0, -1.0], (x.size, 1))).triangle
    return np.where(met >= 0, owner[met], -1).reshape(grid.shape)
