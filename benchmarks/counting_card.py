"""A simulated sound card whose samples count, in a process of its own: ``python -m benchmarks.counting_card RATE``.

Prints one line of JSON (``device``, ``environment``) once it runs, and ends when its standard input does.
"""

from __future__ import annotations

import json
import sys

import numpy as np
from numpy.typing import NDArray

from hw_mocks.sound_card import AudioSettings, PulseSource, SoundCard


class Counter:
    """Sample n is n modulo 65536 on channel 0 and n div 65536 on channel 1, as int16."""

    def __init__(self, sample_rate_hz: float) -> None:
        self.audio = AudioSettings(sample_rate_hz=sample_rate_hz)

    def block(self, first: int, frames: int, t_ns: int) -> NDArray[np.generic]:
        """Samples ``first`` to ``first + frames``."""
        return np.arange(first, first + frames, dtype="<u4").view("<i2").reshape(-1, 2)


def numbers(samples: NDArray[np.generic]) -> NDArray[np.int64]:
    """Numbers that int16 samples (frames, 2) hold."""
    return np.ascontiguousarray(samples).view("<u4")[:, 0].astype(np.int64)


def main(rate_hz: float) -> None:
    """Run the card until the standard input ends."""
    pulse = PulseSource(rate_hz)
    card = SoundCard(Counter(rate_hz), [pulse])
    card.start()
    print(json.dumps({"device": pulse.device, "environment": pulse.environment}), flush=True)
    sys.stdin.read()
    card.close()


if __name__ == "__main__":
    main(float(sys.argv[1]))
