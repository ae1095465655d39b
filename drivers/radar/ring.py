"""A ring of samples with one writer (the sound card's callback) and one reader, without locks.

The writer copies and counts, nothing else: it runs on the audio thread, which must never wait. All memory is there from
the beginning. Counters are plain integers that only the writer changes, and it changes them after the samples are in
place, so the reader never sees a count ahead of its samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray


@dataclass(frozen=True)
class Arrival:
    """One callback: the frames that it brought and when.

    ``adc_age_s`` is how long before the callback its first frame was converted, as the host API says (NaN if it does
    not say).
    """

    first: int
    frames: int
    host_ns: int
    adc_age_s: float
    overflow: bool


class SampleRing:
    """The newest ``capacity`` frames of a stream; frames are numbered from 0 in the order of their arrival."""

    def __init__(self, capacity: int, channels: int, dtype: DTypeLike, arrivals: int = 4096) -> None:
        self._samples = np.zeros((capacity, channels), dtype=dtype)
        # One column for each field of an arrival.
        self._firsts = np.zeros(arrivals, np.int64)
        self._frames = np.zeros(arrivals, np.int64)
        self._host_ns = np.zeros(arrivals, np.int64)
        self._adc_ages = np.zeros(arrivals, np.float64)
        self._overflows = np.zeros(arrivals, np.bool_)
        self._written = 0
        self._arrived = 0

    @property
    def capacity(self) -> int:
        """Frames that fit."""
        return len(self._samples)

    @property
    def written(self) -> int:
        """Frames written so far."""
        return self._written

    @property
    def oldest(self) -> int:
        """Number of the oldest frame that can still be read."""
        return max(self._written - len(self._samples), 0)

    @property
    def last_ns(self) -> int | None:
        """Host time of the newest callback; None before the first."""
        arrived = self._arrived
        return int(self._host_ns[(arrived - 1) % len(self._host_ns)]) if arrived else None

    def write(self, block: NDArray[np.generic], host_ns: int, adc_age_s: float, overflow: bool) -> None:
        """Append a block (frames, channels), at most ``capacity`` frames. Called by the writer only."""
        first, frames, capacity = self._written, len(block), len(self._samples)
        start = first % capacity
        head = min(frames, capacity - start)
        self._samples[start : start + head] = block[:head]
        if head < frames:
            self._samples[: frames - head] = block[head:]
        slot = self._arrived % len(self._firsts)
        self._firsts[slot] = first
        self._frames[slot] = frames
        self._host_ns[slot] = host_ns
        self._adc_ages[slot] = adc_age_s
        self._overflows[slot] = overflow
        self._written = first + frames
        self._arrived += 1

    def arrivals(self, since: int) -> tuple[list[Arrival], int]:
        """Callbacks number ``since`` and later that are still known, and the number of the next one to come."""
        arrived = self._arrived
        # A quarter is left free, into which the writer may come round meanwhile.
        slots = np.arange(max(since, arrived - 3 * len(self._firsts) // 4), arrived) % len(self._firsts)
        columns = (self._firsts, self._frames, self._host_ns, self._adc_ages, self._overflows)
        return [Arrival(*row) for row in zip(*(column[slots].tolist() for column in columns), strict=True)], arrived

    def read(self, first: int, frames: int) -> NDArray[np.generic] | None:
        """Copy of frames ``first`` to ``first + frames`` (all written already); None if overwritten meanwhile."""
        capacity = len(self._samples)
        if first < self.oldest:
            return None
        start = first % capacity
        head = min(frames, capacity - start)
        copy = np.concatenate((self._samples[start : start + head], self._samples[: frames - head]))
        # The writer may have come round during the copy.
        return copy if first >= self.oldest else None
