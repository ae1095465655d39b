"""Levels of the two audio channels, and signals that cannot be a radar's."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceBadAnswer
from drivers.records import Level

SILENCE = 2e-4
"""Fraction of full scale below which a channel is silent: a few counts of 16 bits."""


def fractions(samples: NDArray[Any]) -> NDArray[np.float64]:
    """Samples (frames, channels) of any sample type as fractions of full scale."""
    scale = 1.0 if samples.dtype.kind == "f" else 1.0 / (np.iinfo(samples.dtype).max + 1.0)
    return samples.astype(np.float64) * scale


def level_of(samples: NDArray[Any]) -> Level:
    """Peak and rms of each channel of (frames, channels) samples, as fractions of full scale."""
    values = fractions(samples)
    peak, rms = np.abs(values).max(axis=0), np.sqrt(np.mean(values**2, axis=0))
    return Level(peak=tuple(map(float, peak)), rms=tuple(map(float, rms)))


def refuse_dead(samples: NDArray[Any], where: str) -> None:
    """Refuse samples (frames, 2) that cannot be a radar's beat and sync.

    Raises:
        DeviceBadAnswer: one or both channels are silent, or both carry the same signal.
    """
    swing = np.ptp(fractions(samples), axis=0)
    if np.all(swing < SILENCE):
        what, advice = "both channels are silent", "check the cable, the radar's power and the input's volume"
    elif np.any(swing < SILENCE):
        what = f"channel {int(np.argmin(swing))} is silent"
        advice = "use a stereo cable and a stereo line input"
    elif np.array_equal(samples[:, 0], samples[:, 1]):
        what, advice = "both channels carry the same signal", "use a stereo line input, not a microphone input"
    else:
        return
    raise DeviceBadAnswer(what, where=where, advice=advice)
