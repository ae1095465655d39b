"""What a scene returns to one antenna position."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.calibration.rcs import dihedral_amplitude, plate_amplitude, square_trihedral_amplitude
from processing.errors import DataError
from processing.scene.model import Bush, Point, Reflector, Scene
from processing.scene.radar_response import (
    apparent_scattering,
    bush_cloud,
    local_angles,
    reflector_scattering,
    scatterers,
)

WAVELENGTH = 0.125
coordinate = st.floats(-1.5, 1.5)


def test_trihedral_plate_and_dihedral_at_the_aperture_centre() -> None:
    place = (1.0, 8.0, -1.0)
    trihedral = reflector_scattering(Reflector("t", "trihedral", place, 0.6, 0.7, 0.5), (0, 0, 0), WAVELENGTH)
    # At the centre the stored angles hold, and 5.5 gives the amplitude.
    np.testing.assert_allclose(trihedral, square_trihedral_amplitude(0.6, 0.7, 0.5, WAVELENGTH) * np.eye(2))
    plate = reflector_scattering(Reflector("p", "plate", place, 0.6, 0.02, 0.03), (0, 0, 0), WAVELENGTH)
    np.testing.assert_allclose(plate, plate_amplitude(0.6, 0.6, 0.02, 0.03, WAVELENGTH) * np.eye(2))
    fold = 0.3
    dihedral = reflector_scattering(Reflector("d", "dihedral", place, 0.6, 0.01, 0.0, fold), (0, 0, 0), WAVELENGTH)
    amplitude = dihedral_amplitude(0.6, 0.6, 0.01, 0.0, WAVELENGTH, fold)
    turned = [[np.cos(2 * fold), np.sin(2 * fold)], [np.sin(2 * fold), -np.cos(2 * fold)]]
    np.testing.assert_allclose(dihedral, amplitude * np.array(turned))


@given(coordinate, coordinate)
def test_local_angles_follow_the_geometric_direction(x: float, z: float) -> None:
    reflector = Reflector("t", "trihedral", (0.0, 6.0, 0.0), 0.6, 0.7, 0.5)
    azimuth, elevation = local_angles(reflector, (x, 0.0, z))
    # Straight ahead of the origin the change is plain trigonometry.
    assert azimuth - 0.7 == pytest.approx(np.arctan2(x, 6.0), abs=1e-12)
    assert elevation - 0.5 == pytest.approx(np.arctan2(z, np.hypot(x, 6.0)), abs=1e-12)


def test_many_positions_at_once_and_their_mean() -> None:
    reflector = Reflector("p", "plate", (0.5, 5.0, -1.0), 0.6)
    places = np.stack([np.linspace(-1, 1, 21), np.zeros(21), np.zeros(21)], axis=1)
    each = np.stack([reflector_scattering(reflector, place, WAVELENGTH) for place in places])
    np.testing.assert_allclose(reflector_scattering(reflector, places, WAVELENGTH), each)
    np.testing.assert_allclose(apparent_scattering(reflector, places, WAVELENGTH), each.mean(axis=0))
    weights = np.arange(1.0, 22.0)
    expected = (each * weights[:, None, None]).sum(axis=0) / weights.sum()
    np.testing.assert_allclose(apparent_scattering(reflector, places, WAVELENGTH, weights), expected)


def test_bush_has_the_stated_mean_rcs_and_a_third_of_it_cross_polarized() -> None:
    # Means over the sphere: <cos^4> = 1/5, <cos_h^2 cos_v^2> = 1/15. The sd of d_h^4 is sqrt(1/9 - 1/25) = 0.267, of
    # d_h^2 d_v^2 sqrt(3/315 - 1/225) = 0.071; five of them over sqrt(n) and their mean.
    n, stated = 40_000, 2.5
    _, s = scatterers(Scene("b", bushes=(Bush("b", (0.5, 9.0, -1.0), 0.5, n, stated, 7),)), (0, 0, 0), WAVELENGTH)
    power = (np.abs(s) ** 2).sum(axis=0)
    assert power[0, 0] == pytest.approx(stated, rel=5 * 0.267 / 0.2 / np.sqrt(n))
    assert power[1, 1] == pytest.approx(stated, rel=5 * 0.267 / 0.2 / np.sqrt(n))
    assert power[0, 1] == pytest.approx(stated / 3, rel=5 * 0.071 * 15 / np.sqrt(n))


@given(coordinate, coordinate, coordinate)
def test_every_scatterer_is_reciprocal_and_dipoles_lose_what_points_along_the_sight(
    x: float, y: float, z: float
) -> None:
    bush = Bush("b", (0.0, 9.0, -1.0), 0.5, 20, 1.0, 3)
    antenna = np.array([x, y, z])
    centres, s = scatterers(Scene("b", bushes=(bush,)), antenna, WAVELENGTH)
    np.testing.assert_array_equal(s, s.transpose(0, 2, 1))
    # |S_hh + S_vv| = amplitude (1 - (d . k)^2): h and v complete the line of sight to a basis.
    cloud = bush_cloud(bush)
    sight = (centres - antenna) / np.linalg.norm(centres - antenna, axis=1, keepdims=True)
    along = np.sum(cloud.directions * sight, axis=1)
    np.testing.assert_allclose(np.trace(s, axis1=1, axis2=2).real, cloud.amplitude * (1 - along**2), atol=1e-12)


def test_order_and_number_depend_on_the_scene_alone_and_values_are_smooth() -> None:
    scene = Scene(
        "s",
        points=(Point("p", (1, 5, -1), np.array([[1, 0.1j], [0.1j, 0.9]])),),
        reflectors=(Reflector("t", "trihedral", (0, 8, -1), 0.6, 0.7, 0.5), Reflector("p", "plate", (2, 9, -1), 0.6)),
        bushes=(Bush("b", (0, 12, -1), 0.5, 5, 1.0),),
    )
    centres, s = scatterers(scene, (0.3, 0, 0), WAVELENGTH)
    other, t = scatterers(scene, (0.3 + 1e-6, 0, 0), WAVELENGTH)
    np.testing.assert_array_equal(centres, other)
    assert s.shape == t.shape == (8, 2, 2)
    np.testing.assert_array_equal(s[0], scene.points[0].scattering)
    # A micrometre changes angles by 1e-7; the steepest pattern here has 2 k L / R ~ 13 per metre of 10 sqrt(m^2).
    assert np.abs(s - t).max() < 1e-3


def test_empty_scene_and_mistakes() -> None:
    centres, s = scatterers(Scene("empty"), (0, 0, 0), WAVELENGTH)
    assert centres.shape == (0, 3)
    assert s.shape == (0, 2, 2)
    with pytest.raises(DataError, match="unknown kind"):
        reflector_scattering(Reflector("x", "cube", (0, 5, 0), 1.0), (0, 0, 0), WAVELENGTH)
    with pytest.raises(DataError, match="lies on a reflector"):
        reflector_scattering(Reflector("x", "plate", (0, 5, 0), 1.0), (0, 5, 0), WAVELENGTH)
    with pytest.raises(DataError, match="scatterers"):
        scatterers(Scene("b", bushes=(Bush("b", (0, 5, 0), 1.0, 0, 1.0),)), (0, 0, 0), WAVELENGTH)
