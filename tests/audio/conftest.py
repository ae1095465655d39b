"""A simulated sound card for the audio tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from audio_rig import Rig, start_rig


@pytest.fixture
def make_rig() -> Iterator[Callable[..., Rig]]:
    """Makes running sound cards and ends them after the test."""
    made: list[Rig] = []

    def make(*, pulse: bool = False, **audio: float) -> Rig:
        made.append(start_rig(pulse=pulse, **audio))
        return made[-1]

    yield make
    for rig in made:
        rig.card.close()
        assert rig.card.failure is None
