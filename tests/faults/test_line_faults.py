"""Faults of a serial line, first by the definition of each, then at a real wire."""

import time
from collections.abc import Iterator

import pytest
import serial

from drivers.errors import DeviceLost
from drivers.transport import SerialLine
from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.line_faults import LineFaults
from hw_mocks.wire import HAS_PTY, Wire, serve

MS = 1_000_000


class Echo:
    """Says what it hears."""

    def handle(self, received: bytes) -> bytes:
        return received

    def due_s(self) -> float | None:
        return None


def line(kind: FaultKind, amount: float = 0.0) -> LineFaults:
    script = FaultScript()
    script.start(kind, after_count=1, for_count=1, amount=amount)
    return LineFaults(script)


def said(faults: LineFaults, now_ns: int | None = None) -> list[bytes]:
    """What becomes of three answers, of which only the second is hit (counts are answers given before)."""
    now_ns = time.monotonic_ns() if now_ns is None else now_ns
    return [faults.transmit(answer, now_ns) for answer in (b"first\r\n", b"second\r\n", b"third\r\n")]


def test_silence_swallows_exactly_the_answers_counted() -> None:
    assert said(line(FaultKind.SILENCE)) == [b"first\r\n", b"", b"third\r\n"]


def test_garbage_has_the_answers_length_and_is_the_same_every_time() -> None:
    one, other = said(line(FaultKind.GARBAGE)), said(line(FaultKind.GARBAGE))
    assert one == other
    assert [one[0], one[2]] == [b"first\r\n", b"third\r\n"]
    assert len(one[1]) == len(b"second\r\n")
    assert one[1] != b"second\r\n"


def test_a_partial_line_is_the_first_half() -> None:
    assert said(line(FaultKind.PARTIAL_LINE)) == [b"first\r\n", b"seco", b"third\r\n"]


def test_a_late_answer_delays_those_behind_it_but_never_changes_their_order() -> None:
    faults = line(FaultKind.SLOW, amount=0.25)
    now_ns = time.monotonic_ns()
    assert said(faults, now_ns) == [b"first\r\n", b"", b""]
    assert faults.due_ns(now_ns) == now_ns + 250 * MS
    assert faults.transmit(b"", now_ns + 249 * MS) == b""
    assert faults.transmit(b"", now_ns + 250 * MS) == b"second\r\nthird\r\n"
    assert faults.due_ns(now_ns + 250 * MS) is None


def test_the_cable_is_out_while_disconnected() -> None:
    script = FaultScript()
    faults = LineFaults(script)
    now_ns = time.monotonic_ns()
    assert faults.connected(now_ns)
    script.start(FaultKind.DISCONNECT, for_s=1)
    later_ns = time.monotonic_ns()
    assert not faults.connected(later_ns)
    change_ns = faults.due_ns(later_ns)
    assert change_ns is not None
    assert later_ns < change_ns <= later_ns + 1_000_000_000
    assert faults.connected(change_ns)


@pytest.fixture(params=["pty", "tcp"])
def wire(request: pytest.FixtureRequest) -> Iterator[Wire]:
    if request.param == "pty" and not HAS_PTY:
        pytest.skip("no pseudo-terminals here")
    with serve(Echo(), kind=request.param) as wire:
        yield wire


def ask(port: serial.SerialBase, text: bytes) -> bytes:
    port.write(text)
    return bytes(port.read(len(text)))


def test_a_wire_obeys_faults_started_by_hand_and_recovers(wire: Wire) -> None:
    with serial.serial_for_url(wire.url, timeout=0.3) as port:
        assert ask(port, b"one\n") == b"one\n"
        wire.faults.start(FaultKind.SILENCE)
        assert ask(port, b"two\n") == b""
        wire.faults.stop(FaultKind.SILENCE)
        assert ask(port, b"six\n") == b"six\n"
        wire.faults.start(FaultKind.SLOW, amount=0.1, for_s=5)
        began = time.monotonic()
        assert ask(port, b"ten\n") == b"ten\n"
        assert time.monotonic() - began >= 0.1


def test_a_scripted_unplugging_loses_the_client_and_the_address_returns(wire: Wire) -> None:
    line = SerialLine(wire.url, baud=9600, name="echo", timeout_s=0.2)
    line.open()
    assert line.ask(b"one\n") == "one"
    wire.faults.start(FaultKind.DISCONNECT, for_s=0.3)
    began = time.monotonic()
    with pytest.raises(DeviceLost):
        keep_asking(line, began + 2)
    line.close()
    while True:
        try:
            line.open()
            break
        except DeviceLost:
            assert time.monotonic() < began + 2
            time.sleep(0.02)
    assert time.monotonic() - began >= 0.3
    assert line.ask(b"back\n") == "back"
    line.close()


def keep_asking(line: SerialLine, end: float) -> None:
    while time.monotonic() < end:
        line.ask(b"two\n")


def test_a_device_shares_its_script_with_its_line() -> None:
    class Faulty(Echo):
        faults = FaultScript()

    device = Faulty()
    with serve(device) as wire:
        assert wire.faults is device.faults
