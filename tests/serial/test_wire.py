"""The simulated end of a line: faults on demand, nothing left behind."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
import serial
from serial_helpers import Script, both_kinds

import hw_mocks.wire
from hw_mocks.wire import Kind, serve


@both_kinds
def test_filter_changes_what_is_sent(kind: Kind) -> None:
    script = Script(*[(b"a", b"abc\n")] * 2)
    with serve(script, kind=kind) as wire, serial.serial_for_url(wire.url, timeout=2) as port:
        port.write(b"a")
        assert port.read_until() == b"abc\n"
        wire.filter = lambda said: said.replace(b"b", b"\xff")
        port.write(b"a")
        assert port.read_until() == b"a\xffc\n"


@both_kinds
def test_address_survives_unplugging_and_close_leaves_nothing(kind: Kind) -> None:
    wire = serve(Script(), kind=kind, name="mine")
    url = wire.url
    assert any(thread.name == "wire-mine" for thread in threading.enumerate())
    wire.unplug()
    wire.unplug()
    wire.plug()
    wire.plug()
    assert wire.url == url
    wire.close()
    wire.close()
    assert not any(thread.name == "wire-mine" for thread in threading.enumerate())
    if kind == "pty":
        assert not Path(url).parent.exists()


def test_bytes_that_do_not_fit_are_lost_not_waited_for() -> None:
    """Nobody reads: the device goes on, as a real one does."""

    class Loud:
        turns = 0

        def handle(self, received: bytes) -> bytes:
            self.turns += 1
            return b"x" * 65_536

        def due_s(self) -> float | None:
            return 0.0

    loud = Loud()
    with serve(loud):
        for _ in range(200):
            if loud.turns > 20:
                break
            threading.Event().wait(0.01)
    assert loud.turns > 20


def test_tcp_takes_one_client_at_a_time() -> None:
    with serve(Script((b"a", b"1\n")), kind="tcp") as wire, serial.serial_for_url(wire.url, timeout=2) as first:
        with serial.serial_for_url(wire.url, timeout=2) as second, pytest.raises(serial.SerialException):
            second.read(1)
        first.write(b"a")
        assert first.read_until() == b"1\n"


def test_without_pseudo_terminals_it_is_tcp(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hw_mocks.wire, "HAS_PTY", False)
    with serve(Script()) as wire:
        assert wire.url.startswith("socket://127.0.0.1:")
    with pytest.raises(ValueError, match="no pseudo-terminals"):
        serve(Script(), kind="pty")
