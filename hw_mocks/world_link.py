"""Read the simulated world from another process: a tiny loopback line protocol.

The client sends ``TOKEN state\\n`` and gets one line of JSON with the world's present state. A caller without the token
is hung up on.
"""

from __future__ import annotations

import contextlib
import json
import selectors
import socket
import threading
import time
from typing import TypedDict

from drivers.errors import DeviceBadAnswer, DeviceLost, DeviceTimeout
from hw_mocks.loopback import HOST, MAX_LINE, Address, connect, listen, token_matches
from hw_mocks.world import World


class WorldState(TypedDict):
    """The world at one instant (``t_ns``, the host's monotonic clock)."""

    t_ns: int
    trolley_x_m: float
    polarizer_rad: float
    transmit: str
    receive: str


class WorldServer:
    """Serves the state of a world to processes of this machine; one thread, ended by :meth:`close`."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._server, self._address = listen()
        self._server.setblocking(False)
        self._wake_receive, self._wake_send = socket.socketpair()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._server, selectors.EVENT_READ)
        self._selector.register(self._wake_receive, selectors.EVENT_READ)
        self._pending: dict[socket.socket, bytes] = {}
        self._thread = threading.Thread(target=self._serve, name="world-server", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address for :class:`WorldClient`, like ``tcp://127.0.0.1:PORT?token=...``."""
        return self._address.url

    def close(self) -> None:
        """Stop serving. Idempotent."""
        if self._thread.is_alive():
            with contextlib.suppress(OSError):
                self._wake_send.send(b"x")
            self._thread.join(timeout=5)
        self._wake_send.close()

    def __enter__(self) -> WorldServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _serve(self) -> None:
        try:
            while True:
                for key, _ in self._selector.select():
                    if key.fileobj is self._wake_receive:
                        return
                    if key.fileobj is self._server:
                        self._accept()
                    else:
                        assert isinstance(key.fileobj, socket.socket)
                        self._read(key.fileobj)
        finally:
            self._selector.close()
            for connection in (*self._pending, self._server, self._wake_receive):
                connection.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            connection, _ = self._server.accept()
            # An answer is below 200 bytes: it fits into any socket's buffer, so a send never waits.
            connection.setblocking(False)
            self._pending[connection] = b""
            self._selector.register(connection, selectors.EVENT_READ)

    def _read(self, connection: socket.socket) -> None:
        try:
            received = connection.recv(MAX_LINE)
            buffer = self._pending[connection] + received
            *lines, rest = buffer.split(b"\n")
            alive = bool(received) and len(rest) < MAX_LINE and all(self._answer(connection, line) for line in lines)
        except BlockingIOError:
            return
        except OSError:
            alive, rest = False, b""
        if alive:
            self._pending[connection] = rest
        else:
            self._selector.unregister(connection)
            del self._pending[connection]
            connection.close()

    def _answer(self, connection: socket.socket, line: bytes) -> bool:
        token, _, request = line.partition(b" ")
        if not token_matches(token, self._address) or request != b"state":
            return False
        connection.sendall(json.dumps(self._state()).encode() + b"\n")
        return True

    def _state(self) -> WorldState:
        t_ns = time.monotonic_ns()
        return WorldState(
            t_ns=t_ns,
            trolley_x_m=self._world.trolley_x_m.at(t_ns),
            polarizer_rad=self._world.polarizer_rad.at(t_ns),
            transmit=self._world.transmit.at(t_ns),
            receive=self._world.receive.at(t_ns),
        )


class WorldClient:
    """Asks a :class:`WorldServer`; connects at the first question. Safe to use from several threads."""

    def __init__(self, url: str, *, timeout_s: float = 2.0) -> None:
        self._address = Address.parse(url)
        self._timeout_s = timeout_s
        self._socket: socket.socket | None = None
        self._lock = threading.Lock()

    def state(self) -> WorldState:
        """The world's present state.

        Raises:
            DeviceLost: the simulated rig is gone, or the token is wrong.
            DeviceTimeout: it does not answer in time.
            DeviceBadAnswer: something else answers at that address.
        """
        with self._lock:
            try:
                return self._ask()
            except BaseException:
                # The line may hold half an answer: start afresh the next time.
                self._hang_up()
                raise

    def close(self) -> None:
        """Hang up. Idempotent; a later question connects again."""
        with self._lock:
            self._hang_up()

    def _hang_up(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _ask(self) -> WorldState:
        where = f"tcp://{HOST}:{self._address.port}"
        if self._socket is None:
            self._socket = connect(self._address, self._timeout_s, "world")
        deadline = time.monotonic() + self._timeout_s
        answer = b""
        try:
            self._socket.sendall(f"{self._address.token} state\n".encode())
            while not answer.endswith(b"\n") and len(answer) < MAX_LINE:
                self._socket.settimeout(max(deadline - time.monotonic(), 1e-3))
                received = self._socket.recv(MAX_LINE)
                if not received:
                    raise ConnectionError("it hung up")
                answer += received
        except TimeoutError:
            raise DeviceTimeout(
                "the simulated world does not answer", where=where, advice="start 'polfuse sim' again"
            ) from None
        except OSError as error:
            raise DeviceLost(
                f"the simulated world is gone ({error})",
                where=where,
                advice="start 'polfuse sim' again and use the rig file that it writes",
            ) from error
        try:
            found = json.loads(answer)
            return WorldState(
                t_ns=int(found["t_ns"]),
                trolley_x_m=float(found["trolley_x_m"]),
                polarizer_rad=float(found["polarizer_rad"]),
                transmit=str(found["transmit"]),
                receive=str(found["receive"]),
            )
        except (ValueError, KeyError, TypeError):
            raise DeviceBadAnswer(
                f"something else than the simulated world answered {answer[:40]!r}",
                where=where,
                advice="use the rig file that 'polfuse sim' wrote",
            ) from None
