"""The beat voltage and the antenna pattern against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.radar.antenna import boresight, one_way_gain
from processing.radar.beat import TriangleFm, beat, beat_of_ranges, beat_reference, sync
from processing.radar.beat_kernel import beat_along_track
from processing.radar.profiles import SPEED_OF_LIGHT_M_S

SWEEP = TriangleFm(2.4e9, 80e6, 0.020, 1920.5 / 48_000)


def test_a_point_on_the_up_ramp_has_the_closed_form_of_the_signal_model() -> None:
    t = np.arange(960) / 48_000
    frequency, slope = SWEEP.frequency(t)
    distance, scattering = 9.0, 2.0 - 1.5j
    found = beat(frequency, slope, (0, 0, 0), [(0, distance, 0)], [scattering])
    # Common signal model: conj(M)/R^2 exp(j(2 pi tau (fc + K t) - pi K tau^2)), t from the ramp's centre.
    tau, rate = 2 * distance / SPEED_OF_LIGHT_M_S, 80e6 / 0.020
    phase = 2 * np.pi * tau * (2.4e9 + rate * (t - 0.010)) - np.pi * rate * tau**2
    expected = (np.conj(scattering) / distance**2 * np.exp(1j * phase)).real
    # Phases of 900 rad in float64 are exact to 1e-13; their difference from the definition stays below 1e-11.
    np.testing.assert_allclose(found, expected, atol=1e-12)


@given(
    st.floats(0, 0.999),
    st.lists(
        st.tuples(st.floats(-5, 5), st.floats(3, 30), st.floats(-2, 0), st.floats(-9, 9), st.floats(-9, 9)),
        min_size=1,
        max_size=4,
    ),
)
def test_beat_equals_the_difference_of_transmitted_phases(part: float, points: list[tuple[float, ...]]) -> None:
    t = part * SWEEP.period_s
    centres = [(x, y, z) for x, y, z, _, _ in points]
    amplitudes = [complex(re, im) for *_, re, im in points]
    frequency, slope = SWEEP.frequency([t])
    found = beat(frequency, slope, (0.3, 0.0, 0.0), centres, amplitudes)[0]
    expected = beat_reference(SWEEP, t, (0.3, 0.0, 0.0), centres, amplitudes)
    # The reference subtracts two phases of up to 3e8 rad: 3e8 * 2^-53 * 2 = 7e-8 rad, times the sum of amplitudes.
    scale = sum(abs(a) / math.dist((0.3, 0, 0), c) ** 2 for a, c in zip(amplitudes, centres, strict=True))
    assert found == pytest.approx(expected, abs=3e-7 * scale + 1e-15)


def test_a_moving_antenna_equals_sample_by_sample_positions() -> None:
    t = np.arange(50) / 48_000
    antenna = np.stack([np.linspace(0, 0.01, 50), np.zeros(50), np.zeros(50)], axis=1)
    frequency, slope = SWEEP.frequency(t)
    centres, amplitudes = [(1.0, 8.0, -1.0), (-2.0, 12.0, -1.0)], [3 + 1j, -2j]
    whole = beat(frequency, slope, antenna, centres, amplitudes)
    single = [beat(frequency[i : i + 1], slope[i : i + 1], antenna[i], centres, amplitudes)[0] for i in range(len(t))]
    np.testing.assert_array_equal(whole, single)


@given(seed=st.integers(0, 10_000), delay_m=st.floats(0, 5))
@settings(max_examples=50, deadline=None)
def test_the_compiled_beat_of_a_moving_antenna_is_the_reference(seed: int, delay_m: float) -> None:
    # Two ways of summing the same closed form; the kernel's sine misses by 6e-12 of each amplitude, and 300 turns in
    # float64 are known to 4e-14 turns.
    random = np.random.default_rng(seed)
    frequency, slope = random.uniform(2.36e9, 2.44e9, 500), random.choice([-4e9, 4e9], 500)
    antenna = np.column_stack([np.linspace(-1, 1, 500), np.zeros((500, 2))])
    centres = random.uniform([-8, 3, -2], [8, 20, 1], (40, 3))
    amplitudes = random.normal(size=40) + 1j * random.normal(size=40)
    ranges = np.linalg.norm(antenna[:, None] - centres, axis=-1)
    reference = beat_of_ranges(frequency, slope, ranges + delay_m, amplitudes / ranges**2)
    compiled = beat_along_track(frequency, slope, antenna, centres, amplitudes, delay_m=delay_m)
    np.testing.assert_allclose(compiled, reference, atol=1e-10 * np.abs(amplitudes / ranges**2).sum(axis=1).max())


def test_the_compiled_beat_refuses_what_does_not_fit() -> None:
    good = {"frequency_hz": [2.4e9], "slope_hz_s": [4e9], "antenna_m": [[0, 0, 0]], "centres_m": [[0, 5, 0]]}
    with pytest.raises(DataError, match="do not fit"):
        beat_along_track(**good, amplitudes=[1.0, 2.0])
    with pytest.raises(DataError, match="stands at the antenna"):
        beat_along_track(**good | {"centres_m": [[0, 0, 0]]}, amplitudes=[1.0])


def test_the_down_ramp_mirrors_the_up_ramp() -> None:
    sweep = TriangleFm(2.4e9, 80e6, 0.02, 0.04)
    t = np.linspace(1e-4, 0.0199, 200)
    up, slope_up = sweep.frequency(t)
    down, slope_down = sweep.frequency(0.04 - t)
    np.testing.assert_allclose(up, down, rtol=1e-12)
    np.testing.assert_array_equal(slope_up, -slope_down)
    # Same frequency and opposite slope: only the residual video phase changes sign; at 3 m (tau = 2e-8 s) it is
    # pi K tau^2 = pi 4e9 4e-16 = 5.0e-6 rad, so the difference is at most 1.01e-5.
    np.testing.assert_allclose(
        beat_of_ranges(up, slope_up, [3.0], [1.0]), beat_of_ranges(down, slope_down, [3.0], [1.0]), atol=1.02e-5
    )


@given(st.floats(0.0, 1.0), st.sampled_from([960.0, 959.6, 961.3]))
def test_sync_crossings_are_found_exactly_by_linear_interpolation(offset: float, ramp_samples: float) -> None:
    rate = 48_000
    sweep = TriangleFm(2.4e9, 80e6, ramp_samples / rate, 1920.5 / rate)
    n = np.arange(4000)
    wave = sync(sweep, np.mod((n + offset) / rate, sweep.period_s), 3 / rate)
    at = np.flatnonzero((wave[:-1] < 0) & (wave[1:] >= 0))
    rising = at - wave[at] / (wave[at + 1] - wave[at])
    # Ramps start at whole multiples of the period; sample n is at (n + offset) samples.
    expected = np.array([k * 1920.5 - offset for k in (0, 1, 2)])
    expected = expected[(expected > 0) & (expected < 3999)]
    np.testing.assert_allclose(rising, expected, atol=1e-6)
    at = np.flatnonzero((wave[:-1] >= 0) & (wave[1:] < 0))
    falling = at - wave[at] / (wave[at + 1] - wave[at])
    np.testing.assert_allclose(falling, [ramp_samples - offset, 1920.5 + ramp_samples - offset], atol=1e-6)


def test_antenna_pattern() -> None:
    width = math.radians(70)
    # Definition of the half-power beamwidth; nothing behind; on the axis 1.
    assert one_way_gain(math.cos(width / 2), width) == pytest.approx(0.5, rel=1e-14)
    assert one_way_gain([1.0, 0.0, -0.3], width).tolist() == [1.0, 0.0, 0.0]
    assert np.isnan(one_way_gain(math.nan, width))
    # A half-power beamwidth of 120 degrees is cos^1: cos(60 deg) = 1/2.
    assert one_way_gain(0.3, math.radians(120)) == pytest.approx(0.3, rel=1e-12)
    np.testing.assert_allclose(boresight(math.radians(30)), [0, math.sqrt(3) / 2, -0.5])


@pytest.mark.parametrize("width", [0.0, -1.0, math.pi, math.nan])
def test_no_pattern_for_impossible_beamwidths(width: float) -> None:
    with pytest.raises(DataError, match="beamwidth"):
        one_way_gain(1.0, width)


def test_bad_input_is_refused() -> None:
    with pytest.raises(DataError, match="no triangle"):
        TriangleFm(2.4e9, 80e6, 0.04, 0.04)
    with pytest.raises(DataError, match="at the antenna"):
        beat([2.4e9], [4e9], (0, 0, 0), [(0, 0, 0)], [1])
    with pytest.raises(DataError, match="one row for each sample"):
        beat([2.4e9, 2.4e9], [4e9, 4e9], np.zeros((3, 3)), [(0, 5, 0)], [1])
    with pytest.raises(DataError, match="sync edges"):
        sync(SWEEP, [0.0], 0.03)
