"""A simulated device's end of a serial line: a pseudo-terminal where there is one, else TCP on loopback.

A device is an object with ``handle`` and ``due_s`` (:class:`Handler`); :func:`serve` runs it in a thread of its own
behind an address that ``serial.serial_for_url`` opens. Clients may come and go; :attr:`Wire.faults` (scripted or by
hand), :meth:`Wire.unplug` and :attr:`Wire.filter` make the faults that drivers must survive.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Protocol

from hw_mocks.faults import FaultScript
from hw_mocks.line_faults import LineFaults

try:
    import pty
    import tty
except ImportError:  # Windows has no pseudo-terminals.
    HAS_PTY = False
else:
    HAS_PTY = True

_TICK_S = 0.05

Kind = Literal["pty", "tcp"]
Filter = Callable[[bytes], bytes]


class Handler(Protocol):
    """A device behind a wire. Both methods are called from the wire's thread only.

    A device with faults of its own (a switch that sticks) keeps a :class:`~hw_mocks.faults.FaultScript` in its
    attribute ``faults``; its line obeys the same script.
    """

    def handle(self, received: bytes) -> bytes:
        """React to ``received`` (empty: only time has passed) and return what is sent."""

    def due_s(self) -> float | None:
        """Seconds until the device wants to send by itself, or None while it only answers."""


class Wire:
    """A device's end of a line. Made by :func:`serve`; ended by :meth:`close` (or ``with``)."""

    def __init__(self, handler: Handler, kind: Kind, name: str) -> None:
        self.filter: Filter | None = None
        """Applied to all outgoing bytes (for faults): return what is really sent."""
        self.handler = handler
        """The device behind the line."""
        self.faults: FaultScript = getattr(handler, "faults", None) or FaultScript()
        """Faults of the line and of its device."""
        self._line_faults = LineFaults(self.faults)
        self._cut = False
        self._plug: _PtyPlug | _TcpPlug = _PtyPlug() if kind == "pty" else _TcpPlug()
        self._wake_receive, self._wake_send = socket.socketpair()
        self._lock = threading.Lock()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name=f"wire-{name}", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address for ``serial.serial_for_url``; stays the same over :meth:`unplug` and :meth:`plug`."""
        return self._plug.url

    def unplug(self) -> None:
        """Pull the cable: clients lose the line, the device lives on."""
        with self._lock:
            self._plug.unplug()
        self.wake()

    def plug(self) -> None:
        """Put the cable back in."""
        with self._lock:
            self._plug.plug()
        self.wake()

    def close(self) -> None:
        """End the device and its line. Idempotent."""
        self._closing = True
        if self._thread.is_alive():
            self.wake()
            self._thread.join(timeout=5)
        with self._lock:
            self._plug.remove()
            self._wake_send.close()
            self._wake_receive.close()

    def __enter__(self) -> Wire:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def wake(self) -> None:
        """Let the device look at the time again (after a test has changed its state)."""
        with contextlib.suppress(OSError):
            self._wake_send.send(b"w")

    def _run(self) -> None:
        while not self._closing:
            due_s = self._due_s()
            with self._lock:
                sources = self._plug.sources()
            # Another thread may unplug while we wait; select then says EBADF and the sources are asked for again.
            with contextlib.suppress(OSError, ValueError):
                ready, _, _ = select.select([self._wake_receive, *sources], [], [], due_s)
                if self._wake_receive in ready:
                    self._wake_receive.recv(64)
            with self._lock:
                received = self._plug.read()
            answer = self._line_faults.transmit(self.handler.handle(received), time.monotonic_ns())
            if answer and self.filter is not None:
                answer = self.filter(answer)
            with self._lock:
                self._plug.write(answer)
            self._follow_cable()

    def _due_s(self) -> float | None:
        """Seconds until the device or a fault wants attention; a fault started by hand is seen within a tick."""
        now_ns = time.monotonic_ns()
        change_ns = self._line_faults.due_ns(now_ns)
        due = [self.handler.due_s(), None if change_ns is None else seconds_until(change_ns), _TICK_S]
        return min(s for s in due if s is not None)

    def _follow_cable(self) -> None:
        connected = self._line_faults.connected(time.monotonic_ns())
        if connected != self._cut:
            return
        self._cut = not connected
        with self._lock:
            if connected:
                self._plug.plug()
            else:
                self._plug.unplug()


def serve(handler: Handler, *, kind: Kind | None = None, name: str = "device") -> Wire:
    """Put a device behind a line.

    Args:
        handler: the device.
        kind: ``"pty"``, ``"tcp"`` or None for a pseudo-terminal where the system has them.
        name: for the thread's name.

    Raises:
        ValueError: ``"pty"`` on a system without pseudo-terminals.
    """
    if kind is None:
        kind = "pty" if HAS_PTY else "tcp"
    if kind == "pty" and not HAS_PTY:
        raise ValueError("this system has no pseudo-terminals; use kind='tcp'")
    return Wire(handler, kind, name)


class _PtyPlug:
    """A raw pseudo-terminal behind a link of constant name."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="polfuse-wire-"))
        self.url = str(self._folder / "tty")
        self._master = self._slave = -1
        self.plug()

    def plug(self) -> None:
        if self._master >= 0:
            return
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        # Our own open slave keeps the line alive while no client has it open.
        Path(self.url).symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        if self._master < 0:
            return
        Path(self.url).unlink(missing_ok=True)
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = -1

    def remove(self) -> None:
        self.unplug()
        shutil.rmtree(self._folder, ignore_errors=True)

    def sources(self) -> list[int | socket.socket]:
        return [self._master] if self._master >= 0 else []

    def read(self) -> bytes:
        if self._master < 0:
            return b""
        try:
            return os.read(self._master, 4096)
        except OSError:  # nothing there
            return b""

    def write(self, data: bytes) -> None:
        # A real device does not wait for a reader either: what does not fit is lost.
        if data and self._master >= 0:
            with contextlib.suppress(OSError):
                os.write(self._master, data)


class _TcpPlug:
    """A listening socket on loopback with one client at a time, as a serial port has."""

    def __init__(self) -> None:
        self._port = 0
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None
        self.plug()

    @property
    def url(self) -> str:
        return f"socket://127.0.0.1:{self._port}"

    def plug(self) -> None:
        if self._server is None:
            self._server = self._listen(time.monotonic() + 2.0)
            self._server.setblocking(False)
            self._port = self._server.getsockname()[1]

    def _listen(self, deadline_s: float) -> socket.socket:
        while True:
            try:
                return socket.create_server(("127.0.0.1", self._port))
            except OSError as error:
                # A select that still waits on the former socket keeps its port for a moment.
                if error.errno != errno.EADDRINUSE or time.monotonic() > deadline_s:
                    raise
                time.sleep(0.005)

    def unplug(self) -> None:
        for end in (self._client, self._server):
            if end is not None:
                end.close()
        self._client = self._server = None

    def remove(self) -> None:
        self.unplug()

    def sources(self) -> list[int | socket.socket]:
        return [end for end in (self._server, self._client) if end is not None]

    def read(self) -> bytes:
        received = b""
        if self._client is not None:
            try:
                received = self._client.recv(4096)
                if not received:
                    self._hang_up()
            except BlockingIOError:
                pass
            except OSError:
                self._hang_up()
        if self._server is not None:
            with contextlib.suppress(OSError):
                newcomer, _ = self._server.accept()
                if self._client is None or self._has_left():
                    self._hang_up()
                    newcomer.setblocking(False)
                    newcomer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._client = newcomer
                else:
                    newcomer.close()
        return received

    def write(self, data: bytes) -> None:
        if data and self._client is not None:
            try:
                self._client.send(data)
            except BlockingIOError:
                pass
            except OSError:
                self._hang_up()

    def _has_left(self) -> bool:
        """Whether the client hung up after its last words were read: the next one may be quicker than we are."""
        assert self._client is not None
        try:
            return self._client.recv(1, socket.MSG_PEEK) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None


def seconds_until(t_ns: int) -> float:
    """Seconds from now until a monotonic instant, at least 0 (for :meth:`Handler.due_s`)."""
    return max(t_ns - time.monotonic_ns(), 0) * 1e-9
