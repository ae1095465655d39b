"""GRBL driver, byte for byte against a script: what it sends, and what it makes of odd answers."""

from __future__ import annotations

import math
import time

import pytest
from grbl_helpers import BANNER, IDLE, OPENING, driver
from serial_helpers import Script, both_kinds, until_still

from drivers.contracts import Trolley
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceRefused, DeviceTimeout
from hw_mocks.wire import Kind, serve


@both_kinds
def test_exact_bytes(kind: Kind) -> None:
    script = Script(
        *OPENING,
        # x = 0 is the middle of a 4 m rail whose left end is machine position 0; 0.1 m/s are 6000 mm/min ($110).
        (b"G21 G90 G53 G1 X2000.000 F6000.0\n", b"ok\r\n"),
        (b"?", b"<Run|MPos:500.000,0.000,0.000|FS:6000,0>\r\n"),
        (b"?", b"<Idle|MPos:2000.000,0.000,0.000|FS:0,0>\r\n"),
    )
    with serve(script, kind=kind) as wire:
        trolley = driver(wire.url)
        assert isinstance(trolley, Trolley)
        identity = trolley.open()
        assert (identity.kind, identity.driver, identity.name) == ("trolley", "grbl", "Grbl 1.1h")
        assert "[VER:1.1h.20190830:]" in identity.detail
        trolley.start_move(0.0)
        fix = trolley.poll()
        assert (fix.x_m, fix.moving, fix.state) == (-1.5, True, "Run")
        time.sleep(0.01)
        fix = trolley.poll()
        assert (fix.x_m, fix.moving, fix.state) == (0.0, False, "Idle")
        # Uniform over +-0.5 mm of tolerance and over one step of 4 um: sqrt(0.5^2/3 + 0.004^2/12) mm.
        assert fix.sd_m == pytest.approx(1e-3 * math.sqrt(0.25 / 3 + 0.004**2 / 12), rel=1e-12)
        trolley.close()
    script.check()


def test_exact_bytes_of_a_stop() -> None:
    script = Script(
        *OPENING,
        (b"G21 G90 G53 G1 X2000.000 F6000.0\n", b"ok\r\n"),
        (b"!!", b""),
        (b"?", b"<Hold:1|MPos:500.000,0.000,0.000|FS:6000,0>\r\n"),
        (b"?", b"<Hold:0|MPos:501.000,0.000,0.000|FS:0,0>\r\n"),
        (b"?", b"<Hold:0|MPos:501.000,0.000,0.000|FS:0,0>\r\n"),
        (b"\x18", BANNER),
        (b"?", b"<Idle|MPos:501.000,0.000,0.000|FS:0,0>\r\n"),
    )
    with serve(script) as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_move(0.0)
        trolley.stop()
        assert trolley.poll().moving is True
        time.sleep(0.01)
        fix = trolley.poll()
        assert (fix.moving, fix.x_m) == (False, pytest.approx(-1.499, abs=1e-12))
        trolley.close()
    script.check()


def test_standing_elsewhere_is_refused() -> None:
    turns = [(b"G21 G90 G53 G1 X2000.000 F6000.0\n", b"ok\r\n"), *[(b"?", IDLE)] * 300]
    with serve(Script(*OPENING, *turns)) as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_move(0.0)
        with pytest.raises(DeviceRefused, match=r"stands at x = -2.0000 m instead of 0.0000 m"):
            until_still(trolley.poll)
        trolley.close()


def test_a_move_that_never_ends_times_out() -> None:
    held = b"<Hold:0|MPos:5.000,0.000,0.000|FS:0,0>\r\n"
    turns = [(b"G21 G90 G53 G1 X100.000 F6000.0\n", b"ok\r\n"), *[(b"?", held)] * 300]
    with serve(Script(*OPENING, *turns)) as wire:
        # 0.1 m at 0.1 m/s, and half a second of margin
        trolley = driver(wire.url, length_m=0.1, origin_m=-0.05, move_margin_s=0.5)
        trolley.open()
        trolley.start_move(0.05)
        started = time.monotonic()
        with pytest.raises(DeviceTimeout, match=r"has not arrived at x = 0.0500 m"):
            until_still(trolley.poll)
        assert 1.4 < time.monotonic() - started < 2.5
        trolley.close()


@pytest.mark.parametrize(
    ("said", "error", "says"),
    [
        (b"<Door:1|MPos:0.000,0.000,0.000>\r\n", DeviceRefused, "safety door is open"),
        (b"<Idle,MPos:0.000,0.000,0.000>\r\n", DeviceBadAnswer, "runs GRBL 1.1"),
        (b"<Idle|WPos:0.000,0.000,0.000>\r\n", None, ""),
        (b"ok\r\n" * 300, DeviceBadAnswer, "talks without end"),
        (b"", DeviceTimeout, "no answer"),
        (b"\xff\xfe\r\n", DeviceBadAnswer, "not text"),
    ],
)
def test_odd_answers_to_a_status_question(said: bytes, error: type[DeviceError] | None, says: str) -> None:
    with serve(Script(*OPENING, (b"?", said))) as wire:
        trolley = driver(wire.url, timeout_s=0.3)
        trolley.open()
        time.sleep(0.01)
        if error is None:
            assert trolley.poll().x_m == -2.0  # the offset told at the start is remembered
        else:
            with pytest.raises(error, match=says):
                trolley.poll()
        trolley.close()


def test_inches_are_refused() -> None:
    opening = [*OPENING[:6], (b"$$\n", b"$13=1\r\nok\r\n")]
    with serve(Script(*opening)) as wire, pytest.raises(DeviceRefused, match=r"inches \(\$13=1\); send \$13=0"):
        driver(wire.url).open()


def test_the_controllers_speed_limit_is_heeded() -> None:
    with serve(Script(*OPENING, (b"G21 G90 G53 G1 X0.000 F6000.0\n", b"ok\r\n"))) as wire:
        trolley = driver(wire.url, feed_m_s=0.5)
        trolley.open()
        trolley.start_move(-2.0)
        trolley.close()


def test_nobody_answers() -> None:
    with serve(Script()) as wire:
        started = time.monotonic()
        with pytest.raises(DeviceTimeout, match="no GRBL controller answers"):
            driver(wire.url, timeout_s=0.1).open()
        assert time.monotonic() - started < 4
