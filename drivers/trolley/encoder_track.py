"""Where a hand-pushed trolley was, and when: counts of its encoder on the host's clock.

The controller's clock is laid on the host's by the quickest lines of the last few seconds: none can arrive before it
was sent, so that the smallest difference of arrival and stamp is the clocks' offset (and the shortest delay on the
line), and its change over the window their relative rate (a ceramic resonator is off by up to 0.5 %). The rest of the
differences is the uncertainty of a line's time.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass

import numpy as np

from drivers.trolley.encoder_protocol import SEQUENCE_BITS, TIME_BITS, EncoderLine, unwrap

_WINDOW = 600
_RATE_SPAN_S = 1.5
_GREATEST_RATE = 0.01
_EARLY_S = 0.2
"""A line that arrives so much before it was sent means that the controller's clock jumped."""


class Jump(Exception):
    """The encoder's numbers jumped: the controller restarted, or its wheel was lifted. ``str()`` says which."""


@dataclass(frozen=True)
class Scale:
    """How counts become metres."""

    counts_per_m: float
    """Counts for one metre, negative where they fall towards positive x."""
    scale_sd: float
    """Relative standard deviation of ``counts_per_m``."""
    reference_sd_m: float
    """Standard deviation of a reference position, m."""
    index_x_m: float | None
    """Position of the index mark, m; None where there is none."""
    counter_bits: int
    """Width of the controller's counter."""
    max_speed_m_s: float
    """What no hand does, m/s."""


class EncoderTrack:
    """The last few seconds of an encoder. Not thread-safe.

    Args:
        scale: how counts become metres.
        start_x_m: position at the first line, m.
    """

    def __init__(self, scale: Scale, start_x_m: float) -> None:
        self._scale = scale
        self._reference_m, self._reference_count = start_x_m, 0
        self._last: EncoderLine | None = None
        self._micros = self._count = 0
        self._rows: deque[tuple[float, float, float]] = deque(maxlen=_WINDOW)  # device s, x m, arrival - device s
        self.lost_lines = 0
        """Lines that never came."""
        self.clock_jumps = 0
        """How often the controller's clock jumped ahead; positions stay right, times begin anew."""
        self.indexed = False
        """Whether the index mark has been passed."""
        self._clock_fit: tuple[float, float, float, float] | None = None

    def add(self, line: EncoderLine, arrival_ns: int) -> None:
        """Take a line that arrived at ``arrival_ns`` (the host's monotonic clock).

        Raises:
            Jump: its time or count cannot follow the last one's; the track begins anew with this line.
        """
        last, self._last = self._last, line
        if last is None:
            self._begin(line)
        else:
            self.lost_lines += (line.sequence - last.sequence - 1) % (1 << SEQUENCE_BITS)
            micros = unwrap(self._micros, line.micros, TIME_BITS)
            count = unwrap(self._count, line.count, self._scale.counter_bits)
            step_s = (micros - self._micros) * 1e-6
            step_m = (count - self._count) / self._scale.counts_per_m
            if step_s <= 0:
                self._begin(line)
                raise Jump("the encoder's controller restarted, its count no longer says where the trolley is")
            if abs(step_m) > self._scale.max_speed_m_s * step_s + 2 / abs(self._scale.counts_per_m):
                self._begin(line)
                raise Jump(f"the encoder jumped by {step_m:+.3f} m in {step_s * 1e3:.0f} ms")
            self._micros, self._count = micros, count
            if line.index != last.index:
                self._refer(line)
        device_s = self._micros * 1e-6
        arrival_s = arrival_ns * 1e-9
        if self._rows and arrival_s - self._host_s(device_s) < -_EARLY_S:
            self._rows.clear()
            self.clock_jumps += 1
        self._rows.append((device_s, self._x_m(), arrival_s - device_s))
        self._clock_fit = None

    def __bool__(self) -> bool:
        return bool(self._rows)

    @property
    def last_x_m(self) -> float:
        """Position of the last line, m."""
        return self._rows[-1][1]

    @property
    def last_t_ns(self) -> int:
        """Time of the last line on the host's monotonic clock, ns."""
        return round(self._host_s(self._rows[-1][0]) * 1e9)

    def position(self, t_ns: int | None = None) -> tuple[float, float]:
        """Position and its standard deviation, m, at a host time within the last few seconds (the last line's).

        Between two lines the way is taken as straight; beyond the last line the trolley is taken to go on as it did.

        Raises:
            ValueError: earlier than the first line that is kept.
        """
        rows = self._rows
        at_s = rows[-1][0] if t_ns is None else self._device_s(t_ns * 1e-9)
        if at_s < rows[0][0]:
            raise ValueError("earlier than what is kept of the encoder's track")
        right = min(max(bisect_left(rows, at_s, key=lambda row: row[0]), 1), len(rows) - 1)
        if right < 1:
            return rows[0][1], self._sd_m(rows[0][1], 0.0, 0.0)
        (t0_s, x0_m, _), (t1_s, x1_m, _) = rows[right - 1], rows[right]
        speed_m_s = (x1_m - x0_m) / (t1_s - t0_s)
        x_m = x1_m + speed_m_s * (at_s - t1_s)
        # How far a hand may have deviated from the straight: an eighth of a change by the whole speed between lines.
        beyond_s = min(abs(at_s - t0_s), abs(at_s - t1_s)) / 4 + max(at_s - t1_s, 0.0)
        return x_m, self._sd_m(x_m, speed_m_s, beyond_s)

    def spread_m(self, seconds: float) -> float:
        """Difference of the greatest and the smallest x in the last ``seconds``; infinite while fewer are known."""
        rows = self._rows
        since_s = rows[-1][0] - seconds
        if rows[0][0] > since_s:
            return math.inf
        recent = [x_m for device_s, x_m, _ in rows if device_s >= since_s]
        return max(recent) - min(recent)

    def _begin(self, line: EncoderLine) -> None:
        if self._rows:
            self._reference_m = self._rows[-1][1]
        self._micros, self._count = line.micros, line.count
        self._reference_count = line.count
        self._rows.clear()
        self._clock_fit = None
        self._refer(line)

    def _refer(self, line: EncoderLine) -> None:
        """From its index mark on, positions refer to the mark."""
        if line.index is not None and self._scale.index_x_m is not None:
            self._reference_count = unwrap(self._count, line.index, self._scale.counter_bits)
            self._reference_m = self._scale.index_x_m
            self.indexed = True

    def _x_m(self) -> float:
        return self._reference_m + (self._count - self._reference_count) / self._scale.counts_per_m

    def _clock(self) -> tuple[float, float, float, float]:
        """Reference on the controller's clock, offset of the host's there, relative rate, rms delay of lines; s."""
        if self._clock_fit is None:
            device_s, _, difference_s = np.array(self._rows).T
            reference_s, rate = float(device_s[-1]), 0.0
            third = len(device_s) // 3
            if device_s[-1] - device_s[0] >= _RATE_SPAN_S:
                # The quickest line early in the window and the quickest late in it; slow ones do not matter.
                early, late = int(np.argmin(difference_s[:third])), len(device_s) - third
                late += int(np.argmin(difference_s[late:]))
                rate = float((difference_s[late] - difference_s[early]) / (device_s[late] - device_s[early]))
                rate = min(max(rate, -_GREATEST_RATE), _GREATEST_RATE)
            delay_s = difference_s - rate * (device_s - reference_s)
            offset_s = float(delay_s.min())
            self._clock_fit = reference_s, offset_s, rate, float(np.sqrt(np.mean((delay_s - offset_s) ** 2)))
        return self._clock_fit

    def _host_s(self, device_s: float) -> float:
        reference_s, offset_s, rate, _ = self._clock()
        return device_s + offset_s + rate * (device_s - reference_s)

    def _device_s(self, host_s: float) -> float:
        reference_s, offset_s, rate, _ = self._clock()
        return reference_s + (host_s - offset_s - reference_s) / (1 + rate)

    def _sd_m(self, x_m: float, speed_m_s: float, beyond_s: float) -> float:
        scale, late_s = self._scale, self._clock()[3]
        return math.sqrt(
            scale.reference_sd_m**2
            + (scale.scale_sd * (x_m - self._reference_m)) ** 2
            + 1 / (12 * scale.counts_per_m**2)  # uniform over one count
            + (speed_m_s * late_s) ** 2
            + (speed_m_s * beyond_s) ** 2
        )
