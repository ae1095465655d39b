"""Trolleys that run at a given speed, and those that a person pushes and that cannot."""

from __future__ import annotations

import pytest
from grbl_helpers import driver as grbl_driver
from grbl_helpers import simulated
from speed_checks import check_speeds

from drivers.contracts import Trolley
from drivers.errors import DeviceRefused
from drivers.trolley.by_hand import HandTrolley
from drivers.trolley.encoder import EncoderTrolley
from hw_mocks.world import World


class Nobody:
    """An operator who is not there."""

    def ask(self, prompt: str) -> int:
        return 1

    def answered(self, ticket: int) -> bool:
        return False

    def withdraw(self, ticket: int) -> None:
        pass


@pytest.mark.realtime
def test_grbl_keeps_a_given_speed_and_refuses_one_beyond_its_limit() -> None:
    world = World()
    with simulated(world, feed_limit_m_s=2.0) as wire:
        trolley = grbl_driver(wire.url, feed_m_s=1.0)
        trolley.open()
        try:
            check_speeds(trolley, world)
            with pytest.raises(DeviceRefused, match=r"3 m/s is not within its limit of 2 m/s"):
                trolley.start_move(0.0, 3.0)
            with pytest.raises(DeviceRefused, match="not within its limit"):
                trolley.start_move(0.0, -0.1)
        finally:
            trolley.close()


@pytest.mark.parametrize("kind", ["by_hand", "encoder"])
def test_nobody_pushes_at_a_given_speed(kind: str) -> None:
    trolley: Trolley = (
        HandTrolley(HandTrolley.Options(length_m=2.0), Nobody())
        if kind == "by_hand"
        else EncoderTrolley(EncoderTrolley.Options(port="nowhere", length_m=2.0, counts_per_m=1e4), Nobody())
    )
    with pytest.raises(DeviceRefused, match=r"nobody pushes a trolley at just 0\.1 m/s; leave out"):
        trolley.start_move(0.5, 0.1)
