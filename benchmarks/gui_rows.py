"""What a window's process has measured, as rows: how often it drew, how long it was held up and by whom, how late."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rows import Row

UPDATES, BLOCK_MS, DELAY_MS = 30.0, 50.0, 150.0
LONGEST_S = 180.0
"""For the start of the window's process, and of a collect, besides what is measured."""
PHASES = 8
STEADY = ("ranges", "camera")
"""What comes steadily. Images of positions come when a position is over, whatever the window does."""
WATCHED = ("ranges", "speeds", "sar", "camera", "resized and switched", "dragged, mouse over it")
"""Where live data are always in front: elsewhere there is nothing to draw for some of the time."""


def watch(folder: Path, seconds: float, *more: str) -> dict[str, Any] | str:
    """What :mod:`benchmarks.gui_worker` measured in a process of its own, or what went wrong."""
    longest_s = LONGEST_S + PHASES * seconds
    try:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.gui_worker", str(folder), str(seconds), *more],
            capture_output=True, text=True, timeout=longest_s, check=False,
            env={**os.environ, "POLFUSE_USER_DATA": str(folder), "QT_QPA_PLATFORM": "offscreen"},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"no end within {longest_s:g} s (load {load():.1f})"
    if done.returncode != 0:
        words = (done.stderr.strip().splitlines() or ["no word"])[-1]
        return f"exit status {done.returncode}: {words}"
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def load() -> float:
    """How many programs wanted the computer's processors in the last minute, on average."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")


def phase_rows(benchmark: str, phase: dict[str, Any]) -> list[Row]:
    """Rows of one :class:`benchmarks.gui_worker.Phase`."""
    name, seconds = f"{benchmark}: {phase['name']}", phase["seconds"]
    rows = [_block_row(name, phase)]
    if phase["name"] in WATCHED:
        rate = phase["ticks"] / seconds
        words = (
            f"{name}: {rate:.1f} updates a second, {phase['paints'] / seconds:.1f} paints, "
            f"{100 * phase['cpu_s'] / seconds:.0f} % of a core (load {load():.1f})"
        )
        target = "30 updates a second or more"
        rows.insert(0, Row(words, "30 updates a second", rate / UPDATES, rate >= UPDATES, target))
    delays = np.array(phase["delays_ms"])
    if len(delays) and phase["name"] in STEADY:
        low, median, high = (float(np.percentile(delays, q)) for q in (1, 50, 99))
        rows.append(
            Row(
                f"{name}: newest sample on the screen after {median:.0f} ms median, {high:.0f} ms 99 %",
                "the limit of 150 ms",
                median / DELAY_MS,
                median <= DELAY_MS,
                "newest data shown within 150 ms",
                low / DELAY_MS,
                high / DELAY_MS,
            )
        )
    return rows


def _block_row(name: str, phase: dict[str, Any]) -> Row:
    """The longest block, and how much of it the window itself worked: the rest is the computer doing other things."""
    beats, own = np.array(phase["beats_ms"]), np.array(phase["own_ms"])
    worst = int(np.argmax(beats))
    words = f"{own[worst]:.0f} ms of it its own work"
    if phase["waited_ms"]:
        words += f", {phase['waited_ms'][worst]:.0f} ms waiting for a processor"
    return Row(
        f"{name}: longest block of the event loop {beats[worst]:.0f} ms ({words}), "
        f"{np.percentile(beats, 99.9):.0f} ms 99.9 % of {len(beats)} beats, {int((beats > BLOCK_MS).sum())} above the "
        f"limit; most own work in one {own.max():.0f} ms",
        "the limit of 50 ms",
        float(beats.max()) / BLOCK_MS,
        bool(beats.max() <= BLOCK_MS),
        "no block above 50 ms",
    )
