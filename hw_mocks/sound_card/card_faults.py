"""Faults of the simulated sound card, as a :class:`hw_mocks.faults.FaultScript` tells them. Frames are what is counted.

================ ==================================================================================================
``SILENCE``      a channel is dead: ``amount`` 0 the beat's, 1 the sync's, 2 both
``GARBAGE``      both channels carry random samples of full scale
``STALL``        nothing leaves the card; what it samples meanwhile follows, as far as its buffer reaches (1 s)
``OVERFLOW``     ``amount`` frames are sampled but lost, without a flag, once for each such fault
``CLOCK_JUMP``   the card takes no samples for ``amount`` seconds: its clock falls behind by that much
``WRONG_FORMAT`` the card runs at ``amount`` Hz, whatever it says
``DISCONNECT``   the card is unplugged, and plugged in again when the fault ends
================ ==================================================================================================
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hw_mocks.faults import Fault, FaultKind, FaultScript

CARD_FAULTS = (
    FaultKind.SILENCE,
    FaultKind.GARBAGE,
    FaultKind.STALL,
    FaultKind.OVERFLOW,
    FaultKind.CLOCK_JUMP,
    FaultKind.WRONG_FORMAT,
    FaultKind.DISCONNECT,
)
"""The kinds that a sound card can have."""


class CardFaults:
    """Reads a script for the feeder. Used by the feeder's thread only."""

    def __init__(self, script: FaultScript | None, seed: int = 0) -> None:
        self._script = script
        self._random = np.random.default_rng(seed)
        self._carried_out: dict[FaultKind, Fault | None] = {}

    def active(self, kind: FaultKind, frames: int) -> Fault | None:
        """The fault of a kind that is active after ``frames`` frames."""
        return None if self._script is None else self._script.active(kind, count=frames)

    def begins(self, kind: FaultKind, frames: int) -> Fault | None:
        """The same, but each fault only once."""
        fault = self.active(kind, frames)
        before, self._carried_out[kind] = self._carried_out.get(kind), fault
        return None if fault is before else fault

    def content(self, samples: NDArray[np.generic], frames: int, sync_channel: int) -> NDArray[np.generic]:
        """Samples (frames, 2) as a card with dead channels or garbage delivers them."""
        silence, garbage = (self.active(kind, frames) for kind in (FaultKind.SILENCE, FaultKind.GARBAGE))
        if silence is None and garbage is None:
            return samples
        samples = samples.copy()
        if garbage is not None:
            if samples.dtype.kind == "f":
                samples[:] = self._random.uniform(-1, 1, samples.shape)
            else:
                limits = np.iinfo(samples.dtype)  # type: ignore[type-var]
                samples[:] = self._random.integers(limits.min, limits.max, samples.shape, endpoint=True)
        if silence is not None:
            dead = {0: [1 - sync_channel], 1: [sync_channel]}.get(round(silence.amount), [0, 1])
            samples[:, dead] = 0
        return samples
