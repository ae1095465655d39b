"""From a session's raw sweeps to range profiles of every channel at every position."""

from __future__ import annotations

import logging
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.passes import pass_profiles
from polfuse_lab.products.record_sync import find_record_sync
from polfuse_lab.products.visits import average_visits, visits
from polfuse_lab.records import SUPERSEDED
from polfuse_lab.session import Session, open_session
from polfuse_lab.session.runs import gapless_runs
from processing.errors import DataError
from processing.radar.profiles import RangeProfiles
from processing.radar.ranging import (
    above_noise,
    average,
    compress,
    cut_sweeps,
    noise_of_average,
    range_axis,
    remove_coupling,
)
from processing.radar.sync import Sync

Coupling = Literal["none", "mean", "reference"]

UNUSABLE = SUPERSEDED
"""Records with one of these flags are not used: samples are missing, or channel or place changed while recording."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Record:
    """One usable audio record with its sync measured."""

    index: int
    """Row of ``session.sweeps``."""
    channel: Channel
    position: int
    x_m: float
    t_host_ns: int
    samples: NDArray[np.generic]
    sync: Sync
    sweeps: int
    """How many of its whole up-ramps are used."""


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
    waveform = session.waveform
    axis = range_axis(waveform.bandwidth_hz, max_range_m, oversampling)
    if positions is None and gapless_runs(session):
        passes = pass_profiles(session, axis, window)
        values, noise, antenna, channels = passes.values, passes.noise, passes.antenna_m, passes.channels
    else:
        values, noise, antenna, channels = _standing_profiles(session, axis, window, positions)
    result = RangeProfiles(
        values=values.astype(np.complex64),
        range_m=axis,
        antenna_m=antenna,
        channels=tuple(channel.name for channel in channels),
        centre_hz=waveform.centre_hz,
        bandwidth_hz=waveform.bandwidth_hz,
        window=window,
        range_compensated=range_compensated,
        noise=noise,
    )
    if coupling != "none":
        values = _without_coupling(values, result, coupling, reference, str(session.path))
    if range_compensated:
        values = values * axis**2
    return replace(result, values=values.astype(np.complex64))


def _standing_profiles(
    session: Session, axis: NDArray[np.float64], window: str, positions: Collection[int] | None
) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64], tuple[Channel, ...]]:
    """Values, noise, antenna places and channels of records taken with the trolley at a stand."""
    waveform = session.waveform
    records = usable_records(session, positions=positions)
    channels = sorted({record.channel for record in records})
    numbers = sorted({record.position for record in records})
    ramp = session_ramp_samples(records)
    values = np.full((len(channels), len(numbers), len(axis)), np.nan + 1j * np.nan, dtype=np.complex128)
    noise = np.full(values.shape[:2], np.nan)
    for record in records:
        profiles = compress(
            cut_sweeps(record.samples, record.sync, count=record.sweeps, ramp_samples=ramp),
            axis,
            centre_hz=waveform.centre_hz,
            bandwidth_hz=waveform.bandwidth_hz,
            window=window,
            range_offset_m=0.0 if session.rig is None else session.rig.geometry.range_offset_m,
        )
        place = channels.index(record.channel), numbers.index(record.position)
        values[place], noise[place] = average(profiles), noise_of_average(profiles)
    visited = visits(session)
    found = average_visits(values, noise, _antenna(records, numbers), [visited.get(number) for number in numbers])
    return *found, tuple(channels)


def usable_records(
    session: Session, *, latest_only: bool = True, positions: Collection[int] | None = None
) -> list[Record]:
    """Audio records that can be used, in the order of the file, each with its sync.

    Records whose sync cannot be found are left out and named in the log.

    Args:
        session: an open session.
        latest_only: of several attempts at one position and channel take the last one only.
        positions: numbers of the positions to take; all where left out.

    Raises:
        PolfuseError: there is none; the reason of the last one refused is given.
    """
    rows = session.sweeps
    usable = [index for index, row in enumerate(rows) if not int(row["flags"]) & UNUSABLE and row["samples"]]
    if positions is not None:
        usable = [index for index in usable if int(rows[index]["position"]) in positions]
    if latest_only:
        latest: dict[tuple[int, int], int] = {}
        for index in usable:
            key = int(rows[index]["channel"]), int(rows[index]["position"])
            if key not in latest or rows[index]["attempt"] >= rows[latest[key]]["attempt"]:
                latest[key] = index
        usable = sorted(latest.values())
    records: list[Record] = []
    refused: DataError | None = None
    for index in usable:
        row = rows[index]
        channel = Channel(int(row["channel"]))
        samples = session.audio(index)
        try:
            sync = find_record_sync(session, samples)
        except DataError as error:
            _log.warning("record %d (%s at position %d): %s", index, channel.name, row["position"], error)
            refused = error
            continue
        wanted = int(row["sweeps_requested"])
        sweeps = min(wanted, len(sync.starts)) if wanted > 0 else len(sync.starts)
        records.append(
            Record(
                index=index,
                channel=channel,
                position=int(row["position"]),
                x_m=float(row["x_m"]),
                t_host_ns=int(row["t_host_ns"]),
                samples=samples,
                sync=sync,
                sweeps=sweeps,
            )
        )
    if not records:
        what = "holds no usable audio record" if refused is None else f"no audio record can be used: {refused.what}"
        advice = "record again" if refused is None else refused.advice
        raise PolfuseError(what, where=str(session.path), advice=advice)
    return records


def session_ramp_samples(records: list[Record]) -> float:
    """Median length of the up-ramps used in a session, samples; the same in whatever order they were recorded."""
    return float(np.median(np.concatenate([(r.sync.ends - r.sync.starts)[: r.sweeps] for r in records])))


def _antenna(records: list[Record], positions: list[int]) -> NDArray[np.float64]:
    """(positions, 3): the median of the records' x at each position; y = z = 0."""
    antenna = np.zeros((len(positions), 3))
    for row, position in enumerate(positions):
        antenna[row, 0] = np.median([record.x_m for record in records if record.position == position])
    return antenna


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
