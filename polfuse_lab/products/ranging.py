"""From a session's raw sweeps to range profiles of every channel at every position."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.antennas import antenna_pairs
from polfuse_lab.products.passes import pass_profiles
from polfuse_lab.products.standing import StandingRecords
from polfuse_lab.session import Session, open_session
from polfuse_lab.session.runs import gapless_runs
from processing.radar.profiles import RangeProfiles
from processing.radar.ranging import (
    above_noise,
    range_axis,
    remove_coupling,
)

Coupling = Literal["none", "mean", "reference"]

BLOCK = 64
"""Positions whose profiles are in memory in float64 at a time."""


def range_profiles(
    session: Session | Path | str,
    *,
    window: str = "hann",
    max_range_m: float = 100.0,
    oversampling: int = 8,
    range_compensated: bool = True,
    coupling: Coupling = "none",
    reference: RangeProfiles | None = None,
    positions: Collection[int] | None = None,
) -> RangeProfiles:
    """Range profiles of a session, (channels, positions, bins).

    The sweeps of a record are averaged coherently, in a way whose bits do not depend on their order; the ramp's length
    is the median over the whole session's sweeps. Of several attempts at one position and channel the last usable one
    counts; places that the plan visits more than once (passes, repeats) are averaged coherently. Where the trolley ran
    while it was recorded, each place is one of its own (:mod:`polfuse_lab.products.passes`). Where a channel has no
    usable record at a position, its profile is NaN. Values are in fractions of the audio's full scale, times range
    squared (m^2) if ``range_compensated``.

    Args:
        session: an open session, or its path.
        window: ``"hann"``, ``"taylor"`` or ``"rectangular"``.
        max_range_m: end of the range axis, m.
        oversampling: samples of the range axis in one resolution cell c / 2B.
        range_compensated: multiply by R^2, so that a target's amplitude does not depend on its range.
        coupling: ``"none"``; ``"mean"`` takes the mean over positions off; ``"reference"`` takes the mean over
            ``reference``'s positions off, channel by channel, where that stands above its own noise.
        positions: numbers of the positions to take, such as one target's in a calibration series; all where left out.
        reference: profiles of the coupling alone (of a sky session), made with the same axis and window.

    Raises:
        PolfuseError: the session holds no usable record, or ``reference`` does not fit.
        DataError: a wrong window, range or oversampling.
    """
    if not isinstance(session, Session):
        with open_session(session) as opened:
            return range_profiles(
                opened,
                window=window,
                max_range_m=max_range_m,
                oversampling=oversampling,
                range_compensated=range_compensated,
                coupling=coupling,
                reference=reference,
                positions=positions,
            )
    source = ProfileSource(
        session,
        window=window,
        max_range_m=max_range_m,
        oversampling=oversampling,
        range_compensated=range_compensated,
        coupling=coupling,
        reference=reference,
        positions=positions,
    )
    count = len(source.antenna_m)
    values = np.empty((len(source.channels), count, len(source.range_m)), dtype=np.complex64)
    noise = np.empty(values.shape[:2])
    step = count if coupling == "mean" else BLOCK
    for first in range(0, count, step):
        some = range(first, min(first + step, count))
        values[:, first : some.stop], noise[:, first : some.stop] = source.profiles(some)
    return source.described(values, noise)


class ProfileSource:
    """The range profiles of a session, some positions at a time: what does not fit in memory need not be there.

    Arguments and errors as in :func:`range_profiles`; the mean over positions is no coupling that can be taken off
    some positions at a time, so ``coupling="mean"`` asks for all of them at once.

    Args:
        keep_samples: whether the records' samples stay in memory; else they are read again for their profiles.
    """

    def __init__(
        self,
        session: Session,
        *,
        window: str = "hann",
        max_range_m: float = 100.0,
        oversampling: int = 8,
        range_compensated: bool = True,
        coupling: Coupling = "none",
        reference: RangeProfiles | None = None,
        positions: Collection[int] | None = None,
        keep_samples: bool = True,
    ) -> None:
        self._session, self._window, self._compensated = session, window, range_compensated
        self._coupling: Coupling = coupling
        self._reference = reference
        self.range_m: NDArray[np.float64] = range_axis(session.waveform.bandwidth_hz, max_range_m, oversampling)
        """(bins,) ranges of the profiles."""
        self._passes, self._records = None, None
        if positions is None and gapless_runs(session):
            self._passes = pass_profiles(session, self.range_m, window)
            self.antenna_m, channels = self._passes.antenna_m, self._passes.channels
        else:
            self._records = StandingRecords(session, positions, keep_samples=keep_samples)
            self.antenna_m, channels = self._records.antenna_m, self._records.channels
        self.channels = tuple(channel.name for channel in channels)

    def profiles(self, places: Sequence[int]) -> tuple[NDArray[np.complex64], NDArray[np.float64]]:
        """Values (channels, places, bins) and noise (channels, places) of some positions, given by their indices.

        Bits do not depend on which positions are asked for together (but for the mean as coupling).
        """
        if self._passes is not None:
            some = list(places)
            values, noise = self._passes.values[:, some], self._passes.noise[:, some]
        else:
            assert self._records is not None
            values, noise = self._records.profiles(places, self.range_m, self._window)
        if self._coupling != "none":
            outline = self.described(np.empty((0, 0, 0), dtype=np.complex64), None)
            values = _without_coupling(values, outline, self._coupling, self._reference, str(self._session.path))
        if self._compensated:
            values = values * self.range_m**2
        return values.astype(np.complex64), noise

    def described(self, values: NDArray[np.complex64], noise: NDArray[np.float64] | None) -> RangeProfiles:
        """All positions' values with what is known of them."""
        waveform = self._session.waveform
        return RangeProfiles(
            values=values,
            range_m=self.range_m,
            antenna_m=self.antenna_m,
            channels=self.channels,
            centre_hz=waveform.centre_hz,
            bandwidth_hz=waveform.bandwidth_hz,
            window=self._window,
            range_compensated=self._compensated,
            noise=noise,
            pairs=antenna_pairs(self._session.rig, self.channels),
            velocity_m_s=None if self._passes is None else self._passes.velocity_m_s,
            ramp_s=None if self._passes is None else self._passes.ramp_s,
        )


def _without_coupling(
    values: NDArray[np.complex128],
    profiles: RangeProfiles,
    coupling: Coupling,
    reference: RangeProfiles | None,
    where: str,
) -> NDArray[np.complex128]:
    if coupling == "mean":
        if values.shape[1] < 2:
            raise PolfuseError("has one position, whose mean is itself", where=where, advice="use coupling='none'")
        return np.asarray(remove_coupling(values), dtype=np.complex128)
    if coupling != "reference":
        raise PolfuseError(f"unknown coupling {coupling!r}", where=where, advice="choose none, mean or reference")
    if reference is None:
        raise PolfuseError("no reference is given", where=where, advice="pass the range profiles of a sky session")
    missing = set(profiles.channels) - set(reference.channels)
    same_axis = reference.range_m.shape == profiles.range_m.shape and np.allclose(reference.range_m, profiles.range_m)
    if missing or not same_axis or reference.window != profiles.window or reference.centre_hz != profiles.centre_hz:
        raise PolfuseError(
            "the reference has other channels, ranges, another window or another waveform",
            where=where,
            advice="make both with the same settings from the same rig",
        )
    order = [reference.channels.index(name) for name in profiles.channels]
    empty = np.nanmean(np.asarray(reference.values, dtype=np.complex128)[order], axis=1, keepdims=True)
    if reference.range_compensated:
        empty = np.divide(empty, reference.range_m**2, out=np.zeros_like(empty), where=reference.range_m > 0)
    if reference.noise is not None:
        known = np.isfinite(reference.noise[order])
        total = np.sum(reference.noise[order], axis=1, where=known, initial=0.0)
        # Of the mean over positions; unknown (NaN) where no position tells it.
        with np.errstate(invalid="ignore"):
            empty = above_noise(empty, (total / known.sum(axis=1) ** 2)[:, None])
    return np.asarray(remove_coupling(values, empty), dtype=np.complex128)
