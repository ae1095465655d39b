"""A long day: nothing is lost and no process grows, in accelerated time and in real time over the wires.

Run by itself, ``python -m benchmarks.reliability_soak [--part accelerated|wires] [--minutes N] [--state FILE]``,
it does the full campaign; ``--state`` keeps the account, so that an interrupted one can be gone on with.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from benchmarks import soak_wires
from benchmarks.full_rate import RATE_HZ
from benchmarks.memory_watch import MemoryWatch, Trend, trend
from benchmarks.rows import Row
from benchmarks.soak_accelerated import Account, soak

ACCELERATED_S, QUICK_ACCELERATED_S = 4 * 3600.0, 15.0
WIRES_S, QUICK_WIRES_S, WIRES_SESSION_S = 1200.0, 10.0, 60.0
POSITIONS, QUICK_POSITIONS = 4, 1
"""Of a session, 20 s each at full rate; two sessions of 4, stored as they are by a hurried writer, take 9 GB."""
GROWTH_LIMIT_BYTES = 16e6
"""A process may be larger after the whole campaign by so much, or by what cannot be told from no growth."""
SKIP_S, BLOCK_S = 10.0, 10.0


def run(quick: bool) -> list[Row]:
    """Four hours, or a quarter of a minute when quick."""
    rows = accelerated(QUICK_ACCELERATED_S if quick else ACCELERATED_S, quick=quick)
    return rows + wires(QUICK_WIRES_S if quick else WIRES_S, quick=quick)


def accelerated(simulated_s: float, *, quick: bool = False, state: Path | None = None) -> list[Row]:
    """The soak in accelerated time."""
    with _folder() as folder, MemoryWatch() as watch:
        account = soak(
            Path(folder),
            simulated_s=simulated_s,
            positions=QUICK_POSITIONS if quick else POSITIONS,
            watch=watch,
            state=state,
            told=_tell,
        )
        rows = [_accelerated_row(account, simulated_s)]
        return rows + list(_memory_rows("reliability.soak.memory", watch, ("engine", "writer", "checker"), quick=quick))


def wires(seconds: float, *, quick: bool = False) -> list[Row]:
    """The soak in real time over the wires, onto the disk as in the field."""
    with tempfile.TemporaryDirectory(prefix="polfuse-soak-") as folder, MemoryWatch() as watch:
        watch.watch("engine", os.getpid())
        found = soak_wires.soak(Path(folder), seconds, WIRES_SESSION_S, watch)
        words = (
            f"{found.seconds / 60:.1f} min, {found.sessions} sessions: {found.samples_lost} of"
            f" {found.samples} frames of audio lost, {found.frames_lost} of {found.frames} of the camera"
            f" ({found.camera}); longest poll {found.longest_poll_s * 1e3:.0f} ms, queue full {found.full} times,"
            f" load {os.getloadavg()[0]:.1f}"
        )
        ok = found.sound and found.samples > 0.8 * found.seconds * RATE_HZ
        error = "; ".join(found.problems[:3]) or (None if found.kept else "what was delivered is not all in the files")
        rows = [Row("reliability.soak.wires", found.camera, None, ok, words, error=error)]
        roles = ("engine", "writer", "camera", "checker")
        return rows + list(_memory_rows("reliability.soak.wires.memory", watch, roles, quick=quick))


def _accelerated_row(account: Account, simulated_s: float) -> Row:
    raw = account.raw_bytes
    words = (
        f"{account.simulated_s / 3600:.2f} h at full rate in {account.wall_s / 60:.1f} min,"
        f" {account.sessions} sessions, {account.samples} frames of audio, {account.frames} of the camera,"
        f" {raw / 1e9:.1f} GB, load {os.getloadavg()[0]:.1f}"
    )
    problems = "; ".join(account.problems[:3]) or None
    ok = account.sound and account.simulated_s >= simulated_s
    return Row("reliability.soak.accelerated", "", account.simulated_s / account.wall_s, ok, words, error=problems)


def _memory_rows(name: str, watch: MemoryWatch, roles: Iterable[str], *, quick: bool) -> Iterable[Row]:
    """One row for each process: how its memory grows, for a campaign that is long enough to tell."""
    for role in roles:
        found = trend(watch.samples, role, skip_s=SKIP_S, block_s=BLOCK_S)
        if found is not None:
            yield _memory_row(f"{name}.{role}", found)
        elif not quick:
            yield Row(f"{name}.{role}", "", None, False, "too short a time to tell")


def _memory_row(name: str, found: Trend) -> Row:
    words = (
        f"{found.slope * 3600 / 1e6:+.2f} +- {found.half_width * 3600 / 1e6:.2f} MB/h over {found.seconds / 60:.1f} min"
        f" in {found.blocks} blocks, largest {found.largest / 1e6:.0f} MB"
    )
    flat = found.growth_bytes < GROWTH_LIMIT_BYTES or not found.significant
    return Row(name, "", max(found.growth_bytes, 0) / GROWTH_LIMIT_BYTES, flat, words)


def _tell(account: Account) -> None:
    print(
        f"{account.simulated_s / 60:.1f} min in {account.wall_s / 60:.1f} min, load {os.getloadavg()[0]:.1f}",
        file=sys.stderr,
        flush=True,
    )


def _folder() -> tempfile.TemporaryDirectory[str]:
    """Memory where there is much of it, otherwise the disk."""
    memory = Path("/dev/shm")
    roomy = memory.is_dir() and shutil.disk_usage(memory).free > 12e9
    return tempfile.TemporaryDirectory(prefix="polfuse-soak-", dir=memory if roomy else None)


def main() -> int:
    """The full campaign; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reliability_soak", description=__doc__)
    parser.add_argument("--part", choices=("accelerated", "wires"), default="accelerated")
    parser.add_argument("--minutes", type=float, help="simulated (accelerated: 240) or real (wires: 20)")
    parser.add_argument("--state", type=Path, help="file that holds the account of an accelerated soak")
    given = parser.parse_args()
    if given.part == "wires":
        rows = wires(60 * (given.minutes or WIRES_S / 60))
    else:
        rows = accelerated(60 * (given.minutes or ACCELERATED_S / 60), state=given.state)
    for row in rows:
        print(row, flush=True)
    return 0 if all(row.ok for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
