"""Zaber trolley: the maker's own package against exact bytes and against the simulated stage (ASCII protocol)."""

from __future__ import annotations

import builtins
import importlib.util
import math
import time
from typing import Any

import pytest
from serial_helpers import Script, both_kinds, until_still, wait_for
from speed_checks import check_speeds

from drivers.contracts import Trolley
from drivers.errors import DeviceBadAnswer, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.trolley.zaber import ZaberTrolley
from hw_mocks.faults import FaultKind
from hw_mocks.wire import Kind, serve
from hw_mocks.world import World
from hw_mocks.zaber import ZaberStage, start_zaber

MICROSTEP_M = 0.49609375e-6

needs_package = pytest.mark.skipif(
    importlib.util.find_spec("zaber_motion") is None, reason="zaber-motion is not installed (pip install zaber-motion)"
)


@pytest.fixture(scope="module", autouse=True)
def warm_package() -> None:
    """The package starts its own threads with the first connection and keeps them: no leak of a test."""
    if importlib.util.find_spec("zaber_motion") is not None:
        with start_zaber(World(), length_m=2.0) as wire:
            trolley = driver(wire.url)
            trolley.open()
            trolley.close()


def driver(url: str, **options: Any) -> ZaberTrolley:
    given = {"length_m": 2.0, "microstep_m": MICROSTEP_M, "timeout_s": 0.5} | options
    return ZaberTrolley(ZaberTrolley.Options(port=url, **given))


def exchange(number: int, command: str, answer: str, axis: int = 1, status: str = "IDLE --") -> tuple[bytes, bytes]:
    """A command and its reply; all bytes of the command with its check add up to 0 (the protocol's LRC)."""
    body = f"1 {axis} {number:02d} {command}"
    check = -sum(body.encode()) & 0xFF
    return (
        f"/{body}:{check:02X}\n".encode(),
        f"@01 {axis} {number:02d} {answer.split()[0]} {status} {answer[3:]}\r\n".encode(),
    )


def opening(status: str = "IDLE --", warnings: str = "00") -> list[tuple[bytes, bytes]]:
    talk = [
        ("stop", "OK 0", 1), ("get deviceid", "OK 50419", 0), ("get version", "OK 7.38", 0),
        ("get limit.min", "OK 0", 1), ("get limit.max", "OK 4031496", 1), ("get maxspeed", "OK 330258", 1),
        ("warnings", f"OK {warnings}", 1), ("get pos", "OK 0", 1),
    ]  # fmt: skip
    return [exchange(n, command, answer, axis, status) for n, (command, answer, axis) in enumerate(talk)]


@needs_package
@both_kinds
def test_exact_bytes(kind: Kind) -> None:
    script = Script(
        *opening(),
        exchange(8, "warnings", "OK 00"),
        # x = 0 is 1 m from home: 1 m / 0.49609375 um = 2015748.03 microsteps.
        exchange(9, "move abs 2015748", "OK 0", status="BUSY --"),
        exchange(10, "get pos", "OK 1007874", status="BUSY --"),
        exchange(11, "get pos", "OK 2015748"),
    )
    with serve(script, kind=kind) as wire:
        trolley = driver(wire.url)
        assert isinstance(trolley, Trolley)
        identity = trolley.open()
        assert (identity.kind, identity.driver, identity.name) == ("trolley", "zaber", "Zaber device 50419")
        assert identity.detail == "firmware 7.38, x = -1.0000 m"
        # 4031496 microsteps are 2.0000 m.
        assert trolley.limits_m == pytest.approx((-1.0, 1.0), abs=MICROSTEP_M)
        trolley.start_move(0.0)
        fix = trolley.poll()
        assert (fix.moving, fix.x_m) == (True, pytest.approx(-0.5, abs=MICROSTEP_M))
        fix = trolley.poll()
        assert (fix.moving, fix.x_m, fix.sd_m) == (False, pytest.approx(0.0, abs=MICROSTEP_M), 5e-5)
        trolley.close()
    script.check()


@needs_package
def test_exact_bytes_of_speed_stop_and_direction() -> None:
    script = Script(
        *[turn for turn in opening() if b"maxspeed" not in turn[0]][:5],
        exchange(5, "warnings", "OK 00"),
        exchange(6, "get pos", "OK 0"),
        exchange(7, "warnings", "OK 00"),
        # 0.1 m/s = 201574.8 microsteps/s, in units of 1/1.6384: 330260.
        exchange(8, "move abs 1007874 330260", "OK 0", status="BUSY --"),
        exchange(9, "stop", "OK 0", status="BUSY --"),
        exchange(10, "get pos", "OK 500000"),
    )
    with serve(script, kind="tcp") as wire:
        trolley = driver(wire.url, feed_m_s=0.1, direction=-1)
        trolley.open()
        trolley.start_move(0.5)  # 0.5 m from home at +1 m
        trolley.stop()
        fix = trolley.poll()
        assert (fix.moving, fix.x_m) == (False, pytest.approx(1 - 500_000 * MICROSTEP_M))
        trolley.close()
    script.check()


@needs_package
@both_kinds
def test_homes_then_moves_and_measures(kind: Kind) -> None:
    world = World()
    world.trolley_x_m.hold(-0.7)
    with start_zaber(world, length_m=2.0, speed_m_s=2.0, kind=kind) as wire:
        trolley = driver(wire.url)
        assert trolley.open().detail == "firmware 7.38, to be homed before its first move"
        assert trolley.poll().sd_m == pytest.approx(2.0 / math.sqrt(12))
        trolley.start_move(0.25)
        fix = trolley.poll()
        assert (fix.moving, fix.state) == (True, "Home")
        wait_for(lambda: trolley.poll().state != "Home", "homing")
        assert until_still(trolley.poll).x_m == pytest.approx(0.25, abs=MICROSTEP_M)
        assert world.trolley_x_m.at() == pytest.approx(0.25, abs=MICROSTEP_M)
        for x_m in (1.0, -1.0, 0.1234567):
            trolley.start_move(x_m)
            assert until_still(trolley.poll).x_m == pytest.approx(x_m, abs=2 * MICROSTEP_M)
        trolley.close()
        trolley.close()


@needs_package
def test_stop_and_the_next_move() -> None:
    world = World()
    with serve(ZaberStage(world, length_m=2.0, homed=True), kind="tcp") as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_move(1.0)
        wait_for(lambda: world.trolley_x_m.at() > 0.05, "the move")
        started = time.monotonic()
        trolley.stop()
        fix = until_still(trolley.poll)
        assert time.monotonic() - started < 0.5
        assert fix.x_m == pytest.approx(world.trolley_x_m.at(), abs=MICROSTEP_M)
        assert fix.x_m < 0.9
        trolley.start_move(-0.1)
        assert until_still(trolley.poll).x_m == pytest.approx(-0.1, abs=MICROSTEP_M)
        trolley.close()


@needs_package
def test_stop_while_homing() -> None:
    world = World()
    with start_zaber(world, length_m=2.0, speed_m_s=0.3) as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_move(0.5)
        wait_for(lambda: world.trolley_x_m.at() < -0.02, "homing")
        trolley.make_safe()
        until_still(trolley.poll)
        stood = world.trolley_x_m.at()
        time.sleep(0.1)
        assert world.trolley_x_m.at() == stood > -0.9
        assert trolley.poll().sd_m > 0.5  # still without a reference
        trolley.close()


@needs_package
def test_a_stall_is_reported_in_words() -> None:
    with serve(ZaberStage(World(), length_m=2.0, homed=True), kind="tcp") as wire:
        trolley = driver(wire.url)
        trolley.open()
        wire.faults.start(FaultKind.STALL)
        trolley.start_move(0.2)
        with pytest.raises(
            DeviceRefused, match=r"a stall: it was blocked and has stopped \(flag FS\) at x = 0\.1000 m"
        ):
            until_still(trolley.poll)
        wire.faults.stop(FaultKind.STALL)
        trolley.start_move(0.2)
        assert until_still(trolley.poll).x_m == pytest.approx(0.2, abs=MICROSTEP_M)
        trolley.close()


@needs_package
@pytest.mark.parametrize("flag", ["FD", "FQ", "FE", "FX"])
def test_fault_flags_are_refused(flag: str) -> None:
    with serve(Script(*opening(), exchange(8, "get pos", "OK 5", status=f"IDLE {flag}")), kind="tcp") as wire:
        trolley = driver(wire.url)
        trolley.open()
        with pytest.raises(DeviceRefused, match=rf"flag {flag}\)"):
            trolley.poll()
        trolley.close()


@needs_package
def test_limits_are_the_narrower_ones() -> None:
    with serve(ZaberStage(World(), length_m=1.0, homed=True), kind="tcp") as wire:
        # A rail of 2 m in the file, 1 m of travel from the left end.
        trolley = driver(wire.url)
        trolley.open()
        assert trolley.limits_m == pytest.approx((-1.0, 0.0), abs=MICROSTEP_M)
        with pytest.raises(DeviceRefused, match="outside the rail"):
            trolley.start_move(0.5)
        trolley.close()
        with pytest.raises(DeviceRefused, match="leave nothing of the rail"):
            driver(wire.url, origin_m=5.0).open()


@needs_package
def test_without_a_reference_and_without_leave_to_home() -> None:
    with start_zaber(World(), length_m=2.0) as wire, pytest.raises(DeviceRefused, match="has no reference"):
        driver(wire.url, home_first=False).open()


@needs_package
def test_a_refused_command_says_why() -> None:
    refused = exchange(9, "move abs 2015748", "RJ BADDATA")
    with serve(Script(*opening(), exchange(8, "warnings", "OK 00"), refused), kind="tcp") as wire:
        trolley = driver(wire.url)
        trolley.open()
        with pytest.raises(DeviceRefused, match=r"'move abs 2015748' was refused \(BADDATA\)"):
            trolley.start_move(0.0)
        trolley.close()


@needs_package
@both_kinds
def test_unplugged(kind: Kind) -> None:
    world = World()
    with start_zaber(world, length_m=2.0, homed=True, kind=kind) as wire:
        trolley = driver(wire.url)
        trolley.open()
        wire.unplug()
        with pytest.raises((DeviceLost, DeviceTimeout)):
            trolley.poll()
        trolley.make_safe()
        trolley.close()
        wire.plug()
        trolley.open()
        trolley.start_move(0.05)
        assert until_still(trolley.poll).x_m == pytest.approx(0.05, abs=MICROSTEP_M)
        trolley.close()


@needs_package
def test_nobody_or_somebody_else() -> None:
    with serve(Script(), kind="tcp") as wire:
        started = time.monotonic()
        with pytest.raises(DeviceTimeout, match=r"no answer to 'stop' within 0\.5 s"):
            driver(wire.url).open()
        assert time.monotonic() - started < 2
    with pytest.raises(DeviceLost, match="connection refused"):
        driver(wire.url).open()
    with pytest.raises(DeviceLost, match="cannot be reached"):
        driver("/dev/no-such-port").open()
    with pytest.raises(DeviceLost, match="not open"):
        driver("unused").poll()


@needs_package
@pytest.mark.parametrize(
    "said", [b"\xff\xfe\r\n", b"@01 1 08 OK IDLE -- nan\r\n", b"@01 1 08 OK IDLE -- \r\n", b"@\r\n"]
)
def test_nonsense_is_a_device_error(said: bytes) -> None:
    with serve(Script(*opening(), (exchange(8, "get pos", "OK 0")[0], said)), kind="tcp") as wire:
        trolley = driver(wire.url)
        trolley.open()
        with pytest.raises((DeviceBadAnswer, DeviceTimeout)):
            trolley.poll()
        trolley.close()


def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real_import = builtins.__import__

    def no_zaber(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith("zaber_motion"):
            raise ImportError("No module named 'zaber_motion'")
        return real_import(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", no_zaber)
    with pytest.raises(DeviceRefused, match=r"pip install 'polfuse-lab\[zaber\]'"):
        driver("unused").open()


@pytest.mark.parametrize("x_m", [1.1, -1.1, math.nan])
def test_beyond_the_rail(x_m: float) -> None:
    with pytest.raises(DeviceRefused, match="outside the rail"):
        driver("unused").start_move(x_m)


def test_the_simulated_stage_follows_the_protocol() -> None:
    world = World()
    stage = ZaberStage(world, length_m=2.0, speed_m_s=10.0, acceleration_m_s2=1e4)
    # The protocol's check: all bytes between '@' and ':' and the check add up to 0 modulo 256.
    said = stage.handle(b"/1 1 07 get pos\n")
    body, _, check = said.decode().strip()[1:].rpartition(":")
    assert (sum(body.encode()) + int(check, 16)) & 0xFF == 0
    assert body == "01 1 07 OK IDLE WR 0"
    assert stage.handle(b"/1 1 warnings\n").startswith(b"@01 1 OK IDLE WR 01 WR")
    assert stage.handle(b"/2 1 get pos\n") == b""
    assert stage.handle(b"/1 1 get pos:00\n") == b""  # a wrong checksum
    assert b"RJ IDLE WR BADCOMMAND" in stage.handle(b"/1 1 dance\n")
    assert b"RJ IDLE WR BADDATA" in stage.handle(b"/1 1 move abs -5\n")
    assert b"BADAXIS" in stage.handle(b"/1 2 home\n")
    assert b"OK BUSY WR 0" in stage.handle(b"/1 home\n")
    time.sleep(0.15)
    assert stage.handle(b"/\n").startswith(b"@01 0 OK IDLE -- 0")
    assert world.trolley_x_m.at() == -1.0
    assert stage.handle(b"/1 1 warnings clear\n").startswith(b"@01 1 OK IDLE -- 00")


@needs_package
@pytest.mark.realtime
def test_it_keeps_a_given_speed() -> None:
    world = World()
    with start_zaber(world, length_m=2.0, speed_m_s=1.0, homed=True) as wire:
        trolley = driver(wire.url)
        trolley.open()
        try:
            check_speeds(trolley, world)
        finally:
            trolley.close()
