"""Radar and camera over ground that is not flat, against closed forms: ramp, step, hidden places, errors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.fusion.height_map import HeightMap, camera_sees, radar_places
from processing.fusion.registration import GeometryErrors, ground_to_camera, registration_error, surface_error
from processing.fusion.surface_registration import surface_to_camera
from processing.optics.camera_model import Pinhole

GROUND = -1.5
CAMERA = Pinhole(0.008, 16e-6, 400, 300, (0.3, -0.4, 0.2), float(np.radians(8)))
X, Y = np.linspace(-2, 2, 9), np.linspace(3.0, 15.0, 61)
NODES_X = np.linspace(-6, 6, 25)
ERRORS = GeometryErrors(0.3, 0.1, 0.005, 0.2)


def ramp(slope: float, foot: float = 2.0) -> HeightMap:
    y = np.linspace(1.0, 30.0, 59)
    return HeightMap(NODES_X, y, np.repeat(slope * (y - foot)[:, None], len(NODES_X), axis=1))


def step(edge: float, height: float, cell: float = 0.02) -> HeightMap:
    """Flat, then up by ``height`` between two nodes that are ``cell`` apart, then flat."""
    y = np.array([1.0, 2.0, 3.0, edge, edge + cell, 12.0, 20.0])
    return HeightMap(NODES_X, y, np.repeat(np.where(y > edge, height, 0.0)[:, None], len(NODES_X), axis=1))


def test_a_map_of_zero_height_changes_nothing() -> None:
    flat = HeightMap(NODES_X, Y, np.zeros((len(Y), len(NODES_X))))
    u, v = ground_to_camera(CAMERA, X, Y, GROUND)
    found = surface_to_camera(CAMERA, flat, X, Y, GROUND, ERRORS.height_m)
    np.testing.assert_allclose(found.u, u, atol=1e-9)
    np.testing.assert_allclose(found.v, v, atol=1e-9)
    assert not found.hidden.any()
    np.testing.assert_array_equal(found.layover_px, 0.0)
    np.testing.assert_allclose(
        found.error(CAMERA, ERRORS).total, registration_error(CAMERA, X, Y, GROUND, ERRORS).total, rtol=1e-9
    )


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.05, 0.6))
def test_a_ramp_is_met_where_its_range_is_the_pixels(slope: float) -> None:
    # y'^2 + (z + s (y' - y0))^2 = y^2 + z^2, a quadratic in y'; the root in front of the rail.
    y = np.linspace(4.0, 9.0, 11)
    places = radar_places(ramp(slope), [0.7], y, GROUND)
    b = GROUND - slope * 2.0
    a, half, c = 1 + slope**2, slope * b, b**2 - (y**2 + GROUND**2)
    expected = (-half + np.sqrt(half**2 - a * c)) / a
    np.testing.assert_allclose(places.points_m[:, 1], expected, rtol=1e-12)
    np.testing.assert_allclose(places.points_m[:, 2], GROUND + slope * (expected - 2.0), atol=1e-12)
    np.testing.assert_allclose(places.slope, slope, atol=1e-12)
    # Length of surface in a metre of range: sqrt(1 + s^2) R / (y' + s z').
    towards = expected + slope * places.points_m[:, 2]
    np.testing.assert_allclose(places.area, np.sqrt(1 + slope**2) * np.hypot(y, GROUND) / towards, rtol=1e-9)


def test_the_foot_of_a_step_and_what_lies_over_it() -> None:
    edge, height = 8.0, 1.0
    # Its top begins at the range of hypot(8, -0.5): in the picture at y = sqrt(64 + 0.25 - 2.25) = 7.874.
    y = np.array([7.5, 7.8, 7.9, 7.99, 8.3])
    places = radar_places(step(edge, height, cell=1e-6), [0.0], y, GROUND)
    each = [places.points_m[places.pixel == row, 1:] for row in range(len(y))]
    # Before the step, the ground itself.
    for row in (0, 1):
        np.testing.assert_allclose(each[row], [[y[row], GROUND]], atol=1e-9)
    for row in (2, 3):
        # Ground, wall and top have the same range; the wall where 64 + z^2 is that.
        on_wall = -np.sqrt(y[row] ** 2 + GROUND**2 - 64)
        on_top = np.sqrt(y[row] ** 2 + GROUND**2 - 0.25)
        expected = np.array([[y[row], GROUND], [8.0, on_wall], [on_top, -0.5]])
        # The wall leans by a micrometre: 8 / 0.5 times that in height.
        np.testing.assert_allclose(each[row][np.argsort(each[row][:, 0])], expected, atol=1.7e-5)
    np.testing.assert_allclose(each[4], [[np.sqrt(8.3**2 + 2.25 - 0.25), -0.5]], atol=1e-9)
    # A wall that is seen at a grazing angle has the most surface in a metre of range: it is taken.
    found = surface_to_camera(CAMERA, step(edge, height, cell=1e-6), [0.0], y, GROUND, 0.1)
    assert found.points_m[2, 0, 1] == pytest.approx(8.0, abs=1e-5)
    u, v, _ = CAMERA.project(np.column_stack([np.zeros(3), each[2][np.argsort(each[2][:, 0])]]))
    area = [np.hypot(7.9, GROUND) / 7.9, np.hypot(7.9, GROUND) / np.sqrt(7.9**2 + 2.25 - 64), np.hypot(7.9, GROUND)
            / np.sqrt(7.9**2 + 2.0)]  # fmt: skip
    away = np.hypot(u - u[1], v - v[1])
    assert found.layover_px[2, 0] == pytest.approx(np.sqrt(np.average(away**2, weights=area)), rel=1e-3)
    assert found.layover_px[0, 0] == 0.0


def test_behind_a_step_lies_the_radars_shadow() -> None:
    # A wall of 1 m from y = 6 to 6.02: its top is seen from the rail (1.5 m up) at 0.5 m below over 6 m, and the ground
    # behind is in the shadow to 1.5 m below at y = 6.02 * 1.5 / 0.5.
    y = np.array([1.0, 5.99, 6.0, 6.02, 6.03, 40.0])
    wall = HeightMap(NODES_X, y, np.repeat(np.array([0, 0, 1, 1, 0, 0.0])[:, None], len(NODES_X), axis=1))
    ground = np.linspace(7.0, 30.0, 461)
    lit = np.unique(radar_places(wall, [0.0], ground, GROUND).pixel)
    assert ground[lit].min() == pytest.approx(6.02 * 3, abs=0.05)
    np.testing.assert_array_equal(lit, np.arange(lit[0], len(ground)))


def test_what_the_camera_does_not_see_is_undefined() -> None:
    # A box of 0.6 m from y = 6 to 7 over x in (-0.5, 0.5), seen from 0.2 - (-1.5) = 1.7 m up and 0.4 m behind the rail:
    # at x' = 0 the ray over its far edge reaches the ground at y = 7.4 * 1.7 / 1.1 - 0.4.
    x, y = np.arange(-3, 3.01, 0.05), np.arange(2.0, 15.01, 0.05)
    inside = (np.abs(x) <= 0.5) & ((y >= 6) & (y <= 7))[:, None]
    box = HeightMap(x, y, np.where(inside, 0.6, 0.0))
    at = np.arange(7.1, 14.0, 0.02)
    points = np.stack([np.zeros_like(at), at, np.full_like(at, GROUND)], axis=-1)
    seen = camera_sees(box, GROUND, CAMERA.position_m, points)
    assert at[seen].min() == pytest.approx(
        7.4 * 1.7 / 1.1 - 0.4, abs=0.15
    )  # half a node's distance, over 0.27 of slope
    assert np.all(np.diff(seen.astype(int)) >= 0)
    beside = points + np.array([2.5, 0, 0])
    assert camera_sees(box, GROUND, CAMERA.position_m, beside).all()
    # The radar stands lower than the camera here and forward of it: what only the camera misses is NaN as well.
    low = Pinhole(0.008, 16e-6, 400, 300, (0.0, 0.0, -0.6), float(np.radians(3)))
    found = surface_to_camera(low, box, [0.0], [5.0, 8.2, 9.5], GROUND, 0.1)
    assert np.isfinite(found.u[0, 0])
    # Shadow of the radar to 7 * 1.5 / 0.9 = 11.7 m: nothing is there at all.
    assert np.isnan(found.points_m[1:]).all()
    assert np.isnan(found.u[1:]).all()


def test_a_place_that_only_the_radar_sees_is_told_as_hidden() -> None:
    y = np.arange(2.0, 15.01, 0.05)
    wall = HeightMap(NODES_X, y, np.repeat(np.where((y >= 6) & (y <= 6.2), 0.5, 0.0)[:, None], len(NODES_X), axis=1))
    low = Pinhole(0.008, 16e-6, 400, 300, (0.0, 0.0, -0.9), float(np.radians(3)))
    found = surface_to_camera(low, wall, [0.0], [5.0, 10.0, 13.0], GROUND, 0.1)
    # Radar's shadow to 6.2 * 1.5 / 1.0 = 9.3 m; the camera's, 0.6 m up, to 6.2 * 0.6 / 0.1 = 37 m.
    assert found.hidden.ravel().tolist() == [False, True, True]
    assert np.isfinite(found.points_m[1:]).all()
    assert np.isnan(found.u.ravel()[1:]).all()


def test_errors_on_a_slope_are_what_a_monte_carlo_finds() -> None:
    slope, foot, x, n = 0.3, 2.0, 0.6, 20_000
    random = np.random.default_rng(2)
    errors = GeometryErrors(0.02, 0.03, 0.0, 0.01)
    place = radar_places(ramp(slope), [x], [6.0, 7.0], GROUND)
    found = surface_error(CAMERA, place.points_m, place.slope, errors).total[0]
    reach = np.hypot(6.0, GROUND) + errors.range_m * random.normal(size=n)
    # The ramp as high as it truly is: y^2 + (b + s y)^2 = R^2.
    b = GROUND - slope * foot + errors.height_m * random.normal(size=n)
    a = 1 + slope**2
    y = (-slope * b + np.sqrt((slope * b) ** 2 - a * (b**2 - reach**2))) / a
    true = np.stack([x + errors.cross_range_m * random.normal(size=n), y, b + slope * y], axis=-1)
    u, v, _ = CAMERA.project(true)
    u0, v0, _ = CAMERA.project(place.points_m[0])
    # As in the flat case: 0.5 % by chance, second-order terms below 1 %.
    assert found == pytest.approx(float(np.sqrt(np.mean((u - u0) ** 2 + (v - v0) ** 2))), rel=0.03)


def test_the_maps_own_uncertainty_is_the_pixels() -> None:
    y = np.linspace(1.0, 30.0, 59)
    sd = np.where(y > 8.0, 0.4, 0.1)[:, None] * np.ones(len(NODES_X))
    known = HeightMap(NODES_X, y, np.zeros((59, 25)), np.where(y[:, None] > 11, np.nan, sd))
    found = surface_to_camera(CAMERA, known, [0.0], [5.0, 10.0, 13.0], GROUND, 0.2)
    np.testing.assert_allclose(found.height_sd_m.ravel(), [0.1, 0.4, 0.2])
    one = GeometryErrors(0.0, 0.0, 0.0, 1.0)
    per_metre = registration_error(CAMERA, [0.0], [5.0, 10.0, 13.0], GROUND, one).total.ravel()
    np.testing.assert_allclose(found.error(CAMERA, one).total.ravel(), per_metre * [0.1, 0.4, 0.2], rtol=1e-9)


def test_outside_the_map_and_in_its_holes_nothing_is_known() -> None:
    holed = ramp(0.0)
    holed.height_m[20:24] = np.nan  # y from 11 to 12.5
    places = radar_places(holed, [0.0, 7.0], np.array([10.0, 11.2, 12.2, 14.0, 29.9, 31.0]), GROUND)
    np.testing.assert_array_equal(places.pixel // 2, [0, 3, 4])  # the column x = 7 lies beside the map
    np.testing.assert_array_equal(places.pixel % 2, 0)
    assert np.isnan(holed.at([0.0, 7.0], [11.2, 5.0])).all()


def test_maps_that_cannot_be() -> None:
    x, y = np.arange(3.0), np.arange(4.0)
    for bad, words in (
        ((x, y, np.zeros((3, 4))), "shape"),
        ((x[::-1], y, np.zeros((4, 3))), "increase"),
        ((x, y, np.full((4, 3), np.nan)), "knows no height"),
        ((x, y, np.zeros((4, 3)), np.full((4, 3), -1.0)), "negative"),
    ):
        with pytest.raises(DataError, match=words):
            HeightMap(*bad)
    with pytest.raises(DataError, match="in front of the rail"):
        radar_places(ramp(0.0), [0.0], [0.0, 1.0], GROUND)
