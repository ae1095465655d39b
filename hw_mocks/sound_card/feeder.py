"""The sound card's clock: samples are made in real time and handed to wherever they leave the simulator."""

from __future__ import annotations

import threading
import time
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.sound_card.card_faults import CardFaults
from hw_mocks.sound_card.settings import AudioSettings

BACKLOG_S = 1.0
"""A delayed sink or feeder catches up within this; what is older is lost, as on a sound card."""


class Source(Protocol):
    """What is sampled, such as :class:`hw_mocks.sound_card.synthesizer.Synthesizer`."""

    @property
    def audio(self) -> AudioSettings:
        """The sound card's settings."""

    def block(self, first: int, frames: int, t_ns: int) -> NDArray[np.generic]:
        """Samples ``first`` to ``first + frames``, the first one taken at host time ``t_ns``; shape (frames, 2)."""


class Sink(Protocol):
    """Where samples go. Nothing here waits, but for :meth:`plug_in`."""

    def put(self, samples: NDArray[np.generic], first: int, t_ns: int) -> None:
        """Take samples (frames, 2); the first has the number ``first`` and was taken at host time ``t_ns``."""

    def flush(self) -> bool:
        """Hand on what is waiting; whether anything still waits."""

    def unplug(self) -> None:
        """Fault: vanish, as a sound card whose cable is pulled."""

    def plug_in(self) -> None:
        """Be there again, at the same address."""

    def close(self) -> None:
        """Release everything. Idempotent."""


class SoundCard:
    """Samples a source from :meth:`start` to :meth:`close`, in blocks of ``block_s``.

    ``faults`` scripts what goes wrong (:mod:`hw_mocks.sound_card.card_faults`).
    """

    def __init__(
        self, source: Source, sinks: list[Sink], *, block_s: float = 0.01, faults: FaultScript | None = None
    ) -> None:
        self._source = source
        self._sinks = sinks
        self._rate = source.audio.true_rate_hz
        self._block = max(round(block_s * source.audio.sample_rate_hz), 1)
        self._stop = threading.Event()
        self._faults = CardFaults(faults)
        self._unplugged = False
        self._skip = 0
        self._lost = 0
        self._failure: BaseException | None = None
        # Frame number and the host time at which it is sampled: the card's clock starts anew when its rate changes.
        self._anchor = (0, 0)
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
            self._thread.join(timeout=15)
        for sink in self._sinks:
            sink.close()

    def _run(self) -> None:
        try:
            self._sample()
        except BaseException as error:
            self._failure = error

    def _instant_ns(self, frame: int) -> int:
        number, t_ns = self._anchor
        return t_ns + round((frame - number) / self._rate * 1e9)

    def _sample(self) -> None:
        self._anchor = (0, time.monotonic_ns())
        first = 0
        while not self._stop.is_set():
            self._clock_faults(first)
            stalled = self._stands_still(first)
            late_s = (time.monotonic_ns() - self._instant_ns(first + self._block)) * 1e-9
            if stalled or late_s < 0:
                waiting = [] if stalled else [sink.flush() for sink in self._sinks]
                self._stop.wait(0.002 if stalled or any(waiting) else -late_s)
                continue
            if late_s > BACKLOG_S:
                missed = int(late_s * self._rate)
                self._lost += missed
                first += missed
                continue
            self._deliver(first)
            first += self._block

    def _deliver(self, first: int) -> None:
        t_ns = self._instant_ns(first)
        samples = self._source.block(first, self._block, t_ns)
        samples = self._faults.content(samples, first, self._source.audio.sync_channel)
        dropped = min(self._skip, self._block)
        self._skip -= dropped
        self._lost += dropped
        if dropped < self._block:
            dropped_ns = round(dropped / self._rate * 1e9)
            for sink in self._sinks:
                sink.put(samples[dropped:], first + dropped, t_ns + dropped_ns)

    def _clock_faults(self, first: int) -> None:
        overflow = self._faults.begins(FaultKind.OVERFLOW, first)
        if overflow is not None:
            self.skip(round(overflow.amount))
        jump = self._faults.begins(FaultKind.CLOCK_JUMP, first)
        if jump is not None:
            self._anchor = (self._anchor[0], self._anchor[1] + round(jump.amount * 1e9))
        wrong = self._faults.active(FaultKind.WRONG_FORMAT, first)
        rate = wrong.amount if wrong is not None and wrong.amount > 0 else self._source.audio.true_rate_hz
        if rate != self._rate:
            self._anchor, self._rate = (first, self._instant_ns(first)), rate

    def _stands_still(self, first: int) -> bool:
        gone = self._faults.active(FaultKind.DISCONNECT, first) is not None
        if gone != self._unplugged:
            self._unplugged = gone
            for sink in self._sinks:
                if gone:
                    sink.unplug()
                else:
                    sink.plug_in()
        return gone or self._faults.active(FaultKind.STALL, first) is not None
