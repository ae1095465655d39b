"""Passes of a session: audio records that follow each other without a gap, as one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drivers.records import Channel
from polfuse_lab.plans.steps import PASS_POSITIONS
from polfuse_lab.records import SUPERSEDED, SweepFlag

if TYPE_CHECKING:
    from polfuse_lab.session.reader import Session


@dataclass(frozen=True)
class Run:
    """Audio of one channel without a gap, recorded while the trolley ran."""

    channel: Channel
    number: int
    """Of the pass that it belongs to."""
    indices: tuple[int, ...]
    """Its audio records, in order."""

    def samples(self, session: Session) -> NDArray[Any]:
        """All samples, (n, channels). Raises as :meth:`Session.audio`."""
        return np.concatenate([session.audio(index) for index in self.indices])


def gapless_runs(session: Session) -> list[Run]:
    """The usable runs of each pass, in order: of several attempts the one in which the trolley got furthest.

    Records that had to be taken again (lost samples, switches that moved) part a pass into several runs.
    """
    rows = session.sweeps
    taken: dict[tuple[int, int, int], list[Run]] = {}
    attempt: list[int] = []
    key: tuple[int, int, int] | None = None

    def close() -> None:
        if key is not None and attempt:
            taken.setdefault(key, []).append(Run(Channel(key[1]), key[0], tuple(attempt)))

    begun = 0
    for index in np.flatnonzero((rows["flags"] & int(SweepFlag.CONTINUOUS)) > 0).tolist():
        row = rows[index]
        number, channel = int(row["position"]) // PASS_POSITIONS, int(row["channel"])
        if key is None or int(row["position"]) % PASS_POSITIONS == 0 or (number, channel) != key[:2]:
            close()
            begun += 1
            key, attempt = (number, channel, begun), []
        if attempt:
            last = rows[attempt[-1]]
            if int(last["device_frame"]) + int(last["samples"]) != int(row["device_frame"]):
                close()
                attempt = []
        if int(row["flags"]) & int(SUPERSEDED):
            close()
            attempt = []
        else:
            attempt.append(index)
    close()
    best: dict[tuple[int, int], list[Run]] = {}
    for (number, channel, _), runs in taken.items():
        # Later attempts stand in for earlier ones that got as far.
        if _length_m(rows, runs) >= _length_m(rows, best.get((number, channel), [])):
            best[number, channel] = runs
    return [run for runs in best.values() for run in runs]


def _length_m(rows: NDArray[np.void], runs: list[Run]) -> float:
    """Way between the middles of the first and the last records of runs, rounded to centimetres."""
    return sum(round(abs(float(rows[run.indices[-1]]["x_m"] - rows[run.indices[0]]["x_m"])), 2) for run in runs)
