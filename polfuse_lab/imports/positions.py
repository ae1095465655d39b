"""Which bursts of sweeps are positions along the rail. What the recording does not tell is reported, not guessed."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from polfuse_lab.errors import PolfuseError

SHORT = 0.4
"""Of the median duration: a shorter burst is a fragment or a false start."""
LONG = 2.0
"""Times the median duration: a longer burst is looked at for a cart that moved while the radar was on."""
LONG_GAP = 3.0
"""Times the median silence: a longer one is worth a note, since a position may be missing."""

Kind = Literal["fragment", "short", "repeat", "moved"]


@dataclass(frozen=True)
class Stop:
    """One burst of sweeps as the operator may have meant it. Times in seconds from the recording's start."""

    start_s: float
    stop_s: float
    usable: bool = True
    """Whether it holds a whole up-ramp."""
    repeats_previous: bool = False
    """Its echoes are those of the burst before."""
    moved: bool = False
    """Its echoes change while the radar is on, by as much as from one position to the next."""

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return self.stop_s - self.start_s


@dataclass(frozen=True)
class Wishes:
    """What the user says about the bursts of one recording; they are counted from 1."""

    positions: int | None = None
    """How many positions there were."""
    drop: frozenset[int] = frozenset()
    """Bursts to leave out."""
    repeats: frozenset[int] = frozenset()
    """Bursts that repeat the position of the one before."""


@dataclass(frozen=True)
class Placed:
    """A burst and the position that it was recorded at."""

    burst: int
    """Index from 0."""
    position: int
    attempt: int = 0


@dataclass(frozen=True)
class _Suspect:
    burst: int
    kind: Kind
    text: str


def place(stops: Sequence[Stop], wishes: Wishes, where: str) -> tuple[list[Placed], list[str]]:
    """Give every burst its position, from 0.

    A short burst that is the first or the last one is left out as a fragment: that makes the aperture shorter and moves
    its centre by half a step, and is told. Any other doubt (a short burst between others, one that looks like its
    predecessor, one during which the cart moved) is an error unless the user's wishes settle it: bursts named in them,
    or a number of positions that exactly one reading of the doubtful kinds gives.

    Args:
        stops: the bursts in order.
        wishes: what the user said.
        where: the recording's name, for messages.

    Returns:
        Bursts with positions, in order, and notes for the user.

    Raises:
        PolfuseError: fewer than two bursts, a wish that does not fit, or doubt.
    """
    if len(stops) < 2:
        raise PolfuseError(
            f"holds {len(stops)} burst of sweeps and no silence that would part positions", where=where,
            advice="give a recording in which the radar was switched off between positions "
            "(a recording without pauses is imported with --as wav)",
        )  # fmt: skip
    _check_wishes(wishes, len(stops), where)
    suspects = [item for item in _suspects(stops) if item.burst + 1 not in wishes.drop | wishes.repeats]
    notes = _gap_notes(stops)
    left_out, repeats = set(wishes.drop), set(wishes.repeats)
    for item in _believed(stops, suspects, wishes, where):
        notes.append(f"{item.text}; {'taken as a second attempt' if item.kind == 'repeat' else 'left out'}")
        (repeats if item.kind == "repeat" else left_out).add(item.burst + 1)
    placed: list[Placed] = []
    for burst, stop in enumerate(stops):
        if burst + 1 in left_out:
            continue
        if not stop.usable:
            raise PolfuseError(
                f"burst {burst + 1} ({_when(stop)}) holds no whole up-ramp", where=where,
                advice=f"leave it out with --drop {burst + 1}")  # fmt: skip
        if burst + 1 in repeats and placed:
            placed.append(Placed(burst, placed[-1].position, placed[-1].attempt + 1))
        else:
            placed.append(Placed(burst, placed[-1].position + 1 if placed else 0))
    count = placed[-1].position + 1 if placed else 0
    if count < 2:
        raise PolfuseError(f"{count} position is left", where=where, advice="leave out fewer bursts")
    if wishes.positions not in (None, count):
        # A burst that repeats one which was left out is a position of its own.
        raise _miscount(count, wishes.positions, where)
    return placed, notes


def _check_wishes(wishes: Wishes, count: int, where: str) -> None:
    for option, numbers in (("--drop", wishes.drop), ("--repeats", wishes.repeats)):
        if wrong := sorted(number for number in numbers if not 1 <= number <= count):
            raise PolfuseError(
                f"{option} {wrong[0]}, but there are {count} bursts", where=where, advice="bursts are counted from 1"
            )
    if both := sorted(wishes.drop & wishes.repeats):
        raise PolfuseError(f"burst {both[0]} is both left out and a repeat", where=where, advice="say one of them")
    if 1 in wishes.repeats:
        raise PolfuseError("burst 1 repeats nothing", where=where, advice="name the later one of two bursts")


def _suspects(stops: Sequence[Stop]) -> list[_Suspect]:
    typical = float(np.median([stop.seconds for stop in stops]))
    found = []
    for burst, stop in enumerate(stops):
        name = f"burst {burst + 1} ({_when(stop)})"
        if stop.seconds < SHORT * typical or not stop.usable:
            kind: Kind = "fragment" if burst in (0, len(stops) - 1) else "short"
            found.append(_Suspect(burst, kind, f"{name} is {stop.seconds:.2f} s long, others {typical:.2f} s"))
        elif stop.repeats_previous and burst:
            found.append(_Suspect(burst, "repeat", f"{name} looks like burst {burst}, as if it were the same position"))
        elif stop.moved:
            found.append(_Suspect(burst, "moved", f"{name} changes as if the cart had moved while the radar was on"))
    return found


def _believed(stops: Sequence[Stop], suspects: list[_Suspect], wishes: Wishes, where: str) -> list[_Suspect]:
    """Suspects that are left out or are repeats; the others are positions like any."""
    standing = len(stops) - len(wishes.drop) - len(wishes.repeats)
    if wishes.positions is None:
        doubtful = [item for item in suspects if item.kind != "fragment"]
        if doubtful:
            raise _doubt(doubtful, where, standing)
        return suspects
    kinds = sorted({item.kind for item in suspects})
    readings = [
        chosen
        for count in range(len(kinds) + 1)
        for some in itertools.combinations(kinds, count)
        if standing - len(chosen := [item for item in suspects if item.kind in some]) == wishes.positions
    ]
    if len(readings) == 1:
        return readings[0]
    if suspects:
        raise _doubt(suspects, where, standing, wishes.positions)
    raise _miscount(standing, wishes.positions, where)


def _miscount(found: int, expected: int | None, where: str) -> PolfuseError:
    return PolfuseError(
        f"holds {found} positions, {expected} are expected", where=where,
        advice="check the number and the recording, or leave bursts out with --drop",
    )  # fmt: skip


def _doubt(suspects: Sequence[_Suspect], where: str, standing: int, expected: int | None = None) -> PolfuseError:
    texts = [item.text for item in suspects[:4]] + ([f"{len(suspects) - 4} more"] if len(suspects) > 4 else [])
    number = suspects[0].burst + 1
    count = f"{standing} bursts" if expected is None else f"{standing} bursts, {expected} positions expected"
    return PolfuseError(
        f"it is not clear which of its {count} are positions: {', '.join(texts)}", where=where,
        advice=f"leave a burst out with --drop {number}, name a second attempt with --repeats {number}, or say how "
        "many positions there are with --positions",
    )  # fmt: skip


def _gap_notes(stops: Sequence[Stop]) -> list[str]:
    gaps = np.array([later.start_s - earlier.stop_s for earlier, later in itertools.pairwise(stops)])
    typical = float(np.median(gaps))
    return [
        f"the silence before burst {index + 2} lasts {gaps[index]:.1f} s, others {typical:.1f} s: "
        "was a position left out?"
        for index in np.flatnonzero(gaps > LONG_GAP * typical).tolist()
    ]


def _when(stop: Stop) -> str:
    return f"{stop.start_s:.2f} to {stop.stop_s:.2f} s"
