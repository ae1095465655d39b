"""Which records of a session belong together: visits of one place, repeats of one calibration target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import CalibrationSeriesPlan, SeriesTarget, Visit
from polfuse_lab.session import Session


def visits(session: Session) -> dict[int, Visit]:
    """The planned visits of a session by position number; empty where no plan of this version tells them."""
    try:
        plan = session.plan
    except PolfuseError:
        return {}
    return {} if plan is None else {visit.position: visit for visit in plan.visits()}


def targets(session: Session) -> tuple[SeriesTarget, ...]:
    """Targets of a calibration series in their order; none for any other session."""
    plan = session.plan
    return plan.targets if isinstance(plan, CalibrationSeriesPlan) else ()


def target_positions(session: Session, name: str) -> frozenset[int]:
    """Position numbers of one target's records in a calibration series.

    Raises:
        PolfuseError: the session is no calibration series, or has no target of that name.
    """
    known = [target.name for target in targets(session)]
    if name not in known:
        raise PolfuseError(
            f"holds no target called {name!r}" if known else "is no calibration series",
            where=str(session.path),
            advice=f"choose from {', '.join(known)}" if known else "collect with a plan of kind 'calibration_series'",
        )
    return frozenset(position for position, visit in visits(session).items() if visit.target == name)


def average_visits(
    values: NDArray[np.complex128],
    noise: NDArray[np.float64],
    antenna_m: NDArray[np.float64],
    visited: Sequence[Visit | None],
) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
    """Average the profiles of all visits of one place (and target) coherently, channel by channel.

    Args:
        values: (channels, positions, bins); NaN where a channel has no record.
        noise: (channels, positions) noise power of each profile; NaN where it is not known.
        antenna_m: (positions, 3).
        visited: the visit of each position; what has none stays by itself.

    Returns:
        Values, noise and antenna places with one entry for each place, in the order of its first visit. A missing
        record is left out of its average; the noise of an average of n is that of their sum over n^2.
    """
    groups: dict[object, list[int]] = {}
    for index, visit in enumerate(visited):
        groups.setdefault(index if visit is None else (visit.target, visit.place), []).append(index)
    if len(groups) == len(visited):
        return values, noise, antenna_m
    shape = values.shape[0], len(groups), values.shape[2]
    merged, merged_noise = np.full(shape, np.nan + 1j * np.nan, dtype=np.complex128), np.full(shape[:2], np.nan)
    antenna = np.empty((len(groups), 3))
    for row, members in enumerate(groups.values()):
        antenna[row] = antenna_m[members].mean(axis=0)
        for channel in range(shape[0]):
            present = [index for index in members if np.isfinite(values[channel, index]).all()]
            if present:
                merged[channel, row] = values[channel, present].mean(axis=0)
                merged_noise[channel, row] = noise[channel, present].sum() / len(present) ** 2
    return merged, merged_noise, antenna
