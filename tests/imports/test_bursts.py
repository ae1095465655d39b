import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from real_data import real_data

from polfuse_lab.imports.riff import read_wav
from processing.errors import DataError
from processing.radar.bursts import find_bursts

RATE, PERIOD, RAMP = 44_100.0, 1763.3, 881.6


def sweeps(length, start, rng, *, level=0.8, share=RAMP / PERIOD):
    """(n, 2): a beat and a sync from its closed form, edges three samples long; ``start`` is its phase in samples."""
    since = np.mod(np.arange(length) - start, PERIOD)
    ramp = share * PERIOD
    rise = np.clip(np.minimum(since, PERIOD) / 3 + 0.5, 0, 1) + np.clip((since - PERIOD) / 3 + 0.5, 0, 1)
    sync = rise - np.clip((since - ramp) / 3 + 0.5, 0, 1)
    beat = 0.1 * np.cos(2 * np.pi * 13.3 * since / PERIOD)
    return np.stack([beat, level * (2 * sync - 1)], axis=1) + 0.003 * rng.normal(size=(length, 2))


def recording(bursts=6, *, hum=0.0, clicks=0, idle=0.0, level=0.8, share=RAMP / PERIOD, swapped=False, seed=0):
    """int16 samples, and the true (start, stop) of each burst."""
    rng = np.random.default_rng(seed)

    def silence():
        n = int(rng.uniform(0.4, 1.5) * RATE)
        samples = 0.002 * rng.normal(size=(n, 2))
        wave = np.sin(2 * np.pi * 50 * np.arange(n) / RATE + rng.uniform(0, 6))
        samples += wave[:, None] * (0.1 * hum, hum)
        samples[:, 1] += idle
        for _ in range(clicks):
            at, width = rng.integers(0, n - 40), rng.integers(1, 30)
            samples[at : at + width, 1] += rng.choice([-0.9, 0.9])
        return samples

    pieces, truth, at = [silence()], [], 0
    for _ in range(bursts):
        at = sum(map(len, pieces))
        length = int(rng.uniform(4, 9) * PERIOD)
        pieces.append(sweeps(length, rng.uniform(0, PERIOD), rng, level=level, share=share))
        truth.append((at, at + length))
        pieces.append(silence())
    samples = np.concatenate(pieces)
    if swapped:
        samples = samples[:, ::-1]
    return np.clip(np.round(samples * 32_768), -32_768, 32_767).astype(np.int16), truth


def check(found, truth):
    """A burst reaches from its first whole ramp to its last: at most a period is lost at either end."""
    assert len(found.bursts) == len(truth)
    for burst, (start, stop) in zip(found.bursts, truth, strict=True):
        assert start - 40 <= burst.start <= start + PERIOD + 40
        assert stop - PERIOD - 40 <= burst.stop <= stop + 40
        assert burst.interruptions == 0


@pytest.mark.parametrize(
    "kind",
    [
        {},
        {"hum": 0.5},
        {"hum": 0.9},  # louder than the sync itself
        {"clicks": 30},
        {"hum": 0.3, "clicks": 15},
        {"idle": -0.8},  # the switched-off sync rests at one of its levels
        {"idle": 0.8},
        {"level": 0.02},  # a weak sync
        {"level": 5.0},  # clipped
        {"share": 0.75},
        {"swapped": True, "hum": 0.2},
    ],
    ids=str,
)
def test_bursts_are_those_that_were_made(kind):
    samples, truth = recording(**kind)
    found = find_bursts(samples, RATE)
    check(found, truth)
    assert found.sync.channel == (0 if kind.get("swapped") else 1)
    # Edges are found to a sample, periods over several sweeps: a tenth of a sample.
    assert found.sync.period_s * RATE == pytest.approx(PERIOD, abs=0.1)
    assert found.step / 65_536 == pytest.approx(min(kind.get("level", 0.8), 1.0), rel=0.05)


@given(seed=st.integers(0, 10_000), gain=st.sampled_from([1.0, 0.37, 0.05]), offset=st.floats(-0.1, 0.1))
@settings(max_examples=15, deadline=None)
def test_gain_and_offset_of_the_sound_card_do_not_matter(seed, gain, offset):
    samples, truth = recording(3, seed=seed, clicks=2)
    check(find_bursts(samples / 32_768 * gain + offset, RATE), truth)


def test_a_nominal_period_that_is_wrong_by_half_is_no_hindrance():
    samples, truth = recording(4)
    for nominal in (0.027, 0.060):
        check(find_bursts(samples, RATE, nominal_period_s=nominal), truth)


def test_a_short_loss_of_the_sync_does_not_part_a_burst():
    samples, truth = recording(3)
    start = truth[1][0] + int(2.3 * PERIOD)
    samples[start : start + int(0.7 * PERIOD), 1] = 0
    found = find_bursts(samples, RATE)
    assert [burst.interruptions for burst in found.bursts] == [0, 1, 0]


def test_bursts_at_the_very_ends_of_a_recording():
    samples, truth = recording(3)
    cut = samples[truth[0][0] + 100 : truth[2][1] - 100]
    assert len(find_bursts(cut, RATE).bursts) == 3


@pytest.mark.parametrize(
    ("samples", "words"),
    [
        (np.zeros((90_000, 2), np.int16), "silent"),
        (np.zeros((90_000, 3), np.int16), "two channels"),
        (np.zeros(90_000, np.int16), "two channels"),
        (np.zeros((0, 2), np.int16), "empty"),
        (np.full((90_000, 2), np.nan, np.float32), "undefined"),
        (np.random.default_rng(0).integers(-9000, 9000, (90_000, 2)).astype(np.int16), "no sync"),
    ],
    ids=["silent", "three", "flat", "empty", "nan", "noise"],
)
def test_what_is_no_recording_of_a_radar_is_refused(samples, words):
    with pytest.raises(DataError, match=words):
        find_bursts(samples, RATE)


def test_hum_alone_is_no_clock():
    t = np.arange(90_000) / RATE
    for frequency in (50.0, 60.0):
        hum = np.stack([0.3 * np.sin(2 * np.pi * frequency * t), 0.8 * np.sin(2 * np.pi * frequency * t + 1)], axis=1)
        # At half the period the hum's own rhythm is within the range of periods that are looked for.
        for nominal in (0.04, 0.02):
            with pytest.raises(DataError, match="no sync"):
                find_bursts(hum, RATE, nominal_period_s=nominal)


@pytest.mark.parametrize(
    "name", ["01-Chapa_Hand-09-06-22", "23-12-Big_Truck-30mph-03-28-23-R", "23-05-20mph-Away-02-14-23-R"]
)
def test_real_recordings_are_one_burst_and_as_many_as_they_are_cut_into(name):
    wav = read_wav(real_data(f"coffee_can/{name}.wav"))
    whole = find_bursts(wav.samples, wav.sample_rate_hz)
    assert len(whole.bursts) == 1
    assert whole.bursts[0].interruptions == 0
    assert whole.bursts[0].samples > 0.99 * len(wav.samples)
    # The radar's own silence is not recorded: hum of half the beat's level stands for it.
    rng = np.random.default_rng(3)
    hum = (4000 * np.sin(2 * np.pi * 50 * np.arange(30_000) / wav.sample_rate_hz))[:, None] + rng.normal(0, 30, (1, 2))
    pieces, truth, at = [], [], 0
    for start in range(5_000, len(wav.samples) - 15_000, 20_000)[:6]:
        pieces += [hum.astype(np.int16), wav.samples[start : start + 12_000 + start % 1000]]
        truth.append((at + len(hum), at + len(hum) + len(pieces[-1])))
        at = truth[-1][1]
    found = find_bursts(np.concatenate([*pieces, hum.astype(np.int16)]), wav.sample_rate_hz)
    assert len(found.bursts) == len(truth)
    for burst, (start, stop) in zip(found.bursts, truth, strict=True):
        assert start - 40 <= burst.start < start + 2_000  # a period has up to 1,830 samples
        assert stop - 2_000 < burst.stop <= stop + 40
    assert found.sync.channel == 1  # as told of this radar
