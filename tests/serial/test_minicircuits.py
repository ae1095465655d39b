"""Mini-Circuits RC box: exact bytes over HTTP and Telnet, then the driver against the simulated box.

Commands: the maker's programming manual of its switch boxes.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal
from urllib.request import ProxyHandler, build_opener

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from serial_helpers import Script, keep_trying

from drivers.contracts import Switches
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.records import Channel
from drivers.switches.minicircuits_rc import MiniCircuitsRc
from hw_mocks.faults import FaultKind
from hw_mocks.minicircuits import RcBox, host_and_port, start_rc_box
from hw_mocks.wire import Wire, serve
from hw_mocks.world import World

Protocol = Literal["http", "telnet"]
both = pytest.mark.parametrize("protocol", ["http", "telnet"])


def driver(wire: Wire, protocol: Protocol, **options: object) -> MiniCircuitsRc:
    host, port = host_and_port(wire)
    given = {"settle_s": 0.03, "stagger_s": 0.0, "timeout_s": 1.0} | options
    return MiniCircuitsRc(MiniCircuitsRc.Options(host=host, port=port, connection=protocol, **given))  # type: ignore[arg-type]


def turns(protocol: Protocol, *talk: tuple[str, str]) -> list[tuple[bytes, bytes]]:
    """Questions and answers as they are on the wire."""
    if protocol == "telnet":
        return [(f"{question}\r\n".encode(), f"{answer}\r\n".encode()) for question, answer in talk]
    head = "HTTP/1.0\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
    reply = "HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n{}"
    return [(f"GET /{q} {head}".encode(), reply.format(len(a), a).encode()) for q, a in talk]


GREETING = [("MN?", "MN=RC-2MTS-18"), ("SN?", "SN=11600000001"), ("FIRMWARE?", "C8"), ("HEATALARM?", "0"),
            ("SWPORT?", "0"), ("TEMP1?", "+31.50")]  # fmt: skip


@both
def test_exact_bytes(protocol: Protocol) -> None:
    talk = [
        *GREETING,
        # HV: bit 1 is switch B, the receive switch.
        ("SWPORT?", "0"), ("HEATALARM?", "0"), ("SETB=1", "1"), ("SWPORT?", "2"),
        # HV again: nothing to change. Then VH: transmit first.
        ("SWPORT?", "2"),
        ("SWPORT?", "2"), ("HEATALARM?", "0"), ("SETA=1", "1"), ("SETB=0", "1"), ("SWPORT?", "1"),
        ("SWPORT?", "5"),  # switch C is somebody else's
    ]  # fmt: skip
    script = Script(*turns(protocol, *talk))
    with serve(script, kind="tcp") as wire:
        switches = driver(wire, protocol)
        assert isinstance(switches, Switches)
        identity = switches.open()
        assert (identity.kind, identity.driver, identity.name) == (
            "switches", "minicircuits_rc", "RC-2MTS-18 11600000001")  # fmt: skip
        assert identity.detail.startswith("firmware C8, 31.5 degrees C, switch A at 0, switch B at 0, ")
        for channel in (Channel.HV, Channel.HV, Channel.VH):
            state = switches.select(channel)
            assert (state.transmit, state.receive, state.verified) == (*channel.name, True)
        assert switches.state().transmit == "V"
        switches.close()
    script.check()


@both
def test_all_channels_on_the_simulated_box(protocol: Protocol) -> None:
    world = World()
    with start_rc_box(world, protocol=protocol) as wire:
        switches = driver(wire, protocol, first="receive", stagger_s=0.03)
        switches.open()
        for channel in (Channel.VV, Channel.HV, Channel.HH, Channel.VH):
            switches.select(channel)
            assert world.transmit.at() + world.receive.at() == channel.name
            asked = switches.state()
            assert (asked.transmit, asked.receive, asked.verified) == (*channel.name, True)
        assert switches.temperature_c() == 31.5
        # VV: A and B; HV: A; HH: B; VH: A.
        assert switches.cycles == {"A": 3, "B": 2}
        switches.make_safe()
        assert world.transmit.at() + world.receive.at() == "HH"
        switches.close()
        switches.close()


def test_other_switches_and_inverted_states() -> None:
    script = Script(*turns("telnet", *GREETING[:-2], ("SWPORT?", "12"), ("TEMP1?", "20"),
                           ("SWPORT?", "12"), ("HEATALARM?", "0"), ("SETD=0", "1"), ("SWPORT?", "4")))  # fmt: skip
    with serve(script, kind="tcp") as wire:
        switches = driver(wire, "telnet", transmit_switch="D", receive_switch="C", h_state=1)
        switches.open()
        assert switches.select(Channel.VH).transmit == "V"
        switches.close()
    script.check()


@both
def test_heat_alarm_is_refused_with_the_reason(protocol: Protocol) -> None:
    world = World()
    with start_rc_box(world, protocol=protocol) as wire:
        switches = driver(wire, protocol)
        switches.open()
        wire.faults.start(FaultKind.HEAT_ALARM, amount=71.25)
        with pytest.raises(DeviceRefused, match=r"heat alarm at 71.2 degrees C.*let it cool down"):
            switches.select(Channel.VV)
        assert world.transmit.at() + world.receive.at() == "HH"
        switches.select(Channel.HH)  # nothing has to move
        switches.close()
        with pytest.raises(DeviceRefused, match="heat alarm"):
            switches.open()
        wire.faults.stop(FaultKind.HEAT_ALARM)
        switches.open()
        assert switches.select(Channel.VV).verified
        switches.close()


@both
def test_a_stuck_switch_is_refused(protocol: Protocol) -> None:
    with start_rc_box(World(), protocol=protocol) as wire:
        switches = driver(wire, protocol)
        switches.open()
        wire.faults.start(FaultKind.STUCK_SWITCH, amount=2)
        with pytest.raises(DeviceRefused, match="switch B stands at 0 instead of 1"):
            switches.select(Channel.HV)
        switches.make_safe()
        wire.faults.stop(FaultKind.STUCK_SWITCH)
        assert switches.select(Channel.HV).receive == "V"
        switches.close()


@both
def test_a_switch_that_the_box_does_not_have(protocol: Protocol) -> None:
    with start_rc_box(World(), protocol=protocol) as wire:
        switches = driver(wire, protocol, receive_switch="C")
        switches.open()
        with pytest.raises(DeviceRefused, match="refused 'SETC=1'"):
            switches.select(Channel.HV)
        switches.close()


@both
def test_unplugged(protocol: Protocol) -> None:
    with start_rc_box(World(), protocol=protocol) as wire:
        switches = driver(wire, protocol)
        switches.open()
        wire.unplug()
        with pytest.raises(DeviceLost):
            keep_trying(lambda: switches.select(Channel.VV))
        switches.make_safe()
        switches.close()
        wire.plug()
        switches.open()
        assert switches.select(Channel.VV).verified
        switches.close()
        with pytest.raises(DeviceLost):
            switches.state()


@both
def test_silence_takes_no_longer_than_the_time_out(protocol: Protocol) -> None:
    with start_rc_box(World(), protocol=protocol) as wire:
        switches = driver(wire, protocol, timeout_s=0.4)
        switches.open()
        wire.faults.start(FaultKind.SILENCE)
        started = time.monotonic()
        with pytest.raises(DeviceTimeout, match=r"no answer within 0\.4 s"):
            switches.state()
        assert time.monotonic() - started < 0.8
        switches.close()


@contextmanager
def web_server(*pieces: bytes, pause_s: float = 0.0) -> Iterator[tuple[str, int]]:
    """A server that sends its pieces, whatever is asked, then hangs up."""
    server = socket.create_server(("127.0.0.1", 0))
    over = threading.Event()

    def run() -> None:
        try:
            connection, _ = server.accept()
            with connection:
                connection.recv(1000)
                for piece in pieces:
                    connection.sendall(piece)
                    if over.wait(pause_s):
                        return
        except OSError:
            pass

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    yield "127.0.0.1", server.getsockname()[1]
    over.set()
    server.close()
    thread.join(5)


def test_a_web_server_that_trickles_is_not_waited_for() -> None:
    with web_server(*[b"H"] * 100, pause_s=0.05) as (host, port):
        switches = MiniCircuitsRc(MiniCircuitsRc.Options(host=host, port=port, timeout_s=0.3))
        started = time.monotonic()
        with pytest.raises(DeviceTimeout):
            switches.open()
        assert time.monotonic() - started < 0.8


@pytest.mark.parametrize(
    ("reply", "error", "says"),
    [
        (b"HTTP/1.0 200 OK\r\n\r\nMN=\xff\xfe", DeviceBadAnswer, "something else than a line of text"),
        (b"HTTP/1.0 200 OK\r\n\r\n" + b"x" * 5000, DeviceBadAnswer, "something else than a line of text"),
        (b"HTTP/1.0 200 OK\r\n\r\n", DeviceBadAnswer, "something else than a line of text"),
        (b"HTTP/1.0 404 Not Found\r\nContent-Length: 2\r\n\r\nno", DeviceBadAnswer, "HTTP status 404"),
        (b"220 FTP ready\r\n", DeviceBadAnswer, "does not speak HTTP"),
        (b"HTTP/1.0 200 OK\r\n" + b"X: y\r\n" * 500, DeviceBadAnswer, "does not speak HTTP"),
        (b"", DeviceBadAnswer, "does not speak HTTP"),
    ],
)
def test_other_servers(reply: bytes, error: type[DeviceError], says: str) -> None:
    with web_server(reply) as (host, port), pytest.raises(error, match=says):
        MiniCircuitsRc(MiniCircuitsRc.Options(host=host, port=port)).open()


@pytest.mark.parametrize(
    ("talk", "says"),
    [
        ([*GREETING[:3], ("HEATALARM?", "maybe")], "answered 'HEATALARM\\?' with 'maybe'"),
        ([*GREETING[:4], ("SWPORT?", "-99 Unrecognized Command")], "answered 'SWPORT\\?'"),
        ([*GREETING[:4], ("SWPORT?", "256")], "answered 'SWPORT\\?'"),
        ([*GREETING[:5], ("TEMP1?", "warm")], "answered 'TEMP1\\?' with 'warm'"),
        ([*GREETING[:5], ("TEMP1?", "nan")], "answered 'TEMP1\\?' with 'nan'"),
    ],
)
def test_nonsense_is_a_bad_answer(talk: list[tuple[str, str]], says: str) -> None:
    with serve(Script(*turns("telnet", *talk)), kind="tcp") as wire, pytest.raises(DeviceBadAnswer, match=says):
        driver(wire, "telnet").open()


@both
def test_fuzz_answers(protocol: Protocol) -> None:
    with start_rc_box(World(), protocol=protocol, actuation_s=0.0) as wire:
        switches = driver(wire, protocol, timeout_s=0.03, settle_s=0.0)
        switches.open()

        @given(
            garbage=st.one_of(
                st.binary(max_size=40),
                st.from_regex(rb"(HTTP/1.[01] \d\d\d OK\r\n(Content-Length: \d{1,3}\r\n)?\r\n)?[0-9=-]{0,6}(\r\n)?"),
            )
        )
        @settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
        def anything(garbage: bytes) -> None:
            wire.filter = lambda _: garbage
            for act in (switches.state, lambda: switches.select(Channel.VV), switches.temperature_c):
                try:
                    act()
                except DeviceError:
                    continue

        anything()
        switches.close()


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"receive_switch": "A"}, "are both A"),
        ({"transmit_switch": "a"}, "transmit_switch: found 'a', allowed: 'A', 'B'"),
        ({"host": "a b/"}, "host: found 'a b/'"),
        ({"host": "x\r\nEvil: 1"}, "host: found"),
        ({"connection": "usb"}, "connection: found 'usb', allowed: 'http', 'telnet'"),
        ({"h_state": 2}, "h_state: found 2, allowed: 0, 1"),
    ],
)
def test_wrong_options(wrong: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        MiniCircuitsRc(MiniCircuitsRc.Options(**({"host": "h"} | wrong)))  # type: ignore[arg-type]


def test_the_simulated_box_answers_an_ordinary_web_client() -> None:
    """Python's own urllib is an independent client of the box's web server."""
    with start_rc_box(World(), actuation_s=0.0) as wire:
        host, port = host_and_port(wire)
        opener = build_opener(ProxyHandler({}))

        def ask(question: str) -> str:
            with opener.open(f"http://{host}:{port}/{question}", timeout=2) as response:
                return response.read().decode()

        assert ask("MN?") == "MN=RC-2MTS-18"
        assert ask("SETP=3") == "1"
        assert ask("SETA=0") == "1"
        wire.wake()
        time.sleep(0.05)
        assert ask("SWPORT?") == "2"
        assert ask("SETP=4") == "0"
        assert ask("SETC=1") == "0"
        assert ask("FOO").startswith("-99")


def test_the_simulated_box_shows_contacts() -> None:
    world = World()
    box = RcBox(world, protocol="telnet", actuation_s=0.02)
    assert box.handle(b"SETA=1\r\nSWPORT?\r\n") == b"1\r\n0\r\n"
    assert world.transmit.at() == "?"
    time.sleep(0.025)
    assert box.handle(b"swport?\r\n") == b"1\r\n"
    assert world.transmit.at() == "V"
