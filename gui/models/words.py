"""Numbers as people read them."""

from __future__ import annotations

import math
from datetime import datetime


def duration(seconds: float | None) -> str:
    """``1:02:05`` or ``2:05``; a dash where it is not known."""
    if seconds is None or not math.isfinite(seconds):
        return "–"
    whole = max(round(seconds), 0)
    hours, rest = divmod(whole, 3600)
    minutes, left = divmod(rest, 60)
    return f"{hours}:{minutes:02d}:{left:02d}" if hours else f"{minutes}:{left:02d}"


def age(seconds: float) -> str:
    """How old something is: ``45 ms``, ``8.7 s``, ``2:05``."""
    if seconds < 1:
        return f"{seconds * 1e3:.0f} ms"
    return f"{seconds:.1f} s" if seconds < 60 else duration(seconds)


def signed_db(level: float) -> str:
    """A level with a true minus sign, whole dB."""
    return f"{level:.0f}".replace("-", "\N{MINUS SIGN}")


def moment(iso: str) -> str:
    """An ISO 8601 time in the local zone to the minute; as it is where it cannot be read."""
    try:
        return datetime.fromisoformat(iso).astimezone().strftime("%Y-%m-%d %H:%M")
    except ValueError:
        return iso


def size(count: float | None) -> str:
    """Bytes with a decimal unit; a dash where they are not known."""
    if count is None:
        return "–"
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit in ("B", "kB") else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.1f} TB"
