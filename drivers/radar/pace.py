"""Does a stream that has just begun keep step with the host's clock, and if not, how fast is it?"""

from __future__ import annotations

import math

from drivers.radar.ring import Arrival

SPAN_S = 0.4
SPREAD_S = 0.008


def settled(arrivals: list[Arrival], sample_rate_hz: float) -> list[Arrival] | None:
    """The arrivals of the last :data:`SPAN_S` if they keep pace; None while they do not, or are too few.

    At its beginning a stream may hand over a backlog at once. It keeps pace when the least lateness of each quarter of
    the span is the same within :data:`SPREAD_S`.

    Args:
        arrivals: all so far, in order.
        sample_rate_hz: nominal rate, Hz.
    """
    if not arrivals or arrivals[-1].host_ns - arrivals[0].host_ns < SPAN_S * 1e9:
        return None
    newest_ns = arrivals[-1].host_ns
    recent = [a for a in arrivals if newest_ns - a.host_ns < SPAN_S * 1e9]
    least = [math.inf] * 4
    for a in recent:
        quarter = 3 - int(4 * (newest_ns - a.host_ns) / (SPAN_S * 1e9))
        late_s = (a.host_ns - newest_ns) * 1e-9 - (a.first + a.frames) / sample_rate_hz
        least[quarter] = min(least[quarter], late_s)
    return recent if max(least) - min(least) < SPREAD_S else None


def rate_hz(arrivals: list[Arrival]) -> float | None:
    """Frames a second of the last 2 s by the host's clock; None with fewer than two arrivals."""
    newest_ns = arrivals[-1].host_ns if arrivals else 0
    recent = [a for a in arrivals if newest_ns - a.host_ns < 2e9]
    if len(recent) < 2:
        return None
    frames = recent[-1].first + recent[-1].frames - recent[0].first - recent[0].frames
    return frames / max((newest_ns - recent[0].host_ns) * 1e-9, 1e-9)
