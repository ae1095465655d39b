"""Processes of a trial: all whose environment names its folder (Linux)."""

from __future__ import annotations

import os
from pathlib import Path

ROLES = {
    "polfuse_lab.session.writer_process": "writer",
    "polfuse_lab.engine.guard": "guard",
    "polfuse_lab.engine": "engine",
    "from multiprocessing.resource_tracker": "tracker",
    "from multiprocessing.spawn": "camera",
}
"""By a word of the command line; the camera's is the only process of the collect made by multiprocessing."""


def alive_in(folder: Path) -> dict[int, str]:
    """Process ids and roles of the processes of a folder, zombies left out."""
    found = {}
    mark = os.fsencode(folder) + b"/"
    for name in os.listdir("/proc"):
        if not name.isdigit() or int(name) == os.getpid():
            continue
        try:
            if mark not in Path("/proc", name, "environ").read_bytes():
                continue
            words = Path("/proc", name, "cmdline").read_bytes().decode(errors="replace").split("\0")
            state = Path("/proc", name, "stat").read_bytes().rpartition(b")")[2].split()[0]
        except OSError:
            continue
        if state not in (b"Z", b"X"):
            role = next((role for word, role in ROLES.items() if any(part.startswith(word) for part in words)), "other")
            found[int(name)] = role
    return found


def find(folder: Path, role: str) -> int | None:
    """Process id of the process of a role; None when there is none."""
    return next((pid for pid, name in alive_in(folder).items() if name == role), None)


def gone(folder: Path) -> bool:
    """Whether no process is left."""
    return not alive_in(folder)
