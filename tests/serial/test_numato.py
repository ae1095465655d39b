"""Numato relay module: exact bytes, then the driver against the simulated module. Protocol: the maker's user guide."""

from __future__ import annotations

import time

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from serial_helpers import Script, both_kinds

from drivers.contracts import Switches
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.records import Channel
from drivers.switches.numato_relay import NumatoRelay
from hw_mocks.numato import RelayModule, start_relays
from hw_mocks.wire import Kind, serve
from hw_mocks.world import World

LATCHING = {"transmit_h_relay": 2, "receive_h_relay": 3, "pulse_s": 0.03}


def driver(url: str, **options: object) -> NumatoRelay:
    given = {"settle_s": 0.03, "stagger_s": 0.0, "timeout_s": 1.0} | options
    return NumatoRelay(NumatoRelay.Options(port=url, **given))  # type: ignore[arg-type]


def said(command: bytes, answer: bytes = b"") -> tuple[bytes, bytes]:
    """A command, and what the module sends: its echo, the answer, the prompt."""
    return command + b"\r", command + (b"\n\r" + answer if answer else b"") + b"\n\r>"


GREETING = [(b"\r", b"\n\r>"), said(b"ver", b"00000009")]


@both_kinds
def test_exact_bytes_of_fail_safe_switches(kind: Kind) -> None:
    script = Script(
        *GREETING,
        said(b"relay read 4", b"off"),
        said(b"relay read B", b"off"),  # relay 11
        # HV: only the receive switch must change; its relay is read back.
        said(b"relay read 4", b"off"),
        said(b"relay read B", b"off"),
        said(b"relay on B"),
        said(b"relay read B", b"on"),
        said(b"relay read 4", b"off"),
        said(b"relay read B", b"on"),
    )
    with serve(script, kind=kind) as wire:
        switches = driver(wire.url, transmit_v_relay=4, receive_v_relay=11)
        assert isinstance(switches, Switches)
        identity = switches.open()
        assert (identity.kind, identity.driver) == ("switches", "numato_relay")
        assert identity.name == "Numato relay module 00000009"
        assert identity.detail.startswith("fail-safe switches, ")
        state = switches.select(Channel.HV)
        # The module does not see the RF contacts.
        assert (state.transmit, state.receive, state.verified) == ("H", "V", False)
        assert switches.state().receive == "V"
        switches.close()
    script.check()


def test_exact_bytes_of_a_latching_switch_break_before_make() -> None:
    script = Script(
        *GREETING,
        *[said(b"relay read %d" % n, b"off") for n in (2, 0, 3, 1)],
        # Both are unknown at first: the other coil is opened and read back before one gets its pulse.
        said(b"relay off 0"),
        said(b"relay read 0", b"off"),
        said(b"relay on 2"),
        said(b"relay read 2", b"on"),
        said(b"relay off 2"),
        said(b"relay read 2", b"off"),
        said(b"relay off 3"),
        said(b"relay read 3", b"off"),
        said(b"relay on 1"),
        said(b"relay read 1", b"on"),
        said(b"relay off 1"),
        said(b"relay read 1", b"off"),
        said(b"ver", b"00000009"),
    )
    with serve(script) as wire:
        switches = driver(wire.url, **LATCHING)
        switches.open()
        assert switches.select(Channel.HV).verified is False
        assert switches.select(Channel.HV).receive == "V"  # nothing to change, nothing sent
        assert switches.state().transmit == "H"
        switches.close()
    script.check()


@both_kinds
@pytest.mark.parametrize("latching", [False, True])
def test_all_channels_on_the_simulated_module(kind: Kind, latching: bool) -> None:
    world = World()
    with start_relays(world, latching=latching, kind=kind) as wire:
        switches = driver(wire.url, **(LATCHING if latching else {}))
        switches.open()
        for channel in (Channel.VV, Channel.HV, Channel.HH, Channel.VH, Channel.VH):
            state = switches.select(channel)
            assert (state.transmit, state.receive, state.verified) == (*channel.name, False)
            assert world.transmit.at() + world.receive.at() == channel.name
            asked = switches.state()
            assert (asked.transmit, asked.receive) == tuple(channel.name)
        switches.make_safe()
        assert world.transmit.at() + world.receive.at() == "HH"
        assert switches.cycles["transmit"] >= 3
        switches.close()
        switches.close()
        assert isinstance(wire.handler, RelayModule)
        assert wire.handler.both_coils == 0
        assert wire.handler.handle(b"relay readall\r").endswith(b"00\n\r>")  # no current is left on


def test_the_route_of_latching_switches_is_unknown_at_first() -> None:
    with start_relays(World(), latching=True) as wire:
        switches = driver(wire.url, **LATCHING)
        switches.open()
        with pytest.raises(DeviceRefused, match="latching switches cannot be asked"):
            switches.state()
        switches.close()


def test_a_coil_that_keeps_its_current_bars_the_other_one() -> None:
    module = RelayModule(World(), latching=True)
    with serve(module) as wire:
        switches = driver(wire.url, **LATCHING)
        switches.open()
        switches.select(Channel.VH)
        module.handle(b"relay on 0\r")
        module.welded.add(0)
        with pytest.raises(DeviceRefused, match="relay 0 is closed although it was told otherwise"):
            switches.select(Channel.HH)
        assert module.both_coils == 0
        assert module.handle(b"relay read 2\r").endswith(b"off\n\r>")
        switches.close()


def test_a_relay_that_does_not_close_is_refused() -> None:
    module = RelayModule(World())
    module.welded.add(1)
    with serve(module) as wire:
        switches = driver(wire.url)
        switches.open()
        with pytest.raises(DeviceRefused, match="relay 1 is open although it was told otherwise"):
            switches.select(Channel.HV)
        switches.make_safe()
        switches.close()


def test_contacts_that_stick_are_not_seen_and_not_claimed() -> None:
    world = World()
    with start_relays(world) as wire:
        switches = driver(wire.url)
        switches.open()
        assert isinstance(wire.handler, RelayModule)
        wire.handler._switches.jam(2, True)
        assert switches.select(Channel.HV).verified is False
        assert world.receive.at() == "?"
        switches.close()


@pytest.mark.parametrize("answer", [b"", b"maybe", b"on off", b"\xff", b"1" * 60])
def test_nonsense_is_a_bad_answer(answer: bytes) -> None:
    opening = [*GREETING, said(b"relay read 0", b"off"), said(b"relay read 1", b"off")]
    with serve(Script(*opening, said(b"relay read 0", answer))) as wire:
        switches = driver(wire.url)
        switches.open()
        with pytest.raises((DeviceBadAnswer, DeviceTimeout)):
            switches.state()
        switches.close()


def test_a_device_without_echo_is_somebody_else() -> None:
    other = Script((b"\r", b">"), (b"ver\r", b"hello\r\n>"))
    with serve(other) as wire, pytest.raises(DeviceBadAnswer, match="not the echo of 'ver'"):
        driver(wire.url).open()
    with serve(Script()) as wire, pytest.raises(DeviceTimeout):
        driver(wire.url).open()


def test_half_a_command_that_somebody_typed_does_not_matter() -> None:
    module = RelayModule(World())
    module.handle(b"relay o")
    with serve(module) as wire:
        switches = driver(wire.url)
        switches.open()
        assert switches.state().transmit == "H"
        switches.close()


@both_kinds
def test_unplugged(kind: Kind) -> None:
    with start_relays(World(), kind=kind) as wire:
        switches = driver(wire.url)
        switches.open()
        wire.unplug()
        with pytest.raises(DeviceLost):
            switches.select(Channel.VV)
        switches.make_safe()
        switches.close()
        wire.plug()
        switches.open()
        assert switches.select(Channel.VV).transmit == "V"
        switches.close()


def test_fuzz_answers() -> None:
    with start_relays(World()) as wire:
        switches = driver(wire.url, timeout_s=0.02, settle_s=0.0)
        switches.open()

        @given(
            garbage=st.one_of(
                st.binary(max_size=40),
                st.from_regex(rb"relay (read|on|off) [01](\n\r(on|off|[0-9A-F]{1,8}))?\n\r>?", fullmatch=True),
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
                assert {state.transmit, state.receive} <= {"H", "V"}
                assert state.verified is False

        anything()
        switches.close()


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"receive_v_relay": 0}, "relays: found 0, 0, allowed: each number once"),
        ({"transmit_h_relay": 2}, "found one, allowed: both or neither"),
        ({"transmit_v_relay": 32}, "transmit_v_relay: found 32, allowed: at most 31"),
        ({"transmit_h_relay": 2, "receive_h_relay": 3, "pulse_s": 0.2, "settle_s": 0.2}, r"2 pulse_s: found 0\.6"),
    ],
)
def test_wrong_options(wrong: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        driver("unused", **wrong)


def test_the_simulated_module_follows_the_protocol() -> None:
    world = World()
    module = RelayModule(world, actuation_s=0.0)
    assert module.handle(b"relay on 1\r") == b"relay on 1\n\r>"
    assert module.handle(b"relay read 1\r") == b"relay read 1\n\ron\n\r>"
    assert module.handle(b"relay readall\r") == b"relay readall\n\r02\n\r>"
    assert module.handle(b"relay writeall 01\r") == b"relay writeall 01\n\r>"
    assert module.handle(b"relay readall\r") == b"relay readall\n\r01\n\r>"
    assert (world.transmit.at(), world.receive.at()) == ("V", "H")
    assert module.handle(b"relay read 9\rfoo\r") == b"relay read 9\n\r>foo\n\r>"
    assert RelayModule(World(), relays=32).handle(b"relay readall\r") == b"relay readall\n\r00000000\n\r>"


def test_a_pulse_that_is_too_short_moves_no_simulated_contacts() -> None:
    world = World()
    module = RelayModule(world, latching=True, actuation_s=0.03)
    module.handle(b"relay on 0\rrelay off 0\r")
    time.sleep(0.05)
    module.handle(b"")
    assert world.transmit.at() == "H"
    module.handle(b"relay on 0\r")
    time.sleep(0.035)
    module.handle(b"relay off 0\r")
    assert world.transmit.at() == "V"
    assert module.both_coils == 0
    module.handle(b"relay on 0\rrelay on 2\r")
    assert module.both_coils == 1
