"""Messages of Thorlabs Elliptec devices: an address digit, two letters, hexadecimal data, CR LF."""

from __future__ import annotations

import re
from dataclasses import dataclass

#: The meaning of the status in ``GSxx``.
STATUS = {
    0x00: "ok",
    0x01: "communication time-out",
    0x02: "mechanical time-out",
    0x03: "command error or not supported",
    0x04: "value out of range",
    0x05: "module isolated",
    0x06: "module out of isolation",
    0x07: "initialisation error",
    0x08: "thermal error",
    0x09: "busy",
    0x0A: "sensor error",
    0x0B: "motor error",
    0x0C: "value out of range",
    0x0D: "overcurrent",
}
BUSY = 0x09


@dataclass(frozen=True)
class Information:
    """What ``IN`` tells: type (14 for ELL14), serial number, year, release, travel (degrees or mm) and pulses."""

    type_number: int
    serial_number: str
    year: str
    release: str
    travel: int
    pulses: int


def status(message: str) -> int | None:
    """Status of a ``0GSxx`` message, or None when it is another message."""
    match = re.fullmatch(r"[0-9A-F]GS([0-9A-Fa-f]{2})", message)
    return int(match[1], 16) if match else None


def position(message: str) -> int | None:
    """Pulses of a ``0POxxxxxxxx`` message (32-bit two's complement), or None when it is another message."""
    match = re.fullmatch(r"[0-9A-F]PO([0-9A-Fa-f]{8})", message)
    if match is None:
        return None
    value = int(match[1], 16)
    return value - (1 << 32) if value >= 1 << 31 else value


def information(message: str) -> Information | None:
    """Contents of a ``0IN…`` message, or None when it is another message."""
    match = re.fullmatch(
        r"[0-9A-F]IN([0-9A-F]{2})(\w{8})(\w{4})([0-9A-F]{2})[0-9A-F]{2}([0-9A-F]{4})([0-9A-F]{8})", message, re.ASCII
    )
    if match is None:
        return None
    return Information(int(match[1], 16), match[2], match[3], match[4], int(match[5], 16), int(match[6], 16))


def pulses_hex(pulses: int) -> str:
    """Eight hexadecimal digits of a 32-bit two's complement number.

    Raises:
        ValueError: it does not fit.
    """
    if not -(1 << 31) <= pulses < 1 << 31:
        raise ValueError(f"{pulses} pulses do not fit into 32 bits")
    return f"{pulses & 0xFFFFFFFF:08X}"
