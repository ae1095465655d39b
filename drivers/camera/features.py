"""Features of GenICam cameras under the several names that vendors and standards give them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

_READABLE = (3, 4)
"""GenApi's access modes RO and RW."""
_WRITABLE = (2, 4)
"""GenApi's access modes WO and RW."""

Names = str | Sequence[str]

EXPOSURE = ("ExposureTime", "ExposureTimeAbs", "ExposureValue")
"""Exposure in microseconds."""
GAIN = ("Gain", "GainAbs")
"""Gain in dB."""
GAIN_RAW = "GainRaw"
"""Gain in steps of the camera's own, which no two models share."""
FRAME_RATE_ENABLE = ("AcquisitionFrameRateEnable", "AcquisitionFrameRateEnabled")
FRAME_RATE = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
"""Frames per second."""
PACKET_SIZE = "GevSCPSPacketSize"
"""Bytes of a stream packet, IP and UDP headers included."""
PACKET_DELAY = "GevSCPD"
"""Pause between stream packets, ticks of the camera's clock."""
TICK_HZ = ("GevTimestampTickFrequency", "TimestampTickFrequency")
PTP_ENABLE = ("PtpEnable", "GevIEEE1588")
PTP_STATUS = ("PtpStatus", "GevIEEE1588Status")
TRIGGER_STARTS = ("FrameStart", "ExposureStart")
"""What a trigger of ours begins: symbols of TriggerSelector, the better one first."""
AUTOMATIC = (("ExposureAuto", "Off"), ("GainAuto", "Off"), ("BlackLevelAuto", "Off"))
"""What must not change by itself within a polarizer series."""
NONLINEAR = (("GammaEnable", False), ("LUTEnable", False), ("SharpnessEnable", False))
"""What keeps counts from being proportional to light."""
CHUNKS = (
    # symbols of ChunkSelector, features that hold the chunk's value
    (("Timestamp",), ("ChunkTimestamp",)),
    (("FrameID", "FrameId", "Framecounter"), ("ChunkFrameID", "ChunkFrameId", "ChunkFramecounter")),
    (("ExposureTime",), ("ChunkExposureTime",)),
)
"""What a frame tells of itself: its time, its number, its exposure."""
CHUNK_TIME, CHUNK_ID, CHUNK_EXPOSURE = (values for _, values in CHUNKS)
TIMESTAMP_LATCH = (
    # command, value, ticks per second (None: nanoseconds)
    ("TimestampLatch", "TimestampLatchValue", None),
    ("GevTimestampControlLatch", "GevTimestampValue", TICK_HZ),
)
"""Ways to read the camera's clock, that of SFNC 2 and that of GigE Vision 1; under PTP the clock is the network's."""


class Features:
    """Reads and sets features of one camera; those it lacks are remembered by name, not silently dropped.

    Args:
        node_map: the remote device's node map.
    """

    def __init__(self, node_map: Any) -> None:
        self._map = node_map
        self.missing: list[str] = []
        """Names of features that were to be set and are not there or cannot be written."""

    def node(self, names: Names) -> Any | None:
        """The first of ``names`` that the camera has, else None."""
        for name in (names,) if isinstance(names, str) else names:
            if self._map.has_node(name):
                return self._map.get_node(name)
        return None

    def value(self, names: Names) -> Any | None:
        """Value of the first of ``names`` that the camera has and that can be read, else None."""
        node = self.node(names)
        return None if node is None else getattr(node, "value", None)

    def readable(self, names: Names) -> Any | None:
        """As :meth:`value`, and None as well for what is there but cannot be read at present (chunks)."""
        node = self.node(names)
        return node.value if node is not None and int(node.get_access_mode()) in _READABLE else None

    def symbols(self, name: str) -> tuple[str, ...]:
        """What an enumeration may be set to; empty where the camera lacks it."""
        node = self.node(name)
        return () if node is None else tuple(node.symbolics)

    def limits(self, names: Names) -> tuple[float, float] | None:
        """Smallest and largest value of the first of ``names`` that the camera has, else None."""
        node = self.node(names)
        return None if node is None else (float(node.min), float(node.max))

    def put(self, names: Names, value: Any, *, needed: bool = True) -> bool:
        """Set the first of ``names`` that the camera has, and read it back.

        Numbers outside the feature's limits are refused, whole numbers are rounded to its increment.

        Args:
            names: a feature's name, or its aliases.
            value: what to set it to.
            needed: whether to remember it as missing.

        Returns:
            Whether it was set.

        Raises:
            ValueError: the camera has the feature, but not this value, or it kept another one; says what is allowed.
        """
        node = self.node(names)
        name = names if isinstance(names, str) else names[0]
        if node is None or int(node.get_access_mode()) not in _WRITABLE:
            # One that is fixed at the value wanted is as good as one that was set.
            if node is not None and getattr(node, "value", None) == value:
                return True
            if needed:
                self.missing.append(name)
            return False
        if isinstance(value, str):
            if value not in tuple(node.symbolics):
                raise ValueError(f"{name}: found {value!r}, allowed: {', '.join(node.symbolics)}")
        elif not isinstance(value, bool):
            low, high = node.min, node.max
            if not low <= value <= high:
                raise ValueError(f"{name}: found {value}, allowed: {low} to {high}")
            if isinstance(low, int):
                step = int(node.inc) or 1
                value = low + round((value - low) / step) * step
        node.value = value
        # A float has steps that the camera does not tell; whoever needs to know reads what became of it.
        if not isinstance(value, float) and int(node.get_access_mode()) in _READABLE and node.value != value:
            raise ValueError(f"{name}: {value} was set, the camera kept {node.value}")
        return True

    def require(self, names: Names, value: Any) -> None:
        """As :meth:`put`, for what the user asked for in so many words. Raises ValueError also where it is lacking."""
        if not self.put(names, value, needed=False):
            name = names if isinstance(names, str) else " or ".join(names)
            raise ValueError(f"the camera has no {name} that can be set to {value}")

    def execute(self, name: str) -> bool:
        """Execute a command; False where the camera lacks it."""
        node = self.node(name)
        if node is None:
            return False
        node.execute()
        return True

    def probe(self) -> None:
        """Read something from the camera itself, past all caches. Raises whatever the producer raises when it is gone.

        A camera that was unplugged still "acquires"; only reading from it tells.
        """
        node = self.node("Width")
        if node is not None:
            node.get_value(False, True)
