"""Light: demosaicers and precisions against the scene that was put in, rays and bounces against many more of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from polfuse_lab.trade.rows import Row, relative_db, timed
from processing.optics.debias import debias
from processing.optics.demosaic import demosaic_by
from processing.optics.mosaic import parse_mosaic
from processing.optics.mosaic_stokes import mosaic_stokes, mosaic_stokes_reference
from processing.raytrace import shapes
from processing.raytrace.backward import backward
from processing.raytrace.materials import Fresnel, Lambert, Material
from processing.raytrace.sources import PointSource
from processing.raytrace.triangles import joined
from processing.raytrace.view import View
from processing.raytrace.world import world

Floats = NDArray[np.float64]

ANGLES_DEG = (0, 45, 90, 135)
SAMPLES = (4, 16, 64, 256)
BOUNCES = (0, 1, 2, 4)


def scene(size: int, seed: int = 4) -> Floats:
    """(4, size, size) counts behind the four angles: discs with texture, blurred by half a pixel."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:size, 0:size].astype(np.float64)
    stokes = np.stack([np.full((size, size), 8000.0), np.zeros((size, size)), np.zeros((size, size))])
    texture = 1 + 0.1 * gaussian_filter(rng.normal(size=(size, size)), 1.5) / 0.19
    for _ in range(size * size // 1200 + 6):
        inside = np.hypot(x - rng.uniform(0, size), y - rng.uniform(0, size)) < rng.uniform(4, 20)
        level, dolp, angle = rng.uniform(2e3, 3e4), 0.6 * rng.uniform() ** 1.5, rng.uniform(0, math.pi)
        for plane, part in enumerate((1.0, dolp * math.cos(2 * angle), dolp * math.sin(2 * angle))):
            stokes[plane][inside] = level * part * texture[inside]
    stokes = np.stack([gaussian_filter(plane, 0.5) for plane in stokes])
    angles = np.radians(ANGLES_DEG)[:, None, None]
    return np.asarray(0.5 * (stokes[0] + stokes[1] * np.cos(2 * angles) + stokes[2] * np.sin(2 * angles)))


def optics_rows(size: int, rounds: int) -> Iterator[Row]:
    """Demosaicers against what a pixel behind each angle would have counted, and precisions against float64."""
    truth, mosaic = scene(size), parse_mosaic("90-45-135-0")
    image = np.zeros((size, size), dtype=np.uint16)
    for plane, angle in zip(truth, ANGLES_DEG, strict=True):
        row, column = mosaic.place(angle)
        image[row::2, column::2] = np.rint(plane[row::2, column::2])
    for method in ("bilinear", "newton", "residual"):
        seconds, planes = timed(lambda: demosaic_by(method, image, mosaic), rounds)  # noqa: B023
        yield Row(f"optics.demosaic.{size}", method, seconds, relative_db(planes, truth))
    definition = mosaic_stokes_reference(image, mosaic)[3]  # DOLP: sums and differences of counts are exact
    precisions: dict[str, Callable[[], NDArray[Any]]] = {
        "float32, one pass": lambda: mosaic_stokes(image, mosaic),
        "float64 reference": lambda: mosaic_stokes_reference(image, mosaic),
    }
    for name, work in precisions.items():
        seconds, made = timed(work, rounds)
        yield Row(f"optics.precision.{size}", name, seconds, relative_db(made[3], definition))


def debias_rows(rounds: int) -> Iterator[Row]:
    """Mean of the estimated polarized intensity at twice its noise against the truth: with and without debiasing."""
    rng = np.random.default_rng(6)
    true = 2.0
    drawn = np.hypot(true + rng.normal(size=100_000), rng.normal(size=100_000))
    ways: dict[str, Callable[[], Floats]] = {"none": drawn.copy, "MAS": lambda: debias(drawn, 1.0)}
    for name, work in ways.items():
        seconds, estimate = timed(work, rounds)
        yield Row("optics.debias", name, seconds, float(20 * np.log10(abs(estimate.mean() - true) / true)))


def raytrace_rows(pixels: int, rounds: int, reference_samples: int) -> Iterator[Row]:
    """Rays of each pixel and bounces of each ray in a dihedral before a screen, against many rays and bounces."""
    # The wall stands behind the camera, so that the corner shows it lit.
    corner = shapes.dihedral(1.5)
    wall = shapes.patch((-5.0, 6.0, -1.0), (10.0, 0.0, 0.0), (0.0, 1.5, 7.0), material=1)
    mesh = joined([corner, wall])
    surfaces: list[Material] = [Fresnel(1.02 + 6.84j, 0.15), Lambert(0.8)]
    lamp = PointSource((0.8, 4.0, 2.5), 25.0)
    view = View((0.4, 4.2, 2.0), (0.0, 0.3, 0.5), pixels, pixels, math.radians(24.0))
    built = world(mesh, surfaces, [lamp])
    truth = backward(built, view, bounces=6, samples=reference_samples, seed=99).stokes
    for bounces in BOUNCES:
        for samples in SAMPLES:
            seconds, picture = timed(
                lambda: backward(built, view, bounces=bounces, samples=samples, leave_out=False),  # noqa: B023
                rounds,
            )
            error = relative_db(picture.stokes, truth)
            yield Row("raytrace", f"{samples} rays, {bounces} bounces", seconds, error)
