import json
import math

import numpy as np
import pytest
from made_recordings import C, Point, recording
from typer.testing import CliRunner

from drivers.records import AudioBlock, Channel
from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.ranging import range_profiles
from polfuse_lab.products.ranging_time import range_time
from polfuse_lab.records import SweepFlag, Sweeps
from polfuse_lab.rig import Waveform
from polfuse_lab.session import SessionConfig, SessionWriter, open_session

CENTRE, BANDWIDTH = 2.4e9, 80e6
WAVEFORM = Waveform(centre_hz=CENTRE, bandwidth_hz=BANDWIDTH, ramp_up_s=0.02, sweep_period_s=0.04)
TARGET = np.array([0.4, 30.0])
ONE_WAY_M = {x: float(np.hypot(*(TARGET - [x, 0.0]))) for x in (-0.1, 0.0, 0.1)}


def record(channel, position, x, amplitude=0.2, start=100.0, flags=SweepFlag.NONE, attempt=0, requested=4, extra=()):
    samples, _, _ = recording(
        [Point(ONE_WAY_M[x], amplitude=amplitude), *extra], seconds=0.25, start=start, dtype=np.int16
    )
    block = AudioBlock(samples, 48_000.0, 0, 0.0, 1 + position)
    return Sweeps(block, channel, position, x, 0.001, requested, flags, attempt)


def write(path, records):
    config = SessionConfig(source="collect", waveform=WAVEFORM, sample_rate_hz=48_000.0)
    with SessionWriter.create(path, config) as writer:
        for item in records:
            writer.write(item)
    return path


def two_channels(**options):
    return [
        record(channel, position, x, amplitude, **options)
        for position, x in enumerate(ONE_WAY_M)
        for channel, amplitude in ((Channel.HH, 0.2), (Channel.VV, -0.1j))
    ]


def test_profiles_of_every_channel_and_position(tmp_path):
    profiles = range_profiles(write(tmp_path / "s.h5", two_channels()), range_compensated=False, max_range_m=60.0)
    assert profiles.channels == ("HH", "VV")
    assert profiles.values.shape == (2, 3, len(profiles.range_m))
    assert profiles.values.dtype == np.complex64
    assert np.array_equal(profiles.antenna_m, [[-0.1, 0, 0], [0, 0, 0], [0.1, 0, 0]])
    for row, amplitude in ((0, 0.2), (1, -0.1j)):
        for column, true in enumerate(ONE_WAY_M.values()):
            bin_ = int(np.argmin(np.abs(profiles.range_m - true)))
            away = (profiles.range_m[bin_] - true) / (C / 2 / BANDWIDTH)
            envelope = np.sinc(away) / (1 - away**2)  # Hann
            expected = amplitude * envelope * np.exp(-4j * np.pi * CENTRE * true / C)
            # Image at 32 cycles 1e-5, edges to 2e-4 sample, int16 1e-5, complex64 6e-8.
            assert abs(profiles.values[row, column, bin_] / expected - 1) < 5e-4


def test_compensation_multiplies_by_range_squared(tmp_path):
    path = write(tmp_path / "s.h5", two_channels())
    plain, compensated = (range_profiles(path, range_compensated=flag) for flag in (False, True))
    assert compensated.range_compensated
    assert np.allclose(compensated.values, plain.values * plain.range_m**2, rtol=1e-5, atol=1e-9)


def test_profiles_have_the_same_bytes_when_records_begin_at_other_instants(tmp_path):
    # The sweeps alternate by half a sample; records that begin one period later see the set in another order.
    one = write(tmp_path / "a.h5", two_channels(start=100.0))
    other = write(tmp_path / "b.h5", two_channels(start=100.0 - 1920.5))
    begins = (100.0, 140.0, 100.0 - 1920.5, 300.0, 43.0, 700.0)
    plan = zip(two_channels(), (0.2, -0.1j) * 3, begins, strict=True)
    again = [record(item.channel, item.position, item.x_m, amplitude, start=begin) for item, amplitude, begin in plan]
    mixed = write(tmp_path / "c.h5", again)
    expected = range_profiles(one).values.tobytes()
    assert range_profiles(other).values.tobytes() == expected
    assert range_profiles(mixed).values.tobytes() == expected


def test_the_last_usable_attempt_counts(tmp_path):
    good = two_channels()
    spoilt = [
        record(Channel.HH, 0, -0.1, 0.001, flags=SweepFlag.LOST, attempt=1),
        record(Channel.VV, 1, 0.0, 0.001, flags=SweepFlag.SWITCH_CHANGED, attempt=1),
    ]
    better = record(Channel.HH, 2, 0.1, 0.3, attempt=1, flags=SweepFlag.RETRY)
    values = range_profiles(write(tmp_path / "s.h5", [*good, *spoilt, better])).values
    plain = range_profiles(write(tmp_path / "p.h5", good)).values
    assert np.array_equal(values[0, :2], plain[0, :2])
    assert np.array_equal(values[1], plain[1])
    assert np.abs(values[0, 2]).max() == pytest.approx(1.5 * np.abs(plain[0, 2]).max(), rel=1e-3)


def test_a_missing_record_is_undefined_and_a_silent_one_is_named(tmp_path, caplog):
    records = two_channels()
    silent = Sweeps(AudioBlock(np.zeros((12_000, 2), np.int16), 48_000.0, 0, 0.0, 1), Channel.HH, 2, 0.1)
    values = range_profiles(write(tmp_path / "s.h5", [*records[:3], records[5], silent])).values
    assert np.isnan(values[0, 2]).all()  # HH at the third position was silent
    assert np.isnan(values[1, 1]).all()  # VV at the second was never taken
    assert np.isfinite(values[[0, 0, 1, 1], [0, 1, 0, 2]]).all()
    assert "silent" in caplog.text
    with pytest.raises(PolfuseError, match="silent"):
        range_profiles(write(tmp_path / "t.h5", [silent]))
    with pytest.raises(PolfuseError, match="no usable"):
        range_profiles(write(tmp_path / "u.h5", []))


def test_coupling_is_taken_off_by_mean_and_by_reference(tmp_path):
    coupling = Point(3.0, amplitude=0.5)
    path = write(tmp_path / "s.h5", [record(Channel.HH, n, x, extra=(coupling,)) for n, x in enumerate(ONE_WAY_M)])
    sky_record = recording([coupling], seconds=0.25, dtype=np.int16)[0]
    sky = write(tmp_path / "sky.h5", [Sweeps(AudioBlock(sky_record, 48_000.0, 0, 0.0, 1), Channel.HH, 0)])
    near = slice(4, 20)
    plain = range_profiles(path)
    for compensated in (True, False):
        reference = range_profiles(sky, range_compensated=compensated)
        cleaned = range_profiles(path, coupling="reference", reference=reference)
        assert np.abs(cleaned.values[0, :, near]).max() < 3e-3 * np.abs(plain.values[0, :, near]).max()
        peak = np.argmax(np.abs(cleaned.values[0, 1]))
        assert abs(cleaned.range_m[peak] - 30.0) < 0.5
    mean = range_profiles(path, coupling="mean")
    assert np.abs(mean.values[0, :, near]).max() < 1e-2 * np.abs(plain.values[0, :, near]).max()
    assert np.abs(mean.values.mean(axis=1)).max() < 1e-4 * np.abs(plain.values).max()
    with pytest.raises(PolfuseError, match="one position"):
        range_profiles(sky, coupling="mean")
    with pytest.raises(PolfuseError, match="no reference"):
        range_profiles(path, coupling="reference")
    with pytest.raises(PolfuseError, match="other channels, ranges"):
        range_profiles(path, coupling="reference", reference=range_profiles(sky, max_range_m=50.0))


def test_a_session_without_movement_in_it_says_so(tmp_path):
    path = write(tmp_path / "s.h5", two_channels())
    with pytest.raises(PolfuseError, match="too few to see movement"):
        range_time(path)
    run = CliRunner().invoke(build(), ["range", str(path), "--json"])
    assert run.exit_code == 1
    assert run.stdout == ""
    assert "Traceback" not in run.stderr


def test_range_command_tracks_a_walker(tmp_path):
    speed, start = -4.0, 60.0
    points = [Point(start, speed, 0.01), Point(15.0, amplitude=0.2)]
    samples, _, _ = recording(points, seconds=5.0, noise=0.01, dtype=np.int16)
    block = AudioBlock(samples, 48_000.0, 0, 0.0, 1)
    path = write(tmp_path / "walk.h5", [Sweeps(block, Channel.VV, 0)])
    run = CliRunner().invoke(build(), ["range", str(path), "-o", str(tmp_path / "walk.png"), "--json"])
    assert run.exit_code == 0, run.stderr
    values = json.loads(run.stdout)
    track = values["tracks"][0]
    assert track["speed_m_s"] == pytest.approx(speed, abs=max(4 * track["speed_sd_m_s"], 0.05))
    assert track["doppler_m_s"] == pytest.approx(speed, abs=0.05)
    assert track["ramp_speed_m_s"] == pytest.approx(speed, abs=0.5)
    # Up- and down-ramp together take the Doppler shift of 2.4 m off: the truth, to half a cell.
    assert track["r0_m"] == pytest.approx(start + speed * track["t0_s"], abs=0.9)
    assert track["r1_m"] == pytest.approx(start + speed * track["t1_s"], abs=0.9)
    assert track["t1_s"] - track["t0_s"] > 4.0
    assert values["figure"] == str(tmp_path / "walk.png")
    assert (tmp_path / "walk.png").read_bytes()[:4] == b"\x89PNG"
    assert math.isclose(values["doppler_ambiguity_m_s"], C / CENTRE / 2 / values["sweep_period_s"], rel_tol=1e-9)
    with open_session(path) as session, pytest.raises(PolfuseError, match="no usable record 7"):
        range_time(session, record=7)
