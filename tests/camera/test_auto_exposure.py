"""Automatic exposure: on a linear sensor whose light is known, so that the best exposure is known too."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera.auto_exposure import MOST_LOOKS, ExposureFound, ExposureGoal, auto_exposure
from drivers.contracts import Camera, ExposureControl
from drivers.records import ClockFix, Frame, Identity

ANGLES = tuple(np.radians([0.0, 45.0, 90.0, 135.0]))
LIMITS = (10e-6, 2.0)
FULL, BLACK = 4095, 64.0


class Sensor:
    """A 12-bit sensor behind a polarizer, by Malus' law; exposures have steps of 10 us."""

    shape = (4, 5)
    lost_frames = 0

    def __init__(self, counts_per_s: float, dolp: float = 0.3, aop: float = 0.4, seed: int = 0) -> None:
        self.rate, self.dolp, self.aop = counts_per_s, dolp, aop
        self.angle = 0.0
        self.exposure_s = 1e-3
        self.random = np.random.default_rng(seed)
        self.frames = 0
        self.turns = 0

    def open(self) -> Identity:
        return Identity("camera", "made", "made")

    def make_safe(self) -> None: ...
    def close(self) -> None: ...
    def clock(self) -> ClockFix | None:
        return None

    def exposure_limits(self) -> tuple[float, float]:
        return LIMITS

    def set_exposure(self, seconds: float) -> float:
        assert LIMITS[0] <= seconds <= LIMITS[1]
        self.exposure_s = max(round(seconds / 10e-6), 1) * 10e-6
        return self.exposure_s

    def turn(self, angle_rad: float) -> None:
        self.angle = angle_rad
        self.turns += 1

    def trigger(self) -> None:
        self.frames += 1

    def poll(self) -> Frame:
        return Frame(self.image(), self.frames, self.exposure_s, 0.0, math.nan, 0)

    def image(self) -> np.ndarray:
        light = self.rate * self.exposure_s * 0.5 * (1 + self.dolp * math.cos(2 * (self.angle - self.aop)))
        # Poisson noise of one electron a count, and a picture that is not flat.
        mean = light * np.linspace(0.1, 1.0, 20).reshape(self.shape)
        return np.clip(np.rint(self.random.poisson(mean) + BLACK), 0, FULL).astype(np.uint16)


def goal(**other: float) -> ExposureGoal:
    return ExposureGoal(LIMITS, FULL, BLACK, **other)


def run(sensor: Sensor, start_s: float) -> ExposureFound:
    return auto_exposure(sensor, sensor, goal(), ANGLES, start_s=start_s, turn=sensor.turn)


@given(
    rate=st.floats(2e4, 1e8),
    start=st.floats(1e-6, 10.0),
    dolp=st.floats(0.0, 0.95),
    aop=st.floats(0.0, math.pi),
    seed=st.integers(0, 1000),
)
def test_it_ends_with_nothing_saturated_at_any_angle(
    rate: float, start: float, dolp: float, aop: float, seed: int
) -> None:
    sensor = Sensor(rate, dolp, aop, seed)
    found = run(sensor, start)
    assert found.problem == ""
    assert sensor.exposure_s == found.exposure_s
    # The range ends at 0.9 (target 0.75, tolerance 0.15): ten standard deviations of shot noise below saturation.
    peaks = []
    for angle in ANGLES:
        sensor.turn(angle)
        peaks.append(sensor.image().max())
    assert max(peaks) < FULL
    # And the sensor is used: 0.6 of the range, less five standard deviations of the shot noise of 2419 counts.
    assert max(peaks) > BLACK + 0.6 * (FULL - BLACK) - 250
    # 18 octaves between the limits are 9 steps of 4; then one look at each angle and the confirmation.
    assert found.looks <= 18
    assert found.looks < MOST_LOOKS


def test_from_a_good_start_it_takes_five_frames_and_five_turns() -> None:
    sensor = Sensor(2e6, dolp=0.3)
    # 4031 counts of range; 0.75 of it behind the brightest of the four angles (Malus).
    best = 0.75 * 4031 / (2e6 * 0.5 * (1 + 0.3 * math.cos(2 * (math.pi / 4 - 0.4))))
    found = run(sensor, best)
    assert found.looks == sensor.frames == 5
    assert sensor.turns == 5
    # Steps of 10 us in 2.4 ms, and the noise of the brightest pixel (1.8 %).
    assert found.exposure_s == pytest.approx(best, rel=0.06)


def test_too_bright_is_said() -> None:
    sensor = Sensor(1e10)
    found = run(sensor, 1e-3)
    assert found.level is None
    assert "too bright: saturated even with an exposure of 1e-05 s" in found.problem
    assert sensor.exposure_s == LIMITS[0]


def test_too_dark_is_said_and_the_longest_exposure_kept() -> None:
    sensor = Sensor(500.0)
    found = run(sensor, 1e-3)
    # At 2 s the brightest angle gives 500 * 2 * 0.5 * (1 + 0.3 cos(2 (45 deg - 0.4 rad))) = 608 counts, 15 %.
    assert found.problem.startswith("too dark: the brightest pixel reaches 1")
    assert sensor.exposure_s == LIMITS[1]
    dark = Sensor(0.0)
    assert "too dark" in run(dark, 1e-3).problem


def test_light_that_jumps_about_ends_the_search() -> None:
    class Flickering(Sensor):
        def trigger(self) -> None:
            super().trigger()
            self.rate = 1e9 if self.frames % 2 else 1e3

    found = run(Flickering(1e6), 1e-3)
    assert found.looks <= MOST_LOOKS
    assert found.problem


def test_a_mosaic_needs_one_angle_and_no_turning() -> None:
    sensor = Sensor(1e6)
    found = auto_exposure(sensor, sensor, goal(), start_s=1e-3)
    assert found.problem == ""
    assert sensor.turns == 0
    assert found.looks <= 3
    assert isinstance(sensor, Camera)
    assert isinstance(sensor, ExposureControl)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"limits_s": (0.0, 1.0)}, "limits_s"),
        ({"limits_s": (2.0, 1.0)}, "limits_s"),
        ({"black_level_counts": 4095.0}, "black_level_counts"),
        ({"target": 0.95}, "target"),
        ({"tolerance": 0.0}, "target"),
    ],
)
def test_impossible_goals_are_refused(values: dict[str, object], words: str) -> None:
    usual: dict[str, object] = {"limits_s": LIMITS, "saturation_counts": FULL}
    with pytest.raises(ValueError, match=words):
        ExposureGoal(**{**usual, **values})  # type: ignore[arg-type]
