"""Camera frames as they arrive: what light was let through the polarizer comes out again."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from live_rig import rig

from drivers.records import Frame
from polfuse_lab.live import Board, LiveView
from polfuse_lab.live.pictures import Pictures
from polfuse_lab.records import Exposure, FrameFlag
from processing.errors import DataError
from processing.optics.analyser import measurement_matrix
from processing.optics.binning import bin_factor, bin_frame, bin_frame_reference
from processing.optics.mosaic import parse_mosaic, through_mosaic
from processing.optics.stokes import Flag

S0, DOLP, AOP = 1000.0, 0.4, math.radians(30.0)
STOKES = np.array([S0, S0 * DOLP * math.cos(2 * AOP), S0 * DOLP * math.sin(2 * AOP)])
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
BLACK = 100.0


@settings(max_examples=60, deadline=None)
@given(
    rows=st.integers(1, 23),
    columns=st.integers(1, 23),
    factor=st.integers(1, 6),
    dtype=st.sampled_from([np.uint8, np.uint16]),
    seed=st.integers(0, 99),
)
def test_the_kernel_bins_as_its_definition(rows, columns, factor, dtype, seed):
    image = np.random.default_rng(seed).integers(0, np.iinfo(dtype).max + 1, (rows, columns)).astype(dtype)
    if min(rows, columns) < factor:
        with pytest.raises(DataError, match="blocks"):
            bin_frame(image, factor, 200)
        return
    mean, share = bin_frame(image, factor, 200)
    expected, expected_share = bin_frame_reference(image, factor, 200)
    # Sums are whole numbers below 2^24: only the rounding to float32 is left.
    np.testing.assert_allclose(mean, expected, rtol=6e-8 * 2)
    np.testing.assert_allclose(share, expected_share, rtol=6e-8 * 2)


def test_the_factor_makes_it_fit():
    assert bin_factor((582, 782), 480, 640) == 2
    assert bin_factor((480, 640), 480, 640) == 1
    assert bin_factor((2048, 2448), 480, 640) == 5


def test_what_is_no_frame_is_refused():
    for image in (np.zeros((4, 4)), np.zeros(4, np.uint8)):
        with pytest.raises(DataError):
            bin_frame(image, 1, 200)


def light(angle_deg, shape=(12, 16), stokes=STOKES):
    """Counts behind the polarizer at an angle (thesis 2.7 with a finite extinction ratio)."""
    counts = measurement_matrix([math.radians(angle_deg)], 800.0)[0] @ stokes + BLACK
    return np.full(shape, round(counts), np.uint16)


def exposure(image, angle_deg, **told):
    frame = Frame(image, 1, 0.01, 0.0, 0.0, 123, incomplete=told.pop("incomplete", False))
    return Exposure(frame, math.radians(angle_deg), **told)


@pytest.fixture
def shown(tmp_path):
    board, view = Board(tmp_path), LiveView(tmp_path)
    yield Pictures(rig(), board, angles_deg=ANGLES_DEG, frames_per_angle=2), view
    view.close()
    board.close()


def series(pictures, angles=ANGLES_DEG, frames=2, **told):
    for angle in angles:
        for _ in range(frames):
            pictures.take(exposure(light(angle), angle, **told))


def test_a_complete_series_tells_the_light(shown):
    pictures, view = shown
    series(pictures)
    item = view.newest("optics")
    assert item.values["complete"]
    assert item.values["frames"] == 8
    assert item.values["angles_deg"] == list(ANGLES_DEG)
    # Counts are rounded to whole numbers: 0.5 of 1000, so S0 within 0.6 and DOLP within 0.002.
    np.testing.assert_allclose(item.arrays["s0"], S0, atol=0.8)
    np.testing.assert_allclose(item.arrays["dolp"], DOLP, atol=0.002)
    np.testing.assert_allclose(item.arrays["aop_rad"], AOP, atol=0.003)
    assert not item.arrays["flags"].any()
    assert pictures.polarized.factor == 1


def test_frames_are_shown_by_their_angle(shown):
    pictures, view = shown
    series(pictures, frames=1)
    assert [name for name in view.streams() if name.startswith("camera")] == [
        "camera.000.0",
        "camera.045.0",
        "camera.090.0",
        "camera.135.0",
    ]
    item = view.newest("camera.045.0")
    np.testing.assert_array_equal(item.arrays["image"], light(45.0))
    assert item.values["angle_deg"] == pytest.approx(45.0)
    assert item.values["full_scale"] == 4095
    np.testing.assert_array_equal(view.newest("frame.045.0").arrays["image"], light(45.0))
    # Three of four angles, one frame of two: not complete, and shown all the same.
    assert not view.newest("optics").values["complete"]


def test_saturated_pixels_are_marked_and_undefined(shown):
    pictures, view = shown
    for angle in ANGLES_DEG:
        image = light(angle)
        image[:6, :8] = 4095 if angle == 0.0 else image[0, 0]
        pictures.take(exposure(image, angle))
        pictures.take(exposure(image, angle))
    item = view.newest("camera.000.0")
    assert item.values["saturated_fraction"] == pytest.approx(0.25)
    np.testing.assert_array_equal(item.arrays["saturated"][:6, :8], 1.0)
    polarized = view.newest("optics")
    assert np.isnan(polarized.arrays["dolp"][:6, :8]).all()
    assert (polarized.arrays["flags"][:6, :8] & int(Flag.SATURATED)).all()
    assert np.isfinite(polarized.arrays["dolp"][6:, 8:]).all()


def test_an_angle_that_comes_again_replaces_its_old_frames(shown):
    pictures, view = shown
    series(pictures)
    stokes = STOKES * 0.5
    for angle in ANGLES_DEG:
        for _ in range(2):
            pictures.take(exposure(light(angle, stokes=stokes), angle))
    np.testing.assert_allclose(view.newest("optics").arrays["s0"], S0 / 2, atol=0.8)
    assert view.newest("optics").values["frames"] == 8


def test_frames_taken_while_it_turned_or_with_parts_missing_count_for_nothing(shown):
    pictures, view = shown
    series(pictures)
    pictures.take(exposure(light(90.0), 0.0, flags=FrameFlag.MOVED))
    pictures.take(exposure(np.zeros((12, 16), np.uint16), 45.0, incomplete=True))
    item = view.newest("optics")
    np.testing.assert_allclose(item.arrays["dolp"], DOLP, atol=0.002)
    # They are seen all the same.
    assert view.newest("camera.000.0").arrays["image"][0, 0] == light(90.0)[0, 0]


def test_dark_frames_are_subtracted_instead_of_the_black_level(shown):
    pictures, view = shown
    for _ in range(3):
        pictures.take(exposure(np.full((12, 16), 130, np.uint16), 0.0, dark=True))
    series(pictures)
    # 30 counts more are taken off each angle; the sum of two perpendicular ones is S0 (1 + 1/800 and less).
    np.testing.assert_allclose(view.newest("optics").arrays["s0"], S0 - 60.0 / (1 + 1 / 800), atol=1.2)


def test_a_mosaic_tells_all_at_once(tmp_path):
    polarizer = '[polarizer]\ndriver = "ell14"\nextinction_ratio = 800.0\n'
    rigged = rig(**{polarizer: "", "saturation_counts": 'mosaic = "90-45-135-0"\nsaturation_counts'})
    planes = np.broadcast_to(STOKES[:, None, None], (3, 12, 16))
    image = np.round(through_mosaic(planes, parse_mosaic("90-45-135-0"), 300.0) + BLACK).astype(np.uint16)
    with LiveView(tmp_path) as view:
        board = Board(tmp_path)
        Pictures(rigged, board).take(exposure(image, 0.0))
        item = view.newest("optics")
        assert item.arrays["s0"].shape == (6, 8)
        np.testing.assert_allclose(item.arrays["dolp"], DOLP, atol=0.002)
        np.testing.assert_allclose(item.arrays["aop_rad"], AOP, atol=0.003)
        assert view.newest("camera.mosaic").values["factor"] == 2
        board.close()
