"""A simulated sound card that plays a point's echo and its sync, in a process of its own.

``python -m benchmarks.tape_card RATE SWEEP_S`` plays one second of them again and again: sample n is that of the tape
at n modulo RATE. Prints one line of JSON (``device``, ``environment``) once it runs, and ends when its standard input
does.
"""

from __future__ import annotations

import json
import sys

import numpy as np
from numpy.typing import NDArray

from hw_mocks.sound_card import AudioSettings, PulseSource, SoundCard

BEAT_HZ = 600.0


def tape(rate_hz: int, sweep_s: float) -> NDArray[np.int16]:
    """One second, (rate, 2): beat and sync, with noise that tells each sample from the others of the second."""
    t = np.arange(rate_hz) / rate_hz
    inside = np.mod(t, sweep_s) < sweep_s / 2
    samples = np.zeros((rate_hz, 2))
    samples[:, 0] = 0.2 * np.sin(2 * np.pi * BEAT_HZ * t) * inside
    samples[:, 1] = np.where(inside, 0.7, -0.7)
    noise = np.random.default_rng(1).normal(scale=0.01, size=samples.shape)
    return np.round((samples + noise) * 32767).astype(np.int16)


def place_on(samples: NDArray[np.int16], recorded: NDArray[np.generic]) -> int | None:
    """Where on a tape a record begins, whatever its length; None where it is not the tape's, sample by sample."""
    if len(recorded) < 8 or recorded.dtype != samples.dtype:
        return None
    first = np.all(samples == recorded[0], axis=1)
    for start in np.flatnonzero(first):
        if np.array_equal(np.take(samples, np.arange(start, start + len(recorded)), axis=0, mode="wrap"), recorded):
            return int(start)
    return None


class _Player:
    """Source of the simulated sound card."""

    def __init__(self, rate_hz: int, sweep_s: float) -> None:
        self.audio = AudioSettings(sample_rate_hz=rate_hz)
        self._tape = tape(rate_hz, sweep_s)

    def block(self, first: int, frames: int, t_ns: int) -> NDArray[np.generic]:
        """Samples ``first`` to ``first + frames``."""
        return np.take(self._tape, np.arange(first, first + frames), axis=0, mode="wrap")


def main(rate_hz: int, sweep_s: float) -> None:
    """Run the card until the standard input ends."""
    pulse = PulseSource(rate_hz)
    card = SoundCard(_Player(rate_hz, sweep_s), [pulse])
    card.start()
    print(json.dumps({"device": pulse.device, "environment": pulse.environment}), flush=True)
    sys.stdin.read()
    card.close()


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
