"""Real recordings (see the field notes with them): expectations are what their makers' names and notes say."""

import numpy as np
import pytest
from real_data import real_data
from scipy.io import wavfile

from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports import import_wav
from polfuse_lab.imports.riff import read_wav
from polfuse_lab.products.ranging_time import range_time
from processing.radar.ramp_direction import ramp_direction
from processing.radar.sync import find_sync

HAND = "coffee_can/01-Chapa_Hand-09-06-22.wav"
CAR = "coffee_can/23-05-20mph-Away-02-14-23-R.wav"
TRUCK = "coffee_can/23-12-Big_Truck-30mph-03-28-23-R.wav"
WALKERS = "coffee_can/43-4522-Big_Can-1-R.wav"


@pytest.mark.parametrize("name", [HAND, CAR, TRUCK, WALKERS])
def test_the_sync_is_found_and_measured(name):
    wav = read_wav(real_data(name))
    sync = find_sync(wav.samples, wav.sample_rate_hz)
    # Measured independently by whoever wrote the notes: channel 1, periods 37.8 to 41.4 ms, 65 % clipped, 0.2 sample.
    assert sync.channel == 1
    assert 37.8e-3 < sync.period_s < 41.4e-3
    assert sync.jitter_samples < 0.4
    assert 0.5 < sync.clipped_fraction < 0.8
    assert len(sync.starts) >= int(len(wav.samples) / sync.period_samples) - 2
    # Zero crossings of the raw channel, without any of our code.
    raw = wav.samples[:, 1].astype(float)
    crossings = np.flatnonzero((raw[:-1] < 0) & (raw[1:] >= 0))
    assert sync.period_samples == pytest.approx(np.median(np.diff(crossings)), abs=1.0)
    swapped = find_sync(wav.samples[:, ::-1], wav.sample_rate_hz)
    assert swapped.channel == 0
    assert np.array_equal(swapped.starts, sync.starts)


@pytest.mark.parametrize("name", [CAR, TRUCK, WALKERS])
def test_motion_tells_the_polarity_of_the_sync_as_recorded_and_negated(name):
    wav = read_wav(real_data(name))
    negated = np.stack([wav.samples[:, 0], -np.clip(wav.samples[:, 1], -32_767, None)], axis=1)
    for samples, inverted in ((wav.samples, False), (negated, True)):
        told = ramp_direction(samples, find_sync(samples, wav.sample_rate_hz))
        assert (told.inverted, told.polarity_from) == (inverted, "motion")


def imported(tmp_path, name):
    return import_wav([real_data(name)], tmp_path / "s.h5").session


def test_the_truck_approaches(tmp_path):
    target = range_time(imported(tmp_path, TRUCK)).targets[0]
    assert target.track.speed_m_s < -10
    assert target.track.speed_sd_m_s < 1
    assert target.r1_m < target.r0_m - 40
    assert target.track.t1_s - target.track.t0_s > 2.5
    assert target.ramp_speed_m_s < -5  # known without the bandwidth: it comes nearer, at a lorry's speed


def test_the_car_leaves(tmp_path):
    (target, *_) = range_time(imported(tmp_path, CAR)).targets
    assert target.track.speed_m_s > 5
    assert target.r1_m > target.r0_m + 8
    # "20 mph" is 8.94 m/s: the shift between up- and down-ramp tells it whatever the bandwidth was.
    assert target.ramp_speed_m_s == pytest.approx(8.94, abs=1.5)


def test_people_walk_away_and_back(tmp_path):
    tracks = [target.track for target in range_time(imported(tmp_path, WALKERS)).targets]
    away = [t for t in tracks if t.speed_m_s > 1 and t.t1_s - t.t0_s > 4]
    back = [t for t in tracks if t.speed_m_s < -1 and t.t0_s > 10]
    assert away
    assert back
    assert min(t.t0_s for t in away) < 4  # the first leaves at the beginning


@pytest.mark.parametrize(
    ("name", "reason"), [("bad_no_sync.wav", "no sync"), ("bad_silent_or_identical.wav", "identical")]
)
def test_bad_recordings_are_refused_each_with_its_reason(tmp_path, name, reason):
    with pytest.raises(PolfuseError, match=reason):
        import_wav([real_data(f"coffee_can/{name}")], tmp_path / "s.h5")
    assert not list(tmp_path.iterdir())


def test_the_reader_agrees_with_scipy():
    assert np.array_equal(read_wav(real_data(TRUCK)).samples, wavfile.read(real_data(TRUCK))[1])
