"""What a stand is: a driver, the simulated device at its other end, and what one round of work is."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, Protocol

from hw_mocks.faults import FaultKind

HUNG_S = 15.0
"""A round that takes longer hangs."""


class Untruthful(Exception):
    """A driver said something that is not so, and did not notice."""


class Noticed(Exception):
    """A fault was noticed in the data that a driver delivered; the text is what the user is told."""


class Hung(Exception):
    """A round of work did not end."""


class Stand(Protocol):
    """A driver with its simulated device."""

    name: str
    driver: Any
    timeout_s: float
    """The driver's own time-out, s."""
    opening_s: float
    """Its own time-out for opening, s."""

    def round(self) -> None:
        """One round of work. Raises DeviceError, :class:`Noticed`, :class:`Untruthful` or :class:`Hung`."""

    def begin(self, kind: FaultKind, amount: float) -> None:
        """Begin a fault."""

    def end(self, kind: FaultKind) -> None:
        """End it."""

    def reset(self) -> None:
        """What a person does before the driver is opened again."""

    def close(self) -> None:
        """Release everything."""


def within(seconds: float = HUNG_S) -> Iterator[None]:
    """Ticks of 5 ms for a poll; raises :class:`Hung` when they are used up."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        yield
        time.sleep(0.005)
    raise Hung(f"no end after {seconds:g} s")
