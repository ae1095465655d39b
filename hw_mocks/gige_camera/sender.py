"""Puts packets on the wire at the speed of the link, keeps the last frames for whoever missed a packet."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections import Counter, OrderedDict
from dataclasses import dataclass

import numpy as np

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.gige_camera import bootstrap as gev
from hw_mocks.gige_camera.bootstrap import Bootstrap
from hw_mocks.gige_camera.gvcp import Peer, ResendRequest, stream_address
from hw_mocks.gige_camera.gvsp import UDP_HEADERS, FramePackets, error_packet, runs
from hw_mocks.gige_camera.registers import Registers

_UDP_SEGMENT = 103
"""Linux's socket option that lets the kernel cut one buffer into many datagrams of equal size."""
_BURST_BYTES = 48_000
_BURST_PACKETS = 40
_KEPT_FRAMES = 16
_MOST_RESENT = 4096
_WIRE_OVERHEAD = 38
"""Bytes that Ethernet adds to a packet: preamble, header, check sum, gap."""
_SHORTEST_SLEEP_S = 2e-4


@dataclass(frozen=True)
class Link:
    """The cable between camera and host."""

    bits_per_s: float = 1e9
    """Speed; a frame's packets leave no faster."""
    mtu: int = 9000
    """Largest packet that gets through, bytes; larger ones vanish, as behind a switch without jumbo frames."""


class PacketSender:
    """Sends frames and resends packets. Thread-safe.

    Args:
        registers: the camera's memory, which says whereto, in which packets and how fast.
        source: IPv4 address to send from.
        link: the cable.
        faults: ``DROP_PACKETS``, ``GARBAGE``, ``DISCONNECT``.
        seed: of which packets get lost.
    """

    def __init__(self, registers: Registers, source: str, link: Link, faults: FaultScript, seed: int) -> None:
        self._registers, self._link, self._faults = registers, link, faults
        self._random = np.random.default_rng(seed)
        self._random_lock = threading.Lock()
        self._kept: OrderedDict[int, FramePackets] = OrderedDict()
        self._lock = threading.Lock()
        self.counts: Counter[str] = Counter()
        """Frames sent, packets dropped, packets asked for again, sent again and unavailable, test packets."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4 << 20)
        self._socket.bind((source, 0))
        self._segments = _can_segment(self._socket)

    @property
    def port(self) -> int:
        """Port that packets come from."""
        return int(self._socket.getsockname()[1])

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def forget(self) -> None:
        """Forget all frames kept."""
        with self._lock:
            self._kept.clear()

    def packet_size(self) -> int:
        """Bytes of a packet as the client set it."""
        return self._registers.number(Bootstrap.STREAM_PACKET_SIZE) & gev.PACKET_SIZE_MASK

    def test_packet(self) -> None:
        """Send one packet of the size set, of any content; one that is too large for the link does not arrive."""
        peer = stream_address(self._registers)
        if peer[1]:
            self.counts["test packets"] += 1
            self._put(bytes(self.packet_size() - UDP_HEADERS), peer)

    def send(self, frame: FramePackets, number: int, tick_hz: int) -> None:
        """Send a frame, paced, and keep it.

        Args:
            frame: its packets.
            number: the frame's number, for faults that count.
            tick_hz: unit of the inter-packet delay.
        """
        with self._lock:
            self._kept[frame.block_id] = frame
            while len(self._kept) > _KEPT_FRAMES:
                self._kept.popitem(last=False)
        peer = stream_address(self._registers)
        if not peer[1]:
            return
        if self._faults.active(FaultKind.GARBAGE, count=number):
            self._garbage(peer)
        lost = self._lost(frame.count, number)
        self.counts["packets dropped"] += int(lost.sum())
        delay_s = self._registers.number(Bootstrap.STREAM_PACKET_DELAY) / tick_hz
        packet_s = (frame.packet_bytes + UDP_HEADERS + _WIRE_OVERHEAD) * 8 / self._link.bits_per_s + delay_s
        burst = max(1, min(_BURST_PACKETS, _BURST_BYTES // frame.packet_bytes))
        if delay_s > _SHORTEST_SLEEP_S:
            # The client asked for single packets, and the pauses are long enough to be kept.
            burst = 1
        start = time.perf_counter()
        if not lost[0]:
            self._put(frame.leader, peer)
        for first, last in runs(lost[1:-1]):
            for begin in range(first, last + 1, burst):
                end = min(begin + burst - 1, last)
                _wait_until(start + begin * packet_s)
                self._put_many(frame, begin, end, peer)
        if not lost[-1]:
            self._put(frame.trailer, peer)
        self.counts["frames sent"] += 1

    def resend(self, request: ResendRequest) -> None:
        """Send packets again, or say that they are gone."""
        peer = stream_address(self._registers)
        if not peer[1]:
            return
        with self._lock:
            frame = self._kept.get(request.block_id)
        self.counts["packets asked for"] += request.last - request.first + 1
        if frame is None:
            self.counts["packets unavailable"] += 1
            extended = bool(self._registers.number(Bootstrap.GVSP_CONFIGURATION) & gev.BLOCK_ID_64)
            self._put(error_packet(request.block_id, request.first, extended=extended), peer)
            return
        # Clients may ask for "all the rest" by a last packet far beyond the end.
        last = min(request.last, frame.count - 1, request.first + _MOST_RESENT - 1)
        for number in range(request.first, last + 1):
            if self._lost(1, None)[0]:
                self.counts["packets dropped"] += 1
                continue
            self._put(frame.packet(number), peer)
            self.counts["packets sent again"] += 1

    def _lost(self, packets: int, number: int | None) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        fault = self._faults.active(FaultKind.DROP_PACKETS, count=number)
        if fault is None:
            return np.zeros(packets, dtype=np.bool_)
        with self._random_lock:
            return self._random.random(packets) < fault.amount

    def _garbage(self, peer: Peer) -> None:
        with self._random_lock:
            sizes = self._random.integers(0, 600, 3)
            packets = [self._random.bytes(int(size)) for size in sizes]
        for packet in packets:
            self._put(packet, peer)

    def _put_many(self, frame: FramePackets, first: int, last: int, peer: Peer) -> None:
        """Send data packets that follow one another."""
        if first == last or not self._segments or frame.packet_bytes + UDP_HEADERS > self._link.mtu:
            for number in range(first, last + 1):
                self._put(frame.data(number, number), peer)
            return
        if self._faults.active(FaultKind.DISCONNECT):
            return
        option = (socket.IPPROTO_UDP, _UDP_SEGMENT, struct.pack("H", frame.packet_bytes))
        with contextlib.suppress(OSError):
            self._socket.sendmsg([frame.data(first, last)], [option], 0, peer)

    def _put(self, packet: bytes | memoryview, peer: Peer) -> None:
        """Send one packet, or lose it."""
        if len(packet) + UDP_HEADERS > self._link.mtu or self._faults.active(FaultKind.DISCONNECT):
            return
        # A client that is gone answers with "port unreachable": a camera does not mind.
        with contextlib.suppress(OSError):
            self._socket.sendto(packet, peer)


def _can_segment(sender: socket.socket) -> bool:
    """Whether this system cuts buffers into datagrams."""
    try:
        sender.getsockopt(socket.IPPROTO_UDP, _UDP_SEGMENT)
    except OSError:
        return False
    return True


def _wait_until(instant: float) -> None:
    """Sleep until ``time.perf_counter()`` says so; too short a wait is not worth a sleep."""
    left = instant - time.perf_counter()
    if left > _SHORTEST_SLEEP_S:
        time.sleep(left)
