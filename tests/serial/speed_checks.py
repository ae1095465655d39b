"""Whether a trolley runs at the speed that it is asked for; for tests of several drivers."""

from __future__ import annotations

import time

import pytest

from drivers.contracts import Trolley
from hw_mocks.world import World


def seconds_of_a_move(trolley: Trolley, x_m: float, speed_m_s: float | None, world: World) -> tuple[float, float]:
    """Time that a move takes, and its speed in between as the world tells it."""
    trolley.start_move(x_m, speed_m_s)
    began = time.monotonic()
    places = []
    while trolley.poll().moving:
        assert time.monotonic() < began + 20
        places.append((time.monotonic(), world.trolley_x_m.at()))
        time.sleep(0.005)
    took = time.monotonic() - began
    (t0, x0), (t1, x1) = places[len(places) // 4], places[3 * len(places) // 4]
    return took, abs(x1 - x0) / (t1 - t0)


def check_speeds(trolley: Trolley, world: World) -> None:
    # 0.2 m at 0.4 m/s; then back at 0.2 m/s.
    for x_m, speed in ((0.2, 0.4), (0.0, 0.2)):
        took, found = seconds_of_a_move(trolley, x_m, speed, world)
        assert found == pytest.approx(speed, rel=0.05)
        assert took > 0.2 / speed * 0.95
        assert trolley.poll().x_m == pytest.approx(x_m, abs=1e-3)
    # Without a speed it goes at its own again.
    _, own = seconds_of_a_move(trolley, 0.3, None, world)
    assert own > 0.5
