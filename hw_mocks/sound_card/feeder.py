"""The sound card's clock: samples are made in real time and handed to wherever they leave the simulator."""

from __future__ import annotations

import threading
import time
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hw_mocks.sound_card.synthesizer import Synthesizer

BACKLOG_S = 1.0
"""A delayed sink or feeder catches up within this; what is older is lost, as on a sound card."""


class Sink(Protocol):
    """Where samples go. Nothing here waits."""

    def put(self, samples: NDArray[np.int16], first: int, t_ns: int) -> None:
        """Take samples (frames, 2); the first has the number ``first`` and was taken at host time ``t_ns``."""

    def flush(self) -> bool:
        """Hand on what is waiting; whether anything still waits."""

    def close(self) -> None:
        """Release everything. Idempotent."""


class SoundCard:
    """Samples a world from :meth:`start` to :meth:`close`, in blocks of ``block_s``."""

    def __init__(self, synthesizer: Synthesizer, sinks: list[Sink], *, block_s: float = 0.01) -> None:
        self._synthesizer = synthesizer
        self._sinks = sinks
        self._rate = synthesizer.audio.true_rate_hz
        self._block = max(round(block_s * synthesizer.audio.sample_rate_hz), 1)
        self._stop = threading.Event()
        self._skip = 0
        self._lost = 0
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="sound-card", daemon=True)

    @property
    def lost_frames(self) -> int:
        """Frames that were sampled but never left, through :meth:`skip` or an overload of this computer."""
        return self._lost

    @property
    def failure(self) -> BaseException | None:
        """What ended the sound card by itself, if anything did."""
        return self._failure

    def start(self) -> None:
        """Begin to sample."""
        self._thread.start()

    def skip(self, frames: int) -> None:
        """Fault: the next ``frames`` frames are sampled but get lost, without any flag."""
        self._skip += frames

    def close(self) -> None:
        """Stop, and close the sinks. Idempotent."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=5)
        for sink in self._sinks:
            sink.close()

    def _run(self) -> None:
        try:
            self._sample()
        except BaseException as error:
            self._failure = error

    def _sample(self) -> None:
        start_ns = time.monotonic_ns()
        first = 0
        while not self._stop.is_set():
            due_ns = start_ns + round((first + self._block) / self._rate * 1e9)
            late_s = (time.monotonic_ns() - due_ns) * 1e-9
            if late_s < 0:
                waiting = [sink.flush() for sink in self._sinks]
                self._stop.wait(min(-late_s, 0.002) if any(waiting) else -late_s)
                continue
            if late_s > BACKLOG_S:
                missed = int(late_s * self._rate)
                self._lost += missed
                first += missed
                continue
            t_ns = start_ns + round(first / self._rate * 1e9)
            samples = self._synthesizer.block(first, self._block, t_ns)
            dropped = min(self._skip, self._block)
            self._skip -= dropped
            self._lost += dropped
            if dropped < self._block:
                dropped_ns = round(dropped / self._rate * 1e9)
                for sink in self._sinks:
                    sink.put(samples[dropped:], first + dropped, t_ns + dropped_ns)
            first += self._block
