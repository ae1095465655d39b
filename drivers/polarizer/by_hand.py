"""A polarizer that a person turns to the marks of its ring."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Gt, Le

from drivers.contracts import Operator
from drivers.errors import DeviceRefused
from drivers.options import checked
from drivers.records import Identity, PolarizerFix


class HandPolarizer:
    """Driver ``by_hand``: asks the operator to turn the polarizer and waits for the confirmation."""

    @dataclass(frozen=True)
    class Options:
        """The table ``[polarizer.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        sd_deg: Annotated[float, Gt(0), Le(90)] = 1.0
        """Standard deviation with which a person meets a mark, degrees."""

    def __init__(self, options: Options, operator: Operator) -> None:
        self._options = checked(options)
        self._operator = operator
        self._lock = threading.RLock()
        self._ticket: int | None = None
        self._target_rad = self._angle_rad = 0.0
        self._known = False

    def open(self) -> Identity:
        """Nothing to connect to. The angle is unknown until the first turn is confirmed."""
        return Identity("polarizer", "by_hand", "operator", f"marks met within {self._options.sd_deg:g} degrees")

    def start_turn(self, angle_rad: float) -> None:
        """Ask the operator to turn the polarizer; an earlier request is taken back.

        Raises:
            DeviceRefused: the angle is no number.
        """
        if not math.isfinite(angle_rad):
            raise DeviceRefused(f"{angle_rad} is no angle", where="hand polarizer", advice="ask for a finite angle")
        with self._lock:
            self.stop()
            self._target_rad = angle_rad
            self._known = False
            self._ticket = self._operator.ask(
                f"Turn the polarizer to {math.degrees(angle_rad):.1f} degrees from horizontal, then confirm."
            )

    def poll(self) -> PolarizerFix:
        """The last confirmed angle; while it is asked for and before the first confirmation it may be any."""
        with self._lock:
            if self._ticket is not None and self._operator.answered(self._ticket):
                self._ticket = None
                self._angle_rad, self._known = self._target_rad, True
            # Any angle of the half turn after which a polarizer repeats: the deviation of a uniform distribution.
            sd_rad = math.radians(self._options.sd_deg) if self._known else math.pi / math.sqrt(12)
            return PolarizerFix(self._angle_rad, sd_rad, self._ticket is not None, time.monotonic_ns())

    def stop(self) -> None:
        """Take the request back; where the operator left the polarizer is not known."""
        with self._lock:
            if self._ticket is not None:
                self._operator.withdraw(self._ticket)
                self._ticket = None

    def make_safe(self) -> None:
        """Take the request back."""
        self.stop()

    def close(self) -> None:
        """Take the request back. Idempotent."""
        self.stop()
