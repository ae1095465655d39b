"""pyserial 3.5's answers to one and the same mishap, as measured on Linux, and that a driver sees only one of them.

Each first half is a fact about pyserial (if it fails after an update, look at drivers/transport.py); each second half
is what SerialLine makes of it.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import serial
from serial_helpers import Silent, keep_trying, rfc2217_echo, wait_for

from drivers.errors import DeviceLost, DeviceTimeout
from drivers.transport import PORT_FAILURES, SerialLine
from hw_mocks.wire import HAS_PTY, Kind, Wire, serve

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux") or not HAS_PTY, reason="measured on Linux")


def line_to(url: str) -> SerialLine:
    line = SerialLine(url, baud=9600, name="thing", timeout_s=0.2)
    line.open()
    return line


@contextlib.contextmanager
def orphan(kind: Kind) -> Iterator[tuple[Any, Wire]]:
    """A pyserial port whose peer has gone."""
    device = Silent()
    with serve(device, kind=kind) as wire:
        port = serial.serial_for_url(wire.url, timeout=0.1)
        leaked = getattr(port, "_socket", None)
        port.write(b"a")
        wait_for(lambda: device.heard == b"a", "the connection")
        wire.unplug()
        time.sleep(0.05)
        try:
            yield port, wire
        finally:
            with contextlib.suppress(*PORT_FAILURES):
                port.close()
            if leaked is not None:
                leaked.close()


@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_reading_from_a_peer_that_has_gone(kind: Kind) -> None:
    with orphan(kind) as (port, _), pytest.raises(serial.SerialException):
        port.read(1)


def test_a_pty_without_peer_raises_termios_error_where_nobody_expects_it() -> None:
    import termios

    with orphan("pty") as (port, _):
        with pytest.raises(OSError):  # noqa: PT011  (in_waiting: EIO from an ioctl, not a SerialException)
            _ = port.in_waiting
        for act in (port.reset_input_buffer, port.flush):
            with pytest.raises(termios.error):
                act()
    assert termios.error in PORT_FAILURES


def test_a_socket_without_peer_says_that_a_byte_waits_and_takes_a_first_write() -> None:
    with orphan("tcp") as (port, _):
        assert port.in_waiting == 1
        assert port.write(b"lost") == 4

        def write() -> None:
            port.write(b"lost too")

        with pytest.raises(serial.SerialException):
            keep_trying(write, seconds=1, pause_s=0.01)


def test_a_pty_without_peer_refuses_a_write() -> None:
    with orphan("pty") as (port, _), pytest.raises((serial.SerialException, OSError)):
        port.write(b"x")


def test_a_pty_has_no_modem_lines() -> None:
    with serve(Silent(), kind="pty") as wire, serial.serial_for_url(wire.url) as port, pytest.raises(OSError):  # noqa: PT011
        port.dtr = True
    with serve(Silent(), kind="pty") as wire:
        line_to(wire.url).close()  # so the transport leaves them alone


def test_exclusive_is_ignored_by_sockets() -> None:
    with serve(Silent(), kind="tcp") as wire, serial.serial_for_url(wire.url, exclusive=True):
        pass


def test_exclusive_blocks_only_a_later_exclusive_opening() -> None:
    with serve(Silent(), kind="pty") as wire, serial.serial_for_url(wire.url, exclusive=True):
        serial.serial_for_url(wire.url).close()
        with pytest.raises(serial.SerialException):
            serial.serial_for_url(wire.url, exclusive=True)
        with pytest.raises(DeviceLost, match="is in use"):
            line_to(wire.url)


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial 3.5 itself
def test_rfc2217_without_peer_raises_a_broken_pipe_when_its_speed_is_set() -> None:
    with rfc2217_echo() as (url, kill):
        port = serial.serial_for_url(url, timeout=0.1)
        leaked = port._socket
        kill()

        def set_speed() -> None:
            port.baudrate = 19_200 if port.baudrate == 9600 else 9600

        # pyserial waits 3 s for the peer's word unless the connection is already known to be broken.
        with pytest.raises((BrokenPipeError, ConnectionResetError, serial.SerialException, ValueError)):
            keep_trying(set_speed, seconds=5)
        with contextlib.suppress(*PORT_FAILURES):
            port.close()
        leaked.close()
    assert issubclass(BrokenPipeError, PORT_FAILURES)


class Broken:
    """A port that fails in one way."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    @property
    def in_waiting(self) -> int:
        raise self.error

    def write(self, data: bytes) -> int:
        raise self.error

    def close(self) -> None:
        raise self.error


def failures() -> list[BaseException]:
    import termios

    return [
        serial.SerialException("device disconnected"), OSError(5, "Input/output error"),
        termios.error(5, "Input/output error"), BrokenPipeError(32, "Broken pipe"),
        TypeError("'NoneType' object cannot be interpreted as an integer"), AttributeError("closed meanwhile"),
    ]  # fmt: skip


@pytest.mark.parametrize("number", range(6))
def test_every_way_of_failing_is_one_device_lost(number: int) -> None:
    for act in (lambda line: line.read_line(0.1), lambda line: line.write(b"x"), lambda line: line.drain()):
        line = SerialLine("nowhere", baud=9600, name="thing")
        line._serial = Broken(failures()[number])
        doing: Callable[[SerialLine], Any] = act
        with pytest.raises(DeviceLost, match="the connection was lost"):
            doing(line)
        assert not line.is_open
        line.close()


def test_a_write_that_blocks_is_a_timeout_and_the_port_stays() -> None:
    line = SerialLine("nowhere", baud=9600, name="thing")
    line._serial = Broken(serial.SerialTimeoutException("Write timeout"))
    with pytest.raises(DeviceTimeout, match="does not take what is sent to it"):
        line.write(b"x")
    assert line.is_open
    line._serial = None
