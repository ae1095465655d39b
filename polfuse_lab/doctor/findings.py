"""What the doctor says of one thing that it looked at."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """What was found of one device, or of one thing about the computer."""

    name: str
    """Name of the device's driver, or of what was looked at."""
    kind: str
    """Kind of device, or ``"system"``."""
    ok: bool
    detail: str
    """Who answered, or what is wrong."""
    advice: str
    """How to mend or better it; empty when all is well."""
