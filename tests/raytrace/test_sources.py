"""Sources: what they bring to a surface, against closed forms; and the thesis's plate under its two lamps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from processing.errors import DataError
from processing.raytrace import shapes, source_kernel
from processing.raytrace.backward import backward
from processing.raytrace.forward import lit_points
from processing.raytrace.materials import Lambert
from processing.raytrace.sources import GaussianSource, PlaneSource, PointSource, RayleighSky, Source, Sun, table
from processing.raytrace.view import View
from processing.raytrace.world import world

DOWN = View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), 8, 8, 0.002, (0.0, 1.0, 0.0))
"""At a spot in the middle of a plate, small enough to be even."""


def irradiance(source: Source, samples: int) -> tuple[float, float]:
    """On the middle of a horizontal plate, and its standard error: pi times the radiance of a white one."""
    picture = backward(world(shapes.plate(2.0), [Lambert(1.0)], [source]), DOWN, bounces=1, samples=samples)
    error = float(np.sqrt(np.mean(picture.standard_error[..., 0] ** 2))) / 8
    return math.pi * float(picture.mean[..., 0].mean()), math.pi * error


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        (PointSource((0.0, 0.0, 2.0), 3.0), 3.0 / 4),
        # 45 degrees: r^2 = 8, cos = sqrt 0.5.
        (PointSource((2.0, 0.0, 2.0), 3.0), 3.0 / 8 * math.sqrt(0.5)),
        # A square of half width 0.5 * 2 = 1 m gets all the power evenly.
        (PlaneSource((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), 6.0, 0.5, up=(0.0, 1.0, 0.0)), 6.0 / 4),
        # Peak of a Gaussian of 0.25 * 2 = 0.5 m.
        (GaussianSource((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), 6.0, 0.25, up=(0.0, 1.0, 0.0)), 6.0 / (2 * math.pi * 0.25)),
        (Sun((0.0, 1.0, 1.0), 4.0, 0.0), 4.0 * math.sqrt(0.5)),
    ],
)
def test_irradiance_of_sources_without_extent(source: Source, expected: float) -> None:
    # The spot is 5 mm to either side: over the Gaussian's 0.5 m, squared, that is 1e-4.
    assert irradiance(source, 16)[0] == pytest.approx(expected, rel=1e-4)


def test_irradiance_of_the_suns_disc_and_the_sky() -> None:
    found, error = irradiance(Sun((0.0, 1.0, 1.0), 4.0, 0.1), 400)
    # The disc's radiance over its cosines: E cos to 0.3 % for 0.1 rad.
    assert found == pytest.approx(4.0 * math.sqrt(0.5), abs=4 * error + 4e-3 * found)
    # Sun at the zenith: int 3/4 (1 + cos^2) cos d omega over the half sphere = 2 pi 3/4 (1/2 + 1/4) = 9 pi / 8.
    found, error = irradiance(RayleighSky((0.0, 0.0, 1.0), 1.0), 2000)
    assert found == pytest.approx(9 * math.pi / 8, abs=4 * error)


def test_the_skys_mean_and_polarization() -> None:
    row = table([RayleighSky((0.0, 0.0, 1.0), 2.0, 0.8)])[0]
    # At the horizon, 90 degrees from a sun at the zenith: 3/4 of the mean, DOLP 0.8, horizontal: across the vertical.
    radiance, degree, ax, ay, az = source_kernel.seen(row, 1.0, 0.0, 1e-12)
    assert (radiance, degree) == (pytest.approx(1.5), pytest.approx(0.8))
    np.testing.assert_allclose(np.abs([ax, ay, az]), [0, 1, 0], atol=1e-9)
    # Towards the sun: 3/2 of the mean, unpolarized; below the horizon nothing.
    assert source_kernel.seen(row, 0.0, 0.0, 1.0)[:2] == (pytest.approx(3.0), pytest.approx(0.0))
    assert source_kernel.seen(row, 0.0, 0.0, -1.0)[0] == 0.0


def test_rays_of_the_plane_source_fall_evenly_and_of_the_gaussian_one_in_its_spot() -> None:
    # Thesis 4.3 and Fig. 4.6: 100 000 rays on a plate of 10 x 10; here a lamp 5 m above lights the plate exactly.
    up = (0.0, 1.0, 0.0)
    lamps = [
        PlaneSource((0, 0, 5.0), (0, 0, 0), 1.0, 1.0, up=up),
        GaussianSource((0, 0, 5.0), (0, 0, 0), 1.0, 0.2, up=up),
    ]
    scene = world(shapes.plate(10.0), [Lambert(0.5)], lamps)
    rays = 4000
    even = lit_points(scene, 0, rays)
    assert len(even) == rays
    counts, _, _ = np.histogram2d(even[:, 0], even[:, 1], bins=8, range=[[-5, 5]] * 2)
    # Chi-square of 63 degrees of freedom: 99.9 % lie below 103.
    assert np.sum((counts - rays / 64) ** 2) / (rays / 64) < 103
    spot = lit_points(scene, 1, rays)
    # Standard deviation 0.2 * 5 = 1 m, to four of its standard errors.
    np.testing.assert_allclose(spot[:, :2].std(axis=0), 1.0, atol=4 / math.sqrt(2 * rays))


def test_table_4_1_of_the_thesis() -> None:
    # pi from N points in a square around a circle; sd = sqrt(pi (4 - pi) / N). With the ray tracer's own numbers.
    from processing.raytrace.random_numbers import path_keys, uniforms

    keys = path_keys(1, np.zeros(50_000, dtype=np.int64), np.arange(50_000))
    inside = np.hypot(2 * uniforms(keys, 0) - 1, 2 * uniforms(keys, 1) - 1) <= 1
    for count in (10, 50, 100, 500, 1000, 5000, 10_000, 15_000, 20_000, 30_000, 40_000, 50_000):
        deviation = abs(4 * inside[:count].mean() - math.pi) / math.sqrt(math.pi * (4 - math.pi) / count)
        assert deviation < 3.5
    thesis = {10: 3.6, 50: 2.96, 100: 3.36, 500: 3.192, 1000: 3.128, 5000: 3.108, 10_000: 3.142, 50_000: 3.1412}
    assert all(abs(v - math.pi) / math.sqrt(math.pi * (4 - math.pi) / n) < 1.45 for n, v in thesis.items())


@pytest.mark.parametrize(
    "source",
    [
        PointSource((0, 0, 1), -1.0),
        PointSource((0, 0, math.inf), 1.0),
        PointSource((0, 0, 1), 1.0, (1.0, 1.0, 1.0, 0.0)),
        PlaneSource((0, 0, 1), (0, 0, 1), 1.0, 0.5),
        PlaneSource((0, 0, 1), (0, 0, 0), 1.0, 0.5),
        GaussianSource((0, 0, 1), (1, 0, 0), 1.0, 0.0),
        Sun((0, 0, 0)),
        Sun((0, 0, 1), math.nan),
        Sun((0, 0, 1), 1.0, 2.0),
        RayleighSky((0, 0, 1), 1.0, 1.5),
    ],
)
def test_sources_that_cannot_be_are_refused(source: Source) -> None:
    with pytest.raises(DataError):
        table([source])


def test_scenes_without_light_or_materials_are_refused() -> None:
    with pytest.raises(DataError, match="dark"):
        world(shapes.plate(1.0), [Lambert(0.5)], [])
    with pytest.raises(DataError, match="materials 1 to 1"):
        world(shapes.plate(1.0, material=1), [Lambert(0.5)], [Sun((0, 0, 1))])
