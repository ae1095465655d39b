"""Phase histories of footprints and points: against the sum at every frequency, and focused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from processing.errors import DataError
from processing.radar.antenna import one_way_gain
from processing.radar.phase_history import history_profiles
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.raytrace import shapes
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid
from processing.scattering.contributions import Beam, of_points, together
from processing.scattering.history import Sweep, history_reference, phase_history, segments_needed
from processing.scattering.shooting import Density, shoot
from processing.scattering.surfaces import CONDUCTOR
from processing.scattering.target import radar_target

MIDDLE = np.array([0.0, 30.0, 0.0])
SWEEP = Sweep(2.4e9, 80e6, 64)
TRACK = np.stack([np.linspace(-1.0, 1.0, 33), np.zeros(33), np.full(33, 10.0)], axis=1)


def test_a_points_echo_is_its_phase() -> None:
    """Amplitude S / R^2 and phase -4 pi f (R - reference) / c, channels named transmit then receive."""
    place = np.array([[2.0, 33.0, 1.0]])
    matrix = np.array([[[1.0, 0.25], [0.25, -2j]]])
    found = phase_history(lambda _: of_points(place, matrix), TRACK, MIDDLE, SWEEP)
    distance = np.linalg.norm(TRACK - place, axis=1)[:, None]
    reference = np.linalg.norm(TRACK - MIDDLE, axis=1)[:, None]
    turn = np.exp(-4j * np.pi * SWEEP.frequencies_hz / SPEED_OF_LIGHT_M_S * (distance - reference)) / distance**2
    # Six taps at 1.5 times the terms: -94 dB (KERNEL.error_db), more at the ends of the band.
    for channel, value in zip(found.echoes, (1.0, 0.25, 0.25, -2j), strict=True):
        np.testing.assert_allclose(channel, value * turn, atol=2e-4 * np.abs(turn).max())
    assert found.channels == ("HH", "HV", "VH", "VV")


def test_footprints_echo_as_the_sum_at_every_frequency() -> None:
    corner = shapes.trihedral(1.0).turned(shapes.turn_about((0, 0, 1), -3 * math.pi / 4)).moved(MIDDLE)
    target = radar_target(corner, [CONDUCTOR], SWEEP.wavelength_m)
    part = shoot(target, TRACK[16], MIDDLE, Density(0.1, 3, 3)).contributions
    part = together([part, of_points(MIDDLE[None] + 1.0, np.eye(2)[None] + 0j)])
    beam = Beam(np.array([0.0, 1.0, 0.0]), math.radians(70))
    found = phase_history(lambda _: part, TRACK, MIDDLE, SWEEP, beam=beam)
    exact = history_reference(part, TRACK, MIDDLE, SWEEP, beam=beam)
    # The pattern within a footprint is that of the centre frequency: footprints of 0.1 m at 1.7 % off it.
    np.testing.assert_allclose(found.echoes, exact, atol=2e-3 * np.abs(exact).max())


def test_the_beam_weighs_both_ways() -> None:
    place = np.array([[8.0, 30.0, 0.0]])
    beam = Beam(np.array([0.0, 1.0, 0.0]), math.radians(40))
    track = np.array([[0.0, 0.0, 0.0]])
    part = of_points(place, np.eye(2)[None] + 0j)
    with_beam, without = (phase_history(lambda _: part, track, MIDDLE, SWEEP, beam=b).echoes[0] for b in (beam, None))
    cosine = 30.0 / math.hypot(8.0, 30.0)
    np.testing.assert_allclose(with_beam / without, float(one_way_gain(cosine, math.radians(40))), rtol=1e-5)


def test_a_corner_is_focused_at_its_apex_with_its_rcs() -> None:
    edge = 0.6
    turn = shapes.turn_about((0, 0, 1), -3 * math.pi / 4)
    target = radar_target(shapes.trihedral(edge).turned(turn).moved(MIDDLE), [CONDUCTOR], SWEEP.wavelength_m)
    track = TRACK[10:23] + np.array([0, 0, 11.21])  # near the corner's axis, at 35.3 degrees

    def seen(antenna: np.ndarray):  # type: ignore[no-untyped-def]
        return shoot(target, antenna, MIDDLE, Density(0.05, 4, 3)).contributions

    history = phase_history(seen, track, MIDDLE, SWEEP, segments=3)
    grid = ImageGrid(np.linspace(-2, 2, 9), np.linspace(28, 32, 17), 0.0)
    image = np.abs(backproject(history_profiles(history), grid)[0])
    peak = np.unravel_index(np.argmax(image), image.shape)
    assert grid.y_m[peak[0]] == pytest.approx(30.0, abs=0.26)
    assert grid.x_m[peak[1]] == pytest.approx(0.0, abs=0.51)
    squared = float(np.mean(np.sum((track - MIDDLE) ** 2, axis=1)))
    # 12 pi a^4 / lambda^2 on the axis; the edges of the faces add a little at this size.
    expected = 10 * math.log10(12 * math.pi * edge**4 / SWEEP.wavelength_m**2)
    assert 20 * math.log10(image.max() * squared) == pytest.approx(expected, abs=0.6)


def test_segments_follow_the_turn() -> None:
    assert segments_needed(TRACK, MIDDLE, 1.0) == 1
    # 2 m at 31.6 m turn the sight by 0.063 rad.
    assert segments_needed(TRACK, MIDDLE, 0.01) == 7


def test_what_cannot_be_is_refused() -> None:
    far = of_points(np.array([[0.0, 500.0, 0.0]]), np.eye(2)[None] + 0j)
    with pytest.raises(DataError, match="frequencies or more"):
        phase_history(lambda _: far, TRACK, MIDDLE, SWEEP)
    with pytest.raises(DataError):
        phase_history(lambda _: far, TRACK, MIDDLE, SWEEP, segments=0)
    with pytest.raises(DataError):
        Sweep(1e9, 3e9, 64)
    with pytest.raises(DataError):
        Sweep(1e9, 1e8, 63)
    with pytest.raises(DataError):
        together([])
