"""Lens distortion, corners of a chessboard, calibration of a camera with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.boards import CAMERA, CORNERS, corners_of, picture_of, poses
from processing.errors import DataError
from processing.optics.camera_calibration import board_places, calibrate_camera
from processing.optics.camera_model import Pinhole
from processing.optics.chessboard import find_chessboard
from processing.optics.distortion import NONE, distorted, undistorted

LENS = (-0.22, 0.09, 0.0008, -0.0012)


@given(st.floats(-0.45, 0.45), st.floats(-0.35, 0.35))
def test_undistorting_takes_the_distortion_back(a: float, b: float) -> None:
    x, y = undistorted(*distorted(a, b, LENS), LENS)
    assert (float(x), float(y)) == (pytest.approx(a, abs=1e-10), pytest.approx(b, abs=1e-10))
    assert distorted(a, b, NONE) == (a, b)


def test_distortion_is_brown_and_conradys() -> None:
    # Written out by hand for a = 0.3, b = -0.2: q = 0.13.
    a, b = distorted(0.3, -0.2, (0.1, 0.01, 0.002, -0.003))
    radial = 1 + 0.1 * 0.13 + 0.01 * 0.0169
    assert a == pytest.approx(0.3 * radial + 2 * 0.002 * -0.06 - 0.003 * (0.13 + 0.18))
    assert b == pytest.approx(-0.2 * radial + 0.002 * (0.13 + 0.08) + 2 * -0.003 * -0.06)


def test_what_the_lens_cannot_show_is_undefined() -> None:
    # a (1 - a^2 / 2) has its largest value 0.544 at a = 0.816.
    seen, _ = undistorted([0.5, 0.6], [0.0, 0.0], (-0.5, 0.0, 0.0, 0.0))
    assert np.isfinite(seen[0])
    assert np.isnan(seen[1])
    fish = replace(CAMERA, distortion=(-0.5, 0.0, 0.0, 0.0), principal_offset_px=(0.0, 0.0))
    u, _, _ = fish.project([[0.5, 1.0, 0.0], [1.2, 1.0, 0.0]])
    assert np.isfinite(u[0])
    assert np.isnan(u[1])


def test_a_camera_with_a_lens_projects_and_looks_back_along_the_same_rays() -> None:
    u, v = np.meshgrid(np.linspace(0, 781, 9), np.linspace(0, 581, 7))
    back = CAMERA.project(7.0 * CAMERA.rays(u, v))
    np.testing.assert_allclose(back[0], u, atol=1e-7)
    np.testing.assert_allclose(back[1], v, atol=1e-7)
    # The axis is where it was said to be, and the lens leaves it there.
    np.testing.assert_allclose(CAMERA.project([0.0, 2.0, 0.0])[:2], (390.5 + 6.3, 290.5 - 4.8))
    with pytest.raises(DataError, match="lens"):
        Pinhole(0.008, 8e-6, 10, 10, distortion=(np.nan, 0, 0, 0))


def test_corners_are_found_to_a_tenth_of_a_pixel() -> None:
    camera = replace(CAMERA, pixel_pitch_m=16.6e-6, width_px=391, height_px=291, principal_offset_px=(3.0, -2.0))
    turn, middle = poses(8)[3]
    found = find_chessboard(picture_of(turn, middle, np.random.default_rng(0), camera), *CORNERS)
    truth = corners_of(turn, middle, camera)
    # A board cannot tell its two ends apart.
    rms = min(np.sqrt(np.mean((found - t) ** 2)) for t in (truth, truth[::-1, ::-1]))
    assert rms < 0.1
    with pytest.raises(DataError, match="no chessboard"):
        find_chessboard(picture_of(turn, middle, np.random.default_rng(0), camera), 7, 9)


def test_a_board_of_squares_is_found_turned_and_upright() -> None:
    board = np.kron(np.indices((6, 6)).sum(axis=0) % 2, np.ones((16, 16)))
    for picture in (board, np.rot90(board), board[:, ::-1]):
        framed = np.pad(picture, 20, constant_values=0.5)
        found = find_chessboard(framed, 5, 5)
        # Fields of 16 pixels behind a margin of 20: corners lie between pixels.
        np.testing.assert_allclose(found[..., 0], np.tile(20 + 16 * np.arange(1, 6) - 0.5, (5, 1)), atol=0.02)
        np.testing.assert_allclose(found[..., 1], found[..., 0].T, atol=0.02)
    with pytest.raises(DataError, match="whole picture"):
        find_chessboard(np.zeros((4, 4)), 5, 5)
    with pytest.raises(DataError, match="no chessboard"):
        find_chessboard(np.zeros((50, 50)), 5, 5)


def test_calibration_finds_the_true_camera_within_its_uncertainty() -> None:
    random = np.random.default_rng(3)
    corners = [corners_of(*pose) + random.normal(0, 0.1, (*CORNERS, 2)) for pose in poses(9)]
    told = calibrate_camera(corners, 782, 582)
    found = [told.focal_length_px, *told.principal_point, *told.distortion]
    sds = [told.focal_length_sd_px, *told.principal_point_sd, *told.distortion_sd]
    truth = [CAMERA.focal_length_px, *CAMERA.principal_point, *CAMERA.distortion]
    # Seven numbers within 4 sds: one in 2000 by chance, at this seed none.
    assert np.all(np.abs(np.subtract(found, truth)) < 4 * np.asarray(sds))
    assert told.focal_length_sd_px < 2
    # Corners of 0.1 px, less the part of 61 numbers in 972.
    assert told.rms_px == pytest.approx(0.1, rel=0.1)
    assert told.principal_offset_px(782, 582) == pytest.approx(CAMERA.principal_offset_px, abs=2)


def test_calibration_refuses_what_tells_nothing() -> None:
    same = corners_of(*poses(1)[0])
    with pytest.raises(DataError, match="pictures of a board"):
        calibrate_camera([same, same], 782, 582)
    with pytest.raises(DataError, match="different shapes"):
        calibrate_camera([same, same, same[1:]], 782, 582)
    flat = 300 + 20 * board_places(6, 9)
    with pytest.raises(DataError, match="too alike"):
        calibrate_camera([flat, flat + 5, flat - 5], 782, 582)
