"""Phase histories of footprints and points: against the sum at every frequency, and focused."""

from __future__ import annotations

import math
from dataclasses import replace

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
from processing.scattering.history import (
    MOST_NODES,
    PATTERN_ERROR,
    Sweep,
    history_reference,
    pattern_nodes,
    phase_history,
    segments_needed,
)
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
    # As a point's echo, from the gridding; patterns are within a thousandth of their side lobes.
    np.testing.assert_allclose(found.echoes, exact, atol=3e-4 * np.abs(exact).max())


@pytest.mark.parametrize("cell_m", [0.1, 0.4, 1.5])
@pytest.mark.parametrize("sweep", [Sweep(1.3e9, 0.15e9, 32), Sweep(5.0e9, 0.4e9, 256)])
def test_patterns_are_those_of_every_frequency_however_large_the_footprint(cell_m: float, sweep: Sweep) -> None:
    """Level ground returns nearly nothing: its footprints cancel, and must do so at all frequencies."""
    ground = shapes.patch((-3, 27, 0), (6, 0, 0), (0, 6, 0))
    part = shoot(radar_target(ground, [CONDUCTOR], sweep.wavelength_m), TRACK[2], MIDDLE, Density(cell_m, 2, 1))
    contributions, track = part.contributions, TRACK[:5]
    found = phase_history(lambda _: contributions, track, MIDDLE, sweep)
    exact = history_reference(contributions, track, MIDDLE, sweep)
    # All side lobes together, from the definition of the footprint's pattern.
    ways = [contributions.places_m[:, row] - track[2] for row in (3, 0)]
    near = [np.linalg.norm(way, axis=1) for way in ways]
    k = 2 * np.pi / sweep.wavelength_m
    lobes = k / (near[0] * near[1])
    for edge in (1, 2):
        sides = [contributions.places_m[:, row + edge] for row in (3, 0)]
        grown = np.abs(sum(np.sum(w / r[:, None] * e, axis=1) for w, r, e in zip(ways, near, sides, strict=True)))
        lobes = lobes / np.maximum(k * grown / 2, 1.0)
    together_ = float(np.sum(lobes * np.abs(contributions.amplitudes).max(axis=(1, 2))))
    # A thousandth of them (the growth with frequency changes by a few hundredths), and the gridding's 2e-4.
    assert np.abs(found.echoes - exact).max() < 1.5e-3 * together_
    assert np.linalg.norm(found.echoes - exact) < 4e-3 * np.linalg.norm(exact)


def test_cells_in_step_with_the_wave_return_no_ghost() -> None:
    """2 d cos g = wavelength: with the pattern of one frequency such ground returned more than its edges do."""
    sweep = Sweep(1.3e9, 0.15e9, 32)
    grazing = math.radians(40)
    antenna = 3000 * np.array([[0.0, -math.cos(grazing), math.sin(grazing)]])
    target = radar_target(shapes.patch((-2.5, -2.5, 0), (5, 0, 0), (0, 5, 0)), [CONDUCTOR], sweep.wavelength_m)
    on_ground = sweep.wavelength_m / (2 * math.cos(grazing))
    echoes = []
    for cell_m in (on_ground * math.sin(grazing), on_ground * math.sin(grazing) / 4.3):
        part = shoot(target, antenna[0], np.zeros(3), Density(cell_m, 5, 1)).contributions
        echoes.append(phase_history(lambda _, part=part: part, antenna, np.zeros(3), sweep).echoes)  # type: ignore[misc]
    # What is left is what edges that are split five times leave (3 % of a cell).
    assert np.linalg.norm(echoes[0] - echoes[1]) < 0.1 * np.linalg.norm(echoes[1])


def test_a_pattern_is_worked_out_as_often_as_its_size_requires() -> None:
    """From the remainder of interpolation at Chebyshev's nodes, 2 (x / 2)^n / n!."""
    sweep = Sweep(2.4e9, 80e6, 64)
    wide = np.array([0.0, 0.001, 0.01, 0.5, 2.0, 10.0, 1000.0])
    places = np.zeros((len(wide), 6, 3))
    places[:, [0, 3], 1] = 30.0
    # Along the sight: the path grows by it on both ways.
    grown = wide / (np.pi * sweep.bandwidth_hz / SPEED_OF_LIGHT_M_S / 2)
    places[:, 1, 1] = places[:, 4, 1] = grown / 2
    part = of_points(np.zeros((len(wide), 3)), np.zeros((len(wide), 2, 2), dtype=complex))
    needed = pattern_nodes(replace(part, places_m=places), np.zeros(3), sweep)
    assert needed[0] == needed[1] == 1
    assert needed[-1] == MOST_NODES
    for x, count in zip(wide[:-1], needed[:-1], strict=True):
        assert 2 * (x / 2) ** count / math.factorial(count) <= PATTERN_ERROR
        assert count == 1 or 2 * (x / 2) ** (count - 1) / math.factorial(count - 1) > PATTERN_ERROR


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
