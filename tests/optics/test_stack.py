"""Averaging frames: whole-number sums, black level and dark frames, saturation, frames that are incomplete."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics.series import SensorNoise
from processing.optics.stack import FrameStack
from processing.optics.stokes import Flag, stokes_image

STANDARD = tuple(np.radians([0.0, 45.0, 90.0, 135.0]))
FULL = 65_535


def filled(values: dict[float, list[int]], *, black: float = 0.0, dark: list[int] | None = None) -> FrameStack:
    stack = FrameStack(saturation_counts=FULL, black_level_counts=black)
    for angle, counts in values.items():
        for count in counts:
            stack.add(np.full((2, 3), count, dtype=np.uint16), angle, angle_sd_rad=0.001)
    for count in dark or []:
        stack.add(np.full((2, 3), count, dtype=np.uint16), 0.0, dark=True)
    return stack


def test_means_and_black_level() -> None:
    averaged = filled({0.0: [10, 11], 1.0: [20, 22], 2.0: [5, 7]}, black=4.5).averaged(noise=SensorNoise(2.0))
    np.testing.assert_allclose(averaged.light[:, 0, 0], [6.0, 16.5, 1.5])
    assert averaged.series.frames == (2, 2, 2)
    assert averaged.series.angle_sd_rad == (0.001,) * 3
    assert averaged.series.dark_frames == 0
    assert not averaged.incomplete


def test_dark_frames_take_the_place_of_the_black_level() -> None:
    averaged = filled({0.0: [10], 1.0: [20], 2.0: [5]}, black=4.0, dark=[7, 8]).averaged()
    # Darker than dark is negative, not 65533: unsigned counts are never subtracted from one another.
    np.testing.assert_allclose(averaged.light[:, 1, 2], [2.5, 12.5, -2.5])
    assert averaged.series.dark_frames == 2


def test_counts_near_full_scale_do_not_wrap() -> None:
    # 300 frames of 65534 sum to 2e7, 300 times what uint16 holds; S1 = I0 - I90 is negative here.
    stack = filled({STANDARD[0]: [100], STANDARD[1]: [65534] * 300, STANDARD[2]: [200], STANDARD[3]: [65534] * 300})
    averaged = stack.averaged()
    np.testing.assert_array_equal(averaged.light[1], 65534.0)
    image = stokes_image(averaged.light, averaged.saturated, averaged.series)
    assert image.s1[0, 0] == pytest.approx(-100.0, abs=1e-2)


@given(st.lists(st.integers(0, FULL), min_size=3, max_size=8), st.randoms(use_true_random=False))
def test_order_of_frames_does_not_matter(counts: list[int], shuffle: object) -> None:
    frames = [(angle, count) for angle in STANDARD for count in counts]
    first, second = FrameStack(saturation_counts=FULL), FrameStack(saturation_counts=FULL)
    for angle, count in frames:
        first.add(np.full((1, 1), count, dtype=np.uint16), angle)
    shuffle.shuffle(frames)  # type: ignore[attr-defined]
    for angle, count in frames:
        second.add(np.full((1, 1), count, dtype=np.uint16), angle)
    a, b = first.averaged(), second.averaged()
    assert a.light.tobytes() == b.light.tobytes()
    assert a.series == b.series


def test_angles_that_jitter_by_an_encoder_step_are_one_setting() -> None:
    # ELL14: 143360 pulses a turn, 4.4e-5 rad each.
    averaged = filled({0.0: [10], 4.4e-5: [12], 1.0: [20], 2.0: [5]}).averaged()
    assert averaged.series.frames == (2, 1, 1)
    assert averaged.light[0, 0, 0] == 11


def test_one_saturated_frame_marks_its_pixels() -> None:
    stack = filled({angle: [1000, 1000] for angle in STANDARD})
    image = np.full((2, 3), 1000, dtype=np.uint16)
    image[1, 2] = FULL
    stack.add(image, STANDARD[2])
    averaged = stack.averaged()
    made = stokes_image(averaged.light, averaged.saturated, averaged.series)
    assert np.isnan(made.s0[1, 2])
    assert made.flags[1, 2] == Flag.SATURATED
    assert np.isfinite(made.s0[0]).all()


def test_incomplete_frames_are_left_out() -> None:
    stack = filled({angle: [100] for angle in (*STANDARD, 1.3)})
    stack.add(np.zeros((2, 3), dtype=np.uint16), STANDARD[0], incomplete=True)
    assert stack.incomplete_frames == 1
    averaged = stack.averaged()
    assert averaged.light[0, 0, 0] == 100
    assert not averaged.incomplete
    # An angle with nothing but an incomplete frame is missing, and every pixel says so.
    stack.add(np.zeros((2, 3), dtype=np.uint16), 2.0, incomplete=True)
    averaged = stack.averaged()
    assert len(averaged.series.angles_rad) == 5
    made = stokes_image(averaged.light, averaged.saturated, averaged.series, incomplete=averaged.incomplete)
    assert (made.flags & Flag.INCOMPLETE).all()
    assert np.isfinite(made.dolp).all()


def test_too_few_angles_are_refused() -> None:
    with pytest.raises(DataError, match="condition number"):
        filled({0.0: [10], math.pi / 2: [20]}).averaged()
    with pytest.raises(DataError, match="no complete frame"):
        FrameStack(saturation_counts=FULL).averaged()
    with pytest.raises(DataError, match="no complete frame"):
        filled({}, dark=[3]).averaged()


def test_frames_that_do_not_fit_are_refused() -> None:
    stack = filled({0.0: [10]})
    with pytest.raises(DataError, match="shape"):
        stack.add(np.zeros((3, 3), dtype=np.uint16), 0.0)
    for wrong in (np.zeros((2, 3)), np.zeros((2, 3), dtype=np.int16), np.zeros((2, 3, 3), dtype=np.uint8)):
        with pytest.raises(DataError, match="raw counts"):
            stack.add(wrong, 0.0)
    with pytest.raises(DataError, match="angle is nan"):
        stack.add(np.zeros((2, 3), dtype=np.uint16), math.nan)


@pytest.mark.parametrize(("black", "full"), [(100.0, 100), (-1.0, 100), (math.nan, 100)])
def test_impossible_levels_are_refused(black: float, full: int) -> None:
    with pytest.raises(DataError, match="black level"):
        FrameStack(saturation_counts=full, black_level_counts=black)
