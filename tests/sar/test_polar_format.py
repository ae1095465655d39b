"""Polar format against back-projection, closed forms of the wavefront's curvature, and measured data."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rail_data import C, relative_db
from real_data import real_data
from spotlight_data import flight, profiles, scattered, square

from polfuse_lab.imports.gotcha import import_gotcha
from polfuse_lab.products.focus import focus
from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.sar.aperture import aperture_window
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid, PolarGrid
from processing.sar.planner import Task, choose
from processing.sar.polar_format import polar_format
from processing.sar.polar_format_geometry import polar_forecast, spotlight, usable_radius_m
from processing.sar.quality import carrier_of, point_response
from processing.sar.resolution import point_resolution

WAVELENGTH_M = C / 15e9
K = 4 * np.pi / WAVELENGTH_M


def circle(pulses, turn_deg=3.0, range_m=10e3, height_m=6e3):
    azimuth = np.radians(turn_deg) * (np.arange(pulses) / (pulses - 1) - 0.5) + 0.7
    ground = np.sqrt(range_m**2 - height_m**2)
    return np.column_stack([ground * np.cos(azimuth), ground * np.sin(azimuth), np.full(pulses, height_m)])


TRACKS = {"flight": flight(150), "squinted": flight(150, squint_rad=0.5), "circle": circle(150)}


@pytest.mark.parametrize("name", list(TRACKS))
@pytest.mark.parametrize("span_m", [16.0, 50.0])
def test_error_against_back_projection_is_the_one_foretold(name, span_m):
    # The error foretold is what the curvature leaves, a mean over points anywhere; ours lie within 0.9 of the extent,
    # so that fourth powers of distances are up to 4 dB smaller. Eight taps at 4 bins are exact to -94 dB.
    antenna = TRACKS[name]
    grid = square(int(span_m / 0.32), 0.32)
    data = profiles(scattered(40, span_m), antenna, span_m)
    foretold = polar_forecast(antenna, grid, WAVELENGTH_M, 750e6)
    error = relative_db(polar_format(data, grid)[0], backproject(data, grid, interpolator="sinc16")[0])
    assert foretold is not None
    assert foretold.error_db - 7 < error < foretold.error_db + 2.5
    assert error < -48


def test_small_scene_is_back_projection_in_amplitude_and_phase():
    antenna = TRACKS["circle"]
    grid = square(40, 0.1)
    data = profiles(np.array([[0.3, -0.5, 0.0], [-1.1, 0.9, 0.0]]), antenna, 6.0)
    weights = aperture_window("taylor", 150)
    error = relative_db(
        polar_format(data, grid, weights=weights)[0], backproject(data, grid, weights=weights, interpolator="sinc16")[0]
    )
    # Kernels of -94 dB, cut ranges that roll off.
    assert error < -74


def test_what_is_left_of_the_range_is_its_curvature():
    # The range's difference to the centre's, and its least squares by a general solver.
    antenna = TRACKS["flight"]
    scene = spotlight(antenna, ImageGrid(np.array([-1.0, 1.0]), np.array([-1.0, 1.0]), 0.0))
    places = np.array([[7.0, 0.0, 0.0], [0.0, 9.0, 0.0], [-20.0, 13.0, 0.0]])
    at, left = scene.straightened(places)
    for place, found, rest in zip(places, at, left, strict=True):
        further = np.linalg.norm(place - antenna, axis=1) - np.linalg.norm(antenna, axis=1)
        solved, *_ = np.linalg.lstsq(scene.direction, further, rcond=None)
        np.testing.assert_allclose(found, solved, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(rest, further - scene.direction @ solved, atol=1e-8)
    # Errors of small phases grow with the fourth power of the distance (phase with the square): 12 dB each doubling.
    near, far = (scene.error_power(scene.straightened(f * places[2:])[1], K)[0] for f in (1.0, 2.0))
    assert 10 * np.log10(far / near) == pytest.approx(12.04, abs=0.3)
    radii = [usable_radius_m(scene, K, level) for level in (-62.0412, -50.0)]
    assert radii[1] / radii[0] == pytest.approx(2.0, rel=0.03)


def test_point_targets_are_as_wide_as_theory_says():
    antenna = TRACKS["flight"]
    target = np.array([[6.0, -9.0, 0.0]])
    grid = ImageGrid(6.0 + 0.08 * np.arange(-30, 31), -9.0 + 0.08 * np.arange(-30, 31), 0.0)
    data = profiles(target, antenna, 40.0)
    image = polar_format(data, grid)[0]
    assert np.abs(image).argmax() == 30 * 61 + 30
    # The carrier's phase is taken off by definition: a point of amplitude 1 shows 1.
    assert image[30, 30] / np.abs(image[30, 30]) == pytest.approx(1.0, abs=0.01)
    response = point_response(image, grid, 6.0, -9.0, reach_m=(1.5, 1.5), carrier=carrier_of(antenna, 15e9))
    theory = point_resolution(antenna, tuple(target[0]), centre_hz=15e9, bandwidth_hz=750e6)
    assert response.x.width_m == pytest.approx(theory.x_m, rel=0.02)
    assert response.y.width_m == pytest.approx(theory.y_m, rel=0.02)


def test_channels_missing_pulses_and_any_order_follow_back_projection():
    antenna = TRACKS["squinted"]
    grid = square(50, 0.3)
    data = profiles(scattered(10, 15.0), antenna, 15.0)
    values = np.concatenate([data.values, 0.5j * data.values]).astype(np.complex64)
    values[1, 20:30] = np.nan
    order = np.random.default_rng(0).permutation(150)
    both = replace(
        data, values=values[:, order], antenna_m=antenna[order], start_m=data.start_m[order], channels=("HH", "HV")
    )
    expected = backproject(both, grid, interpolator="sinc16")
    for image, wanted in zip(polar_format(both, grid), expected, strict=True):
        assert relative_db(image, wanted) < -55


def test_one_pulse_is_ranging():
    antenna = TRACKS["circle"][:1]
    grid = square(40, 0.3)
    data = profiles(np.array([[1.0, 2.0, 0.0]]), antenna, 15.0)
    # No aperture, so no defocus: what is left of the range is nothing at all.
    assert relative_db(polar_format(data, grid)[0], backproject(data, grid, interpolator="sinc16")[0]) < -65


def test_pixels_off_the_range_axis_are_undefined_as_in_back_projection():
    antenna = TRACKS["flight"]
    data = profiles(scattered(5, 10.0), antenna, 10.0)
    half = 0.5 * data.range_step_m * len(data.range_m)
    axis = np.linspace(-1.3 * half, 1.3 * half, 40)
    image, expected = (form(data, ImageGrid(axis, axis, 0.0))[0] for form in (polar_format, backproject))
    np.testing.assert_array_equal(np.isnan(image), np.isnan(expected))
    assert 0.1 < np.isnan(image).mean() < 0.9
    assert relative_db(image, expected) < -38


def test_scenes_that_are_too_large_or_not_modelled_are_refused():
    antenna = TRACKS["flight"]
    data = profiles(scattered(3, 10.0), antenna, 10.0)
    grid = square(20, 0.3)
    with pytest.raises(DataError, match=r"straight enough for -20 dB up to \d+ m"):
        polar_format(data, square(20, 60.0))
    with pytest.raises(DataError, match="on a plane"):
        polar_format(data, PolarGrid(np.array([10.0]), np.array([0.0]), 0.0))
    with pytest.raises(DataError, match="stand apart"):
        polar_format(replace(data, pairs=(AntennaPair((0.5, 0.0, 0.0), (0.0, 0.0, 0.0)),)), grid)
    with pytest.raises(DataError, match="motion within the sweeps"):
        polar_format(replace(data, velocity_m_s=np.full((150, 3), 100.0), ramp_s=0.02), grid)
    spoiled = data.values.copy()
    spoiled[0, 3, 40] = np.nan
    with pytest.raises(DataError, match="single NaN"):
        polar_format(replace(data, values=spoiled), grid)
    with pytest.raises(DataError, match="straight above"):
        polar_format(replace(data, antenna_m=np.array([[0, 0, 5e3]] * 150)), grid)
    around = circle(150, turn_deg=200.0)
    with pytest.raises(DataError, match="turn by"):
        polar_format(replace(data, antenna_m=around), grid)
    with pytest.raises(DataError, match="empty"):
        polar_format(data, ImageGrid(np.array([]), np.array([1.0]), 0.0))
    with pytest.raises(DataError, match="outside the profiles"):
        polar_format(replace(data, start_m=data.start_m + 500.0), grid)
    assert polar_forecast(around, grid, WAVELENGTH_M, 750e6) is None
    assert polar_forecast(antenna, square(20, 60.0), WAVELENGTH_M, 750e6) is None


@settings(max_examples=8, deadline=None)
@given(a=st.complex_numbers(max_magnitude=5), b=st.complex_numbers(max_magnitude=5), seed=st.integers(0, 100))
def test_it_is_linear(a, b, seed):
    antenna = flight(30)
    rng = np.random.default_rng(seed)
    data = profiles(scattered(2, 5.0), antenna, 5.0)
    one, two = (rng.normal(size=data.values.shape) + 1j * rng.normal(size=data.values.shape) for _ in range(2))
    grid = square(12, 0.3)
    first, second, both = (polar_format(replace(data, values=v), grid) for v in (one, two, a * one + b * two))
    size = (abs(a) + abs(b) + 1e-3) * np.abs(first).max()
    # complex64 through three transforms.
    np.testing.assert_allclose(both, a * first + b * second, atol=2e-5 * size)


@settings(max_examples=8, deadline=None)
@given(x=st.floats(-500, 500), y=st.floats(-500, 500), z=st.floats(-50, 50))
def test_scene_and_track_may_stand_anywhere(x, y, z):
    antenna = flight(30)
    data = profiles(scattered(2, 5.0), antenna, 5.0)
    grid = square(12, 0.3)
    moved = replace(data, antenna_m=antenna + np.array([x, y, z]))
    there = ImageGrid(grid.x_m + x, grid.y_m + y, grid.z_m + z)
    # Ranges of 8 km in float64 keep 1e-12 m, 1e-9 rad; kernels are read at places that rounding moves a little.
    np.testing.assert_allclose(polar_format(moved, there), polar_format(data, grid), atol=1e-4)


def test_planner_takes_it_where_it_is_exact_enough():
    antenna, grid = flight(600), square(256, 0.16)
    task = Task(
        pixels=256 * 256, pulses=600, channels=1, oversampling=4, wavelength_m=WAVELENGTH_M, furthest_m=8100.0,
        widest_rad=0.0, residual_m=None, compensated=False, bandwidth_hz=750e6, depth_m=60.0,
        polar=polar_forecast(antenna, grid, WAVELENGTH_M, 750e6),
    )  # fmt: skip
    assert choose(task, -45.0).method == "pfa"
    assert choose(task, -90.0).method != "pfa"
    with pytest.raises(DataError, match="polar format"):
        choose(replace(task, polar=None), -45.0, "pfa")


def test_the_car_park_of_the_real_collect(tmp_path):
    folder = real_data("gotcha")
    session, history = import_gotcha([folder], tmp_path / "s.h5")
    # The brightest reflector, a trihedral at the park's edge, by both methods.
    grid = ImageGrid(np.arange(-22, -9, 0.08), np.arange(15, 28, 0.12), 0.0)
    made = {
        name: focus(session, tmp_path / f"{name}.h5", method=name, grid=grid, tolerance_db=-90.0)
        for name in ("pfa", "bp")
    }
    assert made["pfa"].choice.method == "pfa"
    error = relative_db(made["pfa"].image, made["bp"].image)
    assert error < made["pfa"].choice.predicted_error_db + 6
    responses = [
        point_response(
            made[name].image[0], grid, made[name].peaks[0].x_m, made[name].peaks[0].y_m, reach_m=(2.0, 3.0),
            carrier=carrier_of(history.antenna_m, 9.6e9),
        )
        for name in ("pfa", "bp")
    ]  # fmt: skip
    for axis in ("x", "y"):
        ours, theirs = (getattr(response, axis).width_m for response in responses)
        assert ours == pytest.approx(theirs, rel=5e-3)
