"""From a driver's name in a rig file to the driver: names are entry points, so that other packages can add theirs.

A driver class has a nested frozen dataclass ``Options`` (its table in the rig file) and is constructed with one such
object; hand-operated drivers also take ``operator``.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

KINDS = ("switches", "radar", "trolley", "polarizer", "camera")

_SAME_DRIVERS = {"source_polarizer": "polarizer"}


def driver_kind(device: str) -> str:
    """Kind of driver that serves a device of the rig file: the light source's polarizer is driven as the camera's."""
    return _SAME_DRIVERS.get(device, device)


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
