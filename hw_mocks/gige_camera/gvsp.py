"""GVSP, the streaming protocol: a frame as leader, payload and trailer packets. Knows no sockets."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hw_mocks.gige_camera.bootstrap import Status

LEADER, TRAILER, PAYLOAD = 1, 2, 3
IMAGE = 0x0001
WITH_CHUNKS = 0x4000
"""Payload type flag of the extended chunk mode."""
UDP_HEADERS = 28
"""Bytes of the IP and UDP headers, which the stream packet size includes."""
_EXTENDED = 0x80
_SHORT, _LONG = 8, 20
RGB8 = 0x02180014


@dataclass(frozen=True)
class Leader:
    """What the first packet tells of a frame."""

    timestamp_ticks: int
    pixel_format: int
    width: int
    height: int
    offset_x: int
    offset_y: int
    payload_type: int = IMAGE

    def encode(self) -> bytes:
        """The leader's content."""
        sizes = (self.width, self.height, self.offset_x, self.offset_y)
        return struct.pack(">HHQIIIIIHH", 0, self.payload_type, self.timestamp_ticks, self.pixel_format, *sizes, 0, 0)


def trailer(payload_type: int, height: int, chunk_bytes: int = 0) -> bytes:
    """The trailer's content; with chunks also the length of all that they take."""
    content = struct.pack(">HHI", 0, payload_type, height)
    return content + struct.pack(">II", chunk_bytes, 0) if payload_type & WITH_CHUNKS else content


def header(packet_type: int, block_id: int, packet_id: int, *, extended: bool, status: int = 0) -> bytes:
    """A packet's header; ``extended`` has a block id of 64 and a packet id of 32 bits."""
    if extended:
        return struct.pack(">HHBBHQI", status, 0, _EXTENDED | packet_type, 0, 0, block_id, packet_id)
    return struct.pack(">HHI", status, block_id & 0xFFFF, packet_type << 24 | packet_id & 0xFFFFFF)


def chunk(number: int, content: bytes) -> bytes:
    """A chunk with its tag, which follows it; its length is a multiple of 4."""
    content = content.ljust(-(-len(content) // 4) * 4, b"\0")
    return content + struct.pack(">II", number, len(content))


def error_packet(block_id: int, packet_id: int, *, extended: bool) -> bytes:
    """What is sent instead of a packet that is no longer there."""
    return header(PAYLOAD, block_id, packet_id, extended=extended, status=Status.PACKET_UNAVAILABLE)


class FramePackets:
    """A frame cut into packets, ready to be sent, and to be sent again.

    Packet 0 is the leader, 1 to n carry data, n + 1 is the trailer. The data packets lie one behind the other in one
    buffer, all of ``packet_bytes`` but the last.

    Args:
        block_id: number of the frame.
        leader: content of the leader.
        data: what the packets carry, uint8 (bytes,).
        end: content of the trailer.
        packet_size: bytes of a packet with its IP and UDP headers.
        extended: whether block ids have 64 bits.
    """

    def __init__(
        self, block_id: int, leader: bytes, data: NDArray[np.uint8], end: bytes, packet_size: int, *, extended: bool
    ) -> None:
        self.block_id, self.extended = block_id, extended
        self.packet_bytes = packet_size - UDP_HEADERS
        head = _LONG if extended else _SHORT
        room = self.packet_bytes - head
        whole, rest = divmod(data.size, room)
        packets = whole + bool(rest)
        buffer = np.empty((packets, self.packet_bytes), dtype=np.uint8)
        buffer[:, head:][:whole] = data[: whole * room].reshape(whole, room)
        if rest:
            buffer[whole, head : head + rest] = data[whole * room :]
        buffer[:, :head] = _headers(packets, block_id, extended=extended)
        self.data_bytes = packets * head + data.size
        """Bytes of all data packets."""
        self.buffer = buffer.reshape(-1).data[: self.data_bytes]
        self.leader = header(LEADER, block_id, 0, extended=extended) + leader
        self.trailer = header(TRAILER, block_id, packets + 1, extended=extended) + end
        self.count = packets + 2
        """Number of packets, leader and trailer included."""

    def data(self, first: int, last: int) -> memoryview:
        """Data packets ``first`` to ``last`` (from 1), one behind the other."""
        return self.buffer[(first - 1) * self.packet_bytes : last * self.packet_bytes]

    def packet(self, number: int) -> bytes | memoryview:
        """One packet, by its id. Raises IndexError when the frame has no such packet."""
        if not 0 <= number < self.count:
            raise IndexError(number)
        if number == 0:
            return self.leader
        return self.trailer if number == self.count - 1 else self.data(number, number)


def _headers(packets: int, block_id: int, *, extended: bool) -> NDArray[np.uint8]:
    """Headers of all data packets, uint8 (packets, bytes)."""
    first = np.frombuffer(header(PAYLOAD, block_id, 0, extended=extended), dtype=np.uint8)
    headers = np.tile(first, (packets, 1))
    numbers = np.arange(1, packets + 1, dtype=">u4").view(np.uint8).reshape(-1, 4)
    if extended:
        headers[:, 16:20] = numbers
    else:
        headers[:, 5:8] = numbers[:, 1:]
    return headers


def runs(lost: Sequence[bool] | NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index (from 1) of every unbroken run of data packets that are not lost."""
    kept = np.concatenate([[False], ~np.asarray(lost, dtype=bool), [False]]).astype(np.int8)
    edges = np.diff(kept)
    starts, ends = np.flatnonzero(edges == 1) + 1, np.flatnonzero(edges == -1)
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]
