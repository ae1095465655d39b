"""Every row of the table of pyserial's failures must come out as one of the four device errors.

Expected behaviour: pyserial 3.5 as measured on Linux (timeouts, lost peers, blocked writes, exclusive opening), and the
contract in the docstrings of drivers/transport.py.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from serial_helpers import Script, Silent, Talker, both_kinds, keep_trying, rfc2217_echo, wait_for

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceTimeout
from drivers.transport import SerialLine
from hw_mocks.wire import HAS_PTY, Kind, serve

needs_pty = pytest.mark.skipif(not HAS_PTY, reason="no pseudo-terminals here")


def line_to(url: str, **options: Any) -> SerialLine:
    line = SerialLine(url, baud=9600, name="thing", **({"timeout_s": 1.0} | options))
    line.open()
    return line


def suppressing_timeouts(act: Callable[[], Any]) -> None:
    with contextlib.suppress(DeviceTimeout):
        act()


@both_kinds
def test_ask_and_line_endings(kind: Kind) -> None:
    script = Script((b"a?\n", b"one\r\n"), (b"b?\n", b"two\r"), (b"c?\n", b"\n\r\n three \n"))
    with serve(script, kind=kind) as wire:
        line = line_to(wire.url)
        assert [line.ask(question) for question in (b"a?\n", b"b?\n", b"c?\n")] == ["one", "two", "three"]
        line.close()
    script.check()


@both_kinds
def test_ask_forgets_what_came_unasked(kind: Kind) -> None:
    device = Silent()
    with serve(device, kind=kind) as wire:
        line = line_to(wire.url)
        line.write(b"x")
        wait_for(lambda: device.heard == b"x", "the first byte")
        device.to_say = b"stale\r\n"
        wire.wake()
        wait_for(lambda: device.to_say == b"", "the stale line to be said")
        time.sleep(0.05)  # on its way
        device.to_say = b"fresh\r\n"  # said when the question arrives
        assert line.ask(b"?") == "fresh"
        line.close()


@both_kinds
def test_prompt_as_terminator(kind: Kind) -> None:
    # Numato relays end their replies with LF CR and a prompt.
    with serve(Script((b"relay read 0\r", b"relay read 0\n\ron\n\r>rest\n")), kind=kind) as wire:
        line = line_to(wire.url)
        line.write(b"relay read 0\r")
        with pytest.raises(DeviceBadAnswer):
            line.read_until(b">")  # three lines are no single text
        assert line.read_line() == "rest"
        line.close()
    with serve(Script((b"x", b"yes>no")), kind=kind) as wire:
        line = line_to(wire.url)
        line.write(b"x")
        assert line.read_until(b">") == "yes"
        with pytest.raises(DeviceTimeout, match="only b'no' came"):
            line.read_until(b">")
        line.close()


@both_kinds
def test_silence_is_a_timeout_and_a_partial_line_is_kept(kind: Kind) -> None:
    device = Silent()
    with serve(device, kind=kind) as wire:
        line = line_to(wire.url)
        line.write(b"a")
        wait_for(lambda: device.heard == b"a", "the byte")
        started = time.monotonic()
        with pytest.raises(DeviceTimeout, match=r"no answer within 0.1 s"):
            line.read_line(0.1)
        assert 0.09 <= time.monotonic() - started < 0.4
        device.to_say = b"par"
        wire.wake()
        with pytest.raises(DeviceTimeout, match="only b'par' came"):
            line.read_line(0.1)
        assert line.try_line() is None
        device.to_say = b"tial\r\n"
        wire.wake()
        assert line.read_line() == "partial"
        line.close()


@both_kinds
@pytest.mark.parametrize("act", ["read_line", "try_line", "ask", "drain", "read_until"])
def test_unplugged_is_lost_whatever_is_tried(kind: Kind, act: str) -> None:
    with serve(Silent(), kind=kind) as wire:
        line = line_to(wire.url)
        wire.unplug()
        actions = {
            "read_line": line.read_line,
            "try_line": line.try_line,
            "ask": lambda: line.ask(b"?"),
            "drain": line.drain,
            "read_until": lambda: line.read_until(b">"),
        }
        with pytest.raises(DeviceLost) as caught:
            keep_trying(lambda: suppressing_timeouts(actions[act]))
        assert "thing on" in caught.value.where
        assert not line.is_open
        with pytest.raises(DeviceLost, match="not open"):
            line.write(b"x")


@both_kinds
def test_write_into_a_lost_line_is_noticed_by_the_second_write_at_the_latest(kind: Kind) -> None:
    # socket://: the first write after the peer went "succeeds"; a pty raises EIO at once.
    with serve(Silent(), kind=kind) as wire:
        line = line_to(wire.url)
        wire.unplug()
        with pytest.raises(DeviceLost):
            keep_trying(lambda: line.write(b"x"), seconds=0.1, pause_s=0.05)


@both_kinds
def test_replugged_and_reopened(kind: Kind) -> None:
    with serve(Script((b"a", b"1\n"), (b"b", b"2\n")), kind=kind) as wire:
        line = line_to(wire.url)
        assert line.ask(b"a") == "1"
        wire.unplug()
        with pytest.raises(DeviceLost):
            line.read_line()
        with pytest.raises(DeviceLost):
            line.open()
        wire.plug()
        line.open()
        assert line.ask(b"b") == "2"
        line.close()


@both_kinds
def test_clients_come_and_go(kind: Kind) -> None:
    with serve(Script(*[(b"a", b"1\n")] * 3), kind=kind) as wire:
        line = line_to(wire.url)
        for _ in range(3):
            line.open()  # does nothing when open
            assert line.ask(b"a") == "1"
            line.close()
            line.close()
            line.open()
        line.close()


@pytest.mark.parametrize("blocked", [pytest.param("pty", marks=needs_pty), "tcp"])
def test_a_blocked_write_is_a_timeout(blocked: str) -> None:
    if blocked == "pty":
        import pty
        import tty

        master, slave = pty.openpty()
        tty.setraw(slave)
        url = os.ttyname(slave)
    else:
        server = socket.create_server(("127.0.0.1", 0))
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
    line = line_to(url)
    try:
        started = time.monotonic()
        with pytest.raises(DeviceTimeout, match="does not take"):
            keep_trying(lambda: line.write(b"x" * 4_000_000))
        assert time.monotonic() - started < 3
    finally:
        line.close()
        if blocked == "pty":
            os.close(master)
            os.close(slave)
        else:
            server.close()


@needs_pty
def test_a_port_in_use_is_said_so() -> None:
    with serve(Silent(), kind="pty") as wire:
        first = line_to(wire.url)
        with pytest.raises(DeviceLost, match="is in use; close the other program"):
            line_to(wire.url)
        first.close()
        line_to(wire.url).close()


@pytest.mark.parametrize(
    ("port", "says"),
    [
        ("/dev/no-such-port", "cannot be opened.*ports here"),
        ("socket://127.0.0.1:1", "cannot be reached"),
        ("nonsense://x", "cannot be reached"),
        ("socket://127.0.0.1", "cannot be reached"),
        ("", "cannot be opened"),
    ],
)
def test_ports_that_do_not_open(port: str, says: str) -> None:
    with pytest.raises(DeviceLost, match=says):
        line_to(port)


@pytest.mark.parametrize("babble", [b"x" * 50, b"\r\n" * 20, b" \n", b"\xff\x80\n"])
def test_a_device_that_babbles_cannot_hang_or_grow(babble: bytes) -> None:
    with serve(Talker(babble)) as wire:
        line = line_to(wire.url)
        line.write(b"go")
        for ask in (lambda: line.read_line(0.2), lambda: line.read_until(b">", 0.2), lambda: line.ask(b"?", 0.2)):
            started = time.monotonic()
            with pytest.raises(DeviceError):
                ask()
            assert time.monotonic() - started < 3
        started = time.monotonic()
        try:
            assert line.try_line() is None
        except DeviceBadAnswer:
            assert babble.isascii() is False or babble == b"x" * 50
        assert time.monotonic() - started < 0.5
        assert len(line._received) <= 1024 + 4096  # the longest line and one read
        line.close()


@pytest.mark.parametrize("raw", [b"caf\xe9\r\n", b"\x00\x01\x02\n", b"a\x1b[0m\n", b"y" * 2000 + b"\n"])
def test_garbage_is_a_bad_answer_and_the_next_line_is_good(raw: bytes) -> None:
    with serve(Script((b"?", raw + b"good\r\n"))) as wire:
        line = line_to(wire.url)
        line.write(b"?")
        with pytest.raises(DeviceBadAnswer):
            line.read_line()
        if len(raw) < 1000:
            assert line.read_line() == "good"
        line.close()


@both_kinds
def test_closing_ends_a_read_in_another_thread(kind: Kind) -> None:
    with serve(Silent(), kind=kind) as wire:
        line = line_to(wire.url)
        caught: list[BaseException] = []

        def read() -> None:
            try:
                line.read_line(10)
            except BaseException as error:
                caught.append(error)

        reader = threading.Thread(target=read)
        reader.start()
        time.sleep(0.1)
        started = time.monotonic()
        line.close()
        reader.join(2)
        assert time.monotonic() - started < 1
        assert [type(error) for error in caught] == [DeviceLost]


@both_kinds
def test_exchanges_of_threads_do_not_mix(kind: Kind) -> None:
    class Echo:
        def handle(self, received: bytes) -> bytes:
            return received

        def due_s(self) -> float | None:
            return None

    with serve(Echo(), kind=kind) as wire:
        line = line_to(wire.url, timeout_s=2)
        wrong: list[str] = []

        def talk(name: int) -> None:
            for i in range(40):
                question = f"{name}-{i}"
                answer = line.ask(question.encode() + b"\n")
                if answer != question:
                    wrong.append(f"{question} got {answer}")

        threads = [threading.Thread(target=talk, args=(n,)) for n in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(20)
        assert wrong == []
        line.close()


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial 3.5 itself
def test_rfc2217() -> None:
    with rfc2217_echo() as (url, kill):
        line = line_to(url, timeout_s=1)
        assert line.ask(b"over telnet\r\n") == "over telnet"
        with pytest.raises(DeviceTimeout):
            line.read_line(0.1)
        kill()
        with pytest.raises(DeviceLost):
            keep_trying(lambda: suppressing_timeouts(lambda: line.ask(b"anyone?\r\n", 0.2)))
        line.close()


@example(chunks=[b"\r!\r"])  # a blank line before the deadline must not hide the line behind it
@given(chunks=st.lists(st.binary(max_size=60), max_size=8))
@settings(max_examples=200, deadline=None)
def test_any_bytes_give_lines_or_device_errors(chunks: list[bytes]) -> None:
    """Whatever arrives, in whatever pieces: printable ASCII lines without blanks around, or a DeviceError."""

    class Pieces:
        is_open = True

        def __init__(self) -> None:
            self.pieces = [chunk for chunk in chunks if chunk]

        @property
        def in_waiting(self) -> int:
            return len(self.pieces[0]) if self.pieces else 0

        def read(self, size: int) -> bytes:
            return self.pieces.pop(0) if self.pieces else b""

    line = SerialLine("none", baud=9600, name="thing", max_line_bytes=64)
    line._serial = Pieces()
    heard = []
    for _ in range(600):
        try:
            said = line.read_line(0.0)
        except DeviceTimeout:
            if not line._serial.pieces:
                break
        except DeviceBadAnswer:
            continue
        else:
            heard.append(said)
    else:
        pytest.fail("reading does not come to an end")
    for said in heard:
        assert said
        assert said == said.strip()
        assert said.isascii()
        assert said.isprintable()
    # A closed form for the wholly clean case: the stripped, non-blank lines, in order.
    sent = b"".join(chunks)
    if sent.isascii() and all(len(part) <= 64 for part in sent.replace(b"\r", b"\n").split(b"\n")):
        parts = [part.decode().strip() for part in sent.replace(b"\r", b"\n").split(b"\n")[:-1]]
        if all(part.isprintable() for part in parts):
            assert heard == [part for part in parts if part]


def test_errors_survive_the_way_to_another_process() -> None:
    with pytest.raises(DeviceLost) as caught:
        line_to("/dev/no-such-port")
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (str(copy), copy.where, copy.advice) == (str(caught.value), caught.value.where, caught.value.advice)
