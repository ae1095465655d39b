"""How a stepper motor's controller moves: speed up, keep the speed, slow down; as piecewise linear paths."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_RAMP_POINTS = 24


@dataclass(frozen=True)
class Profile:
    """A way in time: distance from the start, in mm, at instants from its beginning, in s (both rising from 0)."""

    t_s: NDArray[np.float64]
    s_mm: NDArray[np.float64]

    @property
    def seconds(self) -> float:
        """Length in time."""
        return float(self.t_s[-1])

    @property
    def distance_mm(self) -> float:
        """Length in space."""
        return float(self.s_mm[-1])

    def speed_mm_s(self, t_s: float) -> float:
        """Speed after ``t_s`` seconds, 0 outside."""
        if not 0 <= t_s < self.seconds:
            return 0.0
        index = int(np.searchsorted(self.t_s, t_s, side="right"))
        return float((self.s_mm[index] - self.s_mm[index - 1]) / (self.t_s[index] - self.t_s[index - 1]))

    def cut(self, distance_mm: float) -> Profile:
        """The same way up to a distance (an end switch)."""
        if distance_mm >= self.distance_mm:
            return self
        keep = self.s_mm < distance_mm
        t_end_s = np.interp(distance_mm, self.s_mm, self.t_s)
        return Profile(np.append(self.t_s[keep], t_end_s), np.append(self.s_mm[keep], max(distance_mm, 0.0)))


def travel(distance_mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> Profile:
    """From rest to rest: a trapezoid of speed, or a triangle where there is no room to reach ``speed_mm_s``.

    Args:
        distance_mm: 0 or more.
        speed_mm_s: greatest speed, above 0.
        acceleration_mm_s2: of both ramps; infinite for none.
    """
    if not math.isfinite(acceleration_mm_s2):
        return Profile(np.array([0.0, distance_mm / speed_mm_s]), np.array([0.0, distance_mm]))
    peak_mm_s = min(speed_mm_s, math.sqrt(distance_mm * acceleration_mm_s2))
    ramp_s = peak_mm_s / acceleration_mm_s2
    ramp_mm = peak_mm_s * ramp_s / 2
    cruise_s = max(distance_mm - 2 * ramp_mm, 0.0) / peak_mm_s if peak_mm_s else 0.0
    up_s = np.linspace(0.0, ramp_s, _RAMP_POINTS)
    up_mm = acceleration_mm_s2 * up_s**2 / 2
    end_s = 2 * ramp_s + cruise_s
    return Profile(np.concatenate([up_s, end_s - up_s[::-1]]), np.concatenate([up_mm, distance_mm - up_mm[::-1]]))


def braking(speed_mm_s: float, seconds: float) -> Profile:
    """From a speed to rest in a given time, slowing down uniformly."""
    t_s = np.linspace(0.0, max(seconds, 1e-9), _RAMP_POINTS)
    return Profile(t_s, speed_mm_s * (t_s - t_s**2 / (2 * t_s[-1])))
