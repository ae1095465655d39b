"""What is heard in a recording of a rail collect: its bursts, their clocks, and which of them look alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.positions import LONG, Placed, Stop
from polfuse_lab.imports.riff import Wav
from polfuse_lab.imports.up_ramp import burst_profiles, with_polarity
from processing.errors import DataError
from processing.radar.bursts import Burst, find_bursts
from processing.radar.likeness import difference, neighbour_difference, repeated
from processing.radar.sync import Polarity, Sync, find_sync

MOVED = 0.5
"""Of what neighbours differ by: where both halves of a long burst differ by more the cart moved meanwhile."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One WAV file of a rail collect."""

    path: Path
    wav: Wav
    bursts: tuple[Burst, ...]
    sync: Sync
    """Of the longest burst."""
    syncs: tuple[Sync | None, ...]
    """Of each burst; None where it holds no whole up-ramp."""

    def samples(self, burst: int) -> NDArray[np.generic]:
        """(n, 2) samples of a burst, as recorded."""
        return self.wav.samples[self.bursts[burst].start : self.bursts[burst].stop]

    def used(self, placed: Sequence[Placed], inverted: bool) -> list[Sync]:
        """Clocks of bursts that were given positions, with the polarity that was found.

        Raises:
            PolfuseError: a burst holds no whole up-ramp of that polarity.
        """
        found = []
        for item in placed:
            sync = self.syncs[item.burst]
            turned = None if sync is None else with_polarity(sync, inverted)
            if turned is None:
                raise PolfuseError(
                    f"burst {item.burst + 1} holds no whole up-ramp", where=str(self.path),
                    advice=f"leave it out with --drop {item.burst + 1}")  # fmt: skip
            found.append(turned)
        return found


def listen(path: Path, wav: Wav, nominal_period_s: float, polarity: Polarity) -> Recording:
    """Find the bursts of a recording and the clock of each.

    Args:
        path: the file, for messages.
        wav: its content.
        nominal_period_s: expected sweep period, s.
        polarity: which level of the sync is the up-ramp, where it is known.

    Raises:
        PolfuseError: it is not stereo, or holds no sync.
    """
    if wav.samples.shape[1] != 2:
        raise PolfuseError(
            f"has {wav.samples.shape[1]} channel(s), not beat and sync in two",
            where=str(path), advice="record in stereo")  # fmt: skip
    rate = wav.sample_rate_hz
    try:
        found = find_bursts(wav.samples, rate, nominal_period_s=nominal_period_s)
        longest = max(found.bursts, key=lambda burst: burst.edges)
        sync = find_sync(
            wav.samples[longest.start : longest.stop], rate, nominal_period_s=found.sync.period_s, polarity=polarity
        )
    except DataError as error:
        raise PolfuseError(error.what, where=str(path), advice=error.advice) from error
    # All bursts are heard as the longest one is: a short one must not have an opinion of its own.
    level: Polarity = "low" if sync.inverted else "high"
    syncs: list[Sync | None] = []
    for burst in found.bursts:
        try:
            one = find_sync(
                wav.samples[burst.start : burst.stop], rate, nominal_period_s=sync.period_s, ramp_up_s=sync.ramp_s,
                polarity=level,
            )  # fmt: skip
        except DataError:
            syncs.append(None)
            continue
        syncs.append(one if one.channel == sync.channel else None)
    return Recording(path, wav, found.bursts, sync, tuple(syncs))


def stops_of(recording: Recording, *, centre_hz: float, bandwidth_hz: float) -> list[Stop]:
    """What is known of each burst as a stop along the rail.

    Args:
        recording: the recording.
        centre_hz: centre frequency, Hz.
        bandwidth_hz: bandwidth, Hz.
    """
    rate = recording.sync.sample_rate_hz
    usable = [index for index, sync in enumerate(recording.syncs) if sync is not None]
    stops = [
        Stop(burst.start / rate, burst.stop / rate, usable=index in usable)
        for index, burst in enumerate(recording.bursts)
    ]
    if not usable:
        return stops
    syncs = [sync for sync in recording.syncs if sync is not None]
    profiles, _, noise = burst_profiles(
        [recording.samples(index) for index in usable], syncs, centre_hz=centre_hz, bandwidth_hz=bandwidth_hz
    )
    for later in repeated(profiles, noise):
        # Neighbours among the usable bursts only: a burst between them is doubtful for itself.
        if usable[later] == usable[later - 1] + 1:
            stops[usable[later]] = replace(stops[usable[later]], repeats_previous=True)
    typical = neighbour_difference(profiles, noise)
    usual = float(np.median([stop.seconds for stop in stops]))
    for place, index in enumerate(usable):
        if typical is None or stops[index].seconds < LONG * usual or len(syncs[place].starts) < 4:
            continue
        halves = _halves(recording.samples(index), syncs[place], centre_hz, bandwidth_hz)
        if halves > MOVED * typical:
            stops[index] = replace(stops[index], moved=True)
    return stops


def _halves(samples: NDArray[np.generic], sync: Sync, centre_hz: float, bandwidth_hz: float) -> float:
    """Energy by which a burst's first and second half differ."""
    middle = len(sync.starts) // 2
    parts = [
        replace(sync, starts=sync.starts[part], ends=sync.ends[part]) for part in (slice(middle), slice(middle, None))
    ]
    profiles, _, noise = burst_profiles([samples] * 2, parts, centre_hz=centre_hz, bandwidth_hz=bandwidth_hz)
    return difference(profiles[0], profiles[1], float(np.nansum(noise)))
