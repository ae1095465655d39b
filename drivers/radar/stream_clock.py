"""When was each frame sampled, and are frames missing? Three witnesses: frame count, ADC time, the host's clock.

Frames arrive late by a varying delay (buffers, scheduling), never early. So the host time at which frame n would
arrive with the least delay is a straight line in n: the lower envelope of all arrivals. Two facts follow.

* A frame's sampling instant is read from the line, not from its own callback, and is immune to bursts and stalls.
* A stall that is caught up loses nothing; after a loss every later frame stays late by the same amount. When the
  least lateness over half a second stays above a threshold, that much is missing, whether or not the host API set its
  overflow flag (PulseAudio never does).
* A server that falls behind by a steady amount looks the same until it catches up. So a loss that no other witness
  confirms is doubted until then: records begin with frames that were sampled late enough in either case.

The ADC time, where its own jitter is small, refines the size of a loss; it never decides, since some host APIs report
ADC times that are hundreds of milliseconds off.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from drivers.radar.ring import Arrival

LOSS_THRESHOLD_S = 0.008
LOSS_WINDOW_S = 0.5
ONSET_TOLERANCE_S = 0.002
DRIFT_WINDOW_S = 1.0
PATIENCE_S = 5.0
ADC_JITTER_S = 0.0005
MOST_BEHIND_S = 2.0
"""Longest that a sound server holds back what it will still deliver; more than that is not waited for."""


@dataclass(frozen=True)
class Loss:
    """``frames`` missing within or just before the arrivals ``first`` to ``end`` (frames numbered as received)."""

    first: int
    end: int
    frames: int


class StreamClock:
    """Follows one stream. Frames are numbered as received; ``lost`` says how many are missing besides."""

    def __init__(self, sample_rate_hz: float, *, paced: bool = True, whole_blocks: bool = False) -> None:
        """Follow a stream of a nominal rate.

        Args:
            sample_rate_hz: nominal rate, Hz.
            paced: whether arrivals tell the time (a file device's do not).
            whole_blocks: whether the host API loses whole callbacks only (JACK), which sizes a loss to the frame.
        """
        self._rate = sample_rate_hz
        self._whole_blocks = whole_blocks
        self._paced = paced
        self._origin_ns: float | None = None
        self._reference_ns = 0
        self._end = 0
        self._confirmed = 0
        self.losses: list[Loss] = []
        self.lost = 0
        self._suspects: list[tuple[Arrival, float, float]] = []
        self._doubted_s = 0.0
        self._doubted_from = 0
        self._drift_from_ns = 0
        self._drift_least_s = math.inf
        self._flagged: deque[Arrival] = deque(maxlen=1024)
        # Lateness of each arrival of the present drift window, and what typical_arrival tells of it.
        self._window: list[tuple[float, tuple[int, int, int]]] = []
        self._typical: tuple[int, int, int] | None = None
        self._last_adc: tuple[int, float] | None = None
        self._adc_steps: deque[float] = deque(maxlen=64)

    @property
    def end(self) -> int:
        """Frames received so far."""
        return self._end

    @property
    def confirmed(self) -> int:
        """Frames up to which every loss is known."""
        return self._confirmed

    @property
    def started(self) -> bool:
        """Whether anything has arrived."""
        return self._origin_ns is not None

    @property
    def typical_arrival(self) -> tuple[int, int, int] | None:
        """(frames including lost ones, host ns, block frames) of an arrival of the last whole second; None before any.

        It is the one that is later than a quarter of the others (in the first second, the earliest so far): the least
        delayed ones scatter more, since few come so early, and the later ones tell of the computer's load.
        """
        if self._typical is None and self._window:
            return min(self._window)[1]
        return self._typical

    def lost_before(self, frame: int) -> int:
        """Frames missing before a received frame."""
        return sum(loss.frames for loss in self.losses if loss.first <= frame)

    def lost_within(self, first: int, end: int) -> int:
        """Frames missing inside received frames ``first`` to ``end``; a loss at the border counts."""
        return sum(loss.frames for loss in self.losses if loss.first < end and loss.end > first)

    def flagged_within(self, first: int, end: int) -> bool:
        """Whether the host API itself flagged an overflow in received frames ``first`` to ``end``."""
        return any(a.first < end and a.first + a.frames > first for a in self._flagged)

    def arrival_ns(self, frame: int) -> int:
        """Host time at which a received frame arrives with the least delay."""
        assert self._origin_ns is not None
        return self._reference_ns + round(self._origin_ns + (frame + self.lost_before(frame)) / self._rate * 1e9)

    def first_frame_after(self, t_ns: int) -> int:
        """Number, as received, of the first frame sampled at or after host time ``t_ns``."""
        assert self._origin_ns is not None
        counted = math.ceil((t_ns - self._reference_ns - self._origin_ns) * 1e-9 * self._rate)
        frame = counted
        for loss in self.losses:
            # Losses that came later do not shift it; one in the middle of which it would lie leaves the frame behind.
            if frame < loss.first:
                break
            frame = max(frame - loss.frames, loss.first)
        return max(frame, 0)

    def frame_surely_after(self, t_ns: int) -> int:
        """As :meth:`first_frame_after`, also if what seems to be lost is only late and will be caught up."""
        frame = self.first_frame_after(t_ns)
        return frame if frame < self._doubted_from else frame + math.ceil(self._doubted_s * self._rate)

    def add(self, arrival: Arrival) -> None:
        """Take note of one callback; callbacks come in order."""
        self._end = end = arrival.first + arrival.frames
        adc_jump_s = self._adc_jump(arrival)
        if arrival.overflow:
            self._flagged.append(arrival)
        if self._origin_ns is None:
            # Nanoseconds relative to the first arrival, so that a float holds them exactly.
            self._reference_ns = self._drift_from_ns = arrival.host_ns
            self._origin_ns = -end / self._rate * 1e9
        if not self._paced:
            self._confirmed = end
            return
        since_ns = arrival.host_ns - self._reference_ns
        late_s = (since_ns - self._origin_ns) * 1e-9 - (end + self.lost) / self._rate
        if late_s < 0:
            # Nothing comes early: what was taken for lost was late, and is being caught up.
            self._doubted_s = max(self._doubted_s + late_s, 0.0)
            self._origin_ns += late_s * 1e9
            late_s = 0.0
        if self._suspects or late_s > LOSS_THRESHOLD_S or arrival.overflow:
            self._suspects.append((arrival, late_s, adc_jump_s))
            self._judge()
        if not self._suspects:
            self._confirmed = end
            self._follow_drift(arrival, late_s)

    def _judge(self) -> None:
        """Decide about the late arrivals so far: caught up, lost, or not known yet."""
        first, newest = self._suspects[0][0], self._suspects[-1]
        if newest[1] <= LOSS_THRESHOLD_S and not any(arrival.overflow for arrival, _, _ in self._suspects):
            self._suspects.clear()  # it was only late
            return
        settled = self._settled()
        if not settled or newest[0].host_ns - first.host_ns < LOSS_WINDOW_S * 1e9:
            return
        # Arrivals just before the loss may have been late too: the level is read from the window's last half, and the
        # loss placed where the lateness rises to that level for good.
        missing_s = min(late_s for _, late_s, _ in settled)
        at = len(self._suspects) - 1
        while at > 0 and self._suspects[at - 1][1] >= missing_s - ONSET_TOLERANCE_S:
            at -= 1
        where, _, adc_jump_s = self._suspects[at]
        if abs(adc_jump_s - missing_s) < LOSS_THRESHOLD_S:
            missing_s = adc_jump_s
        elif not any(arrival.overflow for arrival, _, _ in self._suspects):
            if self._doubted_s == 0:
                self._doubted_from = where.first
            self._doubted_s = min(self._doubted_s + max(missing_s, 0.0), MOST_BEHIND_S)
        frames = max(round(missing_s * self._rate), 1)
        if self._whole_blocks and (blocks := round(frames / where.frames)):
            frames = blocks * where.frames
        self.losses.append(Loss(where.first, where.first + where.frames, frames))
        self.lost += frames
        self._suspects.clear()

    def _settled(self) -> list[tuple[Arrival, float, float]]:
        """The late arrivals of the last half window; none while a longer pause lies within it (a burst follows)."""
        half_ns = LOSS_WINDOW_S / 2 * 1e9
        newest_ns = later_ns = self._suspects[-1][0].host_ns
        settled: list[tuple[Arrival, float, float]] = []
        for suspect in reversed(self._suspects):
            if later_ns - suspect[0].host_ns > half_ns:
                break
            settled.append(suspect)
            later_ns = suspect[0].host_ns
            if newest_ns - later_ns >= half_ns:
                return settled
        # A device that always pauses so long would otherwise never be judged.
        patience_ns = PATIENCE_S * 1e9
        return settled if newest_ns - self._suspects[0][0].host_ns > patience_ns else []

    def _follow_drift(self, arrival: Arrival, late_s: float) -> None:
        """Let the line rise when even the least late arrival of a second lies above it (a slow sound card)."""
        assert self._origin_ns is not None
        self._drift_least_s = min(self._drift_least_s, late_s)
        self._window.append((late_s, (self._end + self.lost, arrival.host_ns, arrival.frames)))
        if arrival.host_ns - self._drift_from_ns >= DRIFT_WINDOW_S * 1e9:
            self._origin_ns += 0.5 * self._drift_least_s * 1e9
            self._drift_from_ns, self._drift_least_s = arrival.host_ns, math.inf
            self._window.sort()
            self._typical = self._window[len(self._window) // 4][1]
            self._window.clear()

    def _adc_jump(self, arrival: Arrival) -> float:
        """How much more ADC time than frames passed since the last callback, s; NaN where ADC times are not clean."""
        if math.isnan(arrival.adc_age_s):
            self._last_adc = None
            return math.nan
        # Differences of integers first: the host's clock has too many digits for a float.
        adc_ns = arrival.host_ns - round(arrival.adc_age_s * 1e9)
        previous, self._last_adc = self._last_adc, (adc_ns, arrival.frames / self._rate)
        if previous is None:
            return math.nan
        step_s = (adc_ns - previous[0]) * 1e-9 - previous[1]
        clean = len(self._adc_steps) >= 16 and all(abs(step) < ADC_JITTER_S for step in self._adc_steps)
        if not clean or abs(step_s) < ADC_JITTER_S:
            self._adc_steps.append(step_s)
        return step_s if clean else math.nan
