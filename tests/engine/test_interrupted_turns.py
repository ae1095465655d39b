"""A turn that the loss of another device interrupted is over before the mount is told to turn again.

A mount refuses an order while it turns (ELL14); expected values: what the stand-in here was asked, in that order.
"""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from drivers.errors import DeviceLost, DeviceRefused
from drivers.records import PolarizerFix
from polfuse_lab.records import SourceFix
from polfuse_lab.scheduler.motion import Motion


class Mount:
    """Turns for three questions; takes no order meanwhile."""

    def __init__(self) -> None:
        self.orders: list[float] = []
        self.left = 0

    def start_turn(self, angle_rad: float) -> None:
        if self.left:
            raise DeviceRefused("the mount is still turning", where="mount", advice="wait until it stands")
        self.orders.append(angle_rad)
        self.left = 3

    def poll(self) -> PolarizerFix:
        self.left = max(self.left - 1, 0)
        return PolarizerFix(self.orders[-1], 0.001, bool(self.left), 0)


class Run:
    """As much of a run as motion needs; another device is lost in a chosen slice of waiting."""

    def __init__(self) -> None:
        self.mount, self.source, self.kept = Mount(), Mount(), []
        self.lost_in = 0
        self.devices = SimpleNamespace(
            polarizer=self.mount, source_polarizer=self.source, call=lambda kind, ask, *given: ask(*given)
        )
        self.control = SimpleNamespace(slice=self.slice)
        self.keep = self.kept.append

    def slice(self) -> None:
        self.lost_in -= 1
        if self.lost_in == 0:
            raise DeviceLost("silent", where="trolley", advice="plug it in")

    def deadline(self, kind: str, seconds: float) -> float:
        return seconds

    def in_time(self, deadline: float, kind: str, what: str) -> None:
        pass


def test_a_turn_begun_beside_a_record_is_begun_again_after_a_loss():
    run = Run()
    motion = Motion(run)
    motion.start_turn(0.5)
    motion.forget_orders()  # another device was lost and is back: the steps are repeated from the checkpoint
    motion.start_turn(0.5)
    motion.turn(0.5)
    assert run.mount.orders == [0.5, 0.5]
    assert [fix.moving for fix in run.kept] == [False, False]


@pytest.mark.parametrize("kind", ["polarizer", "source_polarizer"])
def test_a_turn_that_was_waited_for_is_begun_again_after_a_loss(kind):
    run = Run()
    motion = Motion(run)
    turn, mount = (motion.turn, run.mount) if kind == "polarizer" else (motion.turn_source, run.source)
    run.lost_in = 1
    with pytest.raises(DeviceLost):
        turn(0.5)
    motion.forget_orders()
    turn(0.25)
    assert mount.orders == [0.5, 0.25]
    assert len(run.kept) == 2
    assert all(isinstance(fix, SourceFix) == (kind == "source_polarizer") for fix in run.kept)


def test_a_turn_that_has_ended_costs_no_further_question():
    run = Run()
    motion = Motion(run)
    motion.turn(0.5)
    motion.turn(1.0)
    assert run.mount.orders == [0.5, 1.0]
    assert len(run.kept) == 2
