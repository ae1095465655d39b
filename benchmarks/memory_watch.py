"""Watches the memory of processes, and tells whether it grows: the slope of a line through it, with its confidence."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np


def resident_bytes(pid: int) -> int | None:
    """Resident memory of a process (proc(5), statm), None once it is gone."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError):
        return None
    return pages * os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Sample:
    """Memory of the process ``role`` number ``run``, ``age_s`` after it was first watched."""

    role: str
    run: int
    age_s: float
    resident_bytes: int


class MemoryWatch:
    """Looks at processes every ``every_s`` in a thread of its own. Use it with ``with``."""

    def __init__(self, every_s: float = 1.0) -> None:
        self.samples: list[Sample] = []
        self._every_s = every_s
        self._watched: dict[str, tuple[int, int, float]] = {}
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._work, name="memory watch", daemon=True)

    def __enter__(self) -> MemoryWatch:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join(5)

    def watch(self, role: str, pid: int, run: int = 0) -> None:
        """Watch this process as ``role`` from now on, instead of the one before."""
        with self._lock:
            if self._watched.get(role, (None,))[0] != pid:
                self._watched[role] = (pid, run, time.monotonic())

    def _work(self) -> None:
        while not self._end.wait(self._every_s):
            with self._lock:
                watched = list(self._watched.items())
            now = time.monotonic()
            for role, (pid, run, since) in watched:
                found = resident_bytes(pid)
                if found:
                    self.samples.append(Sample(role, run, now - since, found))


@dataclass(frozen=True)
class Trend:
    """Growth of one role's memory: slope with its 95 % interval, bytes per second; ``largest`` in bytes."""

    slope: float
    half_width: float
    largest: int
    seconds: float
    """Time watched after the start, s."""
    blocks: int

    @property
    def growth_bytes(self) -> float:
        """Growth over the time watched, bytes."""
        return self.slope * self.seconds

    @property
    def significant(self) -> bool:
        """Whether the memory grows beyond doubt (95 %)."""
        return self.slope > self.half_width


def trend(samples: Sequence[Sample], role: str, *, skip_s: float, block_s: float) -> Trend | None:
    """A line through the memory of a role, each of its runs with a level of its own.

    Medians of blocks of ``block_s`` are fitted, since samples that follow each other are not independent; the first
    ``skip_s`` of each run are left out, in which caches fill. None where fewer than four blocks are left.

    The slope is that of ordinary least squares with a level for each run (within estimator), its interval Student's t
    with (blocks - runs - 1) degrees of freedom.
    """
    times, values, runs = [], [], []
    mine = [sample for sample in samples if sample.role == role]
    for run in sorted({sample.run for sample in mine}):
        rows = [sample for sample in mine if sample.run == run and sample.age_s >= skip_s]
        numbers = np.array([int((sample.age_s - skip_s) / block_s) for sample in rows])
        for number in np.unique(numbers):
            block = [sample for sample, own in zip(rows, numbers, strict=True) if own == number]
            times.append(float(np.mean([sample.age_s for sample in block])))
            values.append(float(np.median([sample.resident_bytes for sample in block])))
            runs.append(run)
    return _fit(np.array(times), np.array(values), np.array(runs), max((s.resident_bytes for s in mine), default=0))


def _fit(
    t: np.ndarray[tuple[int], np.dtype[np.float64]],
    y: np.ndarray[tuple[int], np.dtype[np.float64]],
    runs: np.ndarray[tuple[int], np.dtype[np.int64]],
    largest: int,
) -> Trend | None:
    from scipy.stats import t as student

    levels = np.unique(runs)
    freedom = len(t) - len(levels) - 1
    if freedom < 2:
        return None
    t0, y0, spans = t.copy(), y.copy(), 0.0
    for run in levels:
        mine = runs == run
        spans = max(spans, float(np.ptp(t[mine])))
        t0[mine] -= t[mine].mean()
        y0[mine] -= y[mine].mean()
    spread = float(t0 @ t0)
    if spread <= 0:
        return None
    slope = float(t0 @ y0) / spread
    left = y0 - slope * t0
    half = float(student.ppf(0.975, freedom)) * math.sqrt(float(left @ left) / freedom / spread)
    return Trend(slope, half, largest, spans, len(t))
