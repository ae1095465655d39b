"""Echoes of moving points, what motion does to the picture, and pictures focused for what moves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from processing.errors import DataError
from processing.motion.path import Path, echoes_along
from processing.motion.prediction import Passage, ambiguities, appearance, velocity_from_picture
from processing.motion.refocus import refocus, seen_from
from processing.motion.simulation import (
    Collect,
    MovingPoint,
    ground_clutter,
    history_of,
    moving_history,
    ranges_m,
    strip_collect,
)
from processing.radar.beat import beat_of_ranges
from processing.radar.phase_history import history_profiles
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid

SLANT = 15_000 * math.sqrt(2)
# Table 8.1 with a narrower band and beam: the geometry is the thesis's, the test is quick. 3 degrees are seen for 4.6
# s.
STRIP = strip_collect(seconds=8.0, bandwidth_hz=20e6, beamwidth_rad=math.radians(3.0))
SEEN_S = 2 * SLANT * math.tan(math.radians(1.5)) / 240.0
PASSAGE = Passage(240.0, SLANT, STRIP.wavelength_m, SEEN_S, 362.53)


def profiles_of(point: MovingPoint, collect: Collect = STRIP):
    return history_profiles(moving_history([point], collect), oversampling=2)


def test_echoes_are_those_of_the_beat_simulator_on_a_rail():
    rail = np.stack([np.linspace(-1.5, 1.5, 61), np.zeros(61), np.zeros(61)], axis=1)
    collect = Collect(rail, np.arange(61) * 2.0, 2.36e9, 2e6, 40, 6.0)
    point = MovingPoint((0.3, 5.0, -1.0), (0.02, -0.01, 0.0), (0.0, 1e-4, 0.0), amplitude=0.7 * np.exp(0.4j))
    history = moving_history([point], collect)
    counted = np.exp(2j * np.pi * 2 * 6.0 / SPEED_OF_LIGHT_M_S * collect.frequency_hz)
    for pulse in (0, 17, 60):
        # Written out: uniformly accelerated motion from the place at time 0.
        t = 2.0 * pulse
        place = np.array([0.3 + 0.02 * t, 5.0 - 0.01 * t + 0.5e-4 * t**2, -1.0])
        distance = float(np.linalg.norm(place - rail[pulse]))
        # Beat of the radar (its slope tends to 0: the residual video phase goes): real part of the conjugate echo.
        voltage = beat_of_ranges(collect.frequency_hz, np.zeros(40), [distance], [0.7 * np.exp(0.4j)])
        echo = history.echoes[0, pulse] * np.conj(counted)
        np.testing.assert_allclose(np.conj(echo).real, voltage, atol=3e-6)  # complex64


def brightest(image: np.ndarray, grid: ImageGrid) -> tuple[float, float, float]:
    row, column = np.unravel_index(int(np.argmax(np.abs(image))), image.shape)
    return float(grid.x_m[column]), float(grid.y_m[row]), float(np.abs(image[row, column]))


@pytest.mark.parametrize("slant_m_s", [-6.0, 9.0])
def test_a_target_that_moves_in_range_is_shifted_along_the_track(slant_m_s):
    point = MovingPoint((0.0, 15_000.0, -15_000.0), (0.0, slant_m_s * math.sqrt(2), 0.0))
    shift = appearance(PASSAGE, 0.0, slant_m_s).shift_m
    # Thesis 8.1 as in the equations: 88.4 m for each m/s.
    assert shift == pytest.approx(-88.39 * slant_m_s, rel=1e-3)
    # The shifted place has the same squared range: x^2 + y^2 + z^2 = R^2.
    y = math.sqrt(SLANT**2 - shift**2 - 15_000.0**2)
    grid = ImageGrid(np.arange(shift - 30, shift + 31, 1.0), np.arange(y - 20, y + 21, 2.0), -15_000.0)
    x_seen, y_seen, _ = brightest(backproject(profiles_of(point), grid)[0], grid)
    # Pixels of 1 and 2 m; the defocus by v_r^2 / V^2 moves nothing.
    assert x_seen == pytest.approx(shift, abs=1.5)
    assert y_seen == pytest.approx(y, abs=3.0)


@pytest.mark.parametrize("azimuth_m_s", [-6.0, 4.0, 8.0])
def test_a_target_that_moves_along_the_track_is_smeared(azimuth_m_s):
    point = MovingPoint((0.0, 15_000.0, -15_000.0), (azimuth_m_s, 0.0, 0.0))
    grid = ImageGrid(np.arange(-120.0, 121.0, 0.5), np.array([15_000.0]), -15_000.0)
    power = np.abs(backproject(profiles_of(point), grid)[0, 0]) ** 2
    predicted = appearance(PASSAGE, azimuth_m_s, 0.0).smear_m
    assert predicted == pytest.approx(2 * abs(azimuth_m_s) * SEEN_S, rel=0.02)
    # By stationary phase the streak's profile is the pattern laid over it, whose one-way half-power width is the time
    # seen: the two-way power is a quarter there. Fresnel ripples are smoothed over a fifth of the streak.
    width = max(int(0.2 * predicted / 0.5), 1)
    smooth = np.convolve(power, np.ones(width) / width, mode="same")
    above = grid.x_m[smooth > 0.25 * smooth.max()]
    assert above.max() - above.min() == pytest.approx(predicted, rel=0.1)


def test_acceleration_in_range_smears_like_speed_along_the_track():
    equivalent = ambiguities(PASSAGE).azimuth_per_acceleration_s
    assert equivalent == pytest.approx(SLANT / 480.0)
    speed = 5.0
    # (V - v)^2 = V^2 + R a
    slant = ((240 - speed) ** 2 - 240.0**2) / SLANT
    assert -slant * equivalent == pytest.approx(speed, rel=0.02)
    moves = moving_history([MovingPoint((0, 15e3, -15e3), (speed, 0, 0))], STRIP)
    speeds_up = moving_history([MovingPoint((0, 15e3, -15e3), acceleration_m_s2=(0, slant * math.sqrt(2), 0))], STRIP)
    # The ranges differ by third and higher orders only: millimetres.
    likeness = np.vdot(moves.echoes, speeds_up.echoes) / np.linalg.norm(moves.echoes) / np.linalg.norm(speeds_up.echoes)
    assert abs(likeness) > 0.995


def test_refocusing_is_the_picture_of_a_standing_target():
    velocity = (7.0, 11.0, 0.0)
    grid = ImageGrid(np.arange(-12.0, 12.5, 0.5), np.arange(14_970.0, 15_031.0, 2.0), -15_000.0)
    place = (2.0, 15_000.0, -15_000.0)
    isotropic = Collect(
        STRIP.antenna_m[::2], STRIP.time_s[::2], STRIP.first_hz, STRIP.step_hz, STRIP.frequencies, STRIP.reference_m
    )
    moving = refocus(profiles_of(MovingPoint(place, velocity), isotropic), grid, velocity, isotropic.time_s)[0]
    x, y, level = brightest(moving, grid)
    assert (x, y) == (2.0, 15_000.0)
    # All pulses add up: a point of amplitude 1 is 1; interpolation by eight taps misses by 1e-5 and complex64 rounds.
    assert level == pytest.approx(1.0, abs=2e-4)
    still = backproject(profiles_of(MovingPoint(place, velocity), isotropic), grid)[0]
    assert np.abs(still).max() < 0.2


def test_seen_from_refuses_what_does_not_fit():
    profiles = profiles_of(MovingPoint((0, 15e3, -15e3)))
    with pytest.raises(DataError, match="one time for each"):
        seen_from(profiles, (1.0, 0.0, 0.0), STRIP.time_s[:-1])
    with pytest.raises(DataError, match="vx, vy, vz"):
        seen_from(profiles, (1.0, 0.0), STRIP.time_s)


def test_echoes_along_a_targets_own_path_are_steady():
    point = MovingPoint((40.0, 15_010.0, -15_000.0), (6.0, 0.0, 0.0))
    path = Path(40.0, 15_010.0, -15_000.0, 6.0)
    np.testing.assert_allclose(path.ranges_m(STRIP.antenna_m, STRIP.time_s), ranges_m(point, STRIP), rtol=1e-14)
    echoes = echoes_along(profiles_of(point), ranges_m(point, STRIP))
    assert np.abs(np.angle(echoes)).max() < 2e-3  # complex64 profiles
    step = 1e-3
    slopes = path.slopes(STRIP.antenna_m, STRIP.time_s)
    for k, (dx, dv) in enumerate([(step, 0.0), (0.0, step)]):
        ends = [path.moved(s * dx, s * dv).ranges_m(STRIP.antenna_m, STRIP.time_s) for s in (1, -1)]
        np.testing.assert_allclose(slopes[k], (ends[0] - ends[1]) / (2 * step), atol=1e-7)


def test_ambiguities_of_the_thesis_collect():
    told = ambiguities(Passage(240.0, SLANT, 0.2384, 6.95, 362.53))
    # Equations of chapter 8: 21.6 m/s, and the place repeats every 3820 m.
    assert told.unambiguous_m_s == pytest.approx(21.6, abs=0.01)
    assert told.alias_m_s * SLANT / 240.0 == pytest.approx(3820, rel=1e-3)
    folded = appearance(Passage(240.0, SLANT, 0.2384, 6.95, 362.53), 0.0, 25.0)
    assert folded.ghost_shift_m == pytest.approx(-25.0 * SLANT / 240.0 + 3820, abs=5)


def test_shift_and_smear_tell_the_velocity():
    seen = appearance(PASSAGE, 3.0, -7.0)
    along, across = velocity_from_picture(PASSAGE, seen.shift_m, seen.smear_m)
    assert across == pytest.approx(-7.0)
    # The closed form is of first order in v / V, and takes v_r^2 / V for speed along the track.
    assert along == pytest.approx(3.0 - (3.0**2 + 7.0**2) / 480.0, rel=1e-6)
    with pytest.raises(DataError, match="positive"):
        Passage(0.0, 1.0, 1.0, 1.0, 1.0)


def test_clutter_is_that_of_many_scatterers_under_the_beam():
    # Peer: scatterers spread evenly over swath and track, each with its own echoes.
    random = np.random.default_rng(3)
    collect = strip_collect(seconds=6.0, bandwidth_hz=2e6, swath_m=600.0, beamwidth_rad=math.radians(3.0))
    slant = collect.reference_m + random.uniform(-300, 300, 300)
    x = random.uniform(-2500, 2500, 300)
    points = [
        MovingPoint((float(a), math.sqrt(r**2 - 15e3**2), -15e3), amplitude=complex(*random.normal(size=2)))
        for a, r in zip(x, slant, strict=True)
    ]
    peer = moving_history(points, collect).echoes[0]
    ours = ground_clutter(collect, float(np.mean(np.abs(peer) ** 2)), random)

    def doppler_width(echoes: np.ndarray) -> float:
        power = np.mean(np.abs(np.fft.fft(echoes, axis=0)) ** 2, axis=1)
        frequency = np.fft.fftfreq(len(echoes), 1 / 362.53)
        return float(np.sqrt(np.sum(power * frequency**2) / power.sum()))

    # 300 scatterers of exponentially distributed power: the width scatters by some 5 %.
    assert doppler_width(ours) == pytest.approx(doppler_width(peer), rel=0.15)
    assert np.mean(np.abs(ours) ** 2) == pytest.approx(np.mean(np.abs(peer) ** 2), rel=0.2)
    alike = np.abs(np.mean(ours[:, 0] * np.conj(ours[:, 1]))) / np.mean(np.abs(ours) ** 2)
    assert alike < 0.15  # frequencies are independent
    with pytest.raises(DataError, match="beam"):
        ground_clutter(Collect(STRIP.antenna_m, STRIP.time_s, 1e9, 1e6, 4, 2e4), 1.0, random)
    assert history_of(ours, collect).channels == ("HH",)


def test_a_collect_refuses_what_cannot_be():
    with pytest.raises(DataError, match="increasing times"):
        Collect(np.zeros((3, 3)), np.zeros(3), 1e9, 1e6, 4, 10.0)
    with pytest.raises(DataError, match="two frequencies"):
        Collect(np.zeros((3, 3)), np.arange(3.0), 1e9, 1e6, 1, 10.0)
