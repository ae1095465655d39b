"""The socket of an engine of any kind: clients come, are told, steer, and go; what goes on does not depend on them."""

from __future__ import annotations

import contextlib
import hmac
import os
import threading
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import zmq

from polfuse_lab.engine import protocol

LINGER_S = 2.0
"""How long a finished engine waits for its clients to take note."""


@dataclass
class Guest:
    """A client that is attached."""

    heard: float
    """When it was heard last, s of the monotonic clock."""
    preview: int = 0
    """Number of the newest preview that it has been sent."""


class ClientServer(ABC):
    """Serves clients in a thread of its own until :meth:`finish`.

    Args:
        directory: the engine's private directory.
        request: what the engine was started for.
    """

    def __init__(self, directory: Path, request: protocol.Request) -> None:
        self._token = request.token
        self._clients: dict[bytes, Guest] = {}
        self._silent: set[bytes] = set()
        """Those that attached and were forgotten for their silence: a client that was stopped comes back."""
        self._met = False
        """Whether any client has ever attached: a run may end before the one that started it gets to the socket."""
        self._last: Any = None
        """The last message, once all is over."""
        self._changed = threading.Event()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 500)
        self._socket.setsockopt(zmq.SNDHWM, 1000)
        self.endpoint = _bind(self._socket, directory, request.transport)
        self._thread = threading.Thread(target=self._work, name="engine server", daemon=True)

    @abstractmethod
    def _decode(self, content: bytes) -> Any:
        """A client's message. Raises :class:`msgspec.MsgspecError` for anything else."""

    @abstractmethod
    def _obey(self, message: Any) -> str | None:
        """Do what a client asks; why not, where it is not done."""

    @abstractmethod
    def _states(self) -> dict[bytes, Any]:
        """What each attached client is to be told now."""

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def changed(self) -> None:
        """Something has changed: tell it without delay."""
        self._changed.set()

    @property
    def silence_s(self) -> float | None:
        """Since when no attached client has been heard, s; None where none is attached (any more)."""
        now = time.monotonic()
        return min((now - client.heard for client in list(self._clients.values())), default=None)

    @property
    def met(self) -> bool:
        """Whether any client has ever attached."""
        return self._met

    def end(self, last: Any) -> None:
        """Tell the last message, wait until every client has left (a few seconds at most), and end."""
        self._last = last
        self._thread.join(LINGER_S + 8)
        if self._thread.is_alive():
            # ZeroMQ ends the process when a socket is closed under the thread that uses it.
            return
        self._socket.close()
        self._context.term()

    def _work(self) -> None:
        sent = 0.0
        finished: float | None = None
        while True:
            if self._socket.poll(20):
                self._receive()
            now = time.monotonic()
            self._forget(now)
            if self._last is not None:
                if finished is None:
                    finished = now
                    for identity in (*self._clients, *self._silent):
                        self._send(identity, self._last)
                alone = not self._clients and not self._silent
                if (self._met and alone) or now - finished > LINGER_S:
                    return
            elif self._changed.is_set() or now - sent > protocol.STATUS_EVERY_S:
                self._changed.clear()
                sent = now
                self._tell()

    def _receive(self) -> None:
        try:
            identity, content = self._socket.recv_multipart(zmq.NOBLOCK)
        except (zmq.Again, ValueError):
            return
        try:
            message = self._decode(content)
        except msgspec.MsgspecError as error:
            self._send(identity, protocol.Refused(f"message not understood ({error})"))
            return
        if identity in self._silent:
            self._silent.discard(identity)
            self._clients[identity] = Guest(time.monotonic())
            if self._last is not None:
                self._send(identity, self._last)
        if isinstance(message, protocol.Attach):
            self._attach(identity, message)
        elif identity not in self._clients:
            self._send(identity, protocol.Refused("attach first"))
        elif isinstance(message, protocol.Detach):
            del self._clients[identity]
        else:
            self._clients[identity].heard = time.monotonic()
            if not isinstance(message, protocol.Ping) and (refusal := self._obey(message)) is not None:
                self._send(identity, protocol.Refused(refusal))

    def _attach(self, identity: bytes, message: protocol.Attach) -> None:
        if message.version != protocol.PROTOCOL_VERSION:
            self._send(
                identity,
                protocol.Refused(f"the engine speaks protocol {protocol.PROTOCOL_VERSION}, not {message.version}"),
            )
        elif not hmac.compare_digest(message.token.encode(), self._token.encode()):
            self._send(identity, protocol.Refused("wrong token"))
        else:
            self._clients[identity] = Guest(time.monotonic())
            self._met = True
            if self._last is not None:
                self._send(identity, self._last)
            else:
                self._tell()

    def _forget(self, now: float) -> None:
        for identity in [key for key, client in self._clients.items() if now - client.heard > protocol.SILENCE_S]:
            del self._clients[identity]
            self._silent.add(identity)

    def _tell(self) -> None:
        for identity, message in self._states().items():
            self._send(identity, message)

    def _send(self, identity: bytes, message: Any) -> None:
        # A client that does not read loses events; the engine never waits for it.
        with contextlib.suppress(zmq.ZMQError):
            self._socket.send_multipart([identity, protocol.encode(message)], zmq.NOBLOCK)


def _bind(socket: zmq.Socket[bytes], directory: Path, transport: str) -> str:
    if transport == "ipc":
        endpoint = f"ipc://{directory / 'engine.sock'}"
        before = os.umask(0o177)
        try:
            socket.bind(endpoint)
        finally:
            os.umask(before)
        return endpoint
    return f"tcp://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}"
