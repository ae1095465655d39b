"""Hand-operated devices: nothing is taken for done until the operator confirms it."""

from __future__ import annotations

import math

import pytest
from serial_helpers import PatientOperator

from drivers.contracts import Polarizer, Trolley
from drivers.errors import DeviceRefused
from drivers.polarizer.by_hand import HandPolarizer
from drivers.trolley.by_hand import HandTrolley


def test_trolley() -> None:
    operator = PatientOperator()
    trolley = HandTrolley(HandTrolley.Options(length_m=3.048), operator)
    assert isinstance(trolley, Trolley)
    assert trolley.open().driver == "by_hand"
    assert trolley.limits_m == (-1.524, 1.524)
    unknown = trolley.poll()
    # Anywhere on the rail: a uniform distribution's standard deviation is its length over sqrt(12).
    assert (unknown.moving, unknown.state) == (False, "unknown")
    assert unknown.sd_m == pytest.approx(3.048 / math.sqrt(12))
    trolley.start_move(-1.016)
    assert "x = -1.0160 m (0.5080 m from the rail's left end)" in operator.prompts[1]
    assert trolley.poll().moving
    operator.confirmed.add(1)
    fix = trolley.poll()
    assert (fix.x_m, fix.sd_m, fix.moving, fix.state) == (-1.016, 0.002, False, "confirmed")
    trolley.start_move(0.0)
    trolley.stop()
    assert operator.withdrawn == {2}
    operator.confirmed.add(2)  # too late
    fix = trolley.poll()
    assert (fix.moving, fix.state) == (False, "unknown")
    assert fix.sd_m > 0.5
    trolley.start_move(0.1)
    trolley.start_move(0.2)  # takes the earlier request back
    assert operator.withdrawn == {2, 3}
    trolley.make_safe()
    trolley.close()
    trolley.close()
    assert operator.withdrawn == {2, 3, 4}


@pytest.mark.parametrize("x_m", [1.6, -1.6, math.nan])
def test_trolley_beyond_the_rail(x_m: float) -> None:
    operator = PatientOperator()
    trolley = HandTrolley(HandTrolley.Options(length_m=3.0), operator)
    with pytest.raises(DeviceRefused, match="outside the rail"):
        trolley.start_move(x_m)
    assert operator.prompts == {}


def test_polarizer() -> None:
    operator = PatientOperator()
    polarizer = HandPolarizer(HandPolarizer.Options(), operator)
    assert isinstance(polarizer, Polarizer)
    assert polarizer.open().kind == "polarizer"
    # A polarizer repeats after pi: pi / sqrt(12) when its angle is unknown.
    assert polarizer.poll().sd_rad == pytest.approx(math.pi / math.sqrt(12))
    polarizer.start_turn(math.radians(135))
    assert "135.0 degrees" in operator.prompts[1]
    assert polarizer.poll().moving
    operator.confirmed.add(1)
    fix = polarizer.poll()
    assert fix.moving is False
    assert fix.angle_rad == pytest.approx(math.radians(135), abs=1e-15)
    assert fix.sd_rad == pytest.approx(math.radians(1), abs=1e-15)
    polarizer.start_turn(0.0)
    polarizer.close()
    assert operator.withdrawn == {2}
    assert polarizer.poll().sd_rad > 0.5
    with pytest.raises(DeviceRefused, match="is no angle"):
        polarizer.start_turn(math.inf)
