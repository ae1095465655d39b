"""Whether a motor-driven trolley gets to where it was sent: arrived, standing elsewhere, blocked, or overdue."""

from __future__ import annotations

import math
import time

from drivers.errors import DeviceRefused, DeviceTimeout

_START_GRACE_S = 0.5
"""Between the order and the first step a controller still reports that it stands."""


class MoveWatch:
    """Watches one move at a time.

    Args:
        where: the device, for messages.
        stall_s: time without any advance after which a move counts as blocked, s.
    """

    def __init__(self, where: str, stall_s: float) -> None:
        self._where = where
        self._stall_s = stall_s
        self._started_s = self._deadline_s = self._advanced_s = 0.0
        self._advanced_to_m = math.nan
        self.target_m: float | None = None
        """Where the trolley was sent, None while no move is under way."""

    def begin(self, target_m: float, longest_s: float) -> None:
        """A move has been ordered; it may take ``longest_s`` seconds."""
        self.target_m = target_m
        self._started_s = self._advanced_s = time.monotonic()
        self._advanced_to_m = math.nan
        self._deadline_s = self._started_s + longest_s

    def end(self) -> None:
        """Forget the move (stopped, or an alarm)."""
        self.target_m = None

    def moving(self, x_m: float, *, standing: bool, driven: bool, tolerance_m: float, state: str) -> bool:
        """Whether the move is still under way; ends it on arrival. Call it only while there is a target.

        Args:
            x_m: present position, m.
            standing: the controller says that it stands.
            driven: the controller says that it moves (and so must advance).
            tolerance_m: how far from its target the trolley may stand, m.
            state: the controller's state, for messages.

        Raises:
            DeviceRefused: it stands elsewhere.
            DeviceTimeout: it does not advance, or takes too long.
        """
        assert self.target_m is not None
        now_s = time.monotonic()
        if standing:
            if abs(x_m - self.target_m) <= tolerance_m:
                self.target_m = None
                return False
            if now_s - self._started_s > _START_GRACE_S:
                target_m, self.target_m = self.target_m, None
                raise DeviceRefused(
                    f"the trolley stands at x = {x_m:.4f} m instead of {target_m:.4f} m",
                    where=self._where,
                    advice="look for an obstacle or lost power, then move again",
                )
        # A hold is somebody's wish; it may last.
        if x_m != self._advanced_to_m or not driven:
            self._advanced_to_m, self._advanced_s = x_m, now_s
        elif now_s - self._advanced_s > self._stall_s:
            raise DeviceTimeout(
                f"the trolley has not advanced from x = {x_m:.4f} m for {self._stall_s:g} s (state {state})",
                where=self._where,
                advice="look whether it is held, or blocked, and whether the controller waits for something",
            )
        if now_s > self._deadline_s:
            raise DeviceTimeout(
                f"the trolley has not arrived at x = {self.target_m:.4f} m (state {state})",
                where=self._where,
                advice="look whether it is held or blocked, or raise move_margin_s",
            )
        return True
