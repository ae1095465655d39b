"""Rendering of flat surfaces: places, order, light."""

import math

import numpy as np
import pytest

from processing.optics.camera_model import Pinhole
from processing.scene.model import Scene, Surface
from processing.scene.optical import BACKGROUND, stokes_image, sun_cosine

# Level camera at the origin, 100 px focal length, axis at pixel (50, 40).
CAMERA = Pinhole(0.01, 1e-4, 101, 81)
TOWARDS_CAMERA = (0.0, -1.0, 0.0)


def wall(name: str, x: float, y: float, size: float, stokes: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> Surface:
    """A square wall facing the camera, its lower left corner at (x, y, x)."""
    return Surface(name, (x, y, x), (size, 0.0, 0.0), (0.0, 0.0, size), stokes)


def test_a_wall_covers_the_pixels_that_geometry_says() -> None:
    # Corners at +-0.205 m, 2 m away: +-10.25 px about the axis, so pixel centres from -10 to +10 are covered.
    _, index = stokes_image(Scene("s", surfaces=(wall("w", -0.205, 2.0, 0.41),), sun_direction=TOWARDS_CAMERA), CAMERA)
    expected = np.full((81, 101), BACKGROUND)
    expected[30:51, 40:61] = 0
    np.testing.assert_array_equal(index, expected)


def test_nearer_surfaces_hide_farther_ones_in_any_order() -> None:
    far, near = wall("far", -1.0, 4.0, 2.0), wall("near", -0.205, 2.0, 0.41)
    for surfaces in ((far, near), (near, far)):
        stokes, index = stokes_image(Scene("s", surfaces=surfaces, sun_direction=TOWARDS_CAMERA), CAMERA)
        assert surfaces[index[40, 50]] is near
        assert surfaces[index[40, 65]] is far
        assert stokes[0, 40, 50] == 1.0


def test_corners_project_where_the_camera_model_says() -> None:
    # A tilted, turned parallelogram seen by a depressed camera: its outline is the polygon of its projected corners.
    camera = Pinhole(0.008, 16e-6, 390, 290, (0.2, 0.1, 0.3), math.radians(12))
    surface = Surface("tilted", (-0.4, 5.0, -1.0), (1.1, 0.7, 0.1), (0.1, 0.5, 0.9), (1.0, 0.0, 0.0))
    _, index = stokes_image(Scene("s", surfaces=(surface,)), camera)
    corner, u_edge, v_edge = map(np.array, (surface.corner_m, surface.edge_u_m, surface.edge_v_m))
    corners = np.stack([corner, corner + u_edge, corner + u_edge + v_edge, corner + v_edge])
    u, v, _ = camera.project(corners)
    # Independent test of every pixel: which side of each projected edge it is on.
    column, row = np.meshgrid(np.arange(390), np.arange(290))
    sides = [(u[(i + 1) % 4] - u[i]) * (row - v[i]) - (v[(i + 1) % 4] - v[i]) * (column - u[i]) for i in range(4)]
    inside = np.all(np.stack(sides) > 0, axis=0) | np.all(np.stack(sides) < 0, axis=0)
    assert inside.sum() > 1000
    np.testing.assert_array_equal(index == 0, inside)


def test_light_falls_with_the_cosine_of_the_suns_angle() -> None:
    surface = wall("w", -1.0, 2.0, 2.0, (0.5, 0.2, -0.1))
    for degrees in (0, 30, 60, 85):
        sun = (math.sin(math.radians(degrees)), -math.cos(math.radians(degrees)), 0.0)
        stokes, _ = stokes_image(Scene("s", surfaces=(surface,), sun_direction=sun), CAMERA)
        expected = np.array([0.5, 0.2, -0.1]) * math.cos(math.radians(degrees))
        np.testing.assert_allclose(stokes[:, 40, 50], expected, atol=1e-15)


def test_a_side_without_sun_is_black_whichever_way_its_edges_turn() -> None:
    behind = (0.0, 1.0, 0.0)
    surface = wall("w", -1.0, 2.0, 2.0)
    swapped = Surface("w", surface.corner_m, surface.edge_v_m, surface.edge_u_m, surface.stokes)
    for flat in (surface, swapped):
        assert sun_cosine(flat, CAMERA, behind) == 0.0
        assert sun_cosine(flat, CAMERA, TOWARDS_CAMERA) == pytest.approx(1.0, rel=1e-15)
        # The sun's direction need not be of unit length.
        assert sun_cosine(flat, CAMERA, (0.0, -3.0, 0.0)) == pytest.approx(1.0, rel=1e-15)


def test_what_nothing_covers_is_background() -> None:
    scene = Scene("empty", background_stokes=(0.05, 0.01, -0.02))
    stokes, index = stokes_image(scene, CAMERA)
    assert (index == BACKGROUND).all()
    np.testing.assert_array_equal(stokes[:, 3, 5], [0.05, 0.01, -0.02])


def test_surfaces_behind_edge_on_or_without_area_are_not_seen() -> None:
    behind = wall("behind", -1.0, -2.0, 2.0)
    edge_on = Surface("edge on", (-1.0, 1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 5.0, 0.0), (1.0, 0.0, 0.0))
    no_area = Surface("line", (-1.0, 2.0, 0.0), (2.0, 0.0, 0.0), (4.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    _, index = stokes_image(Scene("s", surfaces=(behind, edge_on, no_area), sun_direction=TOWARDS_CAMERA), CAMERA)
    assert (index == BACKGROUND).all()
    assert sun_cosine(no_area, CAMERA, TOWARDS_CAMERA) == 0.0
