"""Bodies that move while the radar passes: against closed forms, Galilei's change of frames, and rays sent anew."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from processing.errors import DataError
from processing.motion.simulation import MovingPoint, ranges_m, strip_collect
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.raytrace import shapes
from processing.raytrace.materials import Lambert
from processing.raytrace.triangles import Triangles
from processing.scattering.contributions import of_points
from processing.scattering.history import Sweep, phase_history
from processing.scattering.shooting import Density
from processing.scattering.surfaces import CONDUCTOR, RadarSurface
from processing.scene import primitives
from processing.scene.radar_simulation import RadarLook, Simulated, simulate_radar, straight_track
from processing.scene.solids import Part, Solid, SolidScene, Substance

METAL = Substance("metal", CONDUCTOR, Lambert(0.5))
SOIL = Substance("soil", RadarSurface(6 - 0.3j), Lambert(0.1))
VELOCITY = (7.0, -11.0, 0.5)
SWEEP = Sweep(1.2e9, 60e6, 32)
TRACK = straight_track((0.0, -900.0, 900.0), 240.0, 61)
TIME = np.linspace(-1.0, 1.0, 61)
ORIGIN = np.zeros(3)


def solid(name: str, mesh: Triangles, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Solid:
    return Solid(name, name, (Part(mesh, "metal"),), velocity_m_s=velocity)


def corner(edge: float) -> Triangles:
    return shapes.trihedral(edge).turned(shapes.turn_about((0.0, 0.0, 1.0), -0.75 * math.pi))


def from_zero(found: Simulated, name: str, pulses: slice = slice(None)) -> np.ndarray:
    """Echoes (pulses, frequencies) of HH with phases counted from range 0."""
    history = found.histories[name]
    frequency = history.first_hz + history.step_hz * np.arange(history.echoes.shape[2])
    turns = 2 * history.reference_m[:, None] * frequency / SPEED_OF_LIGHT_M_S
    return np.asarray(history.echoes[0] * np.exp(-2j * np.pi * turns))[pulses]


def test_a_moving_points_echo_is_its_phase() -> None:
    """a exp(-j 4 pi f (R(t) - reference) / c) / R^2 with R(t) of the moving place."""
    place = np.array([[3.0, 5.0, 0.5]])
    part = of_points(place, np.eye(2)[None] + 0j, np.array([VELOCITY]))
    # In two parts the point is told where it is in the middle of each.
    for segments, pulses in ((1, range(61)), (2, range(31, 61))):
        middle = [TIME[30]] if segments == 1 else [TIME[15], TIME[46]]
        told = iter([replace(part, places_m=part.places_m + _moved(t)) for t in middle])
        found = phase_history(lambda _, told=told: next(told), TRACK, ORIGIN, SWEEP, segments=segments, time_s=TIME)  # type: ignore[misc]
        for pulse in pulses:
            distance = float(np.linalg.norm(place[0] + np.array(VELOCITY) * TIME[pulse] - TRACK[pulse]))
            reference = float(np.linalg.norm(TRACK[pulse]))
            turn = np.exp(-4j * np.pi * SWEEP.frequencies_hz / SPEED_OF_LIGHT_M_S * (distance - reference))
            # Six taps at 1.5 times the terms: see processing.scattering.history.
            np.testing.assert_allclose(found.echoes[0, pulse] * distance**2, turn, atol=2e-4)


def _moved(time_s: float) -> np.ndarray:
    """Of places (6, 3): middles move, edges do not."""
    by = np.zeros((6, 3))
    by[0] = by[3] = np.array(VELOCITY) * time_s
    return by


def test_a_moving_trihedral_is_a_standing_one_seen_from_a_platform_that_moves_the_other_way() -> None:
    moving = SolidScene("moving", (METAL,), (solid("corner", corner(1.0), VELOCITY),))
    still = SolidScene("still", (METAL,), (solid("corner", corner(1.0)),))
    look = RadarLook(TRACK, (0.0, 0.0, 0.0), SWEEP, Density(0.1, 3, 3), time_s=TIME, move_m=2.0)
    found = simulate_radar(moving, look)
    # 13.05 m/s for 2 s in steps of 2 m.
    assert found.segments == 14
    other = replace(look, track_m=TRACK - np.array(VELOCITY) * TIME[:, None], time_s=None)
    expected = from_zero(simulate_radar(still, other), "double")
    got = from_zero(found, "double")
    # Amplitudes are those of each segment's middle, up to 0.01 rad away, and the segments are not the same.
    np.testing.assert_allclose(got, expected, atol=0.02 * np.abs(expected).max())
    # The corner's own closed form: steady phase but for its distance, over 140 turns; its level falls to 5 degrees off.
    collect = replace(strip_collect(seconds=1.0), antenna_m=TRACK, time_s=TIME)
    distance = ranges_m(MovingPoint((0.0, 0.0, 0.0), VELOCITY), collect)
    assert np.ptp(2 * distance / SWEEP.wavelength_m) > 100
    left = got[:, 16] * np.exp(4j * np.pi * distance / SWEEP.wavelength_m) * distance**2
    assert np.ptp(np.unwrap(np.angle(left))) < math.radians(3)
    assert np.ptp(np.abs(left)) < 0.1 * np.abs(left).mean()


@pytest.mark.parametrize(
    ("floor_m_s", "wall_m_s"),
    [((0, 0, 1.5), (0, 0, 0)), ((0, 0, 0), (0, 1.5, 0)), ((0.3, 0.2, -1.0), (0.1, -1.2, 0.4)), ((0, 2, 0), (1, 0, 2))],
)
def test_a_fold_of_two_bodies_is_where_their_planes_meet(
    floor_m_s: tuple[float, float, float], wall_m_s: tuple[float, float, float]
) -> None:
    """Two bounces between bodies that move apart are as long as the way to the fold of their planes and back."""
    floor = shapes.patch((-1.0, -2.0, 0.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    wall = shapes.patch((-1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    scene = SolidScene("fold", (METAL,), (solid("floor", floor, floor_m_s), solid("wall", wall, wall_m_s)))
    times = np.linspace(-0.2, 0.2, 7)
    track = TRACK[30] + np.linspace(-1, 1, 7)[:, None] * np.array([3.0, 0.0, 0.0])
    look = RadarLook(track, (0.0, 0.0, 0.0), SWEEP, Density(0.25, 4, 2), time_s=times, move_m=10.0)
    found = simulate_radar(scene, look)
    assert found.segments == 1
    # The wall's plane is moved along y alone and the floor's along z: their parts that slide leave the fold in place.
    fold = times[:, None] * np.array([0.0, wall_m_s[1], floor_m_s[2]])
    distance = np.linalg.norm(fold - track, axis=1)
    got = from_zero(found, "double")[:, 16] * np.exp(4j * np.pi * distance / SWEEP.wavelength_m) * distance**2
    # Footprints follow one body and may stick out of the other by what slides: that changes levels, not the phase.
    assert np.ptp(np.unwrap(np.angle(got))) < math.radians(2)
    assert np.ptp(np.abs(got)) < 0.3 * np.abs(got).mean()


def test_what_moves_over_ground_as_if_rays_were_sent_for_every_pulse() -> None:
    lorry = replace(primitives.box(2.0, 1.5, 1.5, "metal").placed((0.0, 0.0, 0.0), 0.15), velocity_m_s=(1.5, 1.0, 0.0))
    scene = SolidScene("street", (METAL, SOIL), (primitives.ground(16.0, 16.0, "soil"), lorry))
    look = RadarLook(
        TRACK[27:34], (0, 0, 0), SWEEP, Density(0.25, 4, 2), time_s=np.linspace(-0.15, 0.15, 7), move_m=10.0
    )
    once, anew = simulate_radar(scene, look), simulate_radar(scene, replace(look, move_m=0.02))
    assert (once.segments, anew.segments) == (1, 7)
    got, expected = from_zero(once, "double"), from_zero(anew, "double")
    # 0.54 m of way, 19 rad of phase; cells lie otherwise on the edges each time.
    np.testing.assert_allclose(got, expected, atol=0.06 * np.abs(expected).max())


def test_scenes_at_an_instant() -> None:
    tree = replace(primitives.tree(1.0, 1.0, leaf="metal", bark="soil", leaves=5), velocity_m_s=(1.0, 2.0, 0.0))
    scene = SolidScene("x", (METAL, SOIL), (tree, primitives.ground(2.0, 2.0, "soil")))
    later = scene.at(3.0)
    assert later.solids[0].clouds[0].position_m == pytest.approx((3.0, 6.0, 2.0))
    assert later.solids[1] is scene.solids[1]
    assert scene.speed_m_s == pytest.approx(math.sqrt(5))
    target = later.target(0.25)
    points = later.volumes(target, (0.0, -500.0, 500.0))
    np.testing.assert_array_equal(points.motions()[0], [[1, 2, 0], [1, 2, 0]])


def test_times_that_do_not_fit_are_refused() -> None:
    scene = SolidScene("moving", (METAL,), (solid("corner", corner(1.0), VELOCITY),))
    look = RadarLook(TRACK, (0.0, 0.0, 0.0), SWEEP, Density(0.1, 3, 3), time_s=TIME[:-1])
    with pytest.raises(DataError, match="one for each pulse"):
        simulate_radar(scene, look)
    with pytest.raises(DataError, match="positive length"):
        simulate_radar(scene, replace(look, time_s=TIME, move_m=0.0))
    with pytest.raises(DataError, match="one for each pulse"):
        phase_history(lambda _: of_points(np.zeros((1, 3)), np.eye(2)[None]), TRACK, ORIGIN, SWEEP, time_s=TIME[1:])
