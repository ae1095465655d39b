"""From a driver's name in a rig file to the driver: names are entry points, so that other packages can add theirs.

A driver class has a nested frozen dataclass ``Options`` (its table in the rig file) and is constructed with one such
object; hand-operated drivers also take ``operator``.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

KINDS = ("switches", "radar", "trolley", "polarizer", "camera")


def available(kind: str) -> list[str]:
    """Names of all installed drivers of a kind, sorted."""
    return sorted({point.name for point in entry_points(group=f"polfuse_lab.{kind}")})


def driver_class(kind: str, name: str) -> type[Any]:
    """Load the class of a driver.

    Raises:
        KeyError: no installed package offers that name for that kind.
    """
    for point in entry_points(group=f"polfuse_lab.{kind}"):
        if point.name == name:
            loaded: type[Any] = point.load()
            return loaded
    raise KeyError(f"no {kind} driver is called {name!r}; installed: {', '.join(available(kind)) or 'none'}")
