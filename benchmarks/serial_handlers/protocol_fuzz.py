"""``fuzz://NAME``: a port whose peer is a function of what is written to it. Nothing here ever waits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

BUFFER_BYTES = 65_536
"""What an operating system keeps for a program that does not read; older bytes are lost."""


class Serial:
    """The part of :class:`serial.Serial` that :class:`drivers.transport.SerialLine` uses."""

    peers: ClassVar[dict[str, Callable[[bytes], bytes]]] = {}
    """What each name answers to what is written."""

    def __init__(self, port: str | None, **settings: Any) -> None:
        self.port = ""
        self._received = b""

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived."""
        return len(self._received)

    def read(self, size: int = 1) -> bytes:
        """What has arrived; never waits."""
        taken, self._received = self._received[:size], self._received[size:]
        return taken

    def write(self, data: bytes) -> int:
        """Let the peer answer."""
        self._received = (self._received + self.peers[self.port.removeprefix("fuzz://")](data))[-BUFFER_BYTES:]
        return len(data)
