"""Numbers and names of files as people read them."""

from __future__ import annotations

import math
import tempfile
from datetime import datetime
from pathlib import Path


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


def place(path: Path | str) -> str:
    """Where a file is: ``~/…`` in the user's own folder; its name alone where it is there for a while only."""
    path = Path(path)
    short = home_short(path)
    return path.name if short == str(path) and path.is_relative_to(tempfile.gettempdir()) else short


def home_short(path: Path | str) -> str:
    """A file's whole name, with ``~`` for the user's own folder; :func:`typed` reads it."""
    path = Path(path)
    return str(Path("~") / path.relative_to(Path.home())) if path.is_relative_to(Path.home()) else str(path)


def typed(text: str) -> Path:
    """The file that a user has named, with or without ``~``."""
    try:
        return Path(text).expanduser()
    except RuntimeError:  # somebody else's folder, of whom the computer knows nothing
        return Path(text)


def size(count: float | None) -> str:
    """Bytes with a decimal unit; a dash where they are not known."""
    if count is None:
        return "–"
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit in ("B", "kB") else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.1f} TB"
