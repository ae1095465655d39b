"""A soak in accelerated time: scheduler, queue, writer's process and session files at full rate, every sample checked.

One collect follows another, as on a user's long day. While one is written, the one before it is read by a checker in
a process of its own, compared number by number and deleted, so that the disk holds two sessions at most.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.counting_rig import FRAME_HZ, RATE_HZ, CountingRig, plan, plan_toml, rig
from benchmarks.memory_watch import MemoryWatch
from benchmarks.soak_check import Checker
from polfuse_lab.engine.recorder import WriterProcess
from polfuse_lab.scheduler import Scheduler


@dataclass
class Account:
    """What has been recorded and checked so far."""

    sessions: int = 0
    samples: int = 0
    """Frames of audio delivered."""
    frames: int = 0
    samples_checked: int = 0
    frames_checked: int = 0
    wall_s: float = 0.0
    file_bytes: int = 0
    problems: list[str] = field(default_factory=list)

    @property
    def simulated_s(self) -> float:
        """Time that a rig at full rate needs for it, s."""
        return min(self.samples / RATE_HZ, self.frames / FRAME_HZ)

    @property
    def sound(self) -> bool:
        """Whether everything that was delivered has been read back as it was."""
        whole = self.samples == self.samples_checked and self.frames == self.frames_checked
        return whole and not self.problems and self.samples > 0 and self.frames > 0

    @property
    def raw_bytes(self) -> int:
        """Bytes that went through the queue."""
        return self.samples * 4 + self.frames * 582 * 782 * 2


def soak(
    folder: Path,
    *,
    simulated_s: float,
    positions: int,
    watch: MemoryWatch,
    state: Path | None = None,
    told: Callable[[Account], None] = lambda account: None,
) -> Account:
    """Collect until a rig at full rate would have taken ``simulated_s``.

    Args:
        folder: where the sessions are written; holds two of them at most.
        simulated_s: how long, s.
        positions: of each session; each of them is 20 s at full rate.
        watch: watches this process (``"engine"``), the writers and the checker.
        state: file that holds the account after each session; one that is there is gone on with.
        told: called after each session.

    Returns:
        The account, whose ``problems`` say what is missing or wrong.
    """
    account = _load(state)
    for left in folder.glob("soak-*.h5*"):
        left.unlink()
    devices = CountingRig(account.samples, account.frames)
    checker = Checker()
    watch.watch("engine", os.getpid())
    watch.watch("checker", checker.pid)
    waiting = 0
    begun_s, before_s = time.monotonic(), account.wall_s
    try:
        while account.simulated_s < simulated_s and not account.problems:
            first_sample, first_frame = devices.radar.next, devices.camera.next
            path = _collect(folder / f"soak-{account.sessions:04d}.h5", devices, positions, watch, account)
            account.samples = devices.radar.next
            account.frames = devices.camera.next
            if waiting:
                _take(account, checker.answer())
            checker.ask(path=str(path), first_sample=first_sample, first_frame=first_frame)
            waiting = 1
            account.sessions += 1
            account.wall_s = before_s + time.monotonic() - begun_s
            told(account)
            _save(state, account)
        if waiting:
            _take(account, checker.answer())
    finally:
        checker.close()
    account.wall_s = before_s + time.monotonic() - begun_s
    _save(state, account)
    return account


def _collect(path: Path, devices: CountingRig, positions: int, watch: MemoryWatch, account: Account) -> Path:
    recorder = WriterProcess(path)

    def begun() -> None:
        if scheduler.status().state == "running":
            watch.watch("writer", recorder.pid, account.sessions)

    scheduler = Scheduler(
        rig(), plan(positions), path, recorder, plan_toml=plan_toml(positions), on_change=begun, devices=devices
    )
    outcome = scheduler.run()
    if outcome.state != "finished" or outcome.warnings:
        account.problems.append(f"{path.name} {outcome.state}: {outcome.reason} {' '.join(outcome.warnings)}")
    return path


def _take(account: Account, told: dict[str, Any]) -> None:
    account.samples_checked += told["samples"]
    account.frames_checked += told["frames"]
    account.file_bytes += told["file_bytes"]
    account.problems += told["problems"]


def _load(state: Path | None) -> Account:
    if state is None or not state.is_file():
        return Account()
    return Account(**json.loads(state.read_text(encoding="utf-8")))


def _save(state: Path | None, account: Account) -> None:
    """Keep what has been checked; a session that has not been is collected again after an interruption."""
    if state is None:
        return
    unchecked = int(account.samples_checked < account.samples)
    kept = {
        **asdict(account),
        "sessions": account.sessions - unchecked,
        "samples": account.samples_checked,
        "frames": account.frames_checked,
    }
    new = state.with_name(state.name + ".new")
    new.write_text(json.dumps(kept), encoding="utf-8")
    new.replace(state)
