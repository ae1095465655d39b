"""The polarizer's offset in its mount: closed forms, Monte Carlo of its uncertainty, and a mount that is calibrated."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from serial_helpers import until_still

from drivers.polarizer.ell14 import Ell14
from drivers.polarizer.offset import Offset, offset_from_axes, offset_from_intensities
from hw_mocks.rotator import Rotator
from hw_mocks.wire import serve
from hw_mocks.world import World

MOUNT = np.radians([0, 30, 60, 90, 120, 150])
half_turn = st.floats(-math.pi / 2 + 1e-6, math.pi / 2 - 1e-6)


def malus(mount_rad: np.ndarray, offset_rad: float, source_rad: float) -> np.ndarray:
    """The law of Malus for a polarizer of extinction 800:1 (the thesis's)."""
    cosine2 = np.cos(mount_rad + offset_rad - source_rad) ** 2
    return 1000 * (cosine2 + (1 - cosine2) / 800)


@given(half_turn, st.lists(st.integers(-2, 2), min_size=6, max_size=6))
def test_exact_axes_give_the_exact_offset(offset_rad: float, half_turns: list[int]) -> None:
    found = offset_from_axes(MOUNT, MOUNT + offset_rad + math.pi * np.array(half_turns))
    assert math.remainder(found.angle_rad - offset_rad, math.pi) == pytest.approx(0.0, abs=1e-12)
    assert found.sd_rad < 1e-7  # square roots of rounding errors


@given(half_turn, st.floats(-7, 7))
def test_exact_intensities_give_the_exact_offset(offset_rad: float, source_rad: float) -> None:
    found = offset_from_intensities(MOUNT, malus(MOUNT, offset_rad, source_rad), source_rad)
    assert math.remainder(found.angle_rad - offset_rad, math.pi) == pytest.approx(0.0, abs=1e-10)
    assert abs(found.angle_rad) <= math.pi / 2 + 1e-12


def test_uncertainties_are_those_of_a_monte_carlo() -> None:
    dice = np.random.default_rng(1)
    by_axes, by_light = [], []
    for _ in range(400):
        by_axes.append(offset_from_axes(MOUNT, MOUNT + 0.3 + dice.normal(0, 0.02, 6)))
        by_light.append(offset_from_intensities(MOUNT, malus(MOUNT, 0.3, 0.1) + dice.normal(0, 20, 6), 0.1))
    # Of the mean of six directions; of a peak fitted to an amplitude A = 499 with noise 20: noise / (A sqrt(2 n)).
    for found, expected in ((by_axes, 0.02 / math.sqrt(6)), (by_light, 20 / (499.375 * math.sqrt(12)))):
        angles = np.array([one.angle_rad for one in found])
        # The scatter of 400 tries is known to 1/sqrt(800) = 3.5 %; four of these.
        assert np.std(angles) == pytest.approx(expected, rel=0.15)
        assert math.sqrt(np.mean([one.sd_rad**2 for one in found])) == pytest.approx(expected, rel=0.15)
        assert np.mean(angles) == pytest.approx(0.3, abs=4 * expected / 20)


def test_the_line_for_the_rig_file() -> None:
    assert Offset(math.radians(12.5), math.radians(0.25)).option == "offset_deg = 12.500  # +- 0.250"


@pytest.mark.parametrize(
    ("mount", "axis", "says"),
    [
        ([0.0], [1.0], "at least 2"),
        ([0.0, 1.0], [1.0], "same length"),
        ([0.0, math.nan], [1.0, 2.0], "no numbers"),
        # A mount that turns the other way: the axes run against it.
        (list(MOUNT), list(-MOUNT), "is its sense right"),
    ],
)
def test_unusable_axes(mount: list[float], axis: list[float], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        offset_from_axes(mount, axis)


@pytest.mark.parametrize(
    ("mount", "intensity", "says"),
    [
        ([0.0, 1.0, 2.0], [1.0, 2.0, 3.0], "at least 4"),
        (list(MOUNT), [5.0] * 6, "is the light polarized"),
        ([0.0, 0.01, 0.02, 0.03], [1.0, 1.0, 1.0, 1.1], "too close together"),
        ([0.0, 1.0, 2.0, 3.0], [1.0, math.inf, 1.0, 1.0], "no numbers"),
    ],
)
def test_unusable_intensities(mount: list[float], intensity: list[float], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        offset_from_intensities(mount, intensity, 0.0)


def test_a_mount_is_calibrated_and_then_reports_the_axis() -> None:
    """From the first look to the rig file: the film sits 21.7 degrees off, and the light is horizontal."""
    world, glued_rad = World(), math.radians(21.7)
    with serve(Rotator(world, speed_rad_s=100.0)) as wire:
        mount = Ell14(Ell14.Options(port=wire.url))
        mount.open()
        reported, seen = [], []
        for degrees in (0, 40, 80, 120, 160):
            mount.start_turn(math.radians(degrees))
            reported.append(until_still(mount.poll).angle_rad)
            seen.append(float(malus(np.array([world.polarizer_rad.at()]), glued_rad, 0.0)[0]))
        mount.close()
        offset = offset_from_intensities(reported, seen, 0.0)
        calibrated = Ell14(Ell14.Options(port=wire.url, offset_deg=math.degrees(offset.angle_rad)))
        calibrated.open()
        calibrated.start_turn(math.radians(45))
        until_still(calibrated.poll)
        # An encoder pulse is 2.5 millidegrees.
        assert world.polarizer_rad.at() + glued_rad == pytest.approx(math.radians(45), abs=1e-4)
        calibrated.close()
