"""Features of GenICam cameras under the several names that vendors and standards give them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

_WRITABLE = (2, 4)
"""GenApi's access modes WO and RW."""
EXPOSURE = ("ExposureTime", "ExposureTimeAbs", "ExposureValue")
"""Exposure in microseconds."""
GAIN = ("Gain", "GainAbs")
"""Gain in dB. GainRaw has no unit that two cameras share, and is left alone."""
TIMESTAMP_LATCH = (
    # command, value, ticks per second (None: nanoseconds)
    ("TimestampLatch", "TimestampLatchValue", None),
    ("GevTimestampControlLatch", "GevTimestampValue", "GevTimestampTickFrequency"),
)
"""Ways to read the camera's clock."""


class Features:
    """Reads and sets features of one camera; those it lacks are remembered by name, not silently dropped.

    Args:
        node_map: the remote device's node map.
    """

    def __init__(self, node_map: Any) -> None:
        self._map = node_map
        self.missing: list[str] = []
        """Names of features that were to be set and are not there or cannot be written."""

    def node(self, names: str | Sequence[str]) -> Any | None:
        """The first of ``names`` that the camera has, else None."""
        for name in (names,) if isinstance(names, str) else names:
            if self._map.has_node(name):
                return self._map.get_node(name)
        return None

    def value(self, names: str | Sequence[str]) -> Any | None:
        """Value of the first of ``names`` that the camera has and that can be read, else None."""
        node = self.node(names)
        return None if node is None else getattr(node, "value", None)

    def symbols(self, name: str) -> tuple[str, ...]:
        """What an enumeration may be set to; empty where the camera lacks it."""
        node = self.node(name)
        return () if node is None else tuple(node.symbolics)

    def put(self, names: str | Sequence[str], value: Any, *, needed: bool = True) -> bool:
        """Set the first of ``names`` that the camera has.

        Numbers outside the feature's limits are refused, whole numbers are rounded to its increment.

        Args:
            names: a feature's name, or its aliases.
            value: what to set it to.
            needed: whether to remember it as missing.

        Returns:
            Whether it was set.

        Raises:
            ValueError: the camera has the feature, but not this value; says what is allowed.
        """
        node = self.node(names)
        name = names if isinstance(names, str) else names[0]
        if node is None or int(node.get_access_mode()) not in _WRITABLE:
            # One that is fixed at the value wanted is as good as one that was set.
            if needed and (node is None or getattr(node, "value", None) != value):
                self.missing.append(name)
            return False
        if isinstance(value, str):
            if value not in tuple(node.symbolics):
                raise ValueError(f"{name}: found {value!r}, allowed: {', '.join(node.symbolics)}")
        else:
            low, high = node.min, node.max
            if not low <= value <= high:
                raise ValueError(f"{name}: found {value}, allowed: {low} to {high}")
            if isinstance(low, int):
                step = int(node.inc) or 1
                value = low + round((value - low) / step) * step
        node.value = value
        return True

    def execute(self, name: str) -> bool:
        """Execute a command; False where the camera lacks it."""
        node = self.node(name)
        if node is None:
            return False
        node.execute()
        return True
