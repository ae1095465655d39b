"""A scene as the rig's two eyes see it: echoes all along the radar's rail, and one picture for the camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.optics.camera_model import Pinhole
from processing.optics.distortion import NONE
from processing.raytrace.backward import backward
from processing.raytrace.sources import RayleighSky, Sun
from processing.raytrace.view import View
from processing.scattering.contributions import Contributions, of_points, together
from processing.scattering.rail_echoes import RailEchoes, RailRadar, rail_echoes
from processing.scattering.rough import rough_points
from processing.scattering.shooting import Density, shoot
from processing.scattering.target import Target
from processing.scene.model import Scene
from processing.scene.radar_response import scatterers
from processing.scene.solids import SolidScene

Floats = NDArray[np.float64]

CELLS_AT_M = 10.0
"""Distance at which cells between rays have their size."""
AHEAD = np.array([0.0, 1.0, 0.0])
"""Where rays are sent around: away from the rail."""


@dataclass(frozen=True)
class RailRays:
    """How finely bodies are followed by radar rays."""

    density: Density = field(default_factory=lambda: Density(0.1, 5, 3))
    """Cells are those at 10 m. Five levels part the edges of a trihedral of 0.6 m to 1 % of its echo."""
    points_per_m2: float = 10.0
    """Scatterers of rough ground."""
    view_step_m: float = 0.1
    """Way of the trolley after which rays are sent anew."""
    seed: int = 0
    """Of rough ground."""


@dataclass(frozen=True)
class SeenAlongRail:
    """Echoes of all bodies, and what was left out of them."""

    echoes: RailEchoes
    views: int
    """How often rays were sent."""
    rays: int
    contributions: int
    """Largest number of footprints and points of a view."""
    parted: float
    """Largest share of the footprints' area at edges, of which a middle ray decided."""


def bodies_along_rail(
    scene: SolidScene,
    span_m: tuple[float, float],
    radar: RailRadar,
    rays: RailRays | None = None,
    *,
    progress: Callable[[float], None] | None = None,
) -> SeenAlongRail:
    """What a radar on a rail receives of bodies; not modelled is what :mod:`.radar_simulation` does not model.

    Args:
        scene: bodies in rig coordinates: the rail lies along x through the origin, and y is away from it.
        span_m: x of the rail's ends.
        radar: band and antennas.
        rays: how finely.
        progress: called with the fraction done.

    Raises:
        DataError: a scene, rail or density that cannot be simulated, or a body that moves.
    """
    how = rays or RailRays()
    if scene.speed_m_s:
        raise DataError("a body moves, and a trolley that stops at each place sees it at another", "let it stand still")
    target = scene.target(radar.wavelength_m)
    sent: list[tuple[int, int, float]] = []

    def seen(antenna: Floats) -> Contributions:
        found, count, parted = lit(scene, target, antenna, how)
        sent.append((count, len(found), parted))
        return found

    echoes = rail_echoes(seen, span_m, radar, view_step_m=how.view_step_m, progress=progress)
    counts, sizes, shares = zip(*sent, strict=True)
    return SeenAlongRail(echoes, len(sent), sum(counts), max(sizes), max(shares))


def points_along_rail(
    scene: Scene, span_m: tuple[float, float], radar: RailRadar, *, view_step_m: float = 0.02
) -> RailEchoes:
    """What a radar whose antennas are apart receives of points, reflectors and bushes, each way by its own path.

    Args:
        scene: in rig coordinates.
        span_m: x of the rail's ends.
        radar: band and antennas.
        view_step_m: of the places from which scatterers are looked at; matrices between two are interpolated.

    Raises:
        DataError: a scene or rail that cannot be simulated.
    """
    return rail_echoes(
        lambda antenna: of_points(*scatterers(scene, antenna, radar.wavelength_m)), span_m, radar,
        view_step_m=view_step_m,
    )  # fmt: skip


def lit(scene: SolidScene, target: Target, antenna_m: Floats, how: RailRays) -> tuple[Contributions, int, float]:
    """All that scatters to an antenna (3,), the rays that it took, and the share that edges part."""
    shot = shoot(target, antenna_m, antenna_m + CELLS_AT_M * AHEAD, how.density)
    rough = rough_points(target, scene.radar_surfaces, antenna_m, how.points_per_m2, seed=how.seed)
    return together([shot.contributions, rough, scene.volumes(target, antenna_m)]), shot.rays, shot.parted


@dataclass(frozen=True)
class Daylight:
    """Sun and sky over the rig."""

    sun_direction: tuple[float, float, float]
    """Towards the sun, unit vector."""
    sky_share: float = 0.2
    """Irradiance of the sky on level ground over the sun's; 0.2 is a clear day's."""


def camera_picture(
    scene: SolidScene,
    camera: Pinhole,
    light: Daylight,
    *,
    samples: int = 100,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Floats:
    """Stokes parameters (3, rows, columns) in the camera's frame, S0 = 1 for a white surface that faces the sun.

    Args:
        scene: bodies in rig coordinates.
        camera: the rig's, without distortion.
        light: sun and sky.
        samples: rays for each pixel.
        seed: of the rays.
        progress: called with the fraction done.

    Raises:
        DataError: a camera with distortion, a sun below the horizon, or a scene that cannot be traced.
    """
    if camera.distortion != NONE or camera.principal_offset_px != (0.0, 0.0):
        raise DataError("the lens distorts", "simulate a camera without distortion and with a centred axis")
    if not light.sun_direction[2] > 0:
        raise DataError(f"the sun stands at {light.sun_direction}", "let it stand above the horizon")
    sky = light.sky_share * light.sun_direction[2] / math.pi
    target = np.asarray(camera.position_m) + camera.axes[2]
    view = View(
        camera.position_m,
        (float(target[0]), float(target[1]), float(target[2])),
        camera.width_px,
        camera.height_px,
        2 * math.atan(camera.width_px / 2 / camera.focal_length_px),
    )
    world = scene.world([Sun(light.sun_direction), RayleighSky(light.sun_direction, sky)])
    picture = backward(world, view, samples=samples, leave_out=False, seed=seed, progress=progress)
    # A white surface that faces the sun has the radiance 1 / pi.
    return np.ascontiguousarray(np.moveaxis(picture.stokes[..., :3], -1, 0) * math.pi)


def moved(scene: SolidScene, offset_m: tuple[float, float, float]) -> SolidScene:
    """All bodies elsewhere."""
    return replace(scene, solids=tuple(solid.placed(offset_m) for solid in scene.solids))
