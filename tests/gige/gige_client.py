"""A small GigE Vision client of the tests' own, which shares nothing with the camera but the wire."""

import contextlib
import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hw_mocks.gige_camera import GigeCamera

CCP, SCP, SCPS, SCDA = 0x0A00, 0x0D00, 0x0D04, 0x0D18


@dataclass
class Block:
    """What arrived of one frame: contents of packets by packet id, without their headers."""

    status: dict[int, int] = field(default_factory=dict)
    leader: bytes = b""
    trailer: bytes = b""
    data: dict[int, bytes] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        return bool(self.leader and self.trailer) and sorted(self.data) == list(range(1, len(self.data) + 1))

    @property
    def payload(self) -> bytes:
        return b"".join(self.data[number] for number in sorted(self.data))

    @property
    def timestamp(self) -> int:
        return int(struct.unpack_from(">Q", self.leader, 4)[0])


class Client:
    """Speaks GVCP to one camera and collects its stream."""

    def __init__(self, camera: GigeCamera, timeout_s: float = 2.0) -> None:
        self.camera = camera
        self.control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.control.bind((camera.address, 0))
        self.control.settimeout(timeout_s)
        self.stream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        self.stream.bind((camera.address, 0))
        self.stream.settimeout(timeout_s)
        self.number = 0

    def close(self) -> None:
        self.control.close()
        self.stream.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def send(self, command: int, payload: bytes = b"", flags: int = 1) -> int:
        self.number = self.number % 0xFFFF + 1
        head = struct.pack(">BBHHH", 0x42, flags, command, len(payload), self.number)
        self.control.sendto(head + payload, (self.camera.address, self.camera.port))
        return self.number

    def ask(self, command: int, payload: bytes = b"", flags: int = 1) -> tuple[int, bytes]:
        """Status and payload of the acknowledge."""
        number = self.send(command, payload, flags)
        while True:
            status, ack, length, got = struct.unpack_from(">HHHH", answer := self.control.recv(2048))
            if got == number and ack != 0x89:
                assert ack == command + 1
                assert length == len(answer) - 8
                return status, answer[8:]

    def read(self, address: int) -> int:
        status, value = self.ask(0x80, struct.pack(">I", address))
        assert status == 0, hex(status)
        return int.from_bytes(value, "big")

    def write(self, address: int, value: int) -> int:
        """Status."""
        return self.ask(0x82, struct.pack(">II", address, value))[0]

    def read_memory(self, address: int, size: int) -> bytes:
        out = b""
        while len(out) < size:
            count = min(512, -(-(size - len(out)) // 4) * 4)
            status, value = self.ask(0x84, struct.pack(">IHH", address + len(out), 0, count))
            assert status == 0, hex(status)
            out += value[4:]
        return out[:size]

    def at(self, name: str) -> int:
        return self.camera.registers.address_of(name)

    def put(self, name: str, value: float) -> int:
        feature = self.camera.registers._features[name]
        return self.ask(0x86, struct.pack(">I", feature.address) + feature.encode(value))[0]

    def open(self, packet_size: int = 1500) -> None:
        assert self.write(CCP, 2) == 0
        host, port = self.stream.getsockname()
        assert self.write(SCDA, int.from_bytes(socket.inet_aton(host), "big")) == 0
        assert self.write(SCP, port) == 0
        assert self.write(SCPS, packet_size) == 0

    def start(self) -> None:
        assert self.write(self.at("AcquisitionStart"), 1) == 0

    def stop(self) -> None:
        assert self.write(self.at("AcquisitionStop"), 1) == 0

    def packets(self, quiet_s: float) -> Iterator[bytes]:
        """Packets of the stream until none comes for a while."""
        self.stream.settimeout(quiet_s)
        with contextlib.suppress(TimeoutError):
            while True:
                yield self.stream.recv(65_536)

    def blocks(self, count: int, timeout_s: float = 5.0) -> dict[int, Block]:
        """The stream's blocks by their ids until ``count`` of them have a trailer, or nothing comes any more."""
        found: dict[int, Block] = {}
        ends = 0
        deadline = time.monotonic() + timeout_s
        for packet in self.packets(0.5):
            ends += collect(found, packet)
            if ends >= count or time.monotonic() > deadline:
                break
        return found

    def take(self, timeout_s: float = 5.0) -> Block:
        """One whole frame."""
        found = self.blocks(1, timeout_s)
        block = next(iter(found.values()))
        assert block.complete
        return block


def collect(found: dict[int, Block], packet: bytes) -> bool:
    """Sort one packet in; whether it was a trailer."""
    status, block_id, word = struct.unpack_from(">HHI", packet)
    kind, number, content = word >> 24, word & 0xFFFFFF, packet[8:]
    if kind & 0x80:
        kind &= 0x7F
        block_id, number = struct.unpack_from(">QI", packet, 8)
        content = packet[20:]
    block = found.setdefault(block_id, Block())
    block.status[number] = status
    if kind == 1:
        block.leader = content
    elif kind == 2:
        block.trailer = content
    elif status == 0:
        block.data[number] = content
    return kind == 2


def image_of(block: Block) -> tuple[np.ndarray, tuple[int, int, int, int]]:
    """Bytes of an image without chunks, and width, height and offsets told by its leader."""
    width, height, x, y = struct.unpack_from(">IIII", block.leader, 16)
    return np.frombuffer(block.payload, np.uint8), (width, height, x, y)
