import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_recordings import Point, recording

from processing.errors import DataError
from processing.radar.sync import find_sync, opposite

RATE = 48_000.0
POINTS = [Point(20.0), Point(41.0, amplitude=0.05j)]


def whole(starts, ends, count):
    """True whole up-ramps whose levels can be measured (24 samples beside the edges)."""
    inside = (starts > 24) & (ends < count - 24)
    return starts[inside], ends[inside]


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.float32, np.float64])
def test_edges_are_found_to_the_fraction_of_a_sample_on_either_channel(swapped, dtype):
    samples, starts, ends = recording(POINTS, swapped=swapped, dtype=dtype)
    sync = find_sync(samples, RATE)
    starts, ends = whole(starts, ends, len(samples))
    assert sync.channel == (0 if swapped else 1)
    assert sync.beat_channel == 1 - sync.channel
    # A linear edge of 3 samples is interpolated exactly; int16 rounds by 1/52,000 of it, instants by 2^-17.
    assert np.abs(sync.starts - starts).max() < 2e-4
    assert np.abs(sync.ends - ends).max() < 2e-4
    assert abs(sync.period_samples - 1920.5) < 2e-4
    assert abs(sync.ramp_samples - 960.25) < 2e-4


def test_clipped_and_ringing_sync_with_offset_is_measured():
    samples, starts, ends = recording(POINTS, sync_level=0.8)
    n = np.arange(len(samples))
    samples[:, 1] = np.clip(3 * samples[:, 1] + 0.4 * np.cos(np.pi * n / 2) + 0.05, -1.0, 1.0)
    sync = find_sync(samples, RATE)
    starts, _ = whole(starts, ends, len(samples))
    # The ringing of 0.4 on a slope of 1.6 per sample moves a crossing by at most a quarter of a sample.
    assert len(sync.starts) == len(starts)
    assert np.abs(sync.starts - starts).max() < 0.3
    assert sync.clipped_fraction > 0.9


def test_noise_on_the_sync_moves_edges_by_no_more_than_its_slope_allows():
    samples, starts, ends = recording(POINTS, sync_noise=0.08, seconds=2.0)
    sync = find_sync(samples, RATE)
    starts, _ = whole(starts, ends, len(samples))
    assert len(sync.starts) == len(starts)
    # Slope 1.6 / 3 per sample: two samples of noise 0.08 around the crossing give at most 0.15 samples sd.
    assert (sync.starts - starts).std() < 0.15
    assert abs(sync.period_samples - 1920.5) < 0.1


def test_jitter_is_measured():
    samples, _, _ = recording(POINTS, jitter=0.2, seconds=8.0)
    sync = find_sync(samples, RATE)
    # Periods are differences of two starts: sd 0.2 sqrt(2); 200 periods give the robust sd to 10 % (1 sd).
    assert sync.jitter_samples == pytest.approx(0.2 * np.sqrt(2), rel=0.35)


def test_glitches_do_not_make_edges():
    samples, starts, ends = recording(POINTS)
    rng = np.random.default_rng(5)
    for at in rng.integers(0, len(samples) - 8, size=30):
        samples[at : at + 4, 1] *= -1
    sync = find_sync(samples, RATE)
    assert abs(sync.period_samples - 1920.5) < 0.5
    assert len(sync.starts) >= len(whole(starts, ends, len(samples))[0]) - 6


def test_a_gap_in_the_recording_costs_only_the_sweeps_it_touches():
    samples, starts, ends = recording(POINTS, seconds=1.0)
    cut = np.concatenate([samples[:20_000], samples[20_700:]])
    sync = find_sync(cut, RATE)
    assert abs(sync.period_samples - 1920.5) < 2e-4
    assert np.abs(sync.ends - sync.starts - 960.25).max() < 0.6 * 192  # the cut sweep is not a ramp any more
    assert len(whole(starts, ends, len(samples))[0]) - len(sync.starts) <= 2


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize(("ramp", "told"), [(1300.0, None), (1300.0, 1300 / RATE), (600.0, 600 / RATE)])
def test_unequal_durations_tell_the_polarity(inverted, ramp, told):
    # Without being told, the longer level is the up-ramp; told its length, the level that fits.
    samples, starts, ends = recording(POINTS, ramp=ramp, inverted=inverted)
    sync = find_sync(samples, RATE, ramp_up_s=told)
    assert sync.inverted is inverted
    assert sync.polarity_from == "duration"
    assert np.abs(sync.starts - whole(starts, ends, len(samples))[0]).max() < 2e-4


def test_equal_durations_leave_a_convention_and_a_choice():
    samples, starts, ends = recording(POINTS, inverted=True)
    assert (find_sync(samples, RATE).inverted, find_sync(samples, RATE).polarity_from) == (False, "convention")
    sync = find_sync(samples, RATE, polarity="low")
    assert (sync.inverted, sync.polarity_from) == (True, "given")
    assert np.abs(sync.starts - whole(starts, ends, len(samples))[0]).max() < 2e-4


def test_the_opposite_ramps_fill_the_rest_of_the_period():
    samples, _, ends = recording(POINTS)
    sync = find_sync(samples, RATE)
    other = opposite(sync)
    assert other.inverted
    assert np.abs(other.starts - ends[(ends > sync.starts[0]) & (ends < sync.edges[-1])]).max() < 2e-4
    assert abs(other.ramp_samples - 960.25) < 2e-4


@settings(max_examples=25, deadline=None)
@given(st.integers(min_value=0, max_value=3000))
def test_the_same_sweep_gives_the_same_numbers_wherever_the_recording_begins(cut):
    samples, _, _ = recording(POINTS, sync_noise=0.02, dtype=np.int16)
    all_sweeps, later = find_sync(samples, RATE), find_sync(samples[cut:], RATE)
    known = dict(zip(all_sweeps.starts.tolist(), all_sweeps.ends.tolist(), strict=True))
    assert len(later.starts) >= len(all_sweeps.starts) - 2
    for start, end in zip(later.starts, later.ends, strict=True):
        assert known[start + cut] == end + cut  # exactly: instants are multiples of 2^-16


@pytest.mark.parametrize("start", [5.0, 700.0, 1500.0])
def test_two_whole_ramps_are_enough(start):
    samples, _, _ = recording(POINTS, seconds=3.06 * 1920.5 / RATE, start=start)
    sync = find_sync(samples, RATE)
    assert len(sync.starts) >= 2
    assert abs(sync.period_samples - 1920.5) < 2e-4


def refusal(samples, **options):
    with pytest.raises(DataError) as caught:
        find_sync(samples, RATE, **options)
    return caught.value.what


def test_each_refusal_has_its_own_reason():
    rng = np.random.default_rng(0)
    good, _, _ = recording(POINTS)
    tone = np.sin(2 * np.pi * np.arange(24_000) / 1920)
    assert "not two channels" in refusal(good[:, :1])
    assert "empty" in refusal(good[:0])
    assert "undefined" in refusal(np.where(np.arange(24_000)[:, None] == 7, np.nan, good))
    assert "both channels are silent" in refusal(np.full((24_000, 2), 3, dtype=np.int16))
    assert "channel 0 is silent" in refusal(good * [0.0, 1.0])
    assert "identical" in refusal(good[:, [1, 1]])
    assert "mirror" in refusal(good[:, [1, 1]] * [-1, 1])
    assert "too short" in refusal(good[:2500])
    assert "no sync" in refusal(rng.normal(size=(24_000, 2)))
    assert "no sync" in refusal(np.stack([tone, 0.3 * rng.normal(size=24_000)], axis=1))  # periodic, but no levels
    assert "no sync" in refusal(good, nominal_period_s=0.4e-3 * 40)  # a sync of another radar
    assert "not both positive" in refusal(good, nominal_period_s=0.0)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 9000), st.sampled_from([np.int16, np.float32]), st.floats(0, 1e4))
def test_noise_is_never_a_sync(seed, count, dtype, scale):
    rng = np.random.default_rng(seed)
    samples = (scale * rng.normal(size=(count, 2))).clip(-32_768, 32_767).astype(dtype)
    with pytest.raises(DataError):
        find_sync(samples, RATE)
