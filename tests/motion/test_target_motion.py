"""Velocity of targets in simulated collects with the thesis's geometry, and what is no target."""

from __future__ import annotations

import math

import numpy as np
import pytest

from processing.errors import DataError
from processing.motion.estimate import EstimateSettings, estimate_motion
from processing.motion.radon import RadonSettings
from processing.motion.search import find_moving
from processing.motion.simulation import (
    MovingPoint,
    ground_clutter,
    history_of,
    moving_history,
    receiver_noise,
    strip_collect,
)
from processing.radar.phase_history import history_profiles
from processing.sar.grid import ImageGrid

# Table 8.1 with a quarter of its band: each collect takes 0.1 s to simulate.
STRIP = strip_collect(bandwidth_hz=20e6)
HEIGHT = 15_000.0


def collected(points, clutter=5.0, noise=2.0, seed=0):
    random = np.random.default_rng(seed)
    echoes = moving_history(points, STRIP).echoes[0]
    echoes = echoes + ground_clutter(STRIP, clutter, random) + receiver_noise(STRIP, noise, random)
    return history_profiles(history_of(echoes, STRIP), oversampling=2)


def seen_at(point: MovingPoint) -> tuple[float, float, float]:
    """Where the picture of what stands shows a point, from the geometry alone."""
    x, y, _ = point.position_m
    along, away, _ = point.velocity_m_s
    abeam = x / (240.0 - along)
    y_abeam = y + away * abeam
    slant = math.hypot(y_abeam, HEIGHT)
    shift = -slant * (away * y_abeam / slant) / 240.0
    return x + along * abeam + shift, math.sqrt(slant**2 - shift**2 - HEIGHT**2), -HEIGHT


@pytest.mark.parametrize(
    "velocity", [(6.0, 9.0, 0.0), (-9.0, -20.0, 0.0), (4.0, -4.0, 0.0), (-5.0, 26.0, 0.0), (0.0, 15.0, 0.0)]
)
def test_velocity_is_found_within_its_uncertainty(velocity):
    point = MovingPoint((60.0, 15_020.0, -HEIGHT), velocity)
    x, y, z = seen_at(point)
    told = estimate_motion(collected([point]), STRIP.time_s, (x + 6.0, y - 3.0, z), beamwidth_rad=STRIP.beamwidth_rad)
    assert told.azimuth_m_s == pytest.approx(velocity[0], abs=4 * told.azimuth_sd_m_s + 0.002)
    assert told.ground_m_s == pytest.approx(velocity[1], abs=4 * told.ground_sd_m_s)
    assert told.azimuth_sd_m_s < 0.1
    assert told.ground_sd_m_s < 0.6
    assert told.x_m == pytest.approx(60.0, abs=4 * told.ground_sd_m_s / math.sqrt(2) * 88.4)
    assert told.alias == 0
    assert told.alias_sds > 4
    # -R v_r / V along the track, at the moment it was abeam.
    assert told.shift_m == pytest.approx(x - 60.0 - velocity[0] * 0.25, abs=4 * told.slant_sd_m_s * 88.5)


def test_a_known_place_tells_the_range_velocity_better_than_the_beam():
    point = MovingPoint((60.0, 15_020.0, -HEIGHT), (6.0, 9.0, 0.0))
    profiles = collected([point], clutter=30.0)
    by_beam = estimate_motion(profiles, STRIP.time_s, seen_at(point), beamwidth_rad=STRIP.beamwidth_rad)
    by_place = estimate_motion(
        profiles, STRIP.time_s, seen_at(point), beamwidth_rad=None,
        settings=EstimateSettings(place_x_m=60.0, place_sd_m=2.0),
    )  # fmt: skip
    # V sd / R on the slant, sqrt 2 more on the ground: 2 m are 0.032 m/s.
    assert by_place.ground_sd_m_s == pytest.approx(2.0 * 240 / 21_227 * math.sqrt(2), rel=0.1)
    assert by_place.ground_sd_m_s < 0.3 * by_beam.ground_sd_m_s
    assert by_place.ground_m_s == pytest.approx(9.0, abs=4 * by_place.ground_sd_m_s)


def test_pointing_of_the_beam_enters_the_uncertainty():
    point = MovingPoint((0.0, 15_000.0, -HEIGHT), (6.0, 9.0, 0.0))
    profiles = collected([point])
    settings = [EstimateSettings(pointing_sd_rad=sd) for sd in (0.0, 5e-3)]
    sure, unsure = (
        estimate_motion(profiles, STRIP.time_s, seen_at(point), beamwidth_rad=STRIP.beamwidth_rad, settings=how)
        for how in settings
    )
    # The beam's axis off by an angle is a range rate of V times it.
    added = math.sqrt(unsure.slant_sd_m_s**2 - sure.slant_sd_m_s**2)
    assert added == pytest.approx(240 * 5e-3, rel=0.05)


def test_a_picture_alone_is_refused_and_so_are_empty_places_and_bent_tracks():
    point = MovingPoint((0.0, 15_000.0, -HEIGHT), (6.0, 9.0, 0.0))
    profiles = collected([point])
    with pytest.raises(DataError, match="displacement"):
        estimate_motion(profiles, STRIP.time_s, seen_at(point), beamwidth_rad=None)
    with pytest.raises(DataError, match="stands above the clutter"):
        estimate_motion(profiles, STRIP.time_s, (300.0, 15_060.0, -HEIGHT), beamwidth_rad=STRIP.beamwidth_rad)
    uneven = STRIP.time_s.copy()
    uneven[100] += 1e-3
    with pytest.raises(DataError, match="evenly"):
        estimate_motion(profiles, uneven, seen_at(point), beamwidth_rad=STRIP.beamwidth_rad)


def test_moving_targets_are_found_and_what_stands_is_not():
    movers = [
        MovingPoint((20.0, 15_010.0, -HEIGHT), (7.0, 3.0, 0.0)),
        MovingPoint((-150.0, 14_900.0, -HEIGHT), (-6.0, -4.0, 0.0)),
    ]
    random = np.random.default_rng(9)
    standing = [MovingPoint((280.0, 15_060.0, -HEIGHT), amplitude=3.0)]
    # A wall along the track: 80 m of scatterers.
    wall = [
        MovingPoint((float(x), 14_950.0, -HEIGHT), amplitude=complex(*random.normal(size=2)) * 0.4)
        for x in np.arange(150.0, 230.0, 2.0)
    ]
    grid = ImageGrid(np.arange(-500.0, 501.0, 3.0), np.arange(14_700.0, 15_201.0, 7.0), -HEIGHT)
    found = find_moving(
        collected([*movers, *standing, *wall]), STRIP.time_s, grid, beamwidth_rad=STRIP.beamwidth_rad,
        radon=RadonSettings(tile_px=48),
    )  # fmt: skip
    assert len(found.targets) == 2
    for point in movers:
        near = min(found.targets, key=lambda target: abs(target.azimuth_m_s - point.velocity_m_s[0]))
        assert near.azimuth_m_s == pytest.approx(point.velocity_m_s[0], rel=0.05)
        assert near.ground_m_s == pytest.approx(point.velocity_m_s[1], abs=4 * near.ground_sd_m_s)
    # The wall is a streak, but none in which anything moves.
    on_the_wall = [r for r in found.rejected if abs(grid.y_m[round(r.streak.row)] - 14_950) < 15]
    assert on_the_wall
    assert all(r.reason for r in on_the_wall)
    with pytest.raises(DataError, match="no channel"):
        find_moving(collected(movers), STRIP.time_s, grid, beamwidth_rad=STRIP.beamwidth_rad, channel=3)
