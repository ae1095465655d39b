"""Physical optics of flat-faced reflectors: against closed forms at long range, a method of moments, and itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import fresnel

from benchmarks.dihedral_moments import dihedral_by_moments
from processing.calibration import rcs
from processing.calibration.bounce_paths import footprints
from processing.calibration.facets import FacetTarget, dihedral_facets, facing, plate_facets, trihedral_facets
from processing.calibration.near_field import near_field, near_field_scattering
from processing.calibration.physical_optics import Antennas, physical_optics_scattering
from processing.calibration.quadrature import polygon_quadrature
from processing.errors import DataError
from processing.scene.model import Reflector
from processing.scene.radar_response import reflector_scattering

EDGE, WAVELENGTH = 4 * 0.3048, 0.125
"""The thesis's targets."""
FAR = 1e5
"""A range at which the curvature of the wave, k D^2 / 8 R, turns phases by 1e-4 rad."""


def deg(value: float) -> float:
    return float(np.radians(value))


def direction(azimuth: float, elevation: float) -> np.ndarray:
    a, e = deg(azimuth), deg(elevation)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def seen(target: FacetTarget, azimuth: float, elevation: float, range_m: float, **options) -> np.ndarray:
    return physical_optics_scattering(
        target, Antennas.at(range_m * direction(azimuth, elevation)), WAVELENGTH, **options
    )[0]


def db(amplitude: complex) -> float:
    return float(20 * np.log10(abs(amplitude)))


@pytest.mark.parametrize("angles", [(0, 0), (7, -4), (20, 0), (60, 10), (-30, 45)])
def test_plate_at_long_range_is_the_closed_form(angles: tuple[float, float]) -> None:
    # Knott, Shaeffer and Tuley: the same integral in closed form; no cross polarization, HH as VV.
    found = seen(plate_facets(EDGE, 0.7), *angles, FAR)
    expected = rcs.plate_amplitude(EDGE, 0.7, deg(angles[0]), deg(angles[1]), WAVELENGTH)
    # Curvature: 2e-4 rad of the largest amplitude.
    largest = rcs.plate_amplitude(EDGE, 0.7, 0.0, 0.0, WAVELENGTH)
    np.testing.assert_allclose(found, expected * np.eye(2), atol=3e-4 * largest)


@pytest.mark.parametrize("angles", [(45, 35.264), (40, 17), (10, 30), (30, 60), (45, 5), (5, 5)])
@pytest.mark.parametrize("triangular", [False, True])
def test_three_bounces_at_long_range_are_the_closed_form(angles: tuple[float, float], triangular: bool) -> None:
    # Thesis 5.5 and Doerry 2014: effective apertures of square and triangular trihedrals. Bound: 0.3 dB;
    # what is left is the wave's curvature.
    amplitude = rcs.triangular_trihedral_amplitude if triangular else rcs.square_trihedral_amplitude
    expected = float(amplitude(EDGE, deg(angles[0]), deg(angles[1]), WAVELENGTH))
    found = seen(trihedral_facets(EDGE, triangular=triangular), *angles, FAR, bounces=(3,))
    np.testing.assert_allclose(found, -expected * np.eye(2), atol=2e-3 * expected)


@pytest.mark.parametrize("tilt", [0, 10, 20, 40])
@pytest.mark.parametrize("fold", [0, 45, 90])
def test_two_bounces_at_long_range_are_the_closed_form(tilt: float, fold: float) -> None:
    # Thesis 5.10 with the aperture 2 w sin(45 - tilt) across the fold, which physical optics confirms.
    across = np.array([-np.sin(deg(fold)), np.cos(deg(fold))]) * np.sin(deg(tilt))
    elevation = float(np.degrees(np.arcsin(across[1])))
    azimuth = float(np.degrees(np.arctan2(across[0], np.cos(deg(tilt)))))
    expected = rcs.dihedral_amplitude(EDGE, EDGE, deg(azimuth), deg(elevation), WAVELENGTH, deg(fold))
    c, s = np.cos(2 * deg(fold)), np.sin(2 * deg(fold))
    found = seen(dihedral_facets(EDGE, EDGE, deg(fold)), azimuth, elevation, FAR, bounces=(2,))
    if fold in (0, 90):
        np.testing.assert_allclose(found, -expected * np.array([[c, s], [s, -c]]), atol=1e-3 * expected)
    else:
        # Seen obliquely, a fold at 45 degrees no longer stands at 45 degrees in the basis of the line of sight.
        assert np.linalg.norm(found) == pytest.approx(np.sqrt(2) * expected, rel=1e-3)


def test_kernel_is_the_reference() -> None:
    wavelengths = 0.2998 / np.linspace(2.3, 2.5, 5)
    places = Antennas(
        np.array([[4.0, 1.0, 0.5], [3.0, 3.0, 2.0]]), np.array([[4.0, 1.2, 0.5], [3.0, 3.1, 2.2]]), deg(70)
    )
    for target in (trihedral_facets(0.6), dihedral_facets(0.5, 0.4, 0.3), plate_facets(0.4, 0.9)):
        fast = physical_optics_scattering(target, places, wavelengths)
        plain = physical_optics_scattering(target, places, wavelengths, reference=True)
        # Sums of 1e4 rounded terms.
        np.testing.assert_allclose(fast, plain, atol=1e-11 * np.abs(plain).max())
        assert fast.shape == (2, 5, 2, 2)
        # Uneven wavelengths go one by one.
        uneven = wavelengths[[0, 1, 4]]
        np.testing.assert_allclose(
            physical_optics_scattering(target, places, uneven), fast[:, [0, 1, 4]], atol=1e-9 * np.abs(fast).max()
        )


def test_finer_steps_change_nothing() -> None:
    # Error of the default step, measured: 2e-4 sqrt(m^2) of 13 at the thesis's place.
    coarse, fine = (seen(trihedral_facets(EDGE), 40, 17, 3.66, step_wavelengths=step) for step in (0.5, 0.2))
    assert np.abs(coarse - fine).max() < 5e-4


@given(st.floats(1.0, 89.0), st.floats(1.0, 89.0), st.floats(2.0, 50.0))
@settings(max_examples=10, deadline=None)
def test_reciprocity_and_freedom_from_the_way_round(azimuth: float, elevation: float, range_m: float) -> None:
    target = trihedral_facets(0.6)
    here, there = range_m * direction(azimuth, elevation), (range_m + 1) * direction(azimuth, elevation)
    one = physical_optics_scattering(target, Antennas(here[None], there[None]), WAVELENGTH)[0]
    other = physical_optics_scattering(target, Antennas(there[None], here[None]), WAVELENGTH)[0]
    np.testing.assert_allclose(one, other.T, atol=1e-10)


@given(st.floats(0.5, 89.5), st.floats(0.5, 89.5), st.floats(1.5, 30.0))
@settings(max_examples=30, deadline=None)
def test_footprints_lie_on_their_faces_and_paths_are_mirrored(azimuth: float, elevation: float, range_m: float) -> None:
    target, antenna = trihedral_facets(1.0), range_m * direction(azimuth, elevation)
    for part in footprints(target, antenna, antenna):
        face = target.faces[part.faces[-1]]
        assert abs((part.corners_m - face.corners_m[0]) @ face.normal).max() < 1e-9
        assert part.corners_m.min() > -1e-9
        assert part.corners_m.max() < 1 + 1e-9
        # Followed by hand from the antenna over the mirrors: the way is as long as the unfolded one.
        points, weights = polygon_quadrature(part.corners_m, 10.0)
        assert weights.sum() >= 0
        unfolded = points @ part.unfold.T + part.shift_m
        image = antenna.copy()
        for index in part.faces[:-1]:
            image[index] *= -1
        np.testing.assert_allclose(
            np.linalg.norm(unfolded - antenna, axis=1), np.linalg.norm(points - image, axis=1), rtol=1e-9
        )


def test_quadrature_integrates_polynomials_of_degree_five() -> None:
    # Over the unit square: integral of x^a y^b is 1 / ((a + 1) (b + 1)).
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    for step in (2.0, 0.3):
        points, weights = polygon_quadrature(square, step)
        for a, b in ((0, 0), (5, 0), (2, 3), (1, 4), (0, 5)):
            found = np.sum(weights * points[:, 0] ** a * points[:, 1] ** b)
            assert found == pytest.approx(1 / ((a + 1) * (b + 1)), rel=1e-12)


@pytest.mark.parametrize("tilt", [0, 10, 20])
def test_dihedral_agrees_with_the_method_of_moments(tilt: float) -> None:
    # Long range, polarization along the fold: sigma_3D = 2 L^2 / lambda sigma_2D, sigma_2D = 4 / k |A|^2. Physical
    # optics has no diffraction at the faces' ends: below 0.4 dB measured for faces of 9.75 wavelengths (the thesis's).
    exact = dihedral_by_moments(EDGE / WAVELENGTH, 1e6, deg(tilt))
    sigma = 2 * EDGE**2 / WAVELENGTH * 4 / (2 * np.pi / WAVELENGTH) * abs(exact) ** 2
    found = seen(dihedral_facets(EDGE, EDGE, np.pi / 2), tilt, 0, FAR)
    assert db(found[1, 1]) == pytest.approx(10 * np.log10(sigma), abs=0.45)


def test_near_field_of_a_dihedral_agrees_with_moments_across_and_fresnel_along_the_fold() -> None:
    # What the distance of 3.66 m costs, -20 dB: across the fold by the method of moments with a line source there,
    # along it by the Fresnel integral over the phase k x^2 / R. Diffraction moves the first by 0.4 dB (measured against
    # moments in two dimensions), the common curvature of both by less.
    range_m = 12 * 0.3048
    near = dihedral_by_moments(EDGE / WAVELENGTH, range_m / WAVELENGTH, 0.0)
    reach = EDGE / 2 * np.sqrt(4 / (WAVELENGTH * range_m))
    sine, cosine = fresnel(reach)
    along = abs(cosine + 1j * sine) / reach
    sigma = 2 * EDGE**2 / WAVELENGTH * 4 / (2 * np.pi / WAVELENGTH) * abs(near) ** 2 * along**2
    found = seen(dihedral_facets(EDGE, EDGE, np.pi / 2), 0, 0, range_m)[1, 1]
    assert db(found) == pytest.approx(10 * np.log10(sigma), abs=0.7)
    assert db(found) < 35.5 - 19


def test_plate_in_the_near_field_is_the_fresnel_integral() -> None:
    # On the normal, both ways: mean over the plate of exp(-j k (x^2 + y^2) / R), Fresnel's approximation, good to
    # k D^4 / 64 R^3 = 0.5 rad at the corners of the plate: parts in a hundred of the amplitude.
    range_m = 6.0
    reach = EDGE / 2 * np.sqrt(4 / (WAVELENGTH * range_m))
    sine, cosine = fresnel(reach)
    expected = rcs.plate_amplitude(EDGE, EDGE, 0, 0, WAVELENGTH) * ((cosine - 1j * sine) / reach) ** 2
    found = seen(plate_facets(EDGE, EDGE), 0, 0, range_m)
    assert found[0, 0] == pytest.approx(expected, abs=0.06 * abs(expected))


@pytest.mark.parametrize("azimuth", [0, 45, 90])
@pytest.mark.parametrize("elevation", [0, 45, 90])
def test_angles_of_the_edges_are_defined(azimuth: float, elevation: float) -> None:
    # In a face's plane the face is edge-on and returns nothing; what is left is a dihedral, or the plate that looks at
    # the radar. A thousandth of a degree changes little: currents on a face that is just lit at grazing do not vanish
    # where E stands on it, but radiate back to the antenna by (edge / range) / 2 = 4 % only. (Norms, for h and v turn
    # with the azimuth straight above.)
    here = seen(trihedral_facets(0.6), azimuth, elevation, 8.0)
    beside = seen(trihedral_facets(0.6), azimuth + 1e-3, elevation - 1e-3, 8.0)
    assert np.isfinite(here).all()
    largest = np.sqrt(4 * np.pi) * 0.6**2 / WAVELENGTH
    assert np.linalg.norm(here) == pytest.approx(np.linalg.norm(beside), abs=0.04 * np.sqrt(2) * largest)
    if azimuth in (0, 90) and elevation in (0, 90):
        # Along an edge: the far face alone, seen at its corner. Half of the plate lies on either side of no axis, so
        # it is what the integral over a quarter of a plate of twice the edge gives.
        quarter = seen(plate_facets(1.2, 1.2), 0, 0, 8.0)[0, 0] / 4
        assert np.abs(here).max() == pytest.approx(abs(quarter), rel=0.02)


def test_grazing_and_behind_return_nothing() -> None:
    plate = plate_facets(0.5, 0.5)
    assert np.abs(seen(plate, 90, 0, 5.0)).max() < 1e-12
    assert np.abs(seen(plate, 120, 0, 5.0)).max() == 0
    assert np.abs(seen(trihedral_facets(0.5), 225, -30, 5.0)).max() == 0


def test_a_face_hides_what_stands_behind_it() -> None:
    # Beyond 45 degrees a dihedral shows the back of one face, which hides part of the other.
    target = dihedral_facets(1.0, 1.0, np.pi / 2)
    antenna = 20.0 * direction(60, 0)
    parts = footprints(target, antenna, antenna)
    assert all(part.bounces == 1 for part in parts)
    area = sum(polygon_quadrature(part.corners_m, 1.0)[1].sum() for part in parts)
    # From 60 degrees the back face, seen at 15 degrees from its plane, throws a shadow of tan 15 over the unit face;
    # the antenna is not infinitely far: 20 m.
    assert area == pytest.approx(1 - np.tan(deg(15)), abs=0.02)


def test_impossible_geometries_are_refused() -> None:
    plate = plate_facets(0.5, 0.5)
    with pytest.raises(DataError, match="reactive field"):
        seen(plate, 0, 0, 0.05)
    with pytest.raises(DataError, match="reference point"):
        seen(plate, 0, 0, 0.0)
    with pytest.raises(DataError, match="wavelength"):
        physical_optics_scattering(plate, Antennas.at([[3.0, 0, 0]]), 0.0)
    with pytest.raises(DataError, match="step"):
        seen(plate, 0, 0, 3.0, step_wavelengths=0.0)
    with pytest.raises(DataError, match="behind the antennas"):
        physical_optics_scattering(plate, Antennas.at([[3.0, 0, 0]], deg(70), np.array([1.0, 0.0, 0.0])), WAVELENGTH)
    with pytest.raises(DataError, match="places"):
        Antennas.at([[1.0, 2.0]])
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(DataError, match="positive"):
            plate_facets(wrong, 1.0)
        with pytest.raises(DataError, match="positive"):
            trihedral_facets(wrong)
    with pytest.raises(DataError, match="cannot face"):
        facing((0, 0, 0), 0.0, 0.0)


@pytest.mark.parametrize("kind", ["plate", "dihedral", "trihedral", "trihedral_triangular"])
def test_reflectors_of_a_scene_stand_as_their_closed_forms_say(kind: str) -> None:
    # Far away and small enough for single flashes to stay below 0.3 dB, at several places along a rail.
    angles = (deg(42), deg(33)) if "trihedral" in kind else (deg(2), deg(-1))
    reflector = Reflector(kind, kind, (30.0, 400.0, -1.0), 1.0, *angles, fold_rad=np.pi / 2)
    places = np.array([[-3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.1]])
    found = near_field_scattering(reflector, places, WAVELENGTH)
    closed = reflector_scattering(reflector, places, WAVELENGTH)
    for which in (0, 1):
        ratio = found[:, which, which] / closed[:, which, which]
        np.testing.assert_allclose(20 * np.log10(np.abs(ratio)), 0, atol=0.3)
        assert np.abs(np.angle(ratio)).max() < 0.1


def test_near_field_tells_what_the_distance_costs() -> None:
    reflector = Reflector("corner", "trihedral", (0.0, 12 * 0.3048, -1.07), EDGE, deg(40), deg(17))
    places = np.stack([np.linspace(-1.5, 1.5, 7), np.zeros(7), np.zeros(7)], axis=1)
    found = near_field(reflector, places, WAVELENGTH)
    assert found.is_near
    # The largest distance of two corners is that of a face's outer corner from the third tip: sqrt(3) edges.
    assert found.far_field_m == pytest.approx(2 * 3 * EDGE**2 / WAVELENGTH)
    assert found.correction_db[0, 0] < -5
    assert np.isnan(found.correction_db[0, 1])
    with pytest.raises(DataError, match="no flat faces"):
        near_field(Reflector("ball", "sphere", (0, 5, 0), 0.3), places, WAVELENGTH)
