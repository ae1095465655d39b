"""The engine's end of its live process: hands over copies of what arrives, and never waits for it.

The process is started when the first client watches: a collect that nobody looks at pays nothing for pictures.
"""

from __future__ import annotations

import contextlib
import subprocess
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any

from drivers.contracts import OverheardRadar
from drivers.records import AudioBlock
from polfuse_lab.engine.children import start_child
from polfuse_lab.records import Exposure, Record, Sweeps
from polfuse_lab.session import wire

TICK_S = 0.04
"""The radar is overheard so often."""
REACH_S = 0.25
"""Longest pause of this thread that loses no audio for display, s."""
QUEUE_BYTES = 96_000_000
FRAMES_WAITING = 24
"""Frames that wait at most: older ones are of no use for display, and would keep everything behind them waiting."""
PAST_BYTES = 32_000_000
PAST_FRAMES = 8
"""Records and frames kept for a live process that is started in the middle of a run."""
RESTARTS = 3
"""How often a live process that died is started again."""


class LiveFeed:
    """Starts the live process and feeds it. A :class:`polfuse_lab.scheduler.seams.Viewer`; :meth:`offer` never waits.

    Args:
        rig_toml: text of the rig file.
        rig_path: where it came from, for messages.
        directory: the engine's private directory.
        plan_toml: text of the plan file; None in set-up mode.
        plan_path: where it came from.
        drain_s: longest that the live process looks at what still waits at the end, s.
        gives_way: whether others go first: where something is recorded.
    """

    fatal: str | None = None
    """A live view is no reason to stop."""

    def __init__(
        self,
        rig_toml: str,
        rig_path: str,
        directory: Path,
        plan_toml: str | None = None,
        plan_path: str = "plan",
        *,
        drain_s: float = 1.0,
        gives_way: bool = True,
    ) -> None:
        self._drain_s = drain_s
        self._first = {
            "kind": "begin",
            "rig_toml": rig_toml,
            "rig_path": rig_path,
            "plan_toml": plan_toml,
            "plan_path": plan_path,
            "directory": str(directory),
            "drain_s": drain_s,
            "gives_way": gives_way,
        }
        self._waiting: deque[Record] = deque()
        self._bytes = self._frames = 0
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._ended = False
        self._radar: OverheardRadar | None = None
        self._following = 0
        self._past: deque[Record] = deque()
        self._past_frames: deque[Record] = deque(maxlen=PAST_FRAMES)
        self._past_bytes = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._restarts = 0
        self.dropped = 0
        """Records that were not handed over since too many waited."""
        self._warnings: tuple[str, ...] = ()
        self._thread: threading.Thread | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Why there is no live view, if there is none."""
        return self._warnings

    @property
    def pid(self) -> int | None:
        """Process id of the live process, None while there is none."""
        return None if self._process is None else self._process.pid

    def offer(self, record: Record) -> None:
        """Take a record; returns at once. The oldest frames that wait are dropped when there are too many."""
        size = _size(record)
        with self._lock:
            if isinstance(record, Exposure):
                self._past_frames.append(record)
            else:
                self._past.append(record)
                self._past_bytes += size
                while self._past_bytes > PAST_BYTES:
                    self._past_bytes -= _size(self._past.popleft())
            if self._thread is None:
                return
            self._waiting.append(record)
            self._bytes += size
            self._frames += isinstance(record, Exposure)
            while self._frames > FRAMES_WAITING or self._bytes > QUEUE_BYTES:
                self._drop()
        self._wake.set()

    def _drop(self) -> None:
        """Leave out what waits longest: of the frames, while there are any."""
        oldest = next((record for record in self._waiting if isinstance(record, Exposure)), self._waiting[0])
        # Not remove(), which compares arrays.
        place = next(number for number, record in enumerate(self._waiting) if record is oldest)
        del self._waiting[place]
        self._taken(oldest)
        self.dropped += 1

    def _taken(self, record: Record) -> None:
        self._bytes -= _size(record)
        self._frames -= isinstance(record, Exposure)

    def start(self) -> None:
        """Somebody watches: start the live process. Idempotent; returns at once."""
        with self._lock:
            if self._thread is None and not self._ended:
                self._thread = threading.Thread(target=self._work, name="live feed", daemon=True)
                self._thread.start()

    def overhear(self, radar: object) -> None:
        """Listen to a radar from now on, if its driver lets itself be overheard; None ends it."""
        self._radar = radar if isinstance(radar, OverheardRadar) else None
        self._following = 0

    def close(self) -> None:
        """End the live process, which shows the last records first. Bounded; never raises."""
        timeout_s = self._drain_s + 1.0
        with self._lock:
            self._ended, thread = True, self._thread
        self._wake.set()
        if thread is None:
            return
        thread.join(timeout_s)
        process = self._process
        if process is None:
            return
        if not thread.is_alive():
            self._hang_up()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout_s)
        if process.poll() is None:
            process.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(2)

    def _work(self) -> None:
        last = 0.0
        while True:
            try:
                if self._process is None:
                    self._start()
                if time.monotonic() - last >= TICK_S:
                    last = time.monotonic()
                    self._overheard()
                while self._waiting:
                    with self._lock:
                        record = self._waiting.popleft()
                        self._taken(record)
                    self._say(*wire.record_message(record))
                    if time.monotonic() - last >= TICK_S:
                        break
                else:
                    if self._ended:
                        return
                    self._wake.wait(max(last + TICK_S - time.monotonic(), 0.001))
                    self._wake.clear()
            except (OSError, ValueError) as error:
                if not self._again(error):
                    return

    def _start(self) -> None:
        self._process = start_child("polfuse_lab.live", answers=False)
        self._say(self._first, b"")
        with self._lock:
            # All that is still known of the run: the image begins with its first position, whenever somebody comes.
            self._waiting = deque((*self._past, *self._past_frames))
            self._bytes = sum(map(_size, self._waiting))
            self._frames = len(self._past_frames)

    def _again(self, error: Exception) -> bool:
        """After the live process has gone: whether it is to be started once more."""
        self._hang_up()
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(0.5)
            if self._process.poll() is None:
                self._process.kill()
        self._process = None
        if self._ended:
            return False
        self._restarts += 1
        if self._restarts > RESTARTS:
            self._warnings = (f"there is no live view any more: its process ended {self._restarts} times ({error})",)
            return False
        return True

    def _overheard(self) -> None:
        radar = self._radar
        if radar is None:
            return
        block = radar.newest(round(REACH_S * 400_000) if not self._following else self._reach)
        if block is None:
            return
        self._reach = round(REACH_S * block.sample_rate_hz)
        fresh = _after(block, self._following)
        self._following = block.first_frame + len(block.samples)
        if len(fresh):
            end_ns = block.t_host_ns + round(len(block.samples) / block.sample_rate_hz * 1e9)
            header: dict[str, Any] = {
                "kind": "audio",
                "first": self._following - len(fresh),
                "rate_hz": block.sample_rate_hz,
                "end_ns": end_ns,
                "dtype": fresh.dtype.str,
                "shape": fresh.shape,
            }
            self._say(header, fresh.tobytes())
        self._say({"kind": "counts", "dropped": self.dropped, "restarts": self._restarts}, b"")

    _reach = 0

    def _say(self, header: dict[str, Any], payload: bytes | memoryview) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        for piece in wire.encode(header, payload):
            self._process.stdin.write(piece)
        self._process.stdin.flush()

    def _hang_up(self) -> None:
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(OSError, ValueError):
                self._process.stdin.close()


def _after(block: AudioBlock, following: int) -> Any:
    """The part of a block that was not handed over before."""
    known = following - block.first_frame
    # A stream that was opened anew counts from 0 again.
    return block.samples[known:] if 0 <= known <= len(block.samples) else block.samples


def _size(record: Record) -> int:
    if isinstance(record, Sweeps):
        return record.block.samples.nbytes + 500
    if isinstance(record, Exposure):
        return record.frame.image.nbytes + 500
    return 500


class Viewers:
    """Several viewers as one. A :class:`polfuse_lab.scheduler.seams.Viewer`."""

    def __init__(self, *viewers: Any) -> None:
        self._viewers = viewers

    def offer(self, record: Record) -> None:
        """Give a record to each."""
        for viewer in self._viewers:
            viewer.offer(record)

    @property
    def fatal(self) -> str | None:
        """The first reason why the collect is pointless."""
        return next((viewer.fatal for viewer in self._viewers if viewer.fatal is not None), None)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know, of all of them."""
        return tuple(text for viewer in self._viewers for text in viewer.warnings)
