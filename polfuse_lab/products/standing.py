"""Range profiles of records taken with the trolley at a stand, as many at a time as memory allows."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.record_sync import find_record_sync
from polfuse_lab.products.visits import average_visits, visits
from polfuse_lab.records import SUPERSEDED
from polfuse_lab.session import Session
from processing.errors import DataError
from processing.radar.ranging import average, compress, cut_sweeps, noise_of_average
from processing.radar.sync import Sync

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
    """Empty where they are to be read from the session again."""
    sync: Sync
    sweeps: int
    """How many of its whole up-ramps are used."""


class StandingRecords:
    """The usable records of a session by place and channel, before their sweeps are compressed.

    Places that the plan visits more than once are one place, in the order of their first visit.

    Args:
        session: an open session.
        positions: numbers of the positions to take; all where left out.
        keep_samples: as in :func:`usable_records`.

    Raises:
        PolfuseError: there is no usable record.
    """

    def __init__(
        self, session: Session, positions: Collection[int] | None = None, *, keep_samples: bool = True
    ) -> None:
        records = usable_records(session, positions=positions, keep_samples=keep_samples)
        self._session = session
        self.channels: tuple[Channel, ...] = tuple(sorted({record.channel for record in records}))
        """Channels recorded, in the order of profiles."""
        self._ramp = session_ramp_samples(records)
        self._records: dict[int, list[Record]] = {}
        for record in records:
            self._records.setdefault(record.position, []).append(record)
        numbers = sorted(self._records)
        self._visited = visits(session)
        antenna = np.zeros((len(numbers), 3))
        for row, number in enumerate(numbers):
            antenna[row, 0] = np.median([record.x_m for record in self._records[number]])
        self._antenna = dict(zip(numbers, antenna, strict=True))
        # Which positions make one place follows from the plan alone: averaging nothing tells it.
        none = np.zeros((0, len(numbers), 0), dtype=np.complex128)
        told = [self._visited.get(number) for number in numbers]
        self.antenna_m: NDArray[np.float64] = average_visits(none, np.zeros(none.shape[:2]), antenna, told)[2]
        """(places, 3) antenna at each place."""
        groups: dict[object, list[int]] = {}
        for number, visit in zip(numbers, told, strict=True):
            groups.setdefault(number if visit is None else (visit.target, visit.place), []).append(number)
        self._places = list(groups.values())

    def profiles(
        self, places: Sequence[int], axis: NDArray[np.float64], window: str
    ) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
        """Profiles of some places: values (channels, places, bins), NaN where there is no record, and noise.

        Bits do not depend on which places are asked for together.

        Args:
            places: indices into ``antenna_m``.
            axis: (bins,) ranges, m.
            window: over the ramp.

        Raises:
            DataError: a wrong window or range.
        """
        # In the order of their numbers, for averages of visits are sums in that order.
        numbers = [number for place in places for number in self._places[place]]
        values = np.full((len(self.channels), len(numbers), len(axis)), np.nan + 1j * np.nan, dtype=np.complex128)
        noise = np.full(values.shape[:2], np.nan)
        for column, number in enumerate(numbers):
            for record in self._records[number]:
                row = self.channels.index(record.channel)
                values[row, column], noise[row, column] = self._compressed(record, axis, window)
        antenna = np.array([self._antenna[number] for number in numbers]).reshape(-1, 3)
        merged = average_visits(values, noise, antenna, [self._visited.get(number) for number in numbers])
        return merged[0], merged[1]

    def _compressed(
        self, record: Record, axis: NDArray[np.float64], window: str
    ) -> tuple[NDArray[np.complex128], float]:
        session, waveform = self._session, self._session.waveform
        samples = record.samples if len(record.samples) else session.audio(record.index)
        profiles = compress(
            cut_sweeps(samples, record.sync, count=record.sweeps, ramp_samples=self._ramp),
            axis,
            centre_hz=waveform.centre_hz,
            bandwidth_hz=waveform.bandwidth_hz,
            window=window,
            range_offset_m=0.0 if session.rig is None else session.rig.geometry.range_offset_m,
        )
        return average(profiles), noise_of_average(profiles)


def usable_records(
    session: Session,
    *,
    latest_only: bool = True,
    positions: Collection[int] | None = None,
    keep_samples: bool = True,
) -> list[Record]:
    """Audio records that can be used, in the order of the file, each with its sync.

    Records whose sync cannot be found are left out and named in the log.

    Args:
        session: an open session.
        latest_only: of several attempts at one position and channel take the last one only.
        positions: numbers of the positions to take; all where left out.
        keep_samples: whether the records hold their samples; else these are read again where they are needed.

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
                samples=samples if keep_samples else samples[:0].copy(),
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
