"""The window's live view at full rate: 192 kHz audio, four channels, 60 frames a second.

A stand-in for an engine feeds the real live process; the window is a process of its own, without a display. A heartbeat
in its event loop tells how long anything ever held it up; the delay is from the arrival of the newest sample until the
paint that shows it is over. A block that is longer than the window's own work is the computer doing other things: both
are told, and the load. ``speed.gui_collect`` has a real engine in the stand-in's place.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.gui_rows import phase_rows, watch
from benchmarks.rows import Row
from benchmarks.speed_live import full_rate, until_shown
from polfuse_lab.live import LiveView

LOSSES = ("skipped_audio_s", "skipped_records", "skipped_frames", "dropped")


def run(quick: bool) -> list[Row]:
    """Show, measure and tell; ``quick`` for 3 s of each tab instead of 20 s."""
    seconds = 3.0 if quick else 20.0
    with tempfile.TemporaryDirectory() as scratch, full_rate(Path(scratch)), LiveView(Path(scratch)) as view:
        # So that what the live process loads at its start is not taken for the window's slowness.
        until_shown(view)
        before = view.newest("health")
        done = watch(Path(scratch), seconds)
        after = view.newest("health")
    if isinstance(done, str):
        return [Row("speed.gui", "", None, False, "the window lives", error=done)]
    assert before is not None
    assert after is not None
    lost = {name: after.values[name] - before.values[name] for name in LOSSES}
    rows = [row for phase in done["phases"] for row in phase_rows("speed.gui", phase)]
    return [*rows, loss_row("speed.gui", lost, after.values["restarts"])]


def loss_row(benchmark: str, lost: dict[str, float], restarts: float) -> Row:
    """What the live process passed over."""
    told = ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in lost.items())
    return Row(
        f"{benchmark}: what the live process skipped meanwhile ({told})",
        "",
        None,
        restarts == 0 and lost["dropped"] == 0,
        "a window that is flooded takes nothing from the streams",
        error=float(sum(lost.values())),
    )
