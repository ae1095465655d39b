"""The rigs and sessions that were used last."""

from __future__ import annotations

import os
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from polfuse_lab.remembered import store

FILE = "recent.json"
VERSION = 1
MOST = 20
"""Of each kind."""


@dataclass(frozen=True)
class Recent:
    """A file that was used."""

    path: str
    """Absolute."""
    name: str
    """What it calls itself; else the file's name."""
    opened_unix_s: float
    """When it was used last, seconds since 1970."""

    @property
    def exists(self) -> bool:
        """Whether it is (still) there."""
        return Path(self.path).exists()


def recent_rigs() -> list[Recent]:
    """Rig files, the one used last first."""
    return _read("rigs")


def recent_sessions() -> list[Recent]:
    """Sessions and products, the one used last first."""
    return _read("sessions")


def remember_rig(path: Path | str, name: str = "") -> None:
    """A rig file is used now. Never raises: what cannot be remembered is forgotten."""
    _remember("rigs", path, name)


def remember_session(path: Path | str, name: str = "") -> None:
    """A session or a products file is used now. Never raises."""
    _remember("sessions", path, name)


def forget(path: Path | str) -> None:
    """Take a file off both lists. Never raises."""
    absolute = os.path.abspath(path)
    with store.lock:
        content, _ = store.read(FILE, VERSION)
        kinds = {kind: [item for item in _items(content, kind) if item.path != absolute] for kind in _KINDS}
        _write(kinds)


_KINDS = ("rigs", "sessions")


def _read(kind: str) -> list[Recent]:
    with store.lock:
        content, _ = store.read(FILE, VERSION)
    return _items(content, kind)


def _remember(kind: str, path: Path | str, name: str) -> None:
    absolute = os.path.abspath(path)
    entry = Recent(absolute, name or Path(absolute).name, time.time())
    with store.lock:
        content, _ = store.read(FILE, VERSION)
        kinds = {each: _items(content, each) for each in _KINDS}
        kinds[kind] = [entry, *(item for item in kinds[kind] if item.path != absolute)][:MOST]
        _write(kinds)


def _write(kinds: dict[str, list[Recent]]) -> None:
    store.write(FILE, VERSION, {kind: [asdict(item) for item in items] for kind, items in kinds.items()})


def _items(content: dict[str, Any], kind: str) -> list[Recent]:
    found = []
    listed = content.get(kind, [])
    for item in listed if isinstance(listed, list) else []:
        if not isinstance(item, dict):
            continue
        path, name, opened = item.get("path"), item.get("name"), item.get("opened_unix_s")
        if isinstance(path, str) and isinstance(name, str) and isinstance(opened, int | float):
            found.append(Recent(path, name, float(opened)))
    return found
