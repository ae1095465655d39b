"""Radon transform, streaks against speckle, time-frequency distributions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from processing.errors import DataError
from processing.motion.radon import (
    RadonSettings,
    find_streaks,
    line_scores,
    radon,
    speckle_tiles,
    threshold,
    tiles_in,
)
from processing.motion.time_frequency import chirp_line, time_frequency


def test_line_sums_agree_with_scikit_image():
    from skimage.transform import radon as peer

    image = np.random.default_rng(5).random((65, 65))
    row, column = np.mgrid[-32:33, -32:33]
    image[row**2 + column**2 > 31**2] = 0
    angles = np.radians([0.0, 4.0, -7.0])
    ours = radon(image, angles)
    theirs = peer(image, theta=90 - np.degrees(angles), circle=True)[::-1]
    # The peer interpolates the turned picture, we share pixels between lines: both are linear, and err by neighbours'
    # shares.
    np.testing.assert_allclose(ours[:, 0], image.sum(axis=1), atol=1e-9)
    for k in range(3):
        assert np.corrcoef(ours[:, k], theirs[:, k])[0, 1] > 0.9999


@given(st.integers(0, 32), st.floats(-0.17, 0.17))
def test_every_pixel_counts_once_at_each_angle(row: int, angle: float) -> None:
    image = np.zeros((33, 33))
    image[row, 16] = 1.0
    total = radon(image, [angle]).sum()
    assert total == pytest.approx(1.0 if abs(row - 16) < 16 else total)
    with pytest.raises(DataError, match="square"):
        radon(np.zeros((3, 4)), [0.0])


@pytest.mark.parametrize("cell", [(1.0, 1.0), (1.5, 1.2)])
def test_speckle_raises_false_alarms_at_the_rate_that_was_set(cell):
    settings = RadonSettings(tile_px=32, angles=11, false_alarm=0.05)
    tiles = speckle_tiles(800, 32, cell, np.random.default_rng(8))
    alarms = int((np.nanmax(line_scores(tiles, settings), axis=(1, 2)) > threshold(settings, cell)).sum())
    # Counting errors of 800 tiles at 99.9 %, and a quarter for a threshold found from 600 trials.
    low, high = binom.ppf([5e-4, 1 - 5e-4], 800, 0.05)
    assert 0.75 * low <= alarms <= 1.25 * high


def test_a_streak_is_found_where_it_is_and_a_bright_point_or_road_across_is_none():
    random = np.random.default_rng(1)
    power = speckle_tiles(1, 256, (1.0, 1.0), random)[0]
    power[100, 60:110] += 3 * random.gamma(2, 0.5, 50)  # 50 pixels, 5 dB above the clutter
    power[30, 200] += 1e5  # a building
    power[:, 20] += 20  # a road across
    found = find_streaks(power)
    assert len(found) == 1
    (streak,) = found
    assert streak.row == pytest.approx(100, abs=1.5)
    assert streak.column == pytest.approx(84.5, abs=12)
    assert 30 < streak.length_px < 64
    assert abs(streak.angle_rad) < math.radians(3)
    power[90:110, 55:115] = np.nan
    assert find_streaks(power) == []
    assert tiles_in((256, 256), RadonSettings()) == 49


def test_streaks_refuse_small_pictures_and_wrong_settings():
    with pytest.raises(DataError, match="holds no tile"):
        find_streaks(np.ones((20, 100)))
    with pytest.raises(DataError, match="odd number"):
        RadonSettings(angles=4)
    with pytest.raises(DataError, match="45"):
        RadonSettings(max_angle_rad=1.0)


@pytest.mark.parametrize("width", [0, 4, 64])
def test_a_chirps_line_is_found(width):
    step, rate, start = 0.01, 4.0, -3.0
    t = start + step * np.arange(600)
    random = np.random.default_rng(2)
    chirp = np.exp(2j * np.pi * (2.0 * t + rate * t**2 / 2))
    noisy = chirp + 0.5 * (random.normal(size=600) + 1j * random.normal(size=600))
    line = chirp_line(time_frequency(noisy, step, start_s=start, width=width), max_rate_hz_s=8.0)
    # Bins of 0.78 Hz over 5.4 s; rates in steps of 0.1 Hz/s.
    assert line.rate_hz_s == pytest.approx(rate, abs=0.2)
    assert line.frequency_hz == pytest.approx(2.0, abs=0.8)
    assert line.contrast > 5


def test_the_s_method_is_sharper_than_the_spectrogram_without_cross_terms():
    step = 1 / 256
    t = step * np.arange(1024) - 2.0
    two = np.exp(2j * np.pi * (-60 * t + 15 * t**2)) + np.exp(2j * np.pi * (60 * t + 15 * t**2))
    kinds = {width: time_frequency(two, step, start_s=-2.0, width=width) for width in (0, 6, 64)}

    def at(width: int, frequency: float) -> float:
        tf = kinds[width]
        row = int(np.argmin(np.abs(tf.time_s)))
        near = np.abs(tf.frequency_hz - frequency) < 6
        return float(np.abs(tf.power[row, near]).sum() / np.abs(tf.power[row]).sum())

    # Between the two chirps the Wigner distribution has their cross term, the S-method with 6 of 32 bins has none.
    assert at(64, 0.0) > 0.2
    assert at(6, 0.0) < 0.01

    def width_of(width: int) -> float:
        tf = kinds[width]
        power = np.maximum(tf.power[int(np.argmin(np.abs(tf.time_s)))], 0)
        near = np.abs(tf.frequency_hz - 60) < 25
        middle = np.average(tf.frequency_hz[near], weights=power[near])
        return float(np.sqrt(np.average((tf.frequency_hz[near] - middle) ** 2, weights=power[near])))

    assert width_of(6) < 0.85 * width_of(0)


def test_time_frequency_refuses_what_cannot_be():
    with pytest.raises(DataError, match="even window"):
        time_frequency(np.ones(16), 0.1, window=7)
    with pytest.raises(DataError, match="defined samples"):
        time_frequency(np.full(64, np.nan), 0.1, window=8)
    with pytest.raises(DataError, match="positive limits"):
        chirp_line(time_frequency(np.ones(64), 0.1, window=8), max_rate_hz_s=0.0)
