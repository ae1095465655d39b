"""The radar's audio as it arrives: places, speeds and levels by the closed form of the beat."""

from __future__ import annotations

import numpy as np
import pytest
from live_rig import PERIOD, RATE, C, beat, rig

from polfuse_lab.live import Board, LiveView
from polfuse_lab.live.listening import Listener, Piece, level_db
from processing.radar.ranging import compress, cut_sweeps
from processing.radar.sync import find_sync


@pytest.fixture
def listener(tmp_path):
    board = Board(tmp_path)
    view = LiveView(tmp_path)
    listener = Listener(rig(), board)
    yield listener, view
    view.close()
    board.close()


def hear(listener, samples, *, step=1440, first=0, look=True):
    """As the feed does: pieces of 30 ms, a look after each."""
    for at in range(0, len(samples), step):
        piece = samples[at : at + step]
        listener.hear(Piece(piece, first + at, RATE, round((first + at + len(piece)) / RATE * 1e9)))
        if look:
            listener.look()


def test_a_point_stands_at_its_range_and_level_in_its_channel(listener):
    listen, view = listener
    listen.route("HV", 0)
    hear(listen, beat(20.0, 0.1, sweeps=12))
    item = view.newest("profile.HV")
    at = int(np.argmax(item.arrays["level_db"]))
    # Bins are a quarter of c / 2B = 1.87 m; the peak of the real beat of amplitude 0.1 is 0.1.
    assert item.arrays["range_m"][at] == pytest.approx(20.0, abs=0.25)
    assert item.arrays["level_db"][at] == pytest.approx(-20.0, abs=0.3)
    # The profile's phase is that of the ramp's centre: -4 pi fc R / c. Between bins it turns by nothing at base band.
    expected = np.exp(-4j * np.pi * 2.4e9 * 20.0 / C)
    assert np.angle(item.arrays["profile"][at] / expected) == pytest.approx(0.0, abs=0.05)
    assert item.values["sweeps"] == 4
    assert not [name for name in view.streams() if name.endswith("HH")]


def test_every_sweep_is_one_row_of_the_waterfall_and_none_comes_twice(listener):
    listen, view = listener
    listen.route("HH", 0)
    hear(listen, beat(20.0, sweeps=30), step=700)
    rows = view.since("waterfall.HH", 0)
    assert [row.number for row in rows] == list(range(1, len(rows) + 1))
    # The first up-ramp has no rise before it and the last is not over: 28 or 29 of 30 are whole.
    assert 28 <= len(rows) <= 29
    times = np.array([row.values["t_s"] for row in rows])
    np.testing.assert_allclose(np.diff(times), 0.04, atol=2 / RATE)
    assert listen.skipped_s == 0.0


def test_rows_are_what_ranging_makes_of_the_same_sweeps(listener):
    listen, view = listener
    listen.route("HH", 0)
    samples = beat([12.0, 25.0], 0.2, sweeps=10)
    hear(listen, samples)
    rows = view.since("waterfall.HH", 0)
    sync = find_sync(samples, RATE, nominal_period_s=0.04, ramp_up_s=0.02)
    axis = view.newest("profile.HH").arrays["range_m"]
    whole = compress(cut_sweeps(samples, sync), axis, centre_hz=2.4e9, bandwidth_hz=80e6)
    # The sync measures ramps of a record as a whole and of a window alike: the same sweeps, to rounding.
    np.testing.assert_allclose(
        [row.arrays["level_db"] for row in rows], level_db(whole)[: len(rows)], atol=0.02
    )  # fmt: skip


def test_a_moving_point_has_its_speed(listener):
    listen, view = listener
    listen.route("VV", 0)
    # Below lambda / 4T = 0.78 m/s; receding is positive.
    hear(listen, beat(20.0, 0.1, sweeps=40, speed_m_s=0.4))
    item = view.newest("doppler.VV")
    row, column = np.unravel_index(np.argmax(item.arrays["level_db"]), item.arrays["level_db"].shape)
    step = item.arrays["speed_m_s"][1] - item.arrays["speed_m_s"][0]
    assert item.arrays["speed_m_s"][row] == pytest.approx(0.4, abs=step)
    assert item.arrays["range_m"][column] == pytest.approx(20.5, abs=0.6)


def test_levels_and_strip_tell_the_input(listener):
    listen, view = listener
    hear(listen, beat(20.0, 0.25, sweeps=60))
    levels = view.newest("levels").values
    assert levels["sync_channel"] == 1
    assert not levels["sync_inverted"]
    assert levels["beat_peak"] == pytest.approx(0.25, abs=0.01)
    # A square wave's rms is its amplitude.
    assert levels["sync_rms"] == pytest.approx(0.7, abs=0.001)
    assert levels["period_s"] == pytest.approx(0.04, abs=1e-5)
    assert levels["light"] == "ok"
    strip = view.newest("scope")
    assert len(strip.arrays["t_s"]) == 2 * PERIOD
    assert np.abs(strip.arrays["sync"]).max() == pytest.approx(0.7, abs=1e-3)


def test_a_silent_input_is_bad_and_says_how_to_mend_it(listener):
    listen, view = listener
    hear(listen, np.zeros((PERIOD * 40, 2), np.int16))
    levels = view.newest("levels").values
    assert levels["light"] == "bad"
    assert "silent" in levels["what"]
    assert "cable" in levels["mend"]
    assert view.newest("profile.unknown") is None


def test_a_clipped_beat_is_a_warning(listener):
    listen, view = listener
    hear(listen, _clipped())
    levels = view.newest("levels").values
    assert levels["light"] == "warn"
    assert "clipped" in levels["what"]
    assert levels["clipped_fraction"] > 0.05


def _clipped():
    samples = beat(20.0, 0.9, sweeps=60).astype(np.int32)
    samples[:, 0] = np.clip(samples[:, 0] * 3, -32767, 32767)
    return samples.astype(np.int16)


def test_sweeps_are_of_the_channel_that_the_switches_stood_on(listener):
    listen, view = listener
    listen.route("HH", 0)
    listen.route("VH", round(10.25 * 0.04 * 1e9))  # in the eleventh up-ramp
    hear(listen, beat(20.0, sweeps=20))
    first, second = view.since("waterfall.HH", 0), view.since("waterfall.VH", 0)
    assert max(row.values["t_s"] for row in first) < min(row.values["t_s"] for row in second)
    # The ramp that had begun before belongs to the channel that it began in.
    assert len(first) in (10, 11)


def test_what_nobody_looked_at_is_skipped_and_counted(listener):
    listen, view = listener
    listen.route("HH", 0)
    samples = beat(20.0, sweeps=60)
    hear(listen, samples[: 10 * PERIOD])
    hear(listen, samples[10 * PERIOD : 50 * PERIOD], first=10 * PERIOD, look=False)
    hear(listen, samples[50 * PERIOD :], first=50 * PERIOD)
    rows = view.since("waterfall.HH", 0)
    # 40 sweeps came without a look; the window still holds the last four or so of them.
    assert 1.2 < listen.skipped_s < 1.6
    assert 18 <= len(rows) <= 24


def test_a_stream_that_begins_anew_is_not_joined_to_the_old_one(listener):
    listen, view = listener
    listen.route("HH", 0)
    hear(listen, beat(20.0, sweeps=10))
    count = len(view.since("waterfall.HH", 0))
    hear(listen, beat(30.0, sweeps=10), first=5_000_000)
    rows = view.since("waterfall.HH", count)
    assert len(rows) >= 8
    axis = view.newest("profile.HH").arrays["range_m"]
    for row in rows:
        assert axis[np.argmax(row.arrays["level_db"])] == pytest.approx(30.0, abs=0.25)


def test_without_a_ramp_there_are_levels_and_no_complaint(tmp_path):
    board = Board(tmp_path)
    samples = beat(20.0, 0.25, sweeps=60)
    samples[:, 1] = 0  # in CW the sync may be silent
    hear(Listener(rig(), board, continuous_wave=True), samples)
    with LiveView(tmp_path) as view:
        levels = view.newest("levels").values
        assert levels["light"] == "ok"
        assert levels["beat_peak"] == pytest.approx(0.25, abs=0.01)
        assert view.streams() == ("levels", "scope")
    board.close()
