"""Echoes of bodies by shooting and bouncing rays: against closed forms, polygons, moments and Mie's series."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.accuracy_scattering import (
    EDGE_M,
    FAR_M,
    WAVELENGTH_M,
    corner_error,
    flat_error,
    fold_error,
    moments_error,
    sphere_error,
    wall_error,
)
from processing.calibration.facets import dihedral_facets
from processing.calibration.physical_optics import Antennas, physical_optics_scattering
from processing.errors import DataError
from processing.raytrace import shapes
from processing.raytrace.triangles import joined
from processing.scattering.contributions import echoes, echoes_reference
from processing.scattering.shooting import Density, settle, shoot
from processing.scattering.surfaces import CONDUCTOR, RadarSurface
from processing.scattering.target import radar_target

PHASE = 5.0
LEVEL = 0.3
"""What is asked for, degrees and dB; closed forms are in benchmarks.accuracy_scattering, with their sources."""
ORIGIN = np.zeros(3)


@pytest.mark.parametrize("tilt_deg", [(0.0, 0.0), (2.0, 1.0), (-4.0, 3.0)])
def test_a_plate_is_its_closed_form(tilt_deg: tuple[float, float]) -> None:
    level, phase = flat_error(*tilt_deg)
    assert abs(level) < LEVEL
    assert abs(phase) < PHASE


@pytest.mark.parametrize("tilt_deg", [0.0, 20.0, -35.0])
def test_two_bounces_are_the_dihedral_of_5_10(tilt_deg: float) -> None:
    for level, phase in fold_error(tilt_deg):
        assert abs(level) < LEVEL
        assert abs(phase) < PHASE


@pytest.mark.parametrize(("azimuth", "elevation"), [(45, 35.264), (40, 17), (15, 60), (70, 25)])
def test_three_bounces_are_the_trihedral_of_5_5(azimuth: float, elevation: float) -> None:
    level, phase = corner_error(azimuth, elevation)
    assert abs(level) < LEVEL
    assert abs(phase) < PHASE


def test_a_sphere_is_mies() -> None:
    level, phase = sphere_error(0.5)
    assert abs(level) < LEVEL
    assert abs(phase) < PHASE


@pytest.mark.parametrize("permittivity", [None, 5 - 0.2j])
def test_ground_and_wall_reflect_as_fresnel_says(permittivity: complex | None) -> None:
    for level, phase in wall_error(permittivity, 30.0):
        assert abs(level) < LEVEL
        assert abs(phase) < PHASE


def test_a_dihedral_is_that_of_moments() -> None:
    # Physical optics leaves out edges, which make some tenths of a dB at ten wavelengths, here 0.2 (at 0 degrees 0.4).
    assert abs(moments_error(10.0)) < 0.3


def test_near_field_is_that_of_exact_polygons() -> None:
    """The thesis's distance, where closed forms fail: both ways of finding what is lit agree in all elements."""
    place = 3.66 * np.array([math.cos(0.1), math.sin(0.1), 0.0])
    exact = physical_optics_scattering(
        dihedral_facets(EDGE_M, EDGE_M, np.pi / 2), Antennas.at(place), WAVELENGTH_M, step_wavelengths=0.25
    )[0]
    fold = shapes.dihedral(EDGE_M).turned(shapes.turn_about((1, 0, 0), -math.pi / 4))
    upright = fold.turned(shapes.turn_about((0, 1, 0), math.pi / 2))
    turned = upright.turned(shapes.turn_about((0, 0, 1), -math.pi / 2))
    target = radar_target(turned, [CONDUCTOR], WAVELENGTH_M)
    found = settle(target, place, ORIGIN, WAVELENGTH_M, tolerance_db=0.05, start=Density(0.03, 4, 3))
    assert found.reached
    # Footprints are taken as flat: their wavefronts bend by this much.
    assert found.curvature_rad < 0.02
    np.testing.assert_allclose(found.scattering[0], exact, atol=0.02 * np.abs(exact).max())


def test_what_stands_in_front_hides() -> None:
    """A plate behind an absorber-like screen of a matched medium returns nothing."""
    plate = shapes.plate(0.5).turned(shapes.turn_about((1, 0, 0), math.pi / 2))
    screen = shapes.plate(1.0).turned(shapes.turn_about((1, 0, 0), math.pi / 2)).moved((0, -2, 0)).of_material(1)
    target = radar_target(joined([plate, screen]), [CONDUCTOR, RadarSurface(1.0 + 0j)], WAVELENGTH_M)
    shot = shoot(target, (0, -100, 0), ORIGIN, Density(0.05, 2, 2))
    assert np.abs(shot.contributions.amplitudes).max() < 1e-12


def test_a_fold_whose_way_back_is_blocked_shows_no_second_bounce() -> None:
    """A screen between the antenna and the upright face: it is reached by way of the ground, but not seen."""
    fold = shapes.dihedral(1.0)
    # From the face the antenna's direction passes y = 3 at z = 3 to 4, from the ground at 2 to 3.
    screen = shapes.patch((-3, 3, 3.001), (6, 0, 0), (0, 0, 1.5))
    second = []
    for mesh in (fold, joined([fold, screen])):
        target = radar_target(mesh, [CONDUCTOR], WAVELENGTH_M)
        found = shoot(target, (0, 1e4, 1e4), ORIGIN, Density(0.05, 2, 2)).contributions
        on_fold = (found.places_m[:, 0, 1] < 1.01) & (found.places_m[:, 0, 2] < 1.01)
        second.append(np.sum(np.abs(found.amplitudes[on_fold & (found.bounces == 2), 0, 0])))
    assert second[0] > 0.5
    # But for the screen's lower edge, a thousandth of the fold.
    assert second[1] < 0.01 * second[0]


@settings(max_examples=8, deadline=None)
@given(angle=st.floats(0.0, math.pi))
def test_turning_about_the_line_of_sight_turns_the_matrix(angle: float) -> None:
    """S of a body turned by an angle is ``R S R^T``: frames and signs of all elements hang together."""
    level = shapes.dihedral(EDGE_M).turned(shapes.turn_about((1, 0, 0), 3 * math.pi / 4))
    density = Density(0.1, 5, 2)
    place = np.array([0.0, -FAR_M, 0.0])
    told = [
        shoot(radar_target(mesh, [CONDUCTOR], WAVELENGTH_M), place, ORIGIN, density).contributions.scattering(
            place, WAVELENGTH_M, ORIGIN
        )[0, 0]
        for mesh in (level, level.turned(shapes.turn_about((0, 1, 0), -angle)))
    ]
    c, s = math.cos(angle), math.sin(angle)
    # Looking along +y, h is +x and v is +z: a body turned from x to z turns from h to v.
    turn = np.array([[c, -s], [s, c]])
    np.testing.assert_allclose(told[1], turn @ told[0] @ turn.T, atol=0.01 * np.abs(told[0]).max())


def test_settling_tells_whether_it_did() -> None:
    target = radar_target(shapes.dihedral(EDGE_M), [CONDUCTOR], WAVELENGTH_M)
    place = FAR_M * np.array([0.0, 0.6, 0.8])
    done = settle(target, place, ORIGIN, WAVELENGTH_M, tolerance_db=0.5)
    assert done.reached
    assert done.change_db <= 0.5
    # A dihedral has no fourth bounce.
    assert done.bounce_db[-1] < -100
    hasty = settle(target, place, ORIGIN, WAVELENGTH_M, tolerance_db=1e-6, start=Density(0.2, 1, 1), most_refinements=1)
    assert not hasty.reached


def test_echoes_are_those_of_the_definition() -> None:
    target = radar_target(shapes.trihedral(1.0), [CONDUCTOR], WAVELENGTH_M)
    part = shoot(target, (3.0, 4.0, 2.0), ORIGIN, Density(0.2, 1, 3)).contributions
    k = 2 * np.pi / np.array([0.12, 0.13])
    beam = np.array([-0.6, -0.7, -0.39, 1.3])
    sums = [np.empty((2, 2, 2), dtype=np.complex128) for _ in range(2)]
    for form, into in zip((echoes, echoes_reference), sums, strict=True):
        form(part.places_m, part.amplitudes, part.footprints, np.array([3.1, 4.0, 2.0]), k, 10.0, beam, into)
    # Sums of some hundred terms: rounding of the phases, 1e2 rad, and of the order of summation.
    np.testing.assert_allclose(sums[0], sums[1], atol=1e-12 * np.abs(sums[1]).max() * len(part))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda t: shoot(t, (0, 0, 0), ORIGIN, Density(0.1)),
        lambda t: shoot(t, (0, 9, 9), ORIGIN, Density(1e-6)),
        lambda t: Density(0.0),
        lambda t: Density(0.1, bounces=0),
        lambda t: settle(t, (0, 9, 9), ORIGIN, WAVELENGTH_M, tolerance_db=0.0),
        lambda t: settle(t, (0, 9, 9), ORIGIN, -1.0),
        lambda t: radar_target(shapes.plate(1.0), [CONDUCTOR], 0.0),
    ],
)
def test_what_cannot_be_is_refused(wrong) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(DataError):
        wrong(radar_target(shapes.dihedral(1.0), [CONDUCTOR], WAVELENGTH_M))
