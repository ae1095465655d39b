"""What an image sensor makes of light: shot noise, read noise, black level, rounding and clipping."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FULL_SCALE = 65_535
"""Largest count of a 16-bit converter."""


@dataclass(frozen=True)
class Sensor:
    """A sensor's noise and limits, in counts of its 16-bit converter."""

    black_level_counts: float = 0.0
    """Counts without light."""
    electrons_per_count: float = 1.0
    """Photo-electrons for one count at gain 1."""
    read_noise_counts: float = 0.0
    """Read noise, counts rms at gain 1."""
    saturation_counts: int = FULL_SCALE
    """Counts at which the sensor clips."""

    def expose(
        self, light: NDArray[np.float64], noise_key: Sequence[int], *, gain: float = 1.0
    ) -> NDArray[np.unsignedinteger]:
        """One frame.

        Args:
            light: mean counts above black at gain 1, any shape; negative light counts as none.
            noise_key: whole numbers of which the noise is a function, and of nothing else.
            gain: amplification behind the noise of the photo-electrons and of reading.

        Returns:
            uint16, shape of ``light``.
        """
        random = np.random.default_rng(list(noise_key))
        electrons = random.poisson(np.maximum(light, 0.0) * self.electrons_per_count)
        counts: NDArray[np.float64] = electrons / (self.electrons_per_count / gain)
        counts += random.normal(self.black_level_counts, self.read_noise_counts * gain, light.shape)
        np.rint(counts, out=counts)
        # Clipped before the conversion: a float beyond the range of uint16 would wrap round.
        return np.clip(counts, 0, min(self.saturation_counts, FULL_SCALE), out=counts).astype(np.uint16)


def setting_of(angle_rad: float) -> int:
    """A polarizer's angle as part of a noise key: whole millidegrees modulo a turn.

    The same setting gives the same noise whatever the last digits of its angle.
    """
    return round(math.degrees(angle_rad) * 1000) % 360_000
