"""GVCP, the control protocol: takes a datagram and says what to answer. Knows no sockets."""

from __future__ import annotations

import enum
import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass

from hw_mocks.gige_camera import bootstrap as gev
from hw_mocks.gige_camera.bootstrap import Bootstrap, RegisterError, Status
from hw_mocks.gige_camera.registers import WORD, Registers

KEY = 0x42
ACK_REQUIRED = 0x01
EXTENDED_IDS = 0x10
HEADER = 8
LARGEST = 576
"""Bytes of the largest datagram, its IP and UDP headers included."""
MOST_DATA = LARGEST - 28 - HEADER - 4
"""Bytes that one READMEM or WRITEMEM carries at most."""
MOST_REGISTERS = (LARGEST - 28 - HEADER) // WORD

Peer = tuple[str, int]


class Command(enum.IntEnum):
    """Commands; the acknowledge of each is its successor."""

    DISCOVERY = 0x0002
    FORCE_IP = 0x0004
    PACKET_RESEND = 0x0040
    READ_REGISTERS = 0x0080
    WRITE_REGISTERS = 0x0082
    READ_MEMORY = 0x0084
    WRITE_MEMORY = 0x0086
    PENDING_ACK = 0x0089


_CHANGING = (Command.WRITE_REGISTERS, Command.WRITE_MEMORY)


@dataclass(frozen=True)
class ResendRequest:
    """Packets that the client missed."""

    block_id: int
    first: int
    last: int


def acknowledge(command: int, request_id: int, payload: bytes = b"", status: Status = Status.SUCCESS) -> bytes:
    """The datagram that acknowledges a command."""
    return struct.pack(">HHHH", status, command + 1, len(payload), request_id) + payload


def pending(request_id: int, ready_in_ms: int) -> bytes:
    """The datagram that asks the client to be patient."""
    payload = struct.pack(">HH", 0, min(ready_in_ms, 0xFFFF))
    return struct.pack(">HHHH", 0, Command.PENDING_ACK, len(payload), request_id) + payload


class GvcpServer:
    """Answers datagrams, and keeps who controls the camera. Thread-safe.

    Args:
        registers: the camera's memory.
        resend: what to do with requests for packets.
        released: called when control ends, by release, switchover or silence.
    """

    def __init__(
        self, registers: Registers, resend: Callable[[ResendRequest], None], released: Callable[[], None]
    ) -> None:
        self._registers = registers
        self._resend = resend
        self._released = released
        self._lock = threading.RLock()
        self._owner: Peer | None = None
        self._heard_ns = 0
        self._last: tuple[Peer, bytes, bytes] | None = None

    @property
    def owner(self) -> Peer | None:
        """Who controls the camera."""
        with self._lock:
            return self._owner

    def answer(self, datagram: bytes, peer: Peer, now_ns: int) -> bytes | None:
        """What to answer, or None.

        What is no GVCP command is ignored; one that breaks off, or says another length than it has, is answered with
        INVALID_HEADER. A command that changes something and comes twice in a row, since the client missed the
        acknowledge, is carried out once.
        """
        if len(datagram) < HEADER or datagram[0] != KEY:
            return None
        flags, command, length, request_id = struct.unpack_from(">xBHHH", datagram)
        # Odd numbers are acknowledges: whoever answers them talks for ever with another camera. Number 0 is forbidden.
        if command & 1 or request_id == 0:
            return None
        with self._lock:
            if peer == self._owner:
                self._heard_ns = now_ns
            if self._last is not None and self._last[:2] == (peer, datagram):
                return self._last[2]
            payload = datagram[HEADER:]
            status, reply = Status.INVALID_HEADER, b""
            if len(payload) == length:
                status, answered = self._carry_out(command, flags, payload, peer, now_ns)
                if answered is None:
                    return None
                reply = answered
            if not flags & ACK_REQUIRED and command != Command.DISCOVERY:
                return None
            ack = acknowledge(command, request_id, reply, status)
            self._last = (peer, datagram, ack) if command in _CHANGING else None
            return ack

    def check_heartbeat(self, now_ns: int) -> None:
        """Take control away from a client that has been silent for too long."""
        with self._lock:
            disabled = self._registers.number(Bootstrap.GVCP_CONFIGURATION) & gev.HEARTBEAT_DISABLED
            limit_ns = self._registers.number(Bootstrap.HEARTBEAT_TIMEOUT_MS) * 1_000_000
            if self._owner is not None and not disabled and now_ns - self._heard_ns > limit_ns:
                self.release()

    def release(self) -> None:
        """End control: nobody may write, and frames go nowhere."""
        with self._lock:
            held, self._owner, self._last = self._owner is not None, None, None
            for address in (
                Bootstrap.CONTROL_PRIVILEGE,
                Bootstrap.PRIMARY_PORT,
                Bootstrap.PRIMARY_IP,
                Bootstrap.STREAM_PORT,
            ):
                self._registers.put(address, 0)
            if held:
                self._released()

    def _carry_out(
        self, command: int, flags: int, payload: bytes, peer: Peer, now_ns: int
    ) -> tuple[Status, bytes | None]:
        """Status and payload of the acknowledge; None for commands that have none."""
        try:
            if command == Command.DISCOVERY:
                return Status.SUCCESS, self._registers.read(0, gev.DISCOVERY_SIZE)
            if command == Command.READ_REGISTERS:
                return self._read_registers(payload, peer)
            if command == Command.WRITE_REGISTERS:
                return self._write_registers(payload, peer, now_ns)
            if command == Command.READ_MEMORY:
                return Status.SUCCESS, self._read_memory(payload, peer)
            if command == Command.WRITE_MEMORY:
                return self._write_memory(payload, peer, now_ns)
            if command == Command.PACKET_RESEND:
                self._ask_again(payload, flags, peer)
                return Status.SUCCESS, None
            if command == Command.FORCE_IP:
                return self._force_ip(payload)
        except RegisterError as error:
            return error.status, b""
        return Status.NOT_IMPLEMENTED, b""

    def _read_registers(self, payload: bytes, peer: Peer) -> tuple[Status, bytes]:
        if not payload or len(payload) % WORD or len(payload) > MOST_REGISTERS * WORD:
            raise RegisterError(Status.INVALID_PARAMETER)
        values = b""
        for (address,) in struct.iter_unpack(">I", payload):
            try:
                self._may_read(peer, address)
                values += self._registers.read(address, WORD)
            except RegisterError as error:
                # What was read before the first bad address is told as well.
                return error.status, values
        return Status.SUCCESS, values

    def _write_registers(self, payload: bytes, peer: Peer, now_ns: int) -> tuple[Status, bytes]:
        if not payload or len(payload) % (2 * WORD) or len(payload) > MOST_REGISTERS * WORD:
            raise RegisterError(Status.INVALID_PARAMETER)
        for index, (address, value) in enumerate(struct.iter_unpack(">II", payload)):
            try:
                self._write(address, value.to_bytes(WORD, "big"), peer, now_ns)
            except RegisterError as error:
                return error.status, struct.pack(">HH", 0, index)
        return Status.SUCCESS, struct.pack(">HH", 0, len(payload) // (2 * WORD))

    def _read_memory(self, payload: bytes, peer: Peer) -> bytes:
        if len(payload) != 2 * WORD:
            raise RegisterError(Status.INVALID_PARAMETER)
        address, size = struct.unpack(">IxxH", payload)
        if size == 0 or size > MOST_DATA:
            raise RegisterError(Status.INVALID_PARAMETER)
        self._may_read(peer, address)
        return payload[:WORD] + self._registers.read(address, size)

    def _write_memory(self, payload: bytes, peer: Peer, now_ns: int) -> tuple[Status, bytes]:
        if len(payload) <= WORD or len(payload) - WORD > MOST_DATA:
            raise RegisterError(Status.INVALID_PARAMETER)
        try:
            self._write(int.from_bytes(payload[:WORD], "big"), payload[WORD:], peer, now_ns)
        except RegisterError as error:
            return error.status, struct.pack(">HH", 0, 0)
        return Status.SUCCESS, struct.pack(">HH", 0, len(payload) - WORD)

    def _ask_again(self, payload: bytes, flags: int, peer: Peer) -> None:
        extended = bool(flags & EXTENDED_IDS)
        if len(payload) != (20 if extended else 12):
            return
        _, block_id, first, last = struct.unpack_from(">HHII", payload)
        if extended:
            block_id = int.from_bytes(payload[12:20], "big")
        else:
            first, last = first & 0xFFFFFF, last & 0xFFFFFF
        # Only the host that the frames go to may ask; it may do so from another port.
        if first <= last and peer[0] == stream_address(self._registers)[0]:
            self._resend(ResendRequest(block_id, first, last))

    def _force_ip(self, payload: bytes) -> tuple[Status, bytes | None]:
        if len(payload) != 56:
            raise RegisterError(Status.INVALID_PARAMETER)
        mac = self._registers.read(Bootstrap.MAC_HIGH, 8)[2:]
        if payload[2:8] != mac:
            return Status.SUCCESS, None
        same = payload[20:24] == self._registers.read(Bootstrap.CURRENT_IP, WORD)
        # It lives at the address that it was given when it was made, and cannot move.
        return (Status.SUCCESS if same else Status.ERROR), b""

    def _may_read(self, peer: Peer, address: int) -> None:
        exclusive = self._registers.number(Bootstrap.CONTROL_PRIVILEGE) & gev.EXCLUSIVE
        if exclusive and peer != self._owner and address != Bootstrap.CONTROL_PRIVILEGE:
            raise RegisterError(Status.ACCESS_DENIED)

    def _write(self, address: int, content: bytes, peer: Peer, now_ns: int) -> None:
        if address == Bootstrap.CONTROL_PRIVILEGE and len(content) == WORD:
            self._take_control(int.from_bytes(content, "big"), peer, now_ns)
        elif peer != self._owner:
            raise RegisterError(Status.ACCESS_DENIED)
        else:
            self._registers.write(address, content)

    def _take_control(self, value: int, peer: Peer, now_ns: int) -> None:
        wanted = value & (gev.EXCLUSIVE | gev.CONTROL)
        if self._owner not in (None, peer):
            offered = self._registers.number(Bootstrap.CONTROL_PRIVILEGE) & gev.SWITCHOVER_ENABLED
            if not (offered and wanted and value >> 16 == self._registers.number(Bootstrap.SWITCHOVER_KEY)):
                raise RegisterError(Status.ACCESS_DENIED)
        if not wanted:
            self.release()
            return
        self._owner, self._heard_ns = peer, now_ns
        self._registers.put(Bootstrap.CONTROL_PRIVILEGE, value & (wanted | gev.SWITCHOVER_ENABLED))
        self._registers.put(Bootstrap.PRIMARY_PORT, peer[1])
        self._registers.put(Bootstrap.PRIMARY_IP, int.from_bytes(bytes(int(x) for x in peer[0].split(".")), "big"))


def stream_address(registers: Registers) -> Peer:
    """Where frames go; port 0 when nowhere."""
    address = registers.number(Bootstrap.STREAM_IP).to_bytes(WORD, "big")
    return ".".join(str(byte) for byte in address), registers.number(Bootstrap.STREAM_PORT)
