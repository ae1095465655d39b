"""Stokes, Jones and Mueller calculus against the thesis's tables, each other and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics import analyser, jones, mueller, stokes_vectors

ANGLES = st.floats(-10.0, 10.0)
_PART = st.floats(-1.0, 1.0)
JONES = st.lists(_PART, min_size=8, max_size=8).map(lambda x: (np.array(x[:4]) + 1j * np.array(x[4:])).reshape(2, 2))


@pytest.mark.parametrize("name", list(jones.STATES))
def test_jones_states_of_table_2_3_are_the_stokes_states_of_table_2_1(name: str) -> None:
    np.testing.assert_allclose(jones.stokes(jones.STATES[name]), stokes_vectors.STATES[name], atol=1e-15)


@given(ANGLES)
def test_mueller_matrix_of_a_polarizer_by_2_32_is_2_18(angle: float) -> None:
    np.testing.assert_allclose(jones.mueller(jones.polarizer(angle)), analyser.polarizer(angle), atol=1e-14)


@given(ANGLES, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_imperfect_polarizer_by_2_32_is_goldsteins(angle: float, q: float, r: float) -> None:
    np.testing.assert_allclose(jones.mueller(jones.polarizer(angle, q, r)), mueller.polarizer(angle, q, r), atol=1e-14)


@given(JONES, JONES)
def test_the_mueller_matrix_follows_the_field(first: np.ndarray, second: np.ndarray) -> None:
    field = np.array([0.6, 0.8j])
    # Two elements on a field, and their Mueller matrices on its Stokes vector (2.26 to 2.31, 2.17).
    by_field = jones.stokes(second @ first @ field)
    by_stokes = mueller.chain(jones.mueller(first), jones.mueller(second)) @ jones.stokes(field)
    np.testing.assert_allclose(by_stokes, by_field, atol=1e-12)


def test_quarter_wave_plate_makes_circular_light() -> None:
    # Fast axis at 0 on +45 degrees: S3 = -1 (the convention of pypolar and polanalyser).
    out = mueller.retarder(0.0, math.pi / 2) @ np.array(stokes_vectors.STATES["+45"])
    np.testing.assert_allclose(out, stokes_vectors.STATES["LHC"], atol=1e-15)


def test_half_wave_plate_mirrors_the_plane_of_polarization() -> None:
    out = mueller.retarder(math.radians(22.5), math.pi) @ stokes_vectors.linear(0.1)
    np.testing.assert_allclose(out, stokes_vectors.linear(math.radians(45.0) - 0.1), atol=1e-15)


@given(ANGLES, ANGLES)
def test_turning_an_element_is_turning_its_axis(axis: float, angle: float) -> None:
    np.testing.assert_allclose(
        mueller.turned(mueller.retarder(axis, 1.1), angle), mueller.retarder(axis + angle, 1.1), atol=1e-13
    )


def test_imperfect_retarder_without_imperfection_is_the_retarder() -> None:
    np.testing.assert_allclose(mueller.imperfect_retarder(0.3, 1.0, 1.0, 1.0), mueller.retarder(0.3, 1.0), atol=1e-15)


@given(JONES)
def test_matrices_with_a_jones_matrix_have_one_eigenvalue(matrix: np.ndarray) -> None:
    m = jones.mueller(matrix)
    values = mueller.eigenvalues(m)
    np.testing.assert_allclose(values, [m[0, 0], 0, 0, 0], atol=1e-14)
    assert mueller.is_realizable(m)
    found = jones.of_mueller(m)
    np.testing.assert_allclose(jones.mueller(found), m, atol=1e-12)
    assert np.isclose(np.sum(mueller.eigenvalues(m)), m[0, 0], atol=1e-14)


def test_cloudes_eigenvalues_of_known_matrices() -> None:
    # The ideal depolarizer is the equal mixture of four; diag(1, 1, 1, -1) (a mirror of hands) is none.
    np.testing.assert_allclose(mueller.eigenvalues(np.diag([1.0, 0, 0, 0])), [0.25] * 4, atol=1e-15)
    np.testing.assert_allclose(mueller.eigenvalues(np.diag([1.0, 1, 1, -1])), [0.5, 0.5, 0.5, -0.5], atol=1e-15)
    assert not mueller.is_realizable(np.diag([1.0, 1, 1, -1]))


def test_nearest_realizable_leaves_realizable_matrices_and_mends_others() -> None:
    good = 0.5 * mueller.retarder(0.2, 0.7) + 0.3 * mueller.polarizer(1.0)
    np.testing.assert_allclose(mueller.nearest_realizable(good), good, atol=1e-14)
    mended = mueller.nearest_realizable(np.diag([1.0, 1, 1, -1]))
    assert mueller.is_realizable(mended)
    np.testing.assert_allclose(mueller.eigenvalues(mended), [0.5, 0.5, 0.5, 0.0], atol=1e-14)


def test_depolarizer_refuses_what_cannot_be() -> None:
    np.testing.assert_array_equal(mueller.depolarizer(0.0), np.diag([1.0, 0, 0, 0]))
    with pytest.raises(DataError, match="light that cannot be"):
        mueller.depolarizer(1.0, 1.0, -1.0)


def test_measures_of_known_elements() -> None:
    # A polarizer of extinction e has diattenuation (e - 1) / (e + 1): 799 / 801 for 800 (2.18).
    m = mueller.polarizer(0.4, *analyser.transmittances(800.0))
    assert mueller.diattenuation(m) == pytest.approx(799 / 801, rel=1e-14)
    assert mueller.polarizance(m) == pytest.approx(mueller.extinction_scale(800.0), rel=1e-14)
    assert mueller.extinction_scale(math.inf) == 1.0
    assert mueller.depolarization_index(m) == pytest.approx(1.0, rel=1e-14)
    assert mueller.depolarization_index(np.diag([1.0, 0, 0, 0])) == 0.0


@given(ANGLES, st.floats(0.0, 1.0), st.floats(-0.78, 0.78))
def test_degrees_and_angles_are_what_made_the_state(angle: float, degree: float, chi: float) -> None:
    # A state from its angles on the Poincare sphere.
    s = np.array(
        [
            2.0,
            2 * degree * math.cos(2 * chi) * math.cos(2 * angle),
            2 * degree * math.cos(2 * chi) * math.sin(2 * angle),
            2 * degree * math.sin(2 * chi),
        ]
    )
    assert stokes_vectors.dop(s) == pytest.approx(degree, abs=1e-12)
    assert stokes_vectors.dolp(s) == pytest.approx(degree * math.cos(2 * chi), abs=1e-12)
    assert stokes_vectors.docp(s) == pytest.approx(degree * math.sin(2 * chi), abs=1e-12)
    assert stokes_vectors.is_physical(s, 1e-9)
    if degree > 1e-3:
        assert stokes_vectors.ellipticity(s) == pytest.approx(chi, abs=1e-9)
        found = float(stokes_vectors.aop(s))
        assert -math.pi / 2 < found <= math.pi / 2
        assert abs(math.sin(found - angle)) < 1e-6


def test_light_without_intensity_or_polarization_has_no_angle() -> None:
    assert np.isnan(stokes_vectors.dolp(np.zeros(4)))
    assert np.isnan(stokes_vectors.aop([1.0, 0, 0, 0.5]))
    assert np.isnan(stokes_vectors.ellipticity([1.0, 0, 0, 0]))
    assert not stokes_vectors.is_physical([1.0, 1.0, 0.5, 0])
    assert stokes_vectors.aop([1.0, -1.0, -0.0, 0]) == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    "call",
    [
        lambda: stokes_vectors.dolp([1.0, 0.0, 0.0]),
        lambda: mueller.checked(np.eye(3)),
        lambda: jones.stokes([1.0, 0.0, 0.0]),
        lambda: mueller.chain(),
        lambda: jones.polarizer(0.0, 1.2),
        lambda: jones.polarizer(math.inf),
        lambda: mueller.extinction_scale(1.0),
    ],
)
def test_what_is_no_light_or_matter_is_refused(call) -> None:
    with pytest.raises(DataError):
        call()
