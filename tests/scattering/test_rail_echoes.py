"""Echoes all along a rail: the beat of points in closed form, of a corner as rays from that very place make it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from processing.errors import DataError
from processing.radar.antenna import boresight, one_way_gain
from processing.radar.beat import TriangleFm, beat_of_ranges
from processing.raytrace import shapes
from processing.scattering.contributions import Beam, of_points
from processing.scattering.history import Sweep, history_reference
from processing.scattering.rail_echoes import RailRadar, rail_echoes
from processing.scattering.shooting import Density, shoot
from processing.scattering.surfaces import CONDUCTOR
from processing.scattering.target import radar_target

AXIS, WIDTH = boresight(math.radians(17)), math.radians(70)
POINTS = np.array([[1.0, 9.0, -1.0], [-3.0, 25.0, -0.5], [6.0, 40.0, 0.2]])
S = np.array([[20 + 5j, 3j], [3j, -12 + 1j]])
SENDERS, RECEIVERS = np.array([[0.0, 0, 0], [0.1, 0, 0.2]]), np.array([[-0.3, 0, 0], [0.0, 0.05, -0.1]])
APART = RailRadar(2.4e9, 80e6, SENDERS, RECEIVERS, Beam(AXIS, WIDTH))
RAMP = TriangleFm(2.4e9, 80e6, 0.020, 0.04001)
CABLES_M = 0.7


def gain(away: np.ndarray) -> np.ndarray:
    """One antenna's amplitude over the distance."""
    distance = np.linalg.norm(away, axis=-1)
    return np.sqrt(one_way_gain(away @ AXIS / distance, WIDTH)) / distance


def closed_form(
    x_m: np.ndarray, frequency: np.ndarray, slope: np.ndarray, receive: int, transmit: int
) -> tuple[np.ndarray, float]:
    """The beat (n,) by :func:`beat_of_ranges`, there and back from antennas apart, and its largest echo."""
    place = np.stack([x_m, 0 * x_m, 0 * x_m], axis=1)[:, None]
    out, back = POINTS - place - SENDERS[transmit], POINTS - place - RECEIVERS[receive]
    ranges = (np.linalg.norm(out, axis=2) + np.linalg.norm(back, axis=2)) / 2 + CABLES_M
    amplitudes = S[receive, transmit] * gain(out) * gain(back)
    return beat_of_ranges(frequency, slope, ranges, amplitudes), float(np.abs(amplitudes).max())


def test_points_beat_as_their_closed_form_wherever_the_trolley_is() -> None:
    echoes = rail_echoes(lambda _: of_points(POINTS, np.tile(S, (3, 1, 1))), (-0.2, 0.2), APART)
    frequency, slope = RAMP.frequency(np.linspace(0, 0.04, 801)[:-1])
    waves = echoes.waves(frequency, slope, delay_m=CABLES_M)
    # Residual video phase at the bins' delays: pi taps tau / over T = 1.7e-4 of the echo from 40 m, which is 5 % of
    # the nearest's; gridding and the filter along the rail: -88 dB.
    for x_m in (np.array([-0.2]), np.array([0.123456]), np.array([0.2]), np.linspace(0.1, 0.12, 800)):
        for receive in (0, 1):
            for transmit in (0, 1):
                exact, largest = closed_form(np.broadcast_to(x_m, (800,)), frequency, slope, receive, transmit)
                told = echoes.beat(x_m, waves, receive, transmit)
                np.testing.assert_allclose(told, exact, atol=6e-5 * largest)
    # Without the residual video phase it would not be within: pi K tau^2 is 1.2e-3 at 40 m, 6e-5 at 9 m.
    flat = echoes.waves(frequency, np.zeros_like(slope), delay_m=CABLES_M)
    exact, largest = closed_form(np.full(800, 0.1), frequency, slope, 0, 0)
    assert np.abs(echoes.beat([0.1], flat, 0, 0) - exact).max() > 8e-5 * largest


def test_a_front_end_mixes_the_channels() -> None:
    echoes = rail_echoes(lambda _: of_points(POINTS, np.tile(S, (3, 1, 1))), (0.0, 0.0), RailRadar(2.4e9, 80e6))
    receive, transmit = np.array([[1, 0.1j], [0.2, 1.5]]), np.array([[0.9, 0.05], [-0.1j, 1.1]])
    mixed = echoes.through(receive, transmit)
    waves = echoes.waves([2.39e9, 2.41e9], [4e9, 4e9])
    found = np.array([[echoes.rows([0.0], r, t)[-1, 0] for t in (0, 1)] for r in (0, 1)])
    told = np.array([[mixed.rows([0.0], r, t)[-1, 0] for t in (0, 1)] for r in (0, 1)])
    np.testing.assert_allclose(told, np.einsum("ij,jld,lm->imd", receive, found, transmit), atol=1e-12)
    assert mixed.beat([0.0], waves, 0, 1).shape == (2,)


def test_a_corner_echoes_between_two_views_as_from_there() -> None:
    corner = shapes.trihedral(0.61).turned(shapes.turn_about((0, 0, 1), -3 * math.pi / 4))
    target = radar_target(
        corner.turned(shapes.turn_about((1, 0, 0), 0.5)).moved((1.0, 9.0, -0.6)), [CONDUCTOR], 0.12491
    )

    def seen(antenna: np.ndarray):  # type: ignore[no-untyped-def]
        return shoot(target, antenna, antenna + np.array([0.0, 10.0, 0.0]), Density(0.1, 5, 3)).contributions

    radar = RailRadar(2.4e9, 80e6, beam=Beam(AXIS, WIDTH))
    echoes = rail_echoes(seen, (-0.1, 0.1), radar)
    sweep = Sweep(2.4e9, 80e6, 8)
    waves = echoes.waves(sweep.frequencies_hz, np.zeros(8))
    for x in (-0.05, 0.0, 0.08):
        place = np.array([x, 0.0, 0.0])
        exact = history_reference(seen(place), place[None], place, sweep, beam=radar.beam)[0, 0]
        told = np.sum(waves @ echoes.rows([x], 0, 0)[:, 0, :, None], axis=0)[:, 0]
        # Rays at edges fall otherwise from elsewhere: 1 % of a corner of five wavelengths at five levels.
        np.testing.assert_allclose(told, exact, atol=0.02 * np.abs(exact).max())


def test_level_ground_returns_what_its_edges_do_at_all_frequencies() -> None:
    """Against the sum over footprints at every frequency: they cancel but for the edges, in and off the middle."""
    target = radar_target(shapes.patch((-1, 5, -1.1), (2, 0, 0), (0, 4, 0)), [CONDUCTOR], 0.12491)
    place = np.array([0.02, 0.0, 0.0])
    part = shoot(target, place, np.array([0.0, 7.0, -1.1]), Density(0.04, 2, 1)).contributions
    echoes = rail_echoes(lambda _: part, (0.0, 0.05), RailRadar(2.4e9, 80e6), view_step_m=1.0)
    sweep = Sweep(2.4e9, 80e6, 16)
    exact = history_reference(part, place[None], place, sweep)[0, 0]
    waves = echoes.waves(sweep.frequencies_hz, np.zeros(16))
    told = np.sum(waves @ echoes.rows(place[:1], 0, 0)[:, 0, :, None], axis=0)[:, 0]
    # With the pattern of the middle frequency alone 0.45 of it is wrong.
    assert np.linalg.norm(told - exact) < 4e-3 * np.linalg.norm(exact)


def test_what_cannot_be_is_refused() -> None:
    def nothing(_: np.ndarray):  # type: ignore[no-untyped-def]
        return of_points(POINTS, np.tile(S, (3, 1, 1)))

    for span, radar, step in (((1.0, -1.0), APART, 0.1), ((0.0, 1.0), APART, 0.0), ((0.0, 1e6), APART, 1e5)):
        with pytest.raises(DataError):
            rail_echoes(nothing, span, radar, view_step_m=step)
    with pytest.raises(DataError, match="band"):
        RailRadar(2.4e9, 5e9)
    echoes = rail_echoes(nothing, (-0.1, 0.1), APART)
    for x in (-0.3, 0.3, math.nan):
        with pytest.raises(DataError, match="off the rail"):
            echoes.rows([x], 0, 0)
