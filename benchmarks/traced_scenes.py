"""Random small scenes for the planners of rays: of light (:func:`random_light`) and of radar (:func:`random_yard`)."""

from __future__ import annotations

import math

import numpy as np

from processing.raytrace import shapes
from processing.raytrace.materials import Fresnel, Lambert, Material, Ward
from processing.raytrace.sources import GaussianSource, PlaneSource, PointSource, RayleighSky, Source, Sun
from processing.raytrace.triangles import Triangles, joined
from processing.raytrace.view import View
from processing.raytrace.world import World, world

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
