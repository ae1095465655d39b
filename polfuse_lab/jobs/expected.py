"""How long a job is expected to take, by what earlier jobs of its kind took."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path

from polfuse_lab.remembered import store

FILE = "job_times.json"
VERSION = 1
KEPT = 12
"""Jobs of each kind that are remembered."""
OVERHEAD_BYTES = 20_000_000
"""Starting a job takes as long as working on so many bytes, about."""


def input_bytes(paths: Sequence[Path]) -> int:
    """Size of all files together; what is not there counts nothing."""
    total = 0
    for path in paths:
        try:
            total += path.stat().st_size
        except OSError:
            continue
    return total


def expected_s(kind: str, size: int) -> float | None:
    """Expected time, s; None where no job of that kind has been done yet."""
    with store.lock:
        content, _ = store.read(FILE, VERSION)
    times = _times(content.get(kind))
    if not times:
        return None
    return statistics.median(seconds / (held + OVERHEAD_BYTES) for held, seconds in times) * (size + OVERHEAD_BYTES)


def learn(kind: str, size: int, seconds: float) -> None:
    """A job took so long. Never raises."""
    with store.lock:
        content, _ = store.read(FILE, VERSION)
        content.pop("version", None)
        content[kind] = [*_times(content.get(kind)), (size, round(seconds, 3))][-KEPT:]
        store.write(FILE, VERSION, content)


def _times(held: object) -> list[tuple[int, float]]:
    return [
        (int(item[0]), float(item[1]))
        for item in (held if isinstance(held, list) else [])
        if isinstance(item, list) and len(item) == 2 and all(isinstance(number, int | float) for number in item)
    ]
