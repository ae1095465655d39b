"""Pictures by tracing from the sources, as the thesis does (4.1, 4.3), and where a source's rays fall."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.raytrace.forward_kernel import send
from processing.raytrace.materials import LOBE, Lobe
from processing.raytrace.picture import Picture, statistics
from processing.raytrace.random_numbers import path_keys, uniforms
from processing.raytrace.source_kernel import set_out
from processing.raytrace.view import View
from processing.raytrace.world import World

Floats = NDArray[np.float64]

BLOCKS = 4
"""Rays are summed in so many pictures beside each other, whatever the number of threads."""


def forward(
    world: World, view: View, *, rays: int = 100_000, bounces: int = 1, mueller: bool = False, seed: int = 0
) -> Picture:
    """Trace from the sources: every surface met is connected with the camera's pinhole.

    Smooth surfaces cannot be connected (no ray off them meets a point by chance): their own picture of a source is
    missing, as :func:`unreachable` tells; what they throw on other surfaces is there.

    Args:
        world: the scene.
        view: the camera.
        rays: from each source.
        bounces: most reflections, 1 or more.
        mueller: Mueller matrices instead of Stokes vectors.
        seed: of the random numbers.

    Returns:
        The picture. Its standard errors take what one ray adds to a pixel at different bounces as independent.

    Raises:
        DataError: numbers out of range, or a Mueller picture of several sources.
    """
    if rays < 2 or not 1 <= bounces <= 1000:
        raise DataError(f"{rays} rays and {bounces} bounces were asked for", "give 2 or more rays, 1 to 1000 bounces")
    if mueller and len(world.sources) != 1:
        raise DataError(
            f"a Mueller picture of {len(world.sources)} sources mixes their frames", "simulate one source at a time"
        )
    begun = time.perf_counter()
    components = 16 if mueller else 4
    pixels = view.width_px * view.height_px
    mean, variance = np.zeros((2, pixels, components))
    traced = 0
    for number in range(len(world.sources)):
        sums, squares = np.zeros((2, BLOCKS, pixels, components))
        traced += int(send(world, view.row(), number, bounces, seed, 0, rays, sums, squares))
        one, error = statistics(sums.sum(axis=0), squares.sum(axis=0), rays)
        mean += one
        variance += error**2
    shape = (*view.shape, 4, 4) if mueller else (*view.shape, 4)
    return Picture(mean.reshape(shape), np.sqrt(variance).reshape(shape), rays, traced, time.perf_counter() - begun)


def unreachable(world: World) -> bool:
    """Whether the scene has smooth surfaces, whose own picture of the sources :func:`forward` does not show."""
    return bool(np.any(world.materials[:, LOBE] == Lobe.SMOOTH))


def lit_points(world: World, source: int, rays: int, seed: int = 0) -> Floats:
    """Where rays of a source first meet the scene, (N, 3) with N at most ``rays`` (thesis Fig. 4.6)."""
    keys = path_keys(seed, np.full(rays, source), np.arange(rays))
    numbers = np.stack([uniforms(keys, place) for place in range(4)], axis=1)
    row, (x, y, z), radius = world.sources[source], world.centre, world.radius
    sent = np.array([set_out(row, x, y, z, radius, a, b, c, d) for a, b, c, d in numbers])
    origin, direction = sent[:, :3], sent[:, 3:6]
    hits = world.tree.closest(origin, direction)
    met = hits.triangle >= 0
    return np.asarray(origin[met] + hits.distance[met, None] * direction[met])
