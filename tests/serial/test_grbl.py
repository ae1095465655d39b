"""GRBL 1.1: the parser, exact bytes, the simulated controller against the firmware's transcript, driver against both.

The transcript lines are those of real GRBL 1.1h firmware.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from serial_helpers import Script, both_kinds, until_still, wait_for

from drivers.contracts import Trolley
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.trolley.grbl import GrblTrolley
from drivers.trolley.grbl_protocol import explain, parse_report, parse_setting
from hw_mocks.grbl import Grbl, start_grbl
from hw_mocks.wire import Kind, Wire, serve
from hw_mocks.world import World

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
IDLE = b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n"
OPENING = [
    (b"?", IDLE),
    (b"!", b""),
    (b"?", IDLE),
    (b"\x18", BANNER),
    (b"?", b"<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n"),
    (b"$I\n", b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"),
    (b"$$\n", b"$13=0\r\n$100=250.000\r\n$110=6000.000\r\nok\r\n"),
    (b"?", IDLE),
]


def driver(url: str, **options: Any) -> GrblTrolley:
    given = {"length_m": 4.0, "feed_m_s": 1.0, "timeout_s": 1.0, "poll_interval_s": 0.005} | options
    return GrblTrolley(GrblTrolley.Options(port=url, **given))


def simulated(world: World, kind: Kind | None = None, **options: Any) -> Wire:
    return serve(Grbl(world, **({"length_m": 4.0, "feed_limit_m_s": 5.0} | options)), kind=kind)


@pytest.fixture
def rig() -> Iterator[tuple[World, Wire, GrblTrolley]]:
    world = World()
    with simulated(world) as wire:
        trolley = driver(wire.url)
        trolley.open()
        yield world, wire, trolley
        trolley.close()


# The parser


def test_reports_of_the_real_firmware() -> None:
    report = parse_report("<Run|MPos:2.260,0.000,0.000|FS:432,0|Pn:RHS|Ov:100,100,100>", None, "here")
    assert (report.state, report.substate, report.machine_mm) == ("Run", None, (2.26, 0.0, 0.0))
    assert parse_report("<Hold:1|MPos:1.000,0.000,0.000|FS:0,0>", None, "here").name == "Hold:1"
    assert parse_report("<Alarm|MPos:-5.5,0,0>", None, "here").machine_mm == (-5.5, 0.0, 0.0)


def test_work_offset_is_remembered() -> None:
    # Machine position = work position + offset (GRBL 1.1 interface description).
    unknown = parse_report("<Idle|WPos:1.000,2.000,3.000|FS:0,0>", None, "here")
    assert unknown.machine_mm is None
    first = parse_report("<Idle|WPos:1.000,2.000,3.000|FS:0,0|WCO:10.000,0.000,-1.000>", None, "here")
    assert first.machine_mm == (11.0, 2.0, 2.0)
    later = parse_report("<Run|WPos:2.000,2.000,3.000|FS:10,0>", first.work_offset_mm, "here")
    assert later.machine_mm == (12.0, 2.0, 2.0)


@pytest.mark.parametrize(
    "line",
    ["<>", "<Idle>", "<Idle,MPos:0.000,0.000,0.000>", "<Idle|MPos:a,b,c>", "<Idle|MPos:nan,0,0>", "<Idle|MPos:>",
     "<Idle|FS:0,0>", "<idle|MPos:0,0,0>", "<Idle|MPos:1,2,3", "<Idle|WPos:1,2,3|WCO:1>", "<Idle|MPos:1,2,3,4,5,6,7>"],
)  # fmt: skip
def test_what_is_no_report(line: str) -> None:
    with pytest.raises(DeviceBadAnswer, match="here"):
        parse_report(line, None, "here")


@given(st.one_of(st.text(max_size=60), st.from_regex(r"<[A-Z][a-z]{1,6}(:\d)?(\|[MW](Pos|CO):[-\d.,e]{0,12}){0,3}>")))
@settings(max_examples=150, deadline=None)
def test_fuzz_reports(line: str) -> None:
    explain(line)
    parse_setting(line)
    try:
        report = parse_report(line, (1.0, 2.0, 3.0), "here")
    except DeviceBadAnswer:
        return
    assert report.machine_mm is not None
    assert all(math.isfinite(mm) for mm in report.machine_mm)


def test_words_for_codes() -> None:
    assert explain("error:9") == "error:9 (G-code is locked while it is in alarm or jogging)"
    assert explain("ALARM:3") == "ALARM:3 (it was reset while moving, the position is probably lost)"
    assert "does not list" in explain("error:99")
    assert explain("error:") == "error:"


# Exact bytes


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


# The simulated controller against the transcript


def test_the_simulation_answers_as_the_transcript() -> None:
    grbl = Grbl(World(), length_m=4.0, origin_m=0.0, start_delay_s=0.0, hold_s=0.05)
    assert grbl.handle(b"\x18") == BANNER
    assert grbl.handle(b"$I\n") == b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"
    assert grbl.handle(b"$H\n") == b"error:5\r\n"
    assert grbl.handle(b"G91\nG1 X100 F500\n") == b"ok\r\nok\r\n"
    time.sleep(0.02)
    assert grbl.handle(b"?").startswith(b"<Run|MPos:0.")
    assert grbl.handle(b"$H\n") == b"error:8\r\n"
    assert grbl.handle(b"!?").startswith(b"<Hold:1|")
    assert grbl.handle(b"~?").startswith(b"<Hold:1|")  # a resume during Hold:1 is ignored
    time.sleep(0.06)
    assert grbl.handle(b"?").startswith(b"<Hold:0|")
    assert grbl.handle(b"~?").startswith(b"<Run|")
    assert grbl.handle(b"\x18") == b"ALARM:3\r\n" + BANNER + b"[MSG:'$H'|'$X' to unlock]\r\n"
    assert grbl.handle(b"G1 X1 F100\n") == b"error:9\r\n"
    assert grbl.handle(b"?").startswith(b"<Alarm|")
    assert grbl.handle(b"$X\n") == b"[MSG:Caution: Unlocked]\r\nok\r\n"
    assert grbl.handle(b"G5 X1\n") == b"error:20\r\n"
    assert grbl.handle(b"G1 Xa F1\n") == b"error:2\r\n"
    assert grbl.handle(b"12\n") == b"error:1\r\n"
    assert grbl.handle(b"G1 X1\n") == b"error:22\r\n"  # the reset forgot the feed
    assert grbl.handle(b"$Q\n\n") == b"error:3\r\nok\r\n"


def test_the_simulation_keeps_its_position_over_a_reset_in_a_finished_hold() -> None:
    world = World()
    grbl = Grbl(world, length_m=4.0, origin_m=0.0, start_delay_s=0.0, hold_s=0.01)
    grbl.handle(b"G1 X1000 F6000\n")
    time.sleep(0.03)
    grbl.handle(b"!")
    time.sleep(0.02)
    held = world.trolley_x_m.at()
    assert grbl.handle(b"?").startswith(b"<Hold:0|")
    assert grbl.handle(b"\x18") == BANNER
    assert grbl.handle(b"?").startswith(b"<Idle|")
    assert world.trolley_x_m.at() == held > 0


def test_offset_comes_only_in_some_simulated_reports() -> None:
    grbl = Grbl(World(), length_m=4.0)
    reports = [grbl.handle(b"?") for _ in range(25)]
    with_offset = [b"WCO:" in report for report in reports]
    assert with_offset[0]
    assert sum(with_offset) == 3  # every tenth while idle
    assert any(b"Ov:" in report for report in reports)


def test_the_simulated_planner_takes_fifteen_moves() -> None:
    grbl = Grbl(World(), length_m=4.0)
    assert grbl.handle(b"G91 G1 X1 F60\n" * 20) == b"ok\r\n" * 15


# Driver against simulation


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
        with pytest.raises(DeviceRefused, match=r"error:9.*\$X"):
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


def test_nobody_answers() -> None:
    with serve(Script()) as wire:
        started = time.monotonic()
        with pytest.raises(DeviceTimeout, match="no GRBL controller answers"):
            driver(wire.url, timeout_s=0.1).open()
        assert time.monotonic() - started < 4


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
