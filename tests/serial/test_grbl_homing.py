"""GRBL beyond plain moves: homing, jogs, soft limits, unlocking, ramps, and alarms that wait for a reset."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from grbl_helpers import BANNER, IDLE, OPENING, driver, simulated
from hypothesis import given
from hypothesis import strategies as st
from serial_helpers import Script, both_kinds, until_still, wait_for

from drivers.errors import DeviceLost, DeviceRefused, DeviceTimeout
from hw_mocks.faults import FaultKind
from hw_mocks.grbl import Grbl
from hw_mocks.grbl_gcode import Motion, Parser
from hw_mocks.stepper_motion import braking, travel
from hw_mocks.wire import Kind, serve
from hw_mocks.world import World

HOMED = {"homing": True, "homing_m_s": 4.0, "pull_off_mm": 2.0}
# After homing to the positive end, machine position 0 is the switch at x = +2 m.
AT_END = {"origin_m": 2.0, "home_first": True}
LOCKED = b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
SETTINGS = b"$13=0\r\n$20=1\r\n$22=1\r\n$100=250.000\r\n$110=6000.000\r\n$130=3000.000\r\nok\r\n"


# Exact bytes


def test_exact_bytes_of_homing_and_the_move_after_it() -> None:
    script = Script(
        (b"?", LOCKED), (b"!", b""), (b"?", LOCKED), (b"\x18", BANNER + b"[MSG:'$H'|'$X' to unlock]\r\n"),
        (b"?", LOCKED), (b"$I\n", b"[VER:1.1h.20190830:]\r\nok\r\n"), (b"$$\n", SETTINGS),
        (b"?", LOCKED), (b"?", LOCKED),
        (b"$H\n", b"ok\r\n"),
        # x = 0 is 2 m before the switch.
        (b"G21 G90 G53 G1 X-2000.000 F6000.0\n", b"ok\r\n"),
        (b"?", b"<Idle|MPos:-2000.000,0.000,0.000|FS:0,0>\r\n"),
    )  # fmt: skip
    with serve(script) as wire:
        trolley = driver(wire.url, **AT_END)
        assert trolley.open().detail.endswith("to be homed before its first move")
        # $130 = 3 m of travel to the left of the switch.
        assert trolley.limits_m == (-1.0, 2.0)
        fix = trolley.poll()
        assert (fix.moving, fix.state, fix.sd_m) == (False, "Alarm", pytest.approx(4.0 / math.sqrt(12)))
        trolley.start_move(0.0)
        fix = until_still(trolley.poll)
        assert (fix.x_m, fix.state) == (0.0, "Idle")
        trolley.close()
    script.check()


def test_exact_bytes_of_a_jog_and_its_end() -> None:
    jogging = b"<Jog|MPos:10.000,0.000,0.000|FS:600,0>\r\n"
    script = Script(
        *OPENING,
        (b"$J=G21 G90 G53 X4000.000 F600.0\n", b"ok\r\n"),
        (b"?", jogging),
        (b"!!", b""),
        (b"?", IDLE),
        (b"?", IDLE),
        (b"\x18", BANNER),
        (b"?", IDLE),
    )
    with serve(script) as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_jog(2.0, speed_m_s=0.01)
        assert trolley.poll().moving
        trolley.stop()
        assert not trolley.poll().moving
        trolley.close()
    script.check()


def test_exact_bytes_of_unlocking() -> None:
    script = Script(
        *OPENING,
        (b"?", b"ALARM:1\r\n[MSG:Reset to continue]\r\n"),
        (b"\x18", BANNER + b"[MSG:'$H'|'$X' to unlock]\r\n"),
        (b"$X\n", b"[MSG:Caution: Unlocked]\r\nok\r\n"),
        (b"?", IDLE),
    )
    with serve(script) as wire:
        trolley = driver(wire.url)
        trolley.open()
        with pytest.raises(DeviceRefused, match="ALARM:1"):
            trolley.poll()
        with pytest.raises(DeviceRefused, match="in alarm since ALARM:1"):
            trolley.poll()
        trolley.unlock()
        assert trolley.poll().state == "Idle"
        trolley.close()
    script.check()


# Homing, driver against simulation


@both_kinds
@pytest.mark.parametrize("home_end", [1, -1])
def test_homes_before_the_first_move(kind: Kind, home_end: int) -> None:
    world = World()
    world.trolley_x_m.hold(0.37)
    # The firmware's machine positions run from -$130 to 0 whichever end is sought.
    with simulated(world, kind, home_end=home_end, **HOMED) as wire:
        trolley = driver(wire.url, feed_m_s=5.0, **AT_END)
        trolley.open()
        assert not trolley.poll().moving
        trolley.start_move(-0.75)
        fix = trolley.poll()
        assert (fix.moving, fix.state) == (True, "Home")
        assert fix.sd_m == pytest.approx(4.0 / math.sqrt(12))
        reached: list[float] = []
        fix = until_still(lambda: (reached.append(world.trolley_x_m.at()), trolley.poll())[1])
        assert max(home_end * x for x in reached) > 1.5  # it did seek its switch
        assert fix.x_m == pytest.approx(-0.75, abs=3e-6)
        assert world.trolley_x_m.at() == pytest.approx(-0.75, abs=3e-6)
        trolley.start_move(0.25)  # not homed again
        assert until_still(trolley.poll).x_m == pytest.approx(0.25, abs=3e-6)
        trolley.close()


def test_homing_alone_ends_at_the_switch() -> None:
    world = World()
    with simulated(world, **HOMED) as wire:
        trolley = driver(wire.url, **AT_END)
        trolley.open()
        trolley.start_homing()
        with pytest.raises(DeviceRefused, match="is homing"):
            trolley.start_jog(0.0)
        fix = until_still(trolley.poll)
        # The switch is at 2 m; 2 mm are backed off.
        assert fix.x_m == pytest.approx(1.998, abs=3e-6)
        assert fix.sd_m < 0.001
        assert world.trolley_x_m.at() == pytest.approx(1.998, abs=3e-6)
        trolley.close()


def test_a_move_asked_for_while_homing_follows() -> None:
    with simulated(World(), **HOMED) as wire:
        trolley = driver(wire.url, feed_m_s=5.0, **AT_END)
        trolley.open()
        trolley.start_homing()
        trolley.start_move(0.5)
        assert until_still(trolley.poll).x_m == pytest.approx(0.5, abs=3e-6)
        trolley.close()


def test_stop_while_homing_stops_at_once_and_says_what_is_lost() -> None:
    world = World()
    with simulated(world, homing=True, homing_m_s=1.0) as wire:
        trolley = driver(wire.url, **AT_END)
        trolley.open()
        trolley.start_move(0.0)
        wait_for(lambda: world.trolley_x_m.at() > 0.05, "homing")
        started = time.monotonic()
        trolley.stop()
        with pytest.raises(DeviceRefused, match=r"ALARM:6 \(it was reset while homing\)"):
            until_still(trolley.poll)
        assert time.monotonic() - started < 0.3
        stood = world.trolley_x_m.at()
        time.sleep(0.1)
        assert world.trolley_x_m.at() == stood < 1.0
        with pytest.raises(DeviceRefused, match="in alarm since ALARM:6"):
            trolley.start_jog(0.0)
        trolley.start_homing()  # once more, to the end
        assert until_still(trolley.poll, timeout_s=10).x_m == pytest.approx(1.999, abs=3e-6)
        trolley.close()


def test_a_switch_that_is_not_found() -> None:
    with simulated(World(), homing=True, homing_m_s=20.0) as wire:
        wire.faults.start(FaultKind.STALL)
        trolley = driver(wire.url, **AT_END)
        trolley.open()
        trolley.start_move(0.0)
        with pytest.raises(DeviceRefused, match=r"ALARM:9 \(homing did not find the limit switch\)"):
            until_still(trolley.poll)
        wire.faults.stop(FaultKind.STALL)
        trolley.start_homing()
        assert until_still(trolley.poll).x_m == pytest.approx(1.999, abs=3e-6)
        trolley.close()


def test_homing_without_end_times_out_and_is_reset() -> None:
    world = World()
    with simulated(world, homing=True, homing_m_s=0.1) as wire:
        trolley = driver(wire.url, homing_timeout_s=0.3, **AT_END)
        trolley.open()
        trolley.start_homing()
        with pytest.raises(DeviceTimeout, match=r"was not found within 0\.3 s.*\$23"):
            until_still(trolley.poll)
        time.sleep(0.1)
        stood = world.trolley_x_m.at()
        time.sleep(0.05)
        assert world.trolley_x_m.at() == stood
        trolley.close()


def test_homing_where_it_is_not_enabled() -> None:
    with simulated(World()) as wire:
        trolley = driver(wire.url)
        trolley.open()
        with pytest.raises(DeviceRefused, match=r"homing is not enabled \(\$22=0\)"):
            trolley.start_homing()
        trolley.close()
        with pytest.raises(DeviceRefused, match=r"send \$22=1 in a terminal, or leave out home_first"):
            driver(wire.url, home_first=True).open()


def test_homing_is_refused_in_motion() -> None:
    world = World()
    with simulated(world, homing=True, feed_limit_m_s=0.2) as wire:
        trolley = driver(wire.url, unlock_at_open=True)
        trolley.open()
        trolley.start_move(1.0)
        wait_for(lambda: world.trolley_x_m.at() > 0, "the move")
        trolley.start_homing()
        with pytest.raises(DeviceRefused, match=r"error:8 \('\$' commands are taken only while it is idle\)"):
            until_still(trolley.poll)
        trolley.close()


def test_found_homing_at_open() -> None:
    """A controller that is homing answers no status question: the driver resets it and starts afresh."""
    world = World()
    with simulated(world, homing=True, homing_m_s=0.2) as wire:
        first = driver(wire.url, **AT_END)
        first.open()
        first.start_homing()
        wait_for(lambda: world.trolley_x_m.at() > 0, "homing")
        first.close()
        second = driver(wire.url, **AT_END)
        second.open()
        stood = world.trolley_x_m.at()
        time.sleep(0.05)
        assert world.trolley_x_m.at() == stood
        second.close()


def test_a_locked_controller_needs_a_decision() -> None:
    with simulated(World(), **HOMED) as wire, pytest.raises(DeviceRefused, match="in alarm"):
        driver(wire.url, origin_m=2.0).open()


def test_a_controller_that_restarts_while_homing_is_lost() -> None:
    with simulated(World(), homing=True, homing_m_s=0.2) as wire:
        trolley = driver(wire.url, **AT_END)
        trolley.open()
        trolley.start_homing()
        assert isinstance(wire.handler, Grbl)
        wire.handler.power_cycle()
        wire.wake()
        with pytest.raises(DeviceLost, match="restarted by itself"):
            until_still(trolley.poll)
        trolley.close()


# Soft limits


def test_soft_limits_narrow_the_rail() -> None:
    with simulated(World(), soft_limits=True, **HOMED) as wire:
        # The rail file believes in 5 m; the controller's travel of 4 m ends at its switch at x = 2 m.
        trolley = driver(wire.url, length_m=5.0, feed_m_s=5.0, **AT_END)
        trolley.open()
        assert trolley.limits_m == (-2.0, 2.0)
        with pytest.raises(DeviceRefused, match=r"outside the rail \(-2 to 2 m\)"):
            trolley.start_move(2.2)
        with pytest.raises(DeviceRefused, match="outside the rail"):
            trolley.start_jog(-2.2)
        trolley.close()
        with pytest.raises(DeviceRefused, match="leave nothing of the rail"):
            driver(wire.url, length_m=3.0, origin_m=-2.0, home_first=True).open()
        mirrored = driver(wire.url, length_m=5.0, direction=-1, origin_m=-2.0, home_first=True)
        mirrored.open()
        assert mirrored.limits_m == (-2.0, 2.0)
        mirrored.close()


def test_a_soft_limit_alarm_waits_for_a_reset() -> None:
    grbl = Grbl(World(), length_m=4.0, soft_limits=True, homing=True, homing_m_s=1e6)
    grbl.handle(b"$H\n")
    time.sleep(0.01)
    assert grbl.handle(b"").endswith(b"ok\r\n")
    assert grbl.handle(b"$J=G91 X10 F100\n") == b"error:15\r\n"
    assert grbl.handle(b"G53 G1 X5 F100\n") == b"ALARM:2\r\n[MSG:Reset to continue]\r\n"
    assert grbl.handle(b"?$X\n") == b""
    assert grbl.handle(b"\x18").endswith(b"Grbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n")
    assert grbl.handle(b"$X\n") == b"[MSG:Caution: Unlocked]\r\nok\r\n"


# Jogs


@both_kinds
def test_jog_by_hand(kind: Kind) -> None:
    world = World()
    with simulated(world, kind, acceleration_m_s2=5.0) as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_jog(2.0, speed_m_s=0.5)
        wait_for(lambda: world.trolley_x_m.at() > 0.1, "the jog")
        assert trolley.poll().state == "Jog"
        trolley.stop()  # the key is released
        fix = until_still(trolley.poll)
        assert fix.x_m == pytest.approx(world.trolley_x_m.at(), abs=3e-6)
        assert 0.1 < fix.x_m < 1.0
        trolley.start_jog(0.05)
        assert until_still(trolley.poll).x_m == pytest.approx(0.05, abs=3e-6)
        trolley.start_move(0.1)
        assert until_still(trolley.poll).x_m == pytest.approx(0.1, abs=3e-6)
        trolley.close()


def test_simulated_jogs_follow_the_firmware() -> None:
    grbl = Grbl(World(), length_m=4.0, origin_m=0.0, start_delay_s=0.0, hold_s=0.02)
    assert grbl.handle(b"$J=G91 X100\n") == b"error:22\r\n"  # a jog needs its own feed
    assert grbl.handle(b"$J=F100\n") == b"error:26\r\n"
    assert grbl.handle(b"$J=G1 X100 F100\n") == b"error:16\r\n"
    assert grbl.handle(b"$J=Xa F100\n") == b"error:2\r\n"
    assert grbl.handle(b"$J=G91 X100 F600\n") == b"ok\r\n"
    time.sleep(0.01)
    assert grbl.handle(b"?").startswith(b"<Jog|MPos:0.")
    assert grbl.handle(b"G1 X1 F100\n") == b"error:9\r\n"
    assert grbl.handle(b"$$\n") == b"error:8\r\n"
    assert grbl.handle(b"$J=G91 X1 F600\n") == b"ok\r\n"
    grbl.handle(b"\x85")  # jog cancel
    time.sleep(0.03)
    assert grbl.handle(b"?").startswith(b"<Idle|")
    assert grbl.handle(b"$J=G91 X1 F600\n") == b"ok\r\n"
    assert grbl.handle(b"\x18").startswith(b"ALARM:3\r\n")
    assert grbl.handle(b"$J=G91 X1 F600\n") == b"error:8\r\n"


# Ramps


@given(st.floats(0.0, 5000), st.floats(1, 1000), st.floats(10, 10_000))
def test_a_way_from_rest_to_rest(distance_mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> None:
    way = travel(distance_mm, speed_mm_s, acceleration_mm_s2)
    # Closed form: v/a + d/v with room for the full speed, else 2 sqrt(d/a).
    if distance_mm > speed_mm_s**2 / acceleration_mm_s2:
        seconds = speed_mm_s / acceleration_mm_s2 + distance_mm / speed_mm_s
    else:
        seconds = 2 * math.sqrt(distance_mm / acceleration_mm_s2)
    assert way.seconds == pytest.approx(seconds, rel=1e-9, abs=1e-12)
    assert way.distance_mm == pytest.approx(distance_mm, rel=1e-12, abs=1e-12)
    assert np.all(np.diff(way.t_s) >= -1e-12)
    assert np.all(np.diff(way.s_mm) >= -1e-9)
    assert way.speed_mm_s(way.seconds / 2) <= speed_mm_s * (1 + 1e-6)


def test_half_way_up_the_ramp() -> None:
    way = travel(1000.0, 100.0, 200.0)
    # s = a t^2 / 2 = 100 * 0.25^2 = 6.25 mm; straight pieces of 0.5/23 s deviate by at most a h^2 / 8.
    assert np.interp(0.25, way.t_s, way.s_mm) == pytest.approx(6.25, abs=200 * (0.5 / 23) ** 2 / 8)
    assert way.speed_mm_s(5.0) == pytest.approx(100.0)
    assert way.speed_mm_s(-1) == way.speed_mm_s(99) == 0.0
    cut = way.cut(500.0)
    # Half of the way takes half of the time.
    assert (cut.distance_mm, cut.seconds) == (500.0, pytest.approx(way.seconds / 2))
    # From 100 mm/s to rest in 0.5 s: 25 mm.
    assert braking(100.0, 0.5).distance_mm == pytest.approx(25.0)


def test_a_move_with_ramps_takes_its_time() -> None:
    world = World()
    world.trolley_x_m.hold(-2.0)
    with simulated(world, acceleration_m_s2=1.0, feed_limit_m_s=0.5) as wire:
        trolley = driver(wire.url, feed_m_s=0.5)
        trolley.open()
        started = time.monotonic()
        trolley.start_move(-1.75)
        until_still(trolley.poll)
        # From the left end over 0.25 m: sqrt(d a) = 0.5 m/s is just reached; 2 sqrt(0.25) = 1 s.
        assert time.monotonic() - started == pytest.approx(1.0, abs=0.25)
        trolley.close()


def test_a_stop_slows_down_along_the_ramp() -> None:
    world = World()
    with simulated(world, acceleration_m_s2=2.0, feed_limit_m_s=0.4) as wire:
        trolley = driver(wire.url, feed_m_s=0.4)
        trolley.open()
        trolley.start_move(1.5)
        time.sleep(0.4)
        before = world.trolley_x_m.at()
        trolley.stop()
        until_still(trolley.poll)
        # v^2 / 2a = 40 mm of braking; the hold goes out within some ms, at 0.4 m/s.
        assert world.trolley_x_m.at() - before == pytest.approx(0.04, abs=0.02)
        trolley.start_move(0.0)
        assert until_still(trolley.poll).x_m == pytest.approx(0.0, abs=3e-6)
        trolley.close()


def test_blocks_and_jogs_of_the_simulated_parser() -> None:
    parser = Parser()
    assert parser.block("G1X10F500") == Motion(10.0, "work", 500.0)
    assert parser.block("X20") == Motion(20.0, "work", 500.0)
    assert parser.block("G20G91G0X1") == Motion(25.4, "relative", math.inf)
    assert parser.jog("G21G90G53X5F60") == Motion(5.0, "machine", 60.0, jog=True)
    assert parser.jog("X1F1") == Motion(25.4, "relative", 25.4, jog=True)  # modes in force stay
    assert [parser.block(line) for line in ("G90", "F-1", "G0G1X1", "X1X2", "M3")] == [None, 4, 21, 25, 20]
