"""Dow-Key MS: exact bytes, then the driver against the simulated matrix. Commands: the maker's table of commands."""

from __future__ import annotations

import time

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from serial_helpers import Script, both_kinds

from drivers.contracts import Switches
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.records import Channel
from drivers.switches.dowkey_ms import DowKeyMs
from hw_mocks.switch_box import SwitchBox, start_switch_box
from hw_mocks.wire import Kind, serve
from hw_mocks.world import World

GREETING = [(b"*IDN?\r\n", b"MS-2T\r\n"), (b"SYST:ERR?\r\n", b"0,NO ERROR\r\n")]
BOTH_AT_H = [(b":SWITCH1?\r\n", b"1\r\n"), (b":SWITCH2?\r\n", b"1\r\n")]


def driver(url: str, **options: object) -> DowKeyMs:
    return DowKeyMs(DowKeyMs.Options(port=url, **({"settle_s": 0.02, "timeout_s": 1.0} | options)))  # type: ignore[arg-type]


@both_kinds
def test_exact_bytes(kind: Kind) -> None:
    script = Script(
        *GREETING,
        *BOTH_AT_H,
        # HV: transmit stays at H, only the receive switch is told to change.
        *BOTH_AT_H,
        (b":SWITCH2 2\r\n", b""),
        (b"*OPC?\r\n", b"0\r\n"),
        (b"*OPC?\r\n", b"1\n"),
        (b":SWITCH1?\r\n", b"1\r"),
        (b":SWITCH2?\r\n", b"2\r\n"),
        # HV again: nothing is told to change.
        (b":SWITCH1?\r\n", b"1\r\n"),
        (b":SWITCH2?\r\n", b"2\r\n"),
        (b":SWITCH1?\r\n", b"1\r\n"),
        (b":SWITCH2?\r\n", b"2\r\n"),
    )
    with serve(script, kind=kind) as wire:
        switches = driver(wire.url)
        assert isinstance(switches, Switches)
        identity = switches.open()
        assert (identity.kind, identity.driver, identity.name) == ("switches", "dowkey_ms", "MS-2T")
        for _ in range(2):
            state = switches.select(Channel.HV)
            assert (state.transmit, state.receive, state.verified) == ("H", "V", True)
        switches.close()
    script.check()


def test_exact_bytes_without_verification() -> None:
    script = Script(*GREETING, (b":SWITCH4 2\r\n", b""), (b":SWITCH7 1\r\n", b""), (b":SWITCH7 2\r\n", b""))
    with serve(script) as wire:
        switches = driver(
            wire.url, transmit_switch=4, receive_switch=7, h_position=1, v_position=2, verify=False, settle_s=0.0
        )
        switches.open()
        assert switches.select(Channel.VH).verified is False
        switches.select(Channel.VV)
        switches.close()
    script.check()


@both_kinds
def test_all_channels_on_the_simulated_matrix(kind: Kind) -> None:
    world = World()
    with start_switch_box(world, kind=kind) as wire:
        switches = driver(wire.url)
        switches.open()
        for channel in (Channel.VV, Channel.HV, Channel.HH, Channel.VH):
            state = switches.select(channel)
            assert (state.transmit, state.receive, state.verified) == (*channel.name, True)
            assert world.transmit.at() + world.receive.at() == channel.name
            asked = switches.state()
            assert (asked.transmit, asked.receive) == tuple(channel.name)
        switches.make_safe()
        assert world.transmit.at() + world.receive.at() == "HH"
        switches.close()
        switches.close()


def test_route_is_unknown_while_contacts_travel() -> None:
    world = World()
    box = SwitchBox(world, actuation_s=0.03)
    assert box.handle(b":SWITCH1?;*OPC?\r") == b"1\r\n1\r\n"
    assert box.handle(b"ROUTE:SWITCH1 2\n:SWITCH1?\n*OPC?\n") == b"255\r\n0\r\n"
    assert (world.transmit.at(), world.receive.at()) == ("?", "H")
    time.sleep(0.035)
    assert box.handle(b":switch1?\r\n*OPC?\r\n") == b"2\r\n1\r\n"
    assert world.transmit.at() == "V"
    assert box.handle(b"*RST\n") == b""
    time.sleep(0.035)
    assert box.handle(b":SWITCH1?\n") == b"1\r\n"


def test_simulated_error_queue_is_first_in_first_out() -> None:
    box = SwitchBox(World())
    assert box.handle(b"FOO\n:SWITCH9 1\n:SWITCH1 3\nSYST:ERR?\nSYST:ERR?\nSYST:ERR?\nSYST:ERR?\n") == (
        b"-4,SYNTAX ERROR\r\n-3,SWITCH NUMBER OUT OF RANGE\r\n-5,POSITION OUT OF RANGE\r\n0,NO ERROR\r\n"
    )


@both_kinds
def test_settles_before_it_verifies(kind: Kind) -> None:
    world = World()
    with start_switch_box(world, actuation_s=0.03, kind=kind) as wire:
        switches = driver(wire.url, settle_s=0.1)
        switches.open()
        started = time.monotonic()
        switches.select(Channel.VV)
        assert 0.1 <= time.monotonic() - started < 0.5
        started = time.monotonic()
        switches.select(Channel.VV)  # nothing to change, nothing to wait for
        assert time.monotonic() - started < 0.1
        switches.close()


def test_a_jammed_switch_times_out_and_recovers() -> None:
    box = SwitchBox(World())
    with serve(box) as wire:
        switches = driver(wire.url, timeout_s=0.3)
        switches.open()
        box.jam(2)
        with pytest.raises(DeviceTimeout, match=r"have not finished after 0.3 s.*sticks"):
            switches.select(Channel.HV)
        with pytest.raises(DeviceRefused, match=r"switch 2 does not know its position \(255\)"):
            switches.state()
        switches.make_safe()  # does not raise
        box.jam(2, jammed=False)
        assert switches.select(Channel.HV).receive == "V"
        switches.close()


def test_a_wrong_position_quotes_the_units_errors() -> None:
    script = Script(
        *GREETING,
        *BOTH_AT_H,
        *BOTH_AT_H,
        (b":SWITCH1 2\r\n", b""),
        (b"*OPC?\r\n", b"1\r\n"),
        (b":SWITCH1?\r\n", b"1\r\n"),
        (b"SYST:ERR?\r\n", b"-7,NO SUPPLY\r\n"),
        (b"SYST:ERR?\r\n", b"+0,No error\r\n"),
    )
    with serve(script) as wire:
        switches = driver(wire.url)
        switches.open()
        with pytest.raises(DeviceRefused, match=r"switch 1 stands at 1 instead of 2.*-7,NO SUPPLY"):
            switches.select(Channel.VH)
        switches.close()
    script.check()


@pytest.mark.parametrize("answer", [b"one\r\n", b"-1\r\n", b"1.5\r\n", b"1 2\r\n", b"\xb9\r\n", b"99999\r\n"])
def test_nonsense_positions_are_bad_answers(answer: bytes) -> None:
    with serve(Script(*GREETING, *BOTH_AT_H, (b":SWITCH1?\r\n", answer))) as wire:
        switches = driver(wire.url)
        switches.open()
        with pytest.raises(DeviceBadAnswer):
            switches.state()
        switches.close()


def test_an_error_queue_without_end_is_left_alone() -> None:
    endless = [(b"SYST:ERR?\r\n", b"-4,SYNTAX ERROR\r\n")] * 20
    with serve(Script(GREETING[0], *endless, *BOTH_AT_H)) as wire:
        switches = driver(wire.url)
        switches.open()
        switches.close()


@both_kinds
def test_unplugged(kind: Kind) -> None:
    with start_switch_box(World(), kind=kind) as wire:
        switches = driver(wire.url)
        switches.open()
        wire.unplug()
        with pytest.raises(DeviceLost):
            switches.select(Channel.VV)
        switches.make_safe()
        switches.close()
        wire.plug()
        switches.open()
        assert switches.select(Channel.VV).verified
        switches.close()


def test_somebody_else_or_nobody_on_the_port() -> None:
    with serve(Script()) as wire, pytest.raises(DeviceTimeout):
        driver(wire.url).open()
    with serve(Script((b"*IDN?\r\n", b"hello\r\n"), (b"SYST:ERR?\r\n", b"what?\r\n"))) as wire:
        switches = driver(wire.url)
        with pytest.raises(DeviceBadAnswer):
            switches.open()
        with pytest.raises(DeviceLost):  # a failed opening leaves the port closed
            switches.state()


def test_fuzz_answers() -> None:
    box = SwitchBox(World(), actuation_s=0.0)
    with serve(box) as wire:
        switches = driver(wire.url, timeout_s=0.02, settle_s=0.0)
        switches.open()

        @given(
            garbage=st.one_of(
                st.binary(max_size=30),
                st.from_regex(rb"[0-9]{0,4}[,;:x]?[01]?\r\n", fullmatch=True),
                st.sampled_from([b"255\r\n", b"0\r\n", b"1\r\n", b"2\r\n"]),
            )
        )
        @settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
        def anything(garbage: bytes) -> None:
            wire.filter = lambda _: garbage
            for act in (switches.state, lambda: switches.select(Channel.VV)):
                try:
                    state = act()
                except DeviceError:
                    continue
                # Only what the driver understood may come back, and a verified VV was really answered as such.
                assert {state.transmit, state.receive} <= {"H", "V"}

        anything()
        switches.close()


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"transmit_switch": 2}, "transmit_switch and receive_switch are both 2"),
        ({"v_position": 1}, "h_position and v_position are both 1"),
        ({"settle_s": 0.6}, "settle_s: found 0.6, allowed: at most 0.5"),
        ({"settle_s": float("nan")}, "settle_s: found nan, allowed: a finite number"),
        ({"timeout_s": 0.0}, "timeout_s: found 0.0, allowed: greater than 0"),
    ],
)
def test_wrong_options(wrong: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        driver("unused", **wrong)
