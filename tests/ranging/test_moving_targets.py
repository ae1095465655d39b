import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_recordings import C, Point, recording

from processing.errors import DataError
from processing.radar.doppler import (
    mean_range_doppler,
    range_doppler,
    remove_background,
    two_pulse_canceller,
    unambiguous_speed_m_s,
)
from processing.radar.line_fit import breaks, robust_line
from processing.radar.ramp_direction import ramp_direction, ramp_shift
from processing.radar.ranging import compress, cut_sweeps, range_axis
from processing.radar.ridges import best_path, best_path_reference
from processing.radar.sync import find_sync, opposite
from processing.radar.tracks import TrackSettings, find_tracks, moving_level_db

RATE, CENTRE, BANDWIDTH = 48_000.0, 2.4e9, 80e6
CELL, WAVELENGTH = C / (2 * BANDWIDTH), C / CENTRE
PERIOD = 0.04
AXIS = range_axis(BANDWIDTH, 150.0, 2)
WAVEFORM = {"centre_hz": CENTRE, "bandwidth_hz": BANDWIDTH}
LIMIT = WAVELENGTH / (4 * PERIOD)


def pure_tone(speed, count=64):
    t = np.arange(count) * PERIOD
    return np.exp(-4j * np.pi * speed * t / WAVELENGTH)[:, None] * np.array([0.0, 1.0, 0.5])


def test_canceller_removes_what_stands_and_passes_speeds_by_its_formula():
    assert np.abs(two_pulse_canceller(np.ones((9, 4), dtype=complex))).max() == 0
    for speed in (0.1, 0.4, 0.7, 2 * LIMIT):
        gain = np.abs(two_pulse_canceller(pure_tone(speed))[:, 1])
        assert np.allclose(gain, 2 * abs(np.sin(2 * np.pi * speed * PERIOD / WAVELENGTH)), atol=1e-12)


def test_background_is_the_sliding_mean():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(30, 4)) + 5j
    result = remove_background(values, 7)
    assert np.allclose(result[15], values[15] - values[12:19].mean(axis=0))
    assert np.allclose(result[0], values[0] - values[:7].mean(axis=0))
    assert np.allclose(result[-1], values[-1] - values[-7:].mean(axis=0))


@pytest.mark.parametrize("speed", [-0.6, -0.2, 0.0, 0.35, 0.7])
def test_range_doppler_shows_a_receding_target_at_positive_speed(speed):
    values, speeds = range_doppler(pure_tone(speed), PERIOD, WAVELENGTH, padding=8)
    assert (np.diff(speeds) > 0).all()
    peak = np.argmax(np.abs(values[:, 1]))
    assert speeds[peak] == pytest.approx(speed, abs=LIMIT / 500)  # half a bin of 8 x 64
    assert np.abs(values[peak, 1]) == pytest.approx(1.0, abs=0.003)  # Hann at a sixteenth of a bin: 0.25 %
    power, _ = mean_range_doppler(pure_tone(speed, 200), PERIOD, WAVELENGTH)
    assert power.max() == pytest.approx(1.0, abs=0.1)  # padding 2: scalloping of a quarter bin, 0.35 dB


def test_doppler_wraps_at_a_quarter_wavelength_per_period():
    assert unambiguous_speed_m_s(WAVELENGTH, PERIOD) == pytest.approx(LIMIT)
    beyond, speeds = range_doppler(pure_tone(LIMIT * 1.2), PERIOD, WAVELENGTH, padding=8)
    assert speeds[np.argmax(np.abs(beyond[:, 1]))] == pytest.approx(-0.8 * LIMIT, abs=LIMIT / 100)


@given(st.integers(2, 24), st.integers(2, 30), st.integers(1, 5), st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_the_compiled_search_equals_its_reference(count, bins, half, seed):
    score = np.random.default_rng(seed).normal(size=(count, bins)) * 4 - 1
    speeds = np.arange(-half, half + 1) * 0.37
    fast, plain = best_path(score, speeds), best_path_reference(score, speeds)
    assert np.array_equal(fast.rows, plain.rows)
    assert np.array_equal(fast.columns, plain.columns)
    assert fast.total == plain.total


def test_the_search_finds_a_planted_path_and_its_sum():
    score = np.full((40, 60), -3.0)
    speeds = np.arange(-10, 11) * 0.1
    columns = np.round(np.arange(40) * speeds[17]).astype(int) + 10
    score[np.arange(5, 35), columns[5:35]] = 2.0
    path = best_path(score, speeds)
    assert np.array_equal(path.rows, np.arange(5, 35))
    assert np.array_equal(path.columns, columns[5:35])
    assert path.total == pytest.approx(60.0)


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_the_slopes_deviation_is_honest(rho):
    rng = np.random.default_rng(3)
    t = np.arange(80) * 0.04
    scores = []
    for _ in range(400):
        noise = rng.normal(size=80)
        for i in range(1, 80):
            noise[i] = rho * noise[i - 1] + np.sqrt(1 - rho**2) * noise[i]
        line = robust_line(t, 12.0 - 1.5 * t + 0.3 * noise)
        scores.append((line.slope + 1.5) / line.slope_sd)
    # 400 draws give the sd of the scores to 3.5 %; the correlation is estimated low from 80 points, hence the width.
    assert 0.85 < np.std(scores) < 1.25
    assert abs(np.mean(scores)) < 0.2


def test_a_line_withstands_outliers():
    t = np.arange(50) * 0.1
    position = 3.0 + 2.0 * t
    position[::7] += 40.0
    assert robust_line(t, position).slope == pytest.approx(2.0, abs=0.05)
    assert robust_line(t, 1 + 0 * t).slope == 0.0


def test_breaks_are_found_where_the_slope_changes():
    t = np.arange(100) * 0.1
    position = np.where(t < 4.0, 10 + 2 * t, 18 - 1.0 * (t - 4.0)) + 0.05 * np.random.default_rng(0).normal(size=100)
    (first, second) = breaks(t, position, sd=0.05, penalty=30.0, shortest=5)
    assert abs(first[1] - 40) <= 2
    assert (first[0], second[1]) == (0, 100)
    assert breaks(t, 3 * t, sd=0.05, penalty=30.0, shortest=5) == [(0, 100)]
    assert breaks(t[:6], t[:6], sd=1.0, penalty=1.0, shortest=5) == [(0, 6)]


def tracked(points, *, seconds=4.0, noise=0.01, **options):
    samples, _, _ = recording(points, seconds=seconds, noise=noise, **options)
    sync = find_sync(samples, RATE, polarity="low" if options.get("inverted") else "auto")
    pictures, times = [], []
    for clock in (sync, opposite(sync)):
        sweeps = cut_sweeps(samples, clock)
        pictures.append(compress(sweeps, AXIS, **WAVEFORM))
        times.append(sweeps.start_s + sweeps.ramp_s / 2)
    tracks = find_tracks(pictures[0], times[0], AXIS, wavelength_m=WAVELENGTH, resolution_m=CELL)
    return tracks, pictures, times


# Shift of the up-ramp's range by Doppler: v f_c T / B, T = 960.25 samples.
COUPLING_S = CENTRE * 960.25 / RATE / BANDWIDTH


@pytest.mark.parametrize(
    ("start", "speed", "seconds"), [(90.0, -13.4, 4.0), (25.0, 8.9, 4.0), (18.0, 1.2, 10.0), (60.0, -3.6, 4.0)]
)
def test_range_speed_and_doppler_of_a_moving_target(start, speed, seconds):
    still = [Point(15.0, amplitude=0.1), Point(47.0, amplitude=0.05)]
    tracks, pictures, times = tracked([*still, Point(start, speed, amplitude=0.004)], seconds=seconds)
    track = tracks[0]
    assert track.speed_m_s == pytest.approx(speed, abs=max(4 * track.speed_sd_m_s, 0.05))
    assert track.speed_sd_m_s < 0.25
    # The phase of 90 sweeps gives the rate to some mm/s; its alias is the one next to the slope.
    assert track.doppler_m_s == pytest.approx(speed, abs=0.05)
    up = start + speed * track.t0_s + speed * COUPLING_S
    assert track.r0_m == pytest.approx(up, abs=0.5 * CELL)
    levels = [moving_level_db(picture, PERIOD) for picture in pictures]
    shift = ramp_shift(track, *levels, *times, AXIS, CELL)
    # Up- minus down-ramp: 2 v f_c T / B, to a quarter cell.
    assert shift.shift_m == pytest.approx(2 * speed * COUPLING_S, abs=0.3 * CELL)
    assert shift.speed_m_s(960.25 / RATE, BANDWIDTH, CENTRE) == pytest.approx(speed, abs=0.5)


def test_two_targets_that_cross_are_two():
    tracks, _, _ = tracked([Point(20.0, 6.0, 0.01), Point(80.0, -8.0, 0.01)], seconds=5.0)
    # Where they cross a track may break, and pieces are shorter; none goes astray.
    assert all(min(abs(track.speed_m_s - 6), abs(track.speed_m_s + 8)) < 1.0 for track in tracks)
    for speed in (6, -8):
        assert any(abs(t.speed_m_s - speed) < 0.3 and t.t1_s - t.t0_s > 1.5 for t in tracks)


@pytest.mark.parametrize("seed", range(6))
def test_noise_makes_no_tracks(seed):
    assert tracked([Point(15.0, amplitude=0.1)], noise=0.02, seed=seed, seconds=6.0)[0] == []


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("speed", [-6.0, 5.0])
def test_motion_tells_which_level_is_the_up_ramp(inverted, speed):
    samples, _, _ = recording([Point(60.0, speed, 0.01), Point(15.0)], seconds=4.0, noise=0.01, inverted=inverted)
    for guess in ("high", "low"):
        told = ramp_direction(samples, find_sync(samples, RATE, polarity=guess))
        assert (told.inverted, told.polarity_from) == (inverted, "motion")


def test_a_still_scene_does_not_tell_the_polarity():
    samples, _, _ = recording([Point(30.0), Point(15.0)], seconds=2.0, noise=0.01)
    assert ramp_direction(samples, find_sync(samples, RATE)) is None


def test_impossible_requests_are_refused():
    few = np.ones((5, 20), dtype=complex)
    axis = np.arange(20.0)
    with pytest.raises(DataError, match="too few"):
        find_tracks(few, np.arange(5) * 0.04, axis, wavelength_m=0.1, resolution_m=1.0)
    with pytest.raises(DataError, match="shape"):
        find_tracks(few, np.arange(6) * 0.04, axis, wavelength_m=0.1, resolution_m=1.0)
    with pytest.raises(DataError, match="undefined"):
        find_tracks(
            np.full((20, 20), np.nan + 0j), np.arange(20) * 0.04, axis, wavelength_m=0.1, resolution_m=1.0,
            settings=TrackSettings(),
        )  # fmt: skip
    for call in (two_pulse_canceller, lambda p: remove_background(p, 4), lambda p: range_doppler(p, 0.04, 0.1)):
        with pytest.raises(DataError, match="no movement"):
            call(few[:1])
    with pytest.raises(DataError, match="at least two"):
        remove_background(few, 1)
