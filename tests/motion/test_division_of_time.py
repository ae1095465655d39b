"""Traces of what moves between a polarizer's exposures, and their removal."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.motion_scene import MATRIX, RoadScene, dolp_of
from processing.errors import DataError
from processing.motion.division_of_time import (
    camera_displacement,
    compensate,
    error_image,
    object_at_reference,
    read_along,
    touched,
)
from processing.motion.flow import displacement_by_pictures
from processing.optics.analyser import measurement_matrix

VELOCITY = (8.0, 9.0, 0.0)
SCENE = RoadScene(VELOCITY, np.arange(4) * 0.3)


@pytest.fixture(scope="module")
def exposures():
    return SCENE.exposures(np.random.default_rng(1))


@given(
    st.tuples(st.floats(1, 100), st.floats(0, 0.9), st.floats(-1.5, 1.5)),
    st.lists(st.floats(-5, 5), min_size=4, max_size=4),
)
def test_error_image_is_the_thesis_relation(light, off):
    s0, p, angle = light
    stokes = np.array([s0, s0 * p * np.cos(2 * angle), s0 * p * np.sin(2 * angle)])
    i = MATRIX @ stokes + off
    # Thesis 7.2 of chapter 8; what ideal polarizers pass of one light does not contradict itself.
    expected = abs((i[0] + i[2]) - (i[1] + i[3]))
    assert error_image(i[:, None, None], MATRIX)[0, 0] == pytest.approx(expected, abs=1e-9)


def test_error_image_of_five_angles_is_zero_for_one_light_and_three_are_refused():
    five = measurement_matrix(np.radians([0, 30, 60, 90, 120]))
    light = np.tensordot(five, np.ones((3, 2, 2)) * 0.3, 1)
    np.testing.assert_allclose(error_image(light, five), 0, atol=1e-12)
    with pytest.raises(DataError, match="cannot contradict"):
        error_image(light[:3], five[:3])


def test_displacement_is_what_the_camera_sees():
    fields = camera_displacement(SCENE.camera, VELOCITY, SCENE.time_s, -15_000.0)
    assert fields.shape == (4, 2, 128, 160)
    np.testing.assert_allclose(fields[0], 0, atol=1e-9)
    # 21.2 km and 27.03 microradians (Table 7.1): 0.573 m a pixel along x; y is seen under 45 degrees.
    down, right = fields[3, :, 64, 80]
    assert right == pytest.approx(8 * 0.9 / 0.5733, rel=2e-3)
    assert down == pytest.approx(-9 * 0.9 * np.sin(np.pi / 4) / 0.5733, rel=2e-3)


def test_reading_along_follows_a_cubic_picture_exactly():
    row, column = np.mgrid[0:30, 0:40].astype(float)
    light = np.stack([0.01 * (row - 2 * k) ** 2 + 0.1 * (column + k) for k in range(4)])
    moved = read_along(light, [[2.0 * k, -1.0 * k] for k in range(4)])
    # Far from the frame, where the spline's mirrored border does not reach.
    inner = (slice(12, -12), slice(12, -12))
    for k in range(4):
        np.testing.assert_allclose(moved[k][inner], light[0][inner], atol=1e-6)
    assert np.isnan(moved[3, -1]).all()
    with pytest.raises(DataError, match="down and right"):
        read_along(light, np.zeros((4, 3)))


def rms_db(light, compensated) -> tuple[float, float]:
    """How far the DOLP's error falls where motion spoilt it, dB, and the part of that which is left undefined."""
    truth = dolp_of(np.tensordot(MATRIX, SCENE.stokes(0.0), 1))
    clean = np.stack([np.tensordot(m, SCENE.stokes(t), 1) for m, t in zip(MATRIX, SCENE.time_s, strict=True)])
    zone = np.abs(dolp_of(clean) - truth) > 0.01
    before, after = ((dolp_of(x) - truth)[zone] for x in (light, compensated))
    ratio = np.sqrt(np.nanmean(after**2) / np.mean(before**2))
    return -20 * float(np.log10(ratio)), float(np.mean(np.isnan(after)))


def test_the_radars_velocity_takes_the_traces_away(exposures):
    # Off by as much as a measured velocity is: 0.1 m/s along, 0.25 m/s across the track.
    fields = camera_displacement(SCENE.camera, (8.1, 8.75, 0.0), SCENE.time_s, -15_000.0)
    made = compensate(exposures, MATRIX, fields)
    gain, undefined = rms_db(exposures, made.light)
    assert gain > 10
    assert undefined < 0.35
    # Undefined is what two or more exposures did not see, and nothing else.
    np.testing.assert_array_equal(np.isnan(made.light).any(axis=0), made.hidden >= 2)
    far = np.ones((128, 160), dtype=bool)
    far[25:95, 45:140] = False
    np.testing.assert_array_equal(made.light[:, far], exposures[:, far])
    traces = touched(exposures, MATRIX)
    before, after = (np.nanmean(error_image(x, MATRIX)[traces] ** 2) for x in (exposures, made.light))
    assert 10 * np.log10(before / after) > 10


def test_the_object_is_found(exposures):
    fields = camera_displacement(SCENE.camera, VELOCITY, SCENE.time_s, -15_000.0)
    found = object_at_reference(exposures, MATRIX, fields)
    lorry = np.abs(SCENE.stokes(0.0)[0] - RoadScene(VELOCITY, np.zeros(4)).stokes(1e4)[0]) > 0.03
    # A pixel of margin all round is 150 pixels of 670.
    assert (found & lorry).sum() > 0.97 * lorry.sum()
    assert (found & ~lorry).sum() < 0.4 * lorry.sum()


def test_pictures_alone_tell_the_motion_of_one_object(exposures):
    told = displacement_by_pictures(exposures, MATRIX, SCENE.time_s)
    true = camera_displacement(SCENE.camera, VELOCITY, SCENE.time_s, -15_000.0)
    # A tenth of a pixel by perspective and noise each.
    np.testing.assert_allclose(told[3, :, 64, 80], true[3, :, 64, 80], atol=0.3)


def test_where_nothing_moves_nothing_changes():
    still = RoadScene(VELOCITY, np.full(4, 0.0)).exposures(np.random.default_rng(2))
    assert not touched(still, MATRIX).any()
    made = compensate(still, MATRIX, [[0, 0], [3, 3], [6, 6], [9, 9]])
    np.testing.assert_array_equal(made.light, still)
    assert not made.object_mask.any()
    with pytest.raises(DataError, match="nothing moved"):
        displacement_by_pictures(still, MATRIX, np.arange(4.0))
    with pytest.raises(DataError, match="one for each"):
        displacement_by_pictures(still, MATRIX, np.zeros(4))
