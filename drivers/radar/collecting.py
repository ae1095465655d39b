"""From the ring of a stream to the records asked for: one, or one after another without a gap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.radar.ring import SampleRing
from drivers.radar.stream_clock import StreamClock
from drivers.records import AudioBlock


class Collecting:
    """A record being collected. Not thread-safe.

    Args:
        ring: the stream's samples.
        clock: when they were sampled, and which are missing.
        first: number, as received, of the record's first frame.
        samples: where they go, (frames, channels) of the ring's type.
        sample_rate_hz: nominal rate, Hz.
        after_ns: host time after which all of it must have been sampled; None where the device knows no time.
        margin_ns: how much earlier a frame may seem to have been sampled.
        gapless: when it is whole, the next record begins with the next frame.
    """

    def __init__(
        self,
        ring: SampleRing,
        clock: StreamClock,
        first: int,
        samples: NDArray[np.generic],
        *,
        sample_rate_hz: float,
        after_ns: int | None,
        margin_ns: int,
        gapless: bool,
    ) -> None:
        self._ring, self._clock = ring, clock
        self._first, self._samples = first, samples
        self._rate = sample_rate_hz
        self._after_ns, self._margin_ns = after_ns, margin_ns
        self.gapless = gapless
        """Whether another record follows the one being collected."""
        self._filled = 0
        self._skipped = 0
        """Frames that were overwritten in the ring before they came here."""

    @property
    def following(self) -> int:
        """Number, as received, of the first frame that is not needed from the ring any more."""
        return self._first + self._skipped + self._filled

    def take(self) -> AudioBlock | None:
        """The record once it is whole and it is known whether frames are missing in it, else None."""
        self._collect()
        first, end = self._first, self._first + self._skipped + len(self._samples)
        if self._filled < len(self._samples) or self._clock.confirmed < end or self._began_early():
            return None
        clock, samples, skipped = self._clock, self._samples, self._skipped
        if self.gapless:
            # What is missing at a border counts once: from record to record the numbers add up.
            lost = clock.lost_before(end) - clock.lost_before(first)
            self._restart(end)
            self._after_ns = None
        else:
            lost = clock.lost_within(first, end)
        counted = first + clock.lost_before(first)
        return AudioBlock(
            samples=samples,
            sample_rate_hz=self._rate,
            first_frame=counted,
            t_device_s=counted / self._rate,
            t_host_ns=clock.arrival_ns(first),
            lost_frames=lost + skipped,
            overflow=clock.flagged_within(first, end),
        )

    def _restart(self, first: int) -> None:
        self._first, self._samples = first, np.zeros_like(self._samples)
        self._filled = self._skipped = 0

    def _began_early(self) -> bool:
        """Whether the record holds frames from before it was asked for; it is then collected anew from later ones.

        The clock's line only becomes known from arrivals: when all of them were late so far (a stream that began under
        load) and then catch up, frames turn out to have been sampled earlier than they seemed.
        """
        if self._after_ns is None or self._clock.arrival_ns(self._first) >= self._after_ns - self._margin_ns:
            return False
        self._restart(self._clock.frame_surely_after(self._after_ns))
        return True

    def _collect(self) -> None:
        """Move what has arrived from the ring into the record."""
        while self._filled < len(self._samples):
            following = self.following
            frames = min(self._ring.written - following, len(self._samples) - self._filled)
            if frames <= 0:
                return
            piece = self._ring.read(following, frames)
            if piece is None:
                # Nobody polled for longer than the ring holds: those frames are missing inside the record.
                self._skipped += max(self._ring.oldest + self._ring.capacity // 4 - following, 1)
                continue
            self._samples[self._filled : self._filled + frames] = piece
            self._filled += frames
