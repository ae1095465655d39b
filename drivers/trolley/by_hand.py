"""A trolley that a person pushes to marks on the rail, as in the thesis."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Gt

from drivers.by_hand import MovedByHand
from drivers.contracts import Operator
from drivers.errors import DeviceRefused
from drivers.options import checked
from drivers.records import Identity, TrolleyFix


def refuse_speed(speed_m_s: float | None, where: str) -> None:
    """Refuse a constant speed for a trolley that a person pushes. Raises :class:`DeviceRefused`."""
    if speed_m_s is not None:
        raise DeviceRefused(
            f"nobody pushes a trolley at just {speed_m_s:g} m/s",
            where=where,
            advice="leave out the plan's speed_m_s: the positions are read from an encoder",
        )


class HandTrolley(MovedByHand):
    """Driver ``by_hand``: asks the operator to push the trolley and waits for the confirmation."""

    @dataclass(frozen=True)
    class Options:
        """The table ``[trolley.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        length_m: Annotated[float, Gt(0)]
        """Usable length of the rail, m; x runs from -length_m/2 to +length_m/2."""
        sd_m: Annotated[float, Gt(0)] = 0.002
        """Standard deviation with which a person meets a mark, m."""

    def __init__(self, options: Options, operator: Operator) -> None:
        super().__init__(operator)
        self._options = checked(options)

    @property
    def limits_m(self) -> tuple[float, float]:
        """Smallest and largest x that may be asked for, m."""
        return -self._options.length_m / 2, self._options.length_m / 2

    def open(self) -> Identity:
        """Nothing to connect to. The position is unknown until the first move is confirmed."""
        return Identity("trolley", "by_hand", "operator", f"marks met within {self._options.sd_m * 1e3:g} mm")

    def start_move(self, x_m: float, speed_m_s: float | None = None) -> None:
        """Ask the operator to push the trolley to ``x_m``; an earlier request is taken back.

        Raises:
            DeviceRefused: outside the rail, or a speed is asked for.
        """
        refuse_speed(speed_m_s, "hand trolley")
        low, high = self.limits_m
        if not low <= x_m <= high:
            raise DeviceRefused(
                f"x = {x_m:g} m is outside the rail ({low:g} to {high:g} m)",
                where="hand trolley",
                advice="ask for a position on the rail",
            )
        self._ask(
            x_m, f"Push the trolley to x = {x_m:+.4f} m ({x_m - low:.4f} m from the rail's left end), then confirm."
        )

    def poll(self) -> TrolleyFix:
        """The last confirmed position; under way and before the first confirmation it is anywhere on the rail."""
        x_m, known, moving = self._look()
        # Anywhere on the rail: the standard deviation of a uniform distribution.
        sd_m = self._options.sd_m if known else self._options.length_m / math.sqrt(12)
        state = "asked" if moving else "confirmed" if known else "unknown"
        return TrolleyFix(x_m, sd_m, moving, time.monotonic_ns(), state)
