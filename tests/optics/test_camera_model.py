"""The pinhole camera against closed forms and its own inverse."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics.camera_model import Pinhole

CAMERA = Pinhole(0.008, 8.3e-6, 782, 582, (0.1, -0.2, 0.05), math.radians(17))


def test_the_optical_axis_meets_the_middle_of_the_sensor() -> None:
    # A point 5 m along (0, cos 17, -sin 17) from the pupil.
    along = np.array([0.1, -0.2 + 5 * math.cos(math.radians(17)), 0.05 - 5 * math.sin(math.radians(17))])
    u, v, in_front = CAMERA.project(along)
    assert in_front
    assert (u, v) == (pytest.approx(390.5, abs=1e-9), pytest.approx(290.5, abs=1e-9))


def test_scale_and_directions_of_a_level_camera() -> None:
    # Closed form: f / pitch = 963.86 px; at 10 m a metre to the right is 96.39 px right, a metre up 96.39 px up.
    camera = Pinhole(0.008, 8.3e-6, 101, 51)
    u, v, _ = camera.project([[1.0, 10.0, 0.0], [0.0, 10.0, 1.0]])
    scale = 0.008 / 8.3e-6 / 10
    np.testing.assert_allclose(u, [50 + scale, 50], atol=1e-9)
    np.testing.assert_allclose(v, [25, 25 - scale], atol=1e-9)


def test_thesis_registration_figures() -> None:
    # Trolley camera 12 ft from the targets, 17 deg down: half a range cell (0.94 m) of slant range moves the ground
    # point's row. Closed form: v - v0 = f tan(depression of the point - depression of the camera).
    height = 3.6576 * math.sin(math.radians(17))
    camera = Pinhole(0.008, 8.3e-6, 782, 582, (0.0, 0.0, 0.0), math.radians(17))
    for slant in (2.4384, 3.6576, 7.3):
        ground = math.sqrt(slant**2 - height**2)
        expected = 290.5 + camera.focal_length_px * math.tan(math.asin(height / slant) - math.radians(17))
        assert float(camera.project([0.0, ground, -height])[1]) == pytest.approx(expected, abs=1e-9)


def test_points_behind_the_camera_have_no_image() -> None:
    u, v, in_front = CAMERA.project([[0.1, -10.0, 0.05], [0.1, -0.2, 0.05]])
    assert not in_front.any()
    assert np.isnan(u).all()
    assert np.isnan(v).all()
    assert not CAMERA.inside(u, v).any()


@given(st.floats(-0.5, 781.5), st.floats(-0.5, 581.5), st.floats(0.1, 1e4))
def test_projection_inverts_rays(u: float, v: float, distance: float) -> None:
    point = np.asarray(CAMERA.position_m) + distance * CAMERA.rays(u, v)
    u_back, v_back, in_front = CAMERA.project(point)
    assert in_front
    assert CAMERA.inside(u, v)
    # Coordinates of 1e4 m carry 2e-12 m; a pixel at 0.1 m is 1e-4 m.
    assert (u_back, v_back) == (pytest.approx(u, abs=1e-6), pytest.approx(v, abs=1e-6))


def test_rays_of_all_pixels() -> None:
    rays = CAMERA.rays()
    assert rays.shape == (582, 782, 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1, atol=1e-14)
    np.testing.assert_allclose(rays[7, 11], CAMERA.rays(11, 7), atol=1e-15)


def test_axes_are_a_right_handed_frame() -> None:
    right, down, forward = CAMERA.axes
    np.testing.assert_allclose(CAMERA.axes @ CAMERA.axes.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(np.cross(right, down), forward, atol=1e-15)


def test_rays_meet_the_ground_where_the_ground_projects() -> None:
    point = CAMERA.on_plane([100.0, 390.5], [400.0, 290.5], -1.07)
    np.testing.assert_allclose(point[:, 2], -1.07, atol=1e-12)
    u, v, _ = CAMERA.project(point)
    np.testing.assert_allclose(u, [100.0, 390.5], atol=1e-9)
    np.testing.assert_allclose(v, [400.0, 290.5], atol=1e-9)
    # 17 deg down with half a field of 16.8 deg: the top row looks 0.2 deg down, a level camera's upwards.
    level = Pinhole(0.008, 8.3e-6, 782, 582)
    assert np.isnan(level.on_plane(390.5, 0.0, -1.07)).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"focal_length_m": 0.0},
        {"pixel_pitch_m": -1e-6},
        {"width_px": 0},
        {"height_px": -5},
        {"focal_length_m": math.nan},
        {"position_m": (0.0, math.inf, 0.0)},
        {"depression_rad": math.nan},
    ],
)
def test_impossible_cameras_are_refused(wrong: dict[str, object]) -> None:
    values: dict[str, object] = {"focal_length_m": 0.008, "pixel_pitch_m": 8e-6, "width_px": 8, "height_px": 6}
    with pytest.raises(DataError, match="rig file"):
        Pinhole(**{**values, **wrong})  # type: ignore[arg-type]


def test_points_need_three_coordinates() -> None:
    with pytest.raises(DataError, match="last axis"):
        CAMERA.project([1.0, 2.0])
