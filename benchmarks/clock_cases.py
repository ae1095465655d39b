"""Simulated clocks whose truth is known: drift, late answers, jumps, wraps and outliers, and the pairs they give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.clocks import DeviceClock, fit_clock
from polfuse_lab.scheduler.clock_watch import CLOCK_AFTER_S

Floats = NDArray[np.float64]

SHORTEST_EXCHANGE_S = 100e-6
"""Way there and back on an idle line."""
STAMP_LATE_S = 1e-3
"""Mean delay of the host's stamp of a record."""

WANDER_PERIOD_S = 1200.0


@dataclass(frozen=True)
class Case:
    """One kind of session."""

    name: str
    way_out_s: float = 1e-3
    """Mean of the exponential delay of the question, s: what is 1 ms of jitter."""
    way_back_s: float = 1e-3
    """That of the answer."""
    stamp_s: float = 0.0
    """Standard deviation of the host's stamps that no round trip tells (normal)."""
    stamp_late_s: float = 0.0
    """Mean of an exponential delay of the host's stamps that no round trip tells."""
    wander_s: float = 0.0
    """Amplitude of the device's wandering with the day's warmth (a sine of 20 minutes), s."""
    pairs: tuple[int, int] = (13, 240)
    """Fewest and most pairs; one every 5 s."""
    jump_s: float = 0.0
    """How far the device's clock leaps, once, at a random time."""
    sleep_s: float = 0.0
    """How long the computer is suspended, once: its monotonic clock stands, the device's goes on."""
    outliers: float = 0.0
    """Share of pairs that are off by up to 100 ms, without their round trip telling."""
    wrap_s: float = 0.0
    """Period of the device's counter, begun at a random phase; 0: none."""
    limit_s: float | None = 0.5e-3
    """Greatest rms error; None where so few pairs cannot do it."""


CASES = (
    Case("two_sided"),
    Case("late_answers", way_out_s=0.0),
    Case("late_questions", way_back_s=0.0),
    Case("stamps", way_out_s=0.0, way_back_s=0.0, stamp_s=1e-3),
    Case("late_stamps", way_out_s=0.0, way_back_s=0.0, stamp_late_s=1e-3, limit_s=None),
    Case("wander", wander_s=3e-4, pairs=(120, 720)),
    Case("jump", jump_s=0.05),
    Case("jump_late_answers", way_out_s=0.0, jump_s=-0.05),
    Case("jump_stamps", way_out_s=0.0, way_back_s=0.0, stamp_s=1e-3, jump_s=0.05),
    Case("sleep", sleep_s=3600.0),
    Case("outliers", outliers=0.1),
    Case("outliers_and_jump", outliers=0.1, jump_s=0.05, pairs=(40, 240)),
    Case("wrap", wrap_s=2**32 * 1e-6, pairs=(13, 1700)),
    Case("short", pairs=(3, 12), limit_s=None),
    Case("two_pairs", pairs=(2, 2), limit_s=None),
    Case("one_pair", pairs=(1, 1), limit_s=None),
)


@dataclass(frozen=True)
class Trial:
    """One session: how far the fitted times are from the truth."""

    rms_s: float
    """Over all instants looked at."""
    error_s: float
    """At one random instant."""
    sd_s: float
    """The uncertainty reported for that instant."""
    jumps: int
    """Jumps that were found."""


class SimulatedClock:
    """A device's clock as a function of true time, and the host's, s."""

    def __init__(self, case: Case, span_s: float, random: np.random.Generator) -> None:
        self.case = case
        self.rate = 1 + random.uniform(-200, 200) * 1e-6
        self.begin_s = random.uniform(0, case.wrap_s or 1000.0)
        self.host_begin_ns = int(random.integers(10**9, 10**17))
        self.break_s = random.uniform(0.15, 0.85) * span_s

    def device_s(self, t: Floats) -> Floats:
        """Its reading at true times ``t``."""
        reading = self.begin_s + self.rate * t + np.where(t > self.break_s, self.case.jump_s, 0.0)
        reading = reading + self.case.wander_s * np.sin(2 * np.pi * t / WANDER_PERIOD_S)
        wrapped: Floats = np.mod(reading, self.case.wrap_s) if self.case.wrap_s else reading
        return wrapped

    def host_ns(self, t: Floats) -> NDArray[np.int64]:
        """The host's monotonic clock at true times ``t``: it stands while the computer sleeps."""
        slept = np.clip(t - self.break_s, 0.0, self.case.sleep_s)
        ticks: NDArray[np.int64] = self.host_begin_ns + np.round((t - slept) * 1e9).astype(np.int64)
        return ticks


def run_trial(case: Case, seed: int, instants: int = 60) -> Trial:
    """Simulate one session and compare the fitted clock with the truth at random instants within it."""
    random = np.random.default_rng(seed)
    count = int(random.integers(case.pairs[0], case.pairs[1] + 1))
    gaps = [*CLOCK_AFTER_S, *[CLOCK_AFTER_S[-1]] * count][:count]
    asked = np.concatenate([[0.0], np.cumsum(gaps)[: count - 1]])
    span = max(float(asked[-1]), 5.0)
    clock = SimulatedClock(case, span, random)
    # Asleep, nobody asks: what was due then is asked an hour later.
    asked = asked + np.where(asked > clock.break_s, case.sleep_s, 0.0)
    fitted = fit_clock("device", *_pairs(clock, asked, random))
    assert fitted is not None
    times = random.uniform(0.0, span, instants)
    times += np.where(times > clock.break_s, case.sleep_s, 0.0)
    return _judge(clock, fitted, times, random)


def _pairs(
    clock: SimulatedClock, asked: Floats, random: np.random.Generator
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    case, count = clock.case, len(asked)
    out = SHORTEST_EXCHANGE_S / 2 + random.exponential(case.way_out_s, count)
    back = SHORTEST_EXCHANGE_S / 2 + random.exponential(case.way_back_s, count)
    before, after = clock.host_ns(asked), clock.host_ns(asked) + np.round((out + back) * 1e9).astype(np.int64)
    off = random.normal(0, case.stamp_s, count) + random.exponential(case.stamp_late_s, count)
    off += np.where(random.random(count) < case.outliers, random.uniform(-0.1, 0.1, count), 0.0)
    middle = before + (after - before) // 2 + np.round(off * 1e9).astype(np.int64)
    return clock.device_s(asked + out), middle, after - before


def _judge(clock: SimulatedClock, fitted: DeviceClock, times: Floats, random: np.random.Generator) -> Trial:
    truth = clock.host_ns(times)
    stamped = truth + np.round(random.exponential(STAMP_LATE_S, len(times)) * 1e9).astype(np.int64)
    reading = clock.device_s(times)
    errors = (fitted.host_ns(reading, near_ns=stamped) - truth) * 1e-9
    sds = fitted.sd_s(reading, near_ns=stamped)
    return Trial(float(np.sqrt(np.mean(errors**2))), float(errors[0]), float(sds[0]), len(fitted.jumps_s))
