"""In what order and how fast the two transfer switches move: one home for all drivers of switches.

A transfer switch connects the transmitter to an antenna in both of its positions (and the other antenna to a load).
Only while its contacts travel, some 10 to 30 ms, does the transmitter see an open line: contacts break before they
make. To keep the open times apart, the switches move one after the other: ``first`` says which begins, ``stagger_s``
how much later the other one follows. A switch that need not change is not moved: these switches wear, and each
actuation is counted (:mod:`drivers.switches.cycles`). A position at which the transmitter would stay open is no valid
option.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from drivers.switches.cycles import CycleCounter
from drivers.user_data import user_data_folder

RfPath = Literal["transmit", "receive"]
"""One of the two RF paths, each with its own transfer switch."""

_LONGEST_S = 0.5
_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class SequenceOptions:
    """Options that every driver of switches has."""

    settle_s: Annotated[float, Ge(0), Le(0.5)] = 0.07
    """Time after the last switch has been told to change until its contacts are quiet, s (actuation: 10 to 30 ms)."""
    first: Literal["transmit", "receive"] = "transmit"
    """Which switch moves first where both must."""
    stagger_s: Annotated[float, Ge(0), Le(0.25)] = 0.03
    """Time from the first switch to the second where both must move, s; 0: at once."""
    unit: str = ""
    """Name of the unit for its cycle counter; left out: what the unit says of itself, or its port."""
    wear_limit_cycles: Annotated[int, Gt(0)] = 1_000_000
    """Actuations that the maker promises for one switch; a switch beyond them is reported when the unit is opened."""
    cycles_folder: str = ""
    """Folder of the cycle counters; left out: the user's data folder ($POLFUSE_USER_DATA names another)."""

    def __post_init__(self) -> None:
        total_s = self.stagger_s + self.settle_s
        if self.settle_s <= _LONGEST_S < total_s:
            raise ValueError(f"stagger_s plus settle_s: found {total_s:g}, allowed: at most {_LONGEST_S:g}")


class Sequence:
    """Moves the switches that must change, counts their cycles, and waits until they are quiet. Used under a lock.

    Args:
        options: order, times and the counter's folder.
        labels: what the transmit and the receive switch are called on the unit (``{"transmit": "1", ...}``).
    """

    def __init__(self, options: SequenceOptions, labels: dict[RfPath, str]) -> None:
        self._options = options
        self._labels = labels
        self._counter: CycleCounter | None = None

    def begin(self, unit: str) -> str:
        """A unit has been opened: find its counter; return its cycles (and a warning of wear) in words.

        Args:
            unit: what the unit says of itself; the option ``unit`` goes before it.
        """
        options = self._options
        folder = Path(options.cycles_folder) if options.cycles_folder else user_data_folder()
        self._counter = CycleCounter(options.unit or unit, folder)
        cycles = self._counter.cycles()
        said = [f"{cycles.get(label, 0)} cycles of switch {label}" for label in self._labels.values()]
        for label in self._labels.values():
            if cycles.get(label, 0) >= options.wear_limit_cycles:
                said.append(f"switch {label} is beyond its {options.wear_limit_cycles} cycles: replace it soon")
                _log.warning("%s: %s", options.unit or unit, said[-1])
        if self._counter.trouble:
            said.append(self._counter.trouble)
        return ", ".join(said)

    def move(self, paths: Collection[RfPath], tell: Callable[[RfPath], None]) -> None:
        """Tell the switches of ``paths`` to change, in order, and wait until they have settled.

        Args:
            paths: the switches that must change.
            tell: sends the command to one switch; what it raises ends the sequence (later switches are not told).
        """
        settled_s = 0.0
        for number, path in enumerate(sorted(paths, key=lambda path: path != self._options.first)):
            if number:
                time.sleep(self._options.stagger_s)
            tell(path)
            settled_s = time.monotonic() + self._options.settle_s
            # Counted while the contacts travel: the file's writing costs no time of its own.
            if self._counter is not None:
                self._counter.count(self._labels[path])
        if paths:
            time.sleep(max(settled_s - time.monotonic(), 0.0))

    @property
    def cycles(self) -> dict[str, int]:
        """Actuations of each switch by its label on the unit; empty before :meth:`begin`."""
        return {} if self._counter is None else self._counter.cycles()

    def end(self) -> None:
        """The unit is closed: bring its counts to the disk. Never raises."""
        if self._counter is not None:
            self._counter.close()
