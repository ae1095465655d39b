"""The window's live view at full rate: 192 kHz audio, four channels, 60 frames a second.

A stand-in for an engine feeds the real live process; the window is a process of its own, without a display. A heartbeat
in its event loop tells how long anything ever held it up; the delay is from the arrival of the newest sample until the
paint that shows it is over. A block that is longer than the window's own work is the computer doing other things: the
load is told.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rows import Row
from benchmarks.speed_live import full_rate, until_shown
from polfuse_lab.live import LiveView

UPDATES, BLOCK_MS, DELAY_MS = 30.0, 50.0, 150.0
LONGEST_S = 120.0
"""For the start of the window's process, besides what is measured."""
LOSSES = ("skipped_audio_s", "skipped_records", "skipped_frames", "dropped")


def run(quick: bool) -> list[Row]:
    """Show, measure and tell; ``quick`` for 3 s of each tab instead of 20 s."""
    seconds = 3.0 if quick else 20.0
    with tempfile.TemporaryDirectory() as scratch, full_rate(Path(scratch)), LiveView(Path(scratch)) as view:
        # So that what the live process loads at its start is not taken for the window's slowness.
        until_shown(view)
        before = view.newest("health")
        done = _window(scratch, seconds)
        after = view.newest("health")
    if done is None:
        told = f"no end within {LONGEST_S + 20 * seconds:g} s (load {_load():.1f})"
        return [Row("speed.gui", "", None, False, "the window lives", error=told)]
    if done.returncode != 0:
        words = (done.stderr.strip().splitlines() or ["no word"])[-1]
        return [Row("speed.gui", "", None, False, "the window lives", error=f"exit status {done.returncode}: {words}")]
    assert before is not None
    assert after is not None
    phases = json.loads(done.stdout.splitlines()[-1])
    lost = {name: after.values[name] - before.values[name] for name in LOSSES}
    return [row for phase in phases for row in _rows(phase)] + [_loss_row(lost, after.values["restarts"])]


def _window(scratch: str, seconds: float) -> subprocess.CompletedProcess[str] | None:
    """What the window's process said; None where it came to no end."""
    try:
        return subprocess.run(
            [sys.executable, "-m", "benchmarks.gui_worker", scratch, str(seconds)],
            capture_output=True, text=True, timeout=LONGEST_S + 20 * seconds, check=False,
            env={**os.environ, "POLFUSE_USER_DATA": scratch, "QT_QPA_PLATFORM": "offscreen"},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None


def _load() -> float:
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")


def _rows(phase: dict[str, Any]) -> list[Row]:
    name, seconds = phase["name"], phase["seconds"]
    beats, delays = np.array(phase["beats_ms"]), np.array(phase["delays_ms"])
    rate = phase["ticks"] / seconds
    rows = [
        Row(
            f"speed.gui: {name}: {rate:.1f} updates a second, {phase['paints'] / seconds:.1f} paints, "
            f"{100 * phase['cpu_s'] / seconds:.0f} % of a core (load {_load():.1f})",
            "30 updates a second",
            rate / UPDATES,
            rate >= UPDATES,
            "30 updates a second or more",
        ),
        Row(
            f"speed.gui: {name}: longest block of the event loop {beats.max():.0f} ms, "
            f"{np.percentile(beats, 99.9):.0f} ms 99.9 % of {len(beats)} beats, "
            f"{int((beats > BLOCK_MS).sum())} above the limit",
            "the limit of 50 ms",
            float(beats.max()) / BLOCK_MS,
            bool(beats.max() <= BLOCK_MS),
            "no block above 50 ms",
        ),
    ]
    # Images of positions come when a position is over, whatever the window does: delays are of what comes steadily.
    if len(delays) and name in ("ranges", "camera"):
        low, median, high = (float(np.percentile(delays, q)) for q in (1, 50, 99))
        rows.append(
            Row(
                f"speed.gui: {name}: newest sample on the screen after {median:.0f} ms median, {high:.0f} ms 99 %",
                "the limit of 150 ms",
                median / DELAY_MS,
                median <= DELAY_MS,
                "newest data shown within 150 ms",
                low / DELAY_MS,
                high / DELAY_MS,
            )
        )
    return rows


def _loss_row(lost: dict[str, float], restarts: float) -> Row:
    told = ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in lost.items())
    return Row(
        f"speed.gui: what the live process skipped meanwhile ({told})",
        "",
        None,
        restarts == 0 and lost["dropped"] == 0,
        "a window that is flooded takes nothing from the streams",
        error=float(sum(lost.values())),
    )
