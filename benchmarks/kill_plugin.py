"""What the kill campaign puts into a collect's processes: devices whose data can be told apart, and a tap.

Radar and camera are plug-ins (entry points) whose samples and pixels follow from their numbers alone. The tap wraps a
few methods of the engine, which runs as it is: each phase, each record given to the writer, each flush and its answer
is told to a pipe that the campaign holds open. What was told before a kill stays in that pipe: it is the log that the
session file is compared with.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import time
from dataclasses import dataclass
from multiprocessing import shared_memory
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.records import AudioBlock, ClockFix, Frame, Identity, Level

RATE_HZ = 48_000.0
SWEEP_S = 0.04
SHAPE = (48, 64)
_MIXER = np.uint64(0x9E3779B97F4A7C15)


def samples(first: int, frames: int) -> NDArray[np.int16]:
    """Frames ``first`` to ``first + frames``: numbers mixed to noise on channel 0, a sync of 40 ms on channel 1."""
    numbers = np.arange(first, first + frames, dtype=np.uint64)
    period = round(SWEEP_S * RATE_HZ)
    block = np.empty((frames, 2), np.int16)
    block[:, 0] = ((numbers * _MIXER) >> np.uint64(48)).astype(np.uint16).view(np.int16) // 8
    block[:, 1] = np.where(numbers % period < period // 2, 16_000, -16_000)
    return block


def picture(number: int) -> NDArray[np.uint16]:
    """Frame ``number``."""
    values = np.arange(SHAPE[0] * SHAPE[1], dtype=np.uint64) + np.uint64(number * SHAPE[0] * SHAPE[1])
    return ((values * _MIXER) >> np.uint64(52)).astype(np.uint16).reshape(SHAPE)


class Tap:
    """One end of the campaign's pipe; what is said arrives whole and in order, even when the next instant kills."""

    def __init__(self, path: str) -> None:
        self._pipe = os.open(path, os.O_WRONLY)

    def say(self, *words: object) -> None:
        """Tell the campaign; never fails."""
        line = json.dumps([time.monotonic_ns(), *words]).encode() + b"\n"
        with contextlib.suppress(OSError):
            os.write(self._pipe, line)


_taps: dict[str, Tap] = {}


def tap_engine(path: str) -> Tap:
    """Wrap the engine's methods, once in a process."""
    if path in _taps:
        return _taps[path]
    from polfuse_lab.engine.recorder import WriterProcess
    from polfuse_lab.records import Exposure, Observed, Record, Sweeps
    from polfuse_lab.scheduler import RunState, Scheduler
    from polfuse_lab.session.layout import SessionConfig

    tap = _taps[path] = Tap(path)
    enter, offer, take = Scheduler._enter, WriterProcess.offer, WriterProcess._take
    ask, open_ = WriterProcess._ask_flush, WriterProcess.open
    queued = [0]

    def told_enter(self: Scheduler, state: RunState, reason: str) -> None:
        tap.say("phase", str(state), reason[:300])
        enter(self, state, reason)

    def told_open(self: WriterProcess, config: SessionConfig, **more: Any) -> None:
        open_(self, config, **more)
        tap.say("created", self.pid)

    def told_offer(self: WriterProcess, record: Record) -> bool:
        taken = offer(self, record)
        if taken:
            if isinstance(record, Sweeps):
                key = ["audio", record.block.first_frame, len(record.block.samples), record.position]
            elif isinstance(record, Exposure):
                key = ["frame", record.frame.frame_id, 0, 0]
            else:
                state = record.state if isinstance(record, Observed) else record
                key = [type(state).__name__, record.t_host_ns, 0, 0]
            tap.say("queued", queued[0], *key)
            queued[0] += 1
        return taken

    def told_ask(self: WriterProcess, *, durable: bool) -> int:
        # Counted before the question is put: later records are no part of the promise.
        before = queued[0]
        tap.say("asking", durable)
        ticket = ask(self, durable=durable)
        tap.say("asked", ticket, before)
        return ticket

    def told_take(self: WriterProcess, header: dict[str, Any]) -> None:
        take(self, header)
        tap.say("answer", header["kind"], header.get("ticket", 0))

    name = shared_memory._make_filename  # type: ignore[attr-defined]

    def told_name() -> str:
        made: str = name()
        tap.say("memory", made)
        return made

    Scheduler._enter = told_enter  # type: ignore[method-assign]
    WriterProcess.offer, WriterProcess._take = told_offer, told_take  # type: ignore[method-assign]
    WriterProcess._ask_flush, WriterProcess.open = told_ask, told_open  # type: ignore[method-assign, assignment]
    shared_memory._make_filename = told_name  # type: ignore[attr-defined]
    return tap


class CountingRadar:
    """A :class:`drivers.contracts.Radar` that delivers :func:`samples` in real time and tells each delivery."""

    @dataclass(frozen=True)
    class Options:
        """The table ``[radar.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid"}

        log: str

    sample_rate_hz = RATE_HZ
    lost_frames = 0

    def __init__(self, options: Options) -> None:
        self._tap = tap_engine(options.log)
        self._start_ns = time.monotonic_ns()
        self._asked: tuple[int, int] | None = None

    def open(self) -> Identity:
        """Nothing to open."""
        return Identity("radar", "counting", "counting radar")

    def close(self) -> None:
        """Nothing to close."""

    def make_safe(self) -> None:
        """Forget the block asked for."""
        self.cancel()

    def begin(self, frames: int) -> None:
        """The block begins at the next frame."""
        self._asked = math.ceil(self._elapsed_s() * RATE_HZ), frames

    def poll(self) -> AudioBlock | None:
        """The block, once its last frame would have been sampled."""
        if self._asked is None or self._elapsed_s() * RATE_HZ < sum(self._asked):
            return None
        (first, frames), self._asked = self._asked, None
        block = samples(first, frames)
        self._tap.say("audio", first, frames)
        t_s = first / RATE_HZ
        return AudioBlock(block, RATE_HZ, first, t_s, self._start_ns + round(t_s * 1e9))

    def cancel(self) -> None:
        """Forget the block asked for."""
        self._asked = None

    def level(self) -> Level:
        """Not measured."""
        return Level()

    def clock(self) -> ClockFix:
        """Device time runs with the host's."""
        now_ns = time.monotonic_ns()
        return ClockFix("radar", (now_ns - self._start_ns) * 1e-9, now_ns, 1000)

    def _elapsed_s(self) -> float:
        return (time.monotonic_ns() - self._start_ns) * 1e-9


class NumberedCamera:
    """A :class:`drivers.contracts.Camera` whose frame n is :func:`picture` n; it tells each delivery."""

    @dataclass(frozen=True)
    class Options:
        """The table ``[camera.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid"}

        log: str
        exposure_s: float = 0.02

    shape = SHAPE
    lost_frames = 0

    def __init__(self, options: Options) -> None:
        self._tap = Tap(options.log)
        self._exposure_s = options.exposure_s
        # A camera that was opened again goes on with other numbers: no two frames of a trial are alike.
        self._number = time.monotonic_ns() // 1_000_000
        self._due_s: float | None = None

    def open(self) -> Identity:
        """Nothing to open."""
        self._tap.say("camera", os.getpid())
        return Identity("camera", "numbered", "numbered camera")

    def close(self) -> None:
        """Nothing to close."""

    def make_safe(self) -> None:
        """Forget the frame asked for."""
        self._due_s = None

    def trigger(self) -> None:
        """Begin an exposure."""
        self._due_s = time.monotonic() + self._exposure_s

    def poll(self) -> Frame | None:
        """The frame, once it is exposed."""
        if self._due_s is None or time.monotonic() < self._due_s:
            return None
        self._due_s = None
        self._number += 1
        self._tap.say("frame", self._number)
        return Frame(picture(self._number), self._number, self._exposure_s, 0.0, time.monotonic(), time.monotonic_ns())

    def clock(self) -> ClockFix | None:
        """It has none of its own."""
        return None


EARLY_ANSWERS = "writer.SessionWriter.flush = lambda self, *, durable=False: 10**12"
"""A defect: a writer that answers a flush without having made it."""


def install(folder: Path, *, defect: str = "") -> None:
    """Make the devices look like an installed package in ``folder``, which is to be on the path.

    Args:
        folder: an existing folder.
        defect: lines of Python for the writer's process, such as :data:`EARLY_ANSWERS`; ``writer`` is its module.
    """
    info = folder / "polfuse_kill_campaign-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: polfuse-kill-campaign\nVersion: 1\n")
    (info / "entry_points.txt").write_text(
        "[polfuse_lab.radar]\ncounting = benchmarks.kill_plugin:CountingRadar\n"
        "[polfuse_lab.camera]\nnumbered = benchmarks.kill_plugin:NumberedCamera\n"
    )
    if defect:
        lines = ["from polfuse_lab.session import writer", *defect.splitlines()]
        (folder / "sitecustomize.py").write_text(
            "import sys\nif 'polfuse_lab.session.writer_process' in sys.orig_argv:\n    " + "\n    ".join(lines) + "\n"
        )
