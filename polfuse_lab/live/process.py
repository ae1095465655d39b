"""The live process: takes copies of what arrives, makes pictures of them, and puts them where clients read them.

It owns no device and the engine never waits for it. Three threads share the work, so that a picture that takes long
(a SAR image, a large frame) does not keep the radar's meters waiting. Whatever cannot be kept up with is skipped and
counted.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from drivers.records import SwitchState, TrolleyFix
from polfuse_lab.live.board import Board
from polfuse_lab.plans import Plan, parse_plan
from polfuse_lab.priority import give_way
from polfuse_lab.records import Exposure, Observed, Record, Sweeps
from polfuse_lab.rig import Rig, parse_model
from polfuse_lab.session import wire
from processing.errors import DataError

FRAMES_WAITING = 8
RECORDS_WAITING = 2000
AUDIO_WAITING = 32
"""Messages of each kind that may wait; the oldest is skipped when there are more."""
FRAMES_BEHIND = 2
"""With so many waiting behind it, a frame that is followed by another like it is skipped: the newest is to be seen."""
HEALTH_EVERY_S = 1.0
NICE = 5
"""Pictures give way to whoever records."""
SWITCH_S = 0.001
"""Longest that one thread has the interpreter while another waits for it: who takes messages in is not kept waiting."""

Item = TypeVar("Item")


@dataclass
class Counts:
    """What was skipped since it came faster than it could be looked at."""

    frames: int = 0
    records: int = 0
    dropped: int = 0
    """Before it came here."""
    restarts: int = 0


class LiveProcess:
    """Makes pictures of messages. :meth:`take` is called by one thread; the rest goes on in threads of its own.

    Args:
        rig: the rig.
        plan: the plan of the collect; None in set-up mode.
        directory: the engine's private directory.
    """

    def __init__(self, rig: Rig, plan: Plan | None, directory: Path) -> None:
        from polfuse_lab.live.listening import Listener

        self.board = Board(directory)
        self.counts = Counts()
        self._rig, self._plan = rig, plan
        wave = plan is not None and plan.continuous_wave
        self._listener = Listener(rig, self.board, continuous_wave=wave, judge_apart=True)
        self._tapped = False
        """Whether audio comes as it arrives; records are not listened to then."""
        self._audio: deque[Any] = deque()
        self._records: deque[Record] = deque()
        self._frames: deque[Exposure] = deque(maxlen=FRAMES_WAITING)
        self._formed: Any = None
        self._polarized: Any = None
        self._begun = time.monotonic()
        self._ended = False
        self._last: set[str] = set()
        """Threads that look once more and end."""
        self._wakes = {name: threading.Event() for name in ("radar", "camera", "image")}
        self._threads = [
            threading.Thread(target=self._work, args=(name, work), name=f"live {name}", daemon=True)
            for name, work in (("radar", self._radar), ("camera", self._camera()), ("image", self._image()))
        ]
        for thread in self._threads:
            thread.start()

    def take(self, header: dict[str, Any], payload: bytes | memoryview) -> None:
        """Take in one message: a record as :mod:`polfuse_lab.session.wire` writes it, a piece of audio, or a count."""
        kind = header["kind"]
        if kind == "audio":
            self._tapped = True
            self._queue(self._audio, (header, payload), AUDIO_WAITING, "radar")
        elif kind == "counts":
            self.counts.dropped, self.counts.restarts = header["dropped"], header["restarts"]
        else:
            self._record(wire.record_from(header, payload))

    def _record(self, record: Record) -> None:
        if isinstance(record, Observed) and isinstance(record.state, TrolleyFix | SwitchState):
            record = record.state
        if isinstance(record, Exposure):
            if len(self._frames) == FRAMES_WAITING:
                self.counts.frames += 1
            self._frames.append(record)
            self._wakes["camera"].set()
        elif isinstance(record, SwitchState):
            self._queue(self._audio, record, AUDIO_WAITING, "radar")
        elif isinstance(record, TrolleyFix):
            self._queue(self._records, record, RECORDS_WAITING, "image")
        elif isinstance(record, Sweeps):
            self._queue(self._records, record, RECORDS_WAITING, "image")
            if not self._tapped:
                self._queue(self._audio, record, AUDIO_WAITING, "radar")

    def _queue(self, waiting: deque[Any], item: object, most: int, wake: str) -> None:
        waiting.append(item)
        heavy = [other for other in waiting if not isinstance(other, TrolleyFix | SwitchState)]
        if len(heavy) > most:
            with contextlib.suppress(ValueError):
                waiting.remove(heavy[0])
                self.counts.records += isinstance(heavy[0], Sweeps)
        self._wakes[wake].set()

    def close(self, drain_s: float = 1.0) -> None:
        """Show what still waits, for so long at most, end the threads and let go of the memory."""
        end = time.monotonic() + drain_s
        while (self._audio or self._records or self._frames) and time.monotonic() < end:
            time.sleep(0.01)
        self._ended = True
        # The image comes last: radar over camera is made of what the camera's thread ends with.
        for names in (("radar", "camera"), ("image",)):
            self._last.update(names)
            for name in names:
                self._wakes[name].set()
            for thread in self._threads:
                if thread.name.removeprefix("live ") in names:
                    thread.join(max(end - time.monotonic(), 1))
        self.board.close()

    def _work(self, name: str, work: Callable[[], None]) -> None:
        wake = self._wakes[name]
        last = False
        while not last:
            wake.wait(0.25)
            wake.clear()
            last = name in self._last  # after which it looks once more: what was taken in last is shown
            try:
                work()
            except DataError:
                continue  # what is wrong with the signal is said by its light
            except Exception:
                # One bad picture is no reason to be without any; the log tells.
                traceback.print_exc()
                time.sleep(0 if last else 0.5)

    def _radar(self) -> None:
        from polfuse_lab.live.listening import Piece

        heard = False
        while self._audio:
            item = self._audio.popleft()
            if isinstance(item, SwitchState):
                self._listener.route(item.transmit + item.receive, item.t_host_ns)
            elif isinstance(item, Sweeps):
                self._replay(item)
            else:
                header, payload = item
                samples = np.frombuffer(payload, dtype=header["dtype"]).reshape(header["shape"])
                self._listener.hear(Piece(samples, header["first"], header["rate_hz"], header["end_ns"]))
                heard = True
        if heard:
            self._listener.look()
        self._tell_health()

    def _replay(self, record: Sweeps) -> None:
        """A record of a radar that cannot be overheard: its sweeps in pieces, as if they came now."""
        from polfuse_lab.live.listening import Piece

        block = record.block
        # Whatever was recorded before has nothing to do with it.
        self._listener.begin(record.channel.name)
        step = max(round(3 * self._rig.waveform.sweep_period_s * block.sample_rate_hz), 1)
        for first in range(0, len(block.samples), step):
            samples = block.samples[first : first + step]
            end_ns = block.t_host_ns + round((first + len(samples)) / block.sample_rate_hz * 1e9)
            self._listener.hear(Piece(samples, first, block.sample_rate_hz, end_ns))
            self._listener.look()
            if self._ended:
                return

    def _camera(self) -> Callable[[], None]:
        if self._rig.camera is None:
            return lambda: None
        from polfuse_lab.live.pictures import Pictures

        planned = getattr(self._plan, "optics", None) or self._plan
        angles: tuple[float, ...] | None = getattr(planned, "angles_deg", None)
        pictures = Pictures(
            self._rig, self.board, angles_deg=angles, frames_per_angle=getattr(planned, "frames_per_angle", 1)
        )

        def work() -> None:
            while self._frames and not self._ended:
                exposure = self._frames.popleft()
                if len(self._frames) >= FRAMES_BEHIND and _alike(exposure, self._frames[0]):
                    self.counts.frames += 1
                    continue
                pictures.take(exposure)
                if pictures.polarized is not self._polarized:
                    self._polarized = pictures.polarized
                    self._wakes["image"].set()

        return work

    def _image(self) -> Callable[[], None]:
        formers: list[Any] = []
        overlays: list[Any] = []

        def work() -> None:
            if self._plan is None:
                self._records.clear()
                return
            if not formers:
                # Here, for its compiled code takes a second to load, in which the meters are live already.
                from polfuse_lab.live.forming import Former
                from polfuse_lab.live.overlay import Overlay

                formers.append(Former(self._rig, self._plan, self.board))
                overlays.append(Overlay(self._rig, self.board))
            (former,), (overlay,) = formers, overlays
            if not former.useful:
                self._records.clear()
                return
            while self._records and not self._ended:
                record = self._records.popleft()
                if isinstance(record, TrolleyFix):
                    former.moved(record)
                elif isinstance(record, Sweeps):
                    former.take(record)
            former.show(now=self._ended)
            overlay.show(former.formed, self._polarized, now=self._ended)

        return work

    def _tell_health(self) -> None:
        now = time.monotonic()
        if now - getattr(self, "_told", 0.0) < HEALTH_EVERY_S:
            return
        self._told = now
        times = os.times()
        self.board.put(
            "health",
            {},
            t_sample_ns=time.monotonic_ns(),
            units={"skipped_audio_s": "s", "cpu_seconds": "s", "uptime_s": "s"},
            values={
                "skipped_audio_s": self._listener.skipped_s,
                "skipped_records": self.counts.records,
                "skipped_frames": self.counts.frames,
                "dropped": self.counts.dropped,
                "restarts": self.counts.restarts,
                "cpu_seconds": times.user + times.system,
                "uptime_s": now - self._begun,
                "pid": os.getpid(),
            },
        )


def _alike(one: Exposure, other: Exposure) -> bool:
    """Whether two frames show the same: none is missed where one of them is left out."""
    return (one.angle_rad, one.source_angle_rad, one.dark) == (other.angle_rad, other.source_angle_rad, other.dark)


def main() -> None:
    """Read messages from standard input until it ends: with the engine, or when it has enough."""
    wire.widen_pipe(0)
    sys.setswitchinterval(SWITCH_S)
    read = sys.stdin.buffer.read
    first = wire.read_message(read)
    if first is None:
        return
    told = first[0]
    if told["gives_way"]:
        give_way(NICE)
    rig = parse_model(told["rig_toml"], Rig, told["rig_path"])
    plan = None if told["plan_toml"] is None else parse_plan(told["plan_toml"], told["plan_path"])
    process = LiveProcess(rig, plan, Path(told["directory"]))
    try:
        while (message := wire.read_message(read)) is not None:
            process.take(*message)
    finally:
        process.close(told["drain_s"])
