"""A serial line that fails in only four ways.

pyserial's answers to the same mishap differ between a real port, a pseudo-terminal, ``socket://`` and ``rfc2217://``:
``SerialException``, ``OSError``, ``termios.error``, or a write that seems to succeed. :class:`SerialLine` turns them
all into :class:`~drivers.errors.DeviceLost` (gone), :class:`~drivers.errors.DeviceTimeout` (silent) and
:class:`~drivers.errors.DeviceBadAnswer` (not text, or text without end). No call blocks longer than its time-out,
however much the device talks.
"""

from __future__ import annotations

import contextlib
import errno
import threading
import time
from collections.abc import Iterator
from typing import Any

import serial
from serial.tools import list_ports

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceTimeout

try:
    from termios import error as _TermiosError  # noqa: N812
except ImportError:  # Windows has no termios; its pyserial raises SerialException alone.

    class _TermiosError(Exception):  # type: ignore[no-redef]
        """Stands in where there is no termios."""


#: What pyserial raises when a port fails.
PORT_FAILURES: tuple[type[BaseException], ...] = (serial.SerialException, OSError, _TermiosError)
_OPEN_FAILURES: tuple[type[BaseException], ...] = (*PORT_FAILURES, ValueError)
# A handle that another thread closes meanwhile shows as TypeError or AttributeError.
_USE_FAILURES: tuple[type[BaseException], ...] = (*PORT_FAILURES, TypeError, AttributeError)

_SLICE_S = 0.02
_MAX_DRAIN_BYTES = 65_536


class SerialLine:
    """A serial port with bounded, thread-safe, line-wise exchanges.

    Args:
        port: anything that ``serial.serial_for_url`` takes: ``/dev/ttyUSB0``, ``COM3``, ``socket://host:port``,
            ``rfc2217://host:port``.
        baud: line speed, bit/s (8 data bits, no parity, 1 stop bit).
        name: the device, for messages.
        timeout_s: default time to wait for an answer, s.
        max_line_bytes: a line longer than this is a :class:`DeviceBadAnswer`.

    Several threads may share a line: hold :meth:`exchange` from a question until its answer. :meth:`write` itself only
    excludes other writes, so that an emergency byte (a feed hold) need not wait for another thread's exchange.
    """

    def __init__(self, port: str, *, baud: int, name: str, timeout_s: float = 1.0, max_line_bytes: int = 1024) -> None:
        self.where = f"{name} on {port}"
        self.timeout_s = timeout_s
        self._port = port
        self._baud = baud
        self._max_line_bytes = max_line_bytes
        self._serial: Any = None
        self._received = bytearray()
        self._exchange_lock = threading.RLock()
        self._write_lock = threading.Lock()

    @property
    def is_open(self) -> bool:
        """Whether the port is open and has not been lost."""
        return self._serial is not None

    def open(self) -> None:
        """Open the port, exclusively where the system can. Does nothing when it is open.

        Raises:
            DeviceLost: there is no such port, it is in use, or it may not be opened; the message says which.
        """
        with self._exchange_lock:
            if self._serial is not None:
                return
            try:
                # pyserial's RFC 2217 client knows no write time-out; its socket has one of its own (5 s).
                write_timeout_s = None if self._port.lower().startswith("rfc2217://") else self.timeout_s
                # Sliced reads: pyserial renegotiates the line whenever its time-out is changed, so it stays fixed.
                self._serial = serial.serial_for_url(
                    self._port, baudrate=self._baud, timeout=_SLICE_S, write_timeout=write_timeout_s, exclusive=True
                )
            except _OPEN_FAILURES as error:
                raise self._not_opened(error) from error
            self._received.clear()

    def close(self) -> None:
        """Close the port. Idempotent; never raises. A read in another thread ends with :class:`DeviceLost`."""
        handle, self._serial = self._serial, None
        if handle is None:
            return
        # A reader notices within one slice; closing under its feet would hand its descriptor to someone else.
        owned = self._exchange_lock.acquire(timeout=1.0)
        try:
            # pyserial leaks the socket of a peer that has gone: its shutdown fails before the close.
            leaked = getattr(handle, "_socket", None)
            with contextlib.suppress(*_USE_FAILURES):
                handle.close()
            if leaked is not None:
                leaked.close()
        finally:
            if owned:
                self._exchange_lock.release()

    @contextlib.contextmanager
    def exchange(self) -> Iterator[None]:
        """Hold the line for a question and its answer (re-entrant)."""
        with self._exchange_lock:
            yield

    def write(self, data: bytes) -> None:
        """Send all of ``data``.

        Raises:
            DeviceLost: the port failed or is closed.
            DeviceTimeout: the port did not take the bytes in its time.
        """
        with self._write_lock, self._failures("writing"):
            self._handle().write(data)

    def read_line(self, timeout_s: float | None = None) -> str:
        """Next line that is not blank, without its ending (CR, LF or both) and surrounding spaces.

        Raises:
            DeviceTimeout: no whole line in ``timeout_s`` (default: the line's own); what has come is kept.
            DeviceBadAnswer: bytes that are not ASCII text, or more than ``max_line_bytes`` without a line's end.
            DeviceLost: the port failed or is closed.
        """
        timeout_s = self.timeout_s if timeout_s is None else timeout_s
        line = self._next_line(time.monotonic() + timeout_s)
        if line is None:
            raise self._silent(timeout_s)
        return line

    def try_line(self) -> str | None:
        """Next line that has already arrived, else None; does not wait. Raises as :meth:`read_line` but time-outs."""
        return self._next_line(None)

    def read_until(self, terminator: bytes, timeout_s: float | None = None) -> str:
        """Text up to and without ``terminator`` (a prompt such as ``b">"``). Raises as :meth:`read_line`."""
        timeout_s = self.timeout_s if timeout_s is None else timeout_s
        deadline = time.monotonic() + timeout_s
        with self._exchange_lock:
            while (end := self._received.find(terminator)) < 0:
                self._check_length()
                if not self._receive(deadline):
                    raise self._silent(timeout_s)
            raw = bytes(self._received[:end])
            del self._received[: end + len(terminator)]
        return self._text(raw)

    def ask(self, question: bytes, timeout_s: float | None = None) -> str:
        """Forget what came unasked, send ``question`` and return the next line. Raises as write and read_line."""
        with self._exchange_lock:
            self.drain()
            self.write(question)
            return self.read_line(timeout_s)

    def drain(self) -> int:
        """Forget all that has arrived; return how many bytes. Bounded even if the device never stops talking."""
        with self._exchange_lock:
            dropped = len(self._received)
            self._received.clear()
            while dropped < _MAX_DRAIN_BYTES and self._receive(None):
                dropped += len(self._received)
                self._received.clear()
        return dropped

    def _next_line(self, deadline: float | None) -> str | None:
        """Next non-blank line, or None at the deadline; ``deadline`` None: look once at what has arrived."""
        with self._exchange_lock:
            looked = False
            while True:
                line = self._take_line()
                if line:
                    return line
                if line is not None:
                    continue  # a blank one; the buffer may hold more
                self._check_length()
                # Bytes that come for ever, blank lines or none, must not outlast the deadline.
                over = looked and (deadline is None or time.monotonic() > deadline)
                if over or not self._receive(deadline):
                    return None
                looked = True

    def _take_line(self) -> str | None:
        ends = [end for end in (self._received.find(b"\n"), self._received.find(b"\r")) if end >= 0]
        if not ends:
            return None
        raw = bytes(self._received[: min(ends)])
        del self._received[: min(ends) + 1]
        if len(raw) > self._max_line_bytes:
            raise self._bad(raw, f"sent a line of {len(raw)} bytes")
        return self._text(raw)

    def _receive(self, deadline: float | None) -> bool:
        """Take new bytes into the buffer: wait for them until ``deadline``, or take those present when it is None."""
        while True:
            with self._failures("reading"):
                handle = self._handle()
                # For a lost socket in_waiting is 1 and the read raises; for a lost pty in_waiting itself raises.
                waiting = handle.in_waiting
                new = handle.read(min(max(waiting, 1), 4096)) if waiting or deadline is not None else b""
            self._received += new
            if new or deadline is None or time.monotonic() >= deadline:
                return bool(new)

    def _check_length(self) -> None:
        if len(self._received) > self._max_line_bytes:
            raw = bytes(self._received)
            self._received.clear()
            raise self._bad(raw, f"sent {len(raw)} bytes without a line's end")

    def _text(self, raw: bytes) -> str:
        try:
            text = raw.decode("ascii").strip()
        except UnicodeDecodeError:
            raise self._bad(raw, "sent bytes that are not text") from None
        if not text.isprintable():
            raise self._bad(raw, "sent control characters")
        return text

    def _handle(self) -> Any:
        if self._serial is None:
            raise DeviceLost("the port is not open", where=self.where, advice="open the device (again)")
        return self._serial

    @contextlib.contextmanager
    def _failures(self, doing: str) -> Iterator[None]:
        try:
            yield
        except DeviceError:
            raise
        except serial.SerialTimeoutException as error:
            raise DeviceTimeout(
                "does not take what is sent to it",
                where=self.where,
                advice="check the cable, the flow control and that the device is on",
            ) from error
        except _USE_FAILURES as error:
            self.close()
            raise DeviceLost(
                f"the connection was lost while {doing} ({error})",
                where=self.where,
                advice="check cable and power, then open the device again",
            ) from error

    def _silent(self, timeout_s: float) -> DeviceTimeout:
        part = f" (only {bytes(self._received[:40])!r} came)" if self._received else ""
        return DeviceTimeout(
            f"no answer within {timeout_s:g} s{part}",
            where=self.where,
            advice="check that the device is on, and its port and baud rate",
        )

    def _bad(self, raw: bytes, what: str) -> DeviceBadAnswer:
        return DeviceBadAnswer(
            f"{what} ({raw[:40]!r})", where=self.where, advice="check the port, the baud rate and the cable's screen"
        )

    def _not_opened(self, error: BaseException) -> DeviceLost:
        number = getattr(error, "errno", None)
        if number is None and isinstance(error.__cause__ or error.__context__, OSError):
            number = (error.__cause__ or error.__context__).errno  # type: ignore[union-attr]
        if number in (errno.EACCES, errno.EPERM):
            return DeviceLost(
                "may not be opened", where=self.where, advice="add yourself to the group that owns the port (dialout)"
            )
        if number in (errno.EAGAIN, errno.EBUSY):
            return DeviceLost("is in use", where=self.where, advice="close the other program that holds the port")
        if "://" in self._port:
            return DeviceLost(
                f"cannot be reached ({error})", where=self.where, advice="check the address and that its server runs"
            )
        present = ", ".join(sorted(port.device for port in list_ports.comports())) or "none"
        return DeviceLost(
            f"cannot be opened ({error})", where=self.where, advice=f"check cable and name; ports here: {present}"
        )
