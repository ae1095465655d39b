"""Random small scenes for the planners of rays: of light (:func:`random_light`) and of radar (:func:`random_yard`)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from processing.raytrace import shapes
from processing.raytrace.materials import Fresnel, Lambert, Material, Ward
from processing.raytrace.sources import GaussianSource, PlaneSource, PointSource, RayleighSky, Source, Sun
from processing.raytrace.triangles import Triangles, joined
from processing.raytrace.view import View
from processing.raytrace.world import World, world
from processing.sar.grid import ImageGrid
from processing.scattering.history import Sweep
from processing.scattering.shooting import Density
from processing.scattering.surfaces import RadarSurface
from processing.scene import primitives
from processing.scene.radar_simulation import RadarLook, straight_track
from processing.scene.solids import Part, Solid, SolidScene, Substance

INDICES = (1.5, 1.02 + 6.84j, 2.5 + 3.0j, 0.2 + 3.4j)
"""Glass, aluminium, and metals as chromium and silver are."""


def random_light(seed: int, pixels: int = 12) -> tuple[World, View]:
    """Bodies on a floor, some before a wall, of random surfaces, under one to three random sources."""
    rng = np.random.default_rng(seed)
    bodies: list[Triangles] = [shapes.patch((-4.0, -4.0, -0.02), (8.0, 0.0, 0.0), (0.0, 8.0, 0.0))]
    if rng.uniform() < 0.5:
        bodies.append(shapes.patch((-4.0, -3.0, -0.02), (8.0, 0.0, 0.0), (0.0, 0.3, 5.0), material=1))
    for number in range(int(rng.integers(1, 4))):
        make = rng.choice(["dihedral", "trihedral", "sphere", "plate"])
        size = float(rng.uniform(0.4, 1.5))
        if make == "sphere":
            body = shapes.sphere(size / 2, divisions=2).moved((0.0, 0.0, size / 2))
        elif make == "plate":
            body = shapes.plate(size).turned(shapes.turn_about((1, 0, 0), float(rng.uniform(-1, 1))))
            body = body.moved((0.0, 0.0, size))
        else:
            body = shapes.dihedral(size) if make == "dihedral" else shapes.trihedral(size)
        turn = shapes.turn_about((0, 0, 1), float(rng.uniform(-math.pi, math.pi)))
        body = body.turned(turn).moved((float(rng.uniform(-1.2, 1.2)), float(rng.uniform(-1.2, 1.2)), 0.0))
        bodies.append(body.of_material(2 + number))
    surfaces = [_surface(rng) for _ in range(5)]
    lights = [_light(rng) for _ in range(int(rng.integers(1, 4)))]
    angle, height = float(rng.uniform(0.2, math.pi - 0.2)), float(rng.uniform(1.0, 4.0))
    place = (5 * math.cos(angle), 5 * math.sin(angle), height)
    aim = (float(rng.uniform(-0.5, 0.5)), float(rng.uniform(-0.5, 0.5)), float(rng.uniform(0.2, 0.8)))
    view = View(place, aim, pixels, pixels, math.radians(float(rng.uniform(15, 50))))
    return world(joined(bodies), surfaces, lights), view


def _surface(rng: np.random.Generator) -> Material:
    kind = rng.choice(["lambert", "ward", "fresnel"])
    diffuse = float(rng.uniform(0.05, 0.6))
    if kind == "lambert":
        return Lambert(float(rng.uniform(0.1, 0.9)))
    if kind == "ward":
        return Ward(diffuse, float(rng.uniform(0.05, 0.95 - diffuse)), float(rng.uniform(0.08, 0.5)), "bounded")
    index = INDICES[int(rng.integers(len(INDICES)))]
    return Fresnel(index, float(rng.uniform(0.08, 0.5)), float(rng.uniform(0.2, 1 - diffuse)), diffuse)


def _light(rng: np.random.Generator) -> Source:
    kind = rng.choice(["point", "plane", "gaussian", "sun", "sky"])
    away = np.array([rng.uniform(-2.5, 2.5), rng.uniform(-0.5, 4.0), rng.uniform(1.5, 4.5)])
    place = (float(away[0]), float(away[1]), float(away[2]))
    strength = float(10 ** rng.uniform(-1, 0.5))
    if kind == "point":
        return PointSource(place, 6 * strength)
    if kind == "plane":
        return PlaneSource(place, (0.0, 0.0, 0.3), 10 * strength, float(rng.uniform(0.3, 0.8)), up=(0.1, 0.2, 1.0))
    if kind == "gaussian":
        return GaussianSource(place, (0.0, 0.0, 0.3), 10 * strength, float(rng.uniform(0.2, 0.6)), up=(0.1, 0.2, 1.0))
    if kind == "sun":
        return Sun(place, strength)
    return RayleighSky(place, 0.3 * strength)


@dataclass(frozen=True)
class Yard:
    """A scene of bodies, how a radar looks at it, and the picture's pixels."""

    scene: SolidScene
    look: RadarLook
    grid: ImageGrid


def random_yard(seed: int) -> Yard:
    """One to three bodies on a patch of ground, rough or smooth, seen from 2 to 16 km along a track of 24 pulses."""
    rng = np.random.default_rng(seed)
    white = Lambert(0.5)
    permittivity = complex(float(rng.uniform(2.5, 15)), -float(rng.uniform(0.05, 3)))
    substances = (
        Substance("metal", RadarSurface(), white),
        Substance("ground", RadarSurface(permittivity, float(rng.choice([0.005, 0.01, 0.03]))), white),
        Substance("wall", RadarSurface(complex(float(rng.uniform(2.5, 6)), -0.2), 0.001), white),
    )
    # Nothing stands along the track: an edge there is misplaced as a whole, by half of the finest cell.
    patch = shapes.patch((-2.5, -2.5, 0), (5, 0, 0), (0, 5, 0))
    solids = [Solid("ground", "ground", (Part(patch, "ground"),)).placed((0.0, 0.0, 0.0), float(rng.uniform(0.2, 1.3)))]
    for number in range(int(rng.integers(1, 4))):
        make = rng.choice(["box", "dihedral", "trihedral", "plate"])
        size, substance = float(rng.uniform(0.4, 1.2)), str(rng.choice(["metal", "metal", "wall"]))
        if make == "box":
            deep, high = (float(value) for value in rng.uniform(0.4, 1.2, 2))
            body = primitives.box(size, deep, high, substance).parts[0].mesh
        elif make == "plate":
            body = shapes.plate(size).turned(shapes.turn_about((1, 0, 0), float(rng.uniform(0.3, 1.5))))
            body = body.moved((0.0, 0.0, size))
        else:
            open_to = shapes.turn_about((0, 0, 1), math.pi if make == "dihedral" else 1.25 * math.pi)
            made = shapes.dihedral(size) if make == "dihedral" else shapes.trihedral(size)
            body = made.turned(open_to).moved((0.0, 0.0, 0.01))
        turn = float(rng.choice([-1, 1]) * rng.uniform(0.1, 0.6))
        place = (float(rng.uniform(-1.4, 1.4)), float(rng.uniform(-1.4, 1.4)), 0.0)
        solids.append(Solid(f"body {number}", make, (Part(body, substance),)).placed(place, turn))
    away, down = float(10 ** rng.uniform(3.3, 4.2)), math.radians(float(rng.uniform(25, 65)))
    middle = (0.0, -away * math.cos(down), away * math.sin(down))
    sweep = Sweep(float(rng.uniform(1e9, 2.5e9)), 0.15e9, 32)
    # Flat faces flash when they are met upright: as far as the radar turns around them they do or do not.
    track = away * float(rng.uniform(0.02, 0.1))
    look = RadarLook(
        straight_track(middle, track, 24), (0.0, 0.0, 0.0), sweep, Density(0.3), float(rng.uniform(2, 10)),
        seed=seed,
    )  # fmt: skip
    axis = np.linspace(-4.0, 4.0, 25)
    return Yard(SolidScene(f"yard {seed}", substances, tuple(solids)), look, ImageGrid(axis, axis, 0.0))
