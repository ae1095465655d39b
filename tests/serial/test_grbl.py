"""GRBL driver against the simulated controller: moves, stops, alarms, restarts, lost lines."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator

import pytest
from grbl_helpers import BANNER, driver, simulated
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from serial_helpers import both_kinds, until_still, wait_for

from drivers.errors import DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.trolley.grbl import GrblTrolley
from hw_mocks.grbl import Grbl, start_grbl
from hw_mocks.wire import Kind, Wire, serve
from hw_mocks.world import World


@pytest.fixture
def rig() -> Iterator[tuple[World, Wire, GrblTrolley]]:
    world = World()
    with simulated(world) as wire:
        trolley = driver(wire.url)
        trolley.open()
        yield world, wire, trolley
        trolley.close()


@both_kinds
def test_moves_and_measures(kind: Kind) -> None:
    world = World()
    with start_grbl(world, length_m=4.0, feed_limit_m_s=10.0, kind=kind) as wire:
        trolley = driver(wire.url, feed_m_s=10.0)
        trolley.open()
        assert trolley.limits_m == (-2.0, 2.0)
        for x_m in (0.3048, -1.5240, -1.5240, 2.0, -2.0, 0.00001234):
            trolley.start_move(x_m)
            fix = until_still(trolley.poll)
            # Half a step of 1/250 mm; the driver rounds to 1 um, and reports come in 1 um.
            assert fix.x_m == pytest.approx(x_m, abs=3e-6)
            assert world.trolley_x_m.at() == pytest.approx(x_m, abs=3e-6)
            assert abs(time.monotonic_ns() - fix.t_host_ns) < 1e9
        trolley.close()


def test_a_fix_is_taken_at_its_time(rig: tuple[World, Wire, GrblTrolley]) -> None:
    world, _, trolley = rig
    trolley.start_move(1.0)
    for _ in range(20):
        time.sleep(0.01)
        fix = trolley.poll()
        if fix.state == "Run":
            # Speed 1 m/s times a round trip of at most 20 ms on a busy machine.
            assert fix.x_m == pytest.approx(world.trolley_x_m.at(fix.t_host_ns), abs=0.02)
            assert fix.sd_m >= 0.0005 / math.sqrt(3)


def test_ok_is_not_arrival() -> None:
    """A controller that reports Idle for a while after ok has not arrived."""
    world = World()
    with simulated(world, start_delay_s=0.15) as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_move(0.1)
        fix = trolley.poll()
        assert (fix.state, fix.moving) == ("Idle", True)
        assert until_still(trolley.poll).x_m == pytest.approx(0.1, abs=3e-6)
        trolley.close()


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("origin_m", [None, 0.25])
def test_direction_and_origin(direction: int, origin_m: float | None) -> None:
    # A simulated controller whose machine position grows to the left is one whose x axis is mirrored.
    world = World()
    machine_origin_m = (-2.0 if direction == 1 else 2.0) if origin_m is None else origin_m
    with serve(Grbl(world, length_m=8.0, feed_limit_m_s=5.0, origin_m=direction * machine_origin_m)) as wire:
        trolley = driver(wire.url, direction=direction, origin_m=origin_m, feed_m_s=5.0)
        trolley.open()
        trolley.start_move(1.25)
        assert until_still(trolley.poll).x_m == pytest.approx(1.25, abs=3e-6)
        assert direction * world.trolley_x_m.at() == pytest.approx(1.25, abs=3e-6)
        trolley.close()


def test_foreign_work_offsets_do_not_matter() -> None:
    world = World()
    with simulated(world, work_offset_mm=123.0, reports_work=True) as wire:
        trolley = driver(wire.url, feed_m_s=5.0)
        trolley.open()
        trolley.start_move(0.5)
        assert until_still(trolley.poll).x_m == pytest.approx(0.5, abs=3e-6)
        assert world.trolley_x_m.at() == pytest.approx(0.5, abs=3e-6)
        trolley.close()


@pytest.mark.parametrize("x_m", [2.0001, -2.0001, math.nan, math.inf])
def test_beyond_the_rail(rig: tuple[World, Wire, GrblTrolley], x_m: float) -> None:
    with pytest.raises(DeviceRefused, match="outside the rail"):
        rig[2].start_move(x_m)


@both_kinds
def test_stop_stops_within_300_ms_keeps_the_position_and_the_next_move_works(kind: Kind) -> None:
    world = World()
    with simulated(world, kind) as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_move(1.5)
        wait_for(lambda: world.trolley_x_m.at() > 0.1, "the move")
        started = time.monotonic()
        trolley.stop()
        assert time.monotonic() - started < 0.3
        fix = until_still(trolley.poll)
        assert time.monotonic() - started < 0.3
        stood = world.trolley_x_m.at()
        assert fix.x_m == pytest.approx(stood, abs=3e-6)
        time.sleep(0.05)
        assert world.trolley_x_m.at() == stood < 1.0
        trolley.start_move(-0.5)
        assert until_still(trolley.poll).x_m == pytest.approx(-0.5, abs=3e-6)
        trolley.close()


def test_a_move_right_after_a_stop(rig: tuple[World, Wire, GrblTrolley]) -> None:
    world, _, trolley = rig
    trolley.start_move(1.5)
    wait_for(lambda: world.trolley_x_m.at() > 0.05, "the move")
    trolley.stop()
    trolley.start_move(0.0)  # without a poll in between
    assert until_still(trolley.poll).x_m == pytest.approx(0.0, abs=3e-6)


def test_a_stop_between_ok_and_the_first_step() -> None:
    """A feed hold while still Idle is ignored by the firmware; the driver must not rely on it."""
    world = World()
    with simulated(world, start_delay_s=0.05) as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_move(1.5)
        trolley.stop()
        until_still(trolley.poll)
        stood = world.trolley_x_m.at()
        time.sleep(0.1)
        assert world.trolley_x_m.at() == stood < 0.3
        trolley.close()


def test_stop_from_another_thread_does_not_wait_for_a_slow_exchange() -> None:
    """While one thread waits a second for an answer that does not come, the hold byte goes out at once."""
    world = World()
    with simulated(world) as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_move(1.5)
        wait_for(lambda: world.trolley_x_m.at() > 0.05, "the move")
        wire.filter = lambda said: b""  # answers get lost, orders do not
        caught: list[DeviceError] = []

        def poll() -> None:
            try:
                trolley.poll()
            except DeviceError as error:
                caught.append(error)

        poller = threading.Thread(target=poll)
        poller.start()
        time.sleep(0.1)
        stopper = threading.Thread(target=trolley.stop)
        stopper.start()
        time.sleep(0.25)
        stood = world.trolley_x_m.at()
        time.sleep(0.05)
        assert world.trolley_x_m.at() == stood < 1.4
        poller.join(5)
        stopper.join(5)
        assert [type(error) for error in caught] == [DeviceTimeout]
        trolley.close()


def test_hitting_the_end_switch_is_an_alarm_with_a_mend() -> None:
    world = World()
    with serve(Grbl(world, length_m=0.4, feed_limit_m_s=5.0, origin_m=0.0)) as wire:
        trolley = driver(wire.url, origin_m=0.0)  # believes in a longer rail
        trolley.open()
        trolley.start_move(0.5)
        with pytest.raises(DeviceRefused, match=r"ALARM:1 \(a limit switch was hit.*\$X"):
            until_still(trolley.poll)
        with pytest.raises(DeviceRefused, match="in alarm"):
            trolley.poll()
        with pytest.raises(DeviceRefused, match=r"in alarm since ALARM:1.*\$X"):
            trolley.start_move(0.0)
        trolley.close()
        with pytest.raises(DeviceRefused, match=r"in alarm.*home it \(\$H\) or unlock it \(\$X\)"):
            trolley.open()
        unlocking = driver(wire.url, origin_m=0.0, unlock_at_open=True)
        unlocking.open()
        unlocking.start_move(0.0)
        assert until_still(unlocking.poll).x_m == pytest.approx(0.0, abs=3e-6)
        unlocking.close()


def test_a_controller_that_restarts_is_lost(rig: tuple[World, Wire, GrblTrolley]) -> None:
    _, wire, trolley = rig
    trolley.start_move(1.0)
    time.sleep(0.02)
    assert isinstance(wire.handler, Grbl)
    wire.handler.power_cycle()
    wire.wake()
    with pytest.raises(DeviceLost, match="restarted by itself, its position is no longer known"):
        until_still(trolley.poll)


def test_found_moving_at_open() -> None:
    world = World()
    with simulated(world) as wire:
        first = driver(wire.url)
        first.open()
        first.start_move(2.0)
        first.close()
        second = driver(wire.url)
        second.open()  # comes to a stand without an alarm
        fix = second.poll()
        assert (fix.moving, fix.state) == (False, "Idle")
        assert fix.x_m == pytest.approx(world.trolley_x_m.at(), abs=3e-6)
        assert fix.x_m < 2.0
        second.close()


@both_kinds
def test_unplugged_in_motion(kind: Kind) -> None:
    world = World()
    with simulated(world, kind) as wire:
        trolley = driver(wire.url)
        trolley.open()
        trolley.start_move(1.0)
        wire.unplug()
        with pytest.raises(DeviceLost):
            until_still(trolley.poll)
        with pytest.raises(DeviceLost):
            trolley.stop()
        trolley.make_safe()
        trolley.close()
        wire.plug()
        trolley.open()
        assert until_still(trolley.poll).x_m == pytest.approx(world.trolley_x_m.at(), abs=3e-6)
        trolley.close()


def test_an_arduino_that_restarts_with_its_port() -> None:
    """The port's opening resets an Arduino: silence, then the banner; questions in between are lost."""

    class Arduino(Grbl):
        ready_s = math.inf

        def handle(self, received: bytes) -> bytes:
            if received and self.ready_s == math.inf:
                self.ready_s = time.monotonic() + 0.6
            if time.monotonic() < self.ready_s:
                return b""
            if self.ready_s > 0:
                self.ready_s = 0.0
                return super().handle(b"\x18")
            return super().handle(received)

        def due_s(self) -> float | None:
            return 0.02

    with serve(Arduino(World(), length_m=4.0)) as wire:
        trolley = driver(wire.url)
        assert trolley.open().name == "Grbl 1.1h"
        trolley.close()


def test_fuzz_answers() -> None:
    with simulated(World()) as wire:
        trolley = driver(wire.url, timeout_s=0.02, poll_interval_s=1e-9)
        trolley.open()

        @given(
            garbage=st.one_of(
                st.binary(max_size=40),
                st.from_regex(
                    rb"(<(Idle|Run|Hold:0|Alarm|Sleep)\|[MW]Pos:[-0-9.,]{1,12}(\|FS:0,0)?>|ok|error:\d\d?)\r\n"
                ),
                st.sampled_from([b"ALARM:3\r\n", BANNER, b"[MSG:x]\r\nok\r\n", b"<\r\n", b"ok\r\nok\r\n"]),
            )
        )
        @settings(max_examples=50, deadline=None, suppress_health_check=list(HealthCheck))
        def anything(garbage: bytes) -> None:
            wire.filter = lambda _: garbage
            for act in (trolley.poll, lambda: trolley.start_move(0.5), trolley.poll, trolley.stop, trolley.poll):
                try:
                    fix = act()
                except DeviceError:
                    continue
                assert fix is None or math.isfinite(fix.x_m)

        anything()
        trolley.close()
