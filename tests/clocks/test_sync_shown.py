"""What people see of clocks: lines of ``polfuse info``, numbers of the report."""

from __future__ import annotations

import json

import numpy as np
import pytest

from drivers.records import AudioBlock, Channel, ClockFix, Identity
from polfuse_lab.cli.info import info
from polfuse_lab.products.store import Products
from polfuse_lab.records import Note, SweepFlag, Sweeps
from polfuse_lab.report.numbers import stage_numbers
from polfuse_lab.rig import Waveform
from polfuse_lab.session import SessionConfig, SessionWriter, open_session
from polfuse_lab.session.description import bytes_text, clock_text, duration_text, precision_text

WAVEFORM = Waveform(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.02, sweep_period_s=0.04)


@pytest.fixture
def session(tmp_path):
    config = SessionConfig(
        source="test",
        waveform=WAVEFORM,
        sample_rate_hz=48_000.0,
        audio_block_frames=480,
        identities=(Identity("radar", "d", "a card"),),
    )
    path = tmp_path / "s.h5"
    with SessionWriter.create(path, config) as writer:
        for number in range(12):
            # Half a minute passes after the sixth record.
            t = number + (30 if number > 5 else 0)
            block = AudioBlock(np.zeros((480, 2), np.int16), 48_000.0, 0, t * (1 + 30e-6), t * 10**9)
            flags = SweepFlag.RETRY if number == 3 else SweepFlag.NONE
            writer.write(Sweeps(block, Channel.HH, number, flags=flags))
            writer.write(ClockFix("radar", t * (1 + 30e-6), t * 10**9, 40_000))
        writer.write(Note("a car drove past", 8 * 10**9))
    return path


def test_info_is_worth_reading(session, capsys):
    info(session)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"{session}: whole, finished"
    text = "\n".join(lines)
    assert "devices  radar a card" in text
    assert "radar    12 records at 12 positions, HH" in text
    assert "lost     nothing" in text
    assert "flags    1 taken again" in text
    # From the end of record 5 (5.01 s) to the begin of record 6 (36 s).
    assert "pause    31.0 s at 0:00:05" in text
    # Drift of the host against the device: 1 / (1 + 30e-6).
    assert "-30.0 ppm, 12 readings" in text
    assert "note     0:00:08  a car drove past" in text
    assert "free" in text
    assert "problem" not in text


def test_json_has_the_same(session, capsys):
    info(session, json_=True)
    found = json.loads(capsys.readouterr().out)
    assert found["sync_rms_s"] < 1e-6
    # Half of 40 us, uniform: 11.5 us; and by as much from end to end if that changes meanwhile.
    t_s = np.array([number + (30 if number > 5 else 0) for number in range(12)])
    tilt = np.mean(((t_s - np.mean(t_s[[0, -1]])) / np.ptp(t_s)) ** 2)
    assert found["sync"]["devices"]["radar"]["rms_s"] == pytest.approx(20e-6 / 3**0.5 * (1 + tilt) ** 0.5, rel=0.02)
    assert found["flags"] == {"SWEEP_RETRY": 1}
    assert found["gaps"] == [{"time_s": pytest.approx(5.01), "seconds": pytest.approx(30.99)}]
    assert found["notes"] == [{"kind": "note", "time_s": 8.0, "text": "a car drove past"}]
    # 12 records of 480 frames of 2 int16.
    assert found["disk"]["audio_raw"] == 12 * 480 * 4
    assert found["disk"]["file"] == session.stat().st_size
    assert found["devices"][0]["name"] == "a card"


def test_the_report_tells_the_clocks(session, tmp_path):
    with open_session(session) as opened:
        sync = opened.sync.summary()
    sync["pairs"]["radar-camera"] = 0.002
    products = Products(tmp_path / "p.h5")
    products.write("ranging", {"a": np.zeros(1)}, settings={"sync": sync}, inputs=[session], units={"a": "1"})
    numbers = {number.name: number for number in stage_numbers(products)}
    assert numbers["Clock of the radar"].value == pytest.approx(-30, abs=0.1)
    assert numbers["Clock of the radar"].unit == "ppm"
    assert numbers["Sync, radar to camera"].value == pytest.approx(2.0)
    products.write("ranging", {"a": np.zeros(1)}, settings={}, inputs=[session], units={"a": "1"})
    assert stage_numbers(products) == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (duration_text(0.85), "850 ms"),
        (duration_text(12.34), "12.3 s"),
        (duration_text(245), "4 min 05 s"),
        (duration_text(3599.7), "1 h 00 min"),
        (duration_text(7380), "2 h 03 min"),
        (clock_text(3725.2), "1:02:05"),
        (clock_text(-3.0), "-0:00:03"),
        (clock_text(-0.2), "0:00:00"),
        (precision_text(None), "unknown"),
        (precision_text(35.4e-6), "35.4 us"),
        (precision_text(5.79e-3), "5.79 ms"),
        (precision_text(8.5e-9), "8.5 ns"),
        (bytes_text(12_345_678), "12.3 MB"),
        (bytes_text(12), "12 bytes"),
    ],
)
def test_numbers_as_people_write_them(text, expected):
    assert text == expected
