"""A polarizer that a person turns to the marks of its ring."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Gt, Le

from drivers.by_hand import MovedByHand
from drivers.contracts import Operator
from drivers.errors import DeviceRefused
from drivers.options import checked
from drivers.records import Identity, PolarizerFix


class HandPolarizer(MovedByHand):
    """Driver ``by_hand``: asks the operator to turn the polarizer and waits for the confirmation."""

    @dataclass(frozen=True)
    class Options:
        """The table ``[polarizer.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        sd_deg: Annotated[float, Gt(0), Le(90)] = 1.0
        """Standard deviation with which a person meets a mark, degrees."""

    def __init__(self, options: Options, operator: Operator) -> None:
        super().__init__(operator)
        self._options = checked(options)

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
        self._ask(
            angle_rad, f"Turn the polarizer to {math.degrees(angle_rad):.1f} degrees from horizontal, then confirm."
        )

    def poll(self) -> PolarizerFix:
        """The last confirmed angle; while it is asked for and before the first confirmation it may be any."""
        angle_rad, known, asked = self._look()
        # Any angle of the half turn after which a polarizer repeats: the deviation of a uniform distribution.
        sd_rad = math.radians(self._options.sd_deg) if known else math.pi / math.sqrt(12)
        return PolarizerFix(angle_rad, sd_rad, asked, time.monotonic_ns())
