"""The sound card over loopback TCP, for machines without PortAudio.

A client sends ``TOKEN listen\\n``, gets one line of JSON (sample rate, channels, sample type) and then blocks: a header
``<QqI`` of first frame, host time of its sampling (ns, monotonic) and number of frames, followed by the samples. A
client that does not keep up loses whole blocks, which the frame numbers tell.
"""

from __future__ import annotations

import contextlib
import json
import socket
import struct
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hw_mocks.loopback import MAX_LINE, Address, listen, token_matches
from hw_mocks.sound_card.sample_formats import encode

HEADER = struct.Struct("<QqI")
BACKLOG_S = 2.0
LONGEST_BLOCK = 1_000_000
"""Frames that one block may hold; whoever announces more sends something else."""


def read_block(read: Callable[[int], bytes]) -> tuple[NDArray[np.int16], int, int]:
    """Read one block: samples (frames, 2), number of the first frame, host time of its sampling (ns).

    Args:
        read: gives as many bytes as asked for, fewer only at the stream's end.

    Raises:
        ConnectionError: the stream ends. ValueError: a block that no sound card sends.
    """
    header = read(HEADER.size)
    if len(header) < HEADER.size:
        raise ConnectionError("it hung up")
    first, t_ns, frames = HEADER.unpack(header)
    if frames > LONGEST_BLOCK:
        raise ValueError(f"it announces a block of {frames} frames")
    payload = read(4 * frames)
    if len(payload) < 4 * frames:
        raise ConnectionError("it hung up")
    return np.frombuffer(payload, dtype="<i2").astype(np.int16).reshape(-1, 2), first, t_ns


@dataclass
class _Client:
    connection: socket.socket
    greeting: bytes = b""
    listening: bool = False
    pending: bytearray = field(default_factory=bytearray)


class StreamServer:
    """A :class:`hw_mocks.sound_card.feeder.Sink` that serves any number of clients from the feeder's thread."""

    def __init__(self, sample_rate_hz: float) -> None:
        self._rate = sample_rate_hz
        self._server, self._address = listen()
        self._server.setblocking(False)
        self._clients: list[_Client] = []
        self._unplugged = False

    @property
    def url(self) -> str:
        """Address for :class:`hw_mocks.scene_radar.SceneRadar`."""
        return self._address.url

    @property
    def address(self) -> Address:
        """The same as parts."""
        return self._address

    def put(self, samples: NDArray[np.generic], first: int, t_ns: int) -> None:
        """Send a block to every client; see :class:`hw_mocks.sound_card.feeder.Sink`."""
        self._accept()
        message = HEADER.pack(first, t_ns, len(samples)) + encode(samples, "int16")
        limit = int(BACKLOG_S * self._rate) * 4
        for client in self._clients:
            if client.listening and len(client.pending) < limit:
                client.pending += message
        self.flush()

    def flush(self) -> bool:
        """Send what waits, without waiting; whether anything still waits."""
        for client in list(self._clients):
            try:
                if not client.listening:
                    self._greet(client)
                if client.pending:
                    del client.pending[: client.connection.send(client.pending)]
            except BlockingIOError:
                continue
            except OSError:
                client.connection.close()
                self._clients.remove(client)
        return any(client.pending for client in self._clients)

    def unplug(self) -> None:
        """Fault: hang up on everybody, and on whoever calls, until :meth:`plug_in`."""
        self._unplugged = True
        self._hang_up()

    def plug_in(self) -> None:
        """Answer again."""
        self._accept()
        self._unplugged = False

    def close(self) -> None:
        """Hang up on everybody. Idempotent."""
        self._hang_up()
        self._server.close()

    def _hang_up(self) -> None:
        for client in self._clients:
            client.connection.close()
        self._clients.clear()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._server.accept()
                if self._unplugged:
                    connection.close()
                    continue
                connection.setblocking(False)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._clients.append(_Client(connection))

    def _greet(self, client: _Client) -> None:
        received = client.connection.recv(MAX_LINE)
        client.greeting += received
        line, end, _ = client.greeting.partition(b"\n")
        token, _, request = line.partition(b" ")
        if end and token_matches(token, self._address) and request == b"listen":
            client.listening = True
            client.pending += json.dumps({"sample_rate_hz": self._rate, "channels": 2, "dtype": "<i2"}).encode() + b"\n"
        elif end or not received or len(client.greeting) > MAX_LINE:
            raise ConnectionError("not a listener")
