"""Fresnel's amplitudes and thin films against other forms, and the scalar kernels against the arrays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics import fresnel, jones, mueller

ALUMINIUM = 1.02 + 6.84j
INDICES = st.tuples(st.floats(0.05, 8.0), st.floats(0.0, 12.0)).map(lambda x: complex(*x))
COSINES = st.floats(0.0, 1.0)


@pytest.mark.parametrize("n", [1.33, 1.5, 2.4])
def test_reflectances_of_dielectrics_in_the_form_of_sines_and_tangents(n: float) -> None:
    # Born and Wolf, 1.5.2, (21a): an independent form, singular only at normal incidence.
    angle = np.radians(np.linspace(0.5, 89.5, 90))
    inside = np.arcsin(np.sin(angle) / n)
    s, p = fresnel.reflectances(n, np.cos(angle))
    np.testing.assert_allclose(s, (np.sin(angle - inside) / np.sin(angle + inside)) ** 2, atol=1e-13)
    np.testing.assert_allclose(p, (np.tan(angle - inside) / np.tan(angle + inside)) ** 2, atol=1e-13)


def test_aluminium_of_the_thesis_polarizes_as_its_table_says() -> None:
    # (Rs - Rp) / (Rs + Rp) at 0, 30, 60, 75 degrees for n = 1.02, k = 6.84 (thesis 4.6, Fig. 4.14).
    s, p = fresnel.reflectances(ALUMINIUM, np.cos(np.radians([0, 30, 60, 75])))
    np.testing.assert_allclose((s - p) / (s + p), [0, 0.0122, 0.0598, 0.118], atol=5e-4)


@pytest.mark.parametrize("n", [1.2, 1.5, 3.5])
def test_nothing_of_p_is_reflected_at_brewsters_angle(n: float) -> None:
    s, p = fresnel.reflectances(n, math.cos(fresnel.brewster(n)))
    assert p < 1e-30
    # There s is ((n^2 - 1) / (n^2 + 1))^2.
    assert s == pytest.approx(((n * n - 1) / (n * n + 1)) ** 2, rel=1e-13)


@pytest.mark.parametrize("n", [1.0, 1.5, ALUMINIUM])
def test_limits_of_incidence(n: complex) -> None:
    ss, pp = fresnel.amplitudes(n, 1.0)
    assert ss == pytest.approx((1 - n) / (1 + n), abs=1e-15)
    assert pp == pytest.approx(-ss, abs=1e-15)
    s, p = fresnel.reflectances(n, 0.0)
    expected = 0.0 if n == 1 else 1.0
    assert (s, p) == (pytest.approx(expected), pytest.approx(expected))


@given(INDICES, COSINES)
def test_no_surface_returns_more_than_it_gets(n: complex, cosine: float) -> None:
    s, p = fresnel.reflectances(n, cosine)
    assert -1e-15 <= s <= 1 + 1e-12
    assert -1e-15 <= p <= 1 + 1e-12


@settings(deadline=None)
@example(1 + 0j, 0.0, (1.0, 1.0), 2.2250738585e-313)  # denormal numbers over denormal ones
@example(1 + 0j, 0.0, (1.0, 1.0), 1e-289)
@given(INDICES, COSINES, st.tuples(st.floats(1.0, 4.0), st.floats(0.0, 3.0)), st.floats(0.0, 3.0))
def test_scalars_are_the_arrays(n: complex, cosine: float, film: tuple[float, float], thickness: float) -> None:
    expected = fresnel.film_amplitudes(n, cosine, complex(*film), thickness)
    found = fresnel.amplitudes_kernel(n, cosine, complex(*film), thickness)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    bare = fresnel.amplitudes_kernel(n, cosine, 1.0 + 0j, 0.0)
    np.testing.assert_allclose(bare, fresnel.amplitudes(n, cosine), atol=1e-9)


@given(st.floats(0.05, 1.0), st.floats(0.0, 2.0))
def test_films_by_their_characteristic_matrix(cosine: float, thickness: float) -> None:
    # Born and Wolf 1.6.2: a layer turns (E, H) by [[cos d, -i sin d / q], [-i q sin d, cos d]], for fields exp(-i w t);
    # q is the admittance, n cos for s and cos / n for p.
    film, medium = 1.38 + 0.02j, ALUMINIUM
    sine2 = 1 - cosine**2
    cosines = [cosine, np.sqrt(1 - sine2 / film**2), np.sqrt(1 - sine2 / medium**2)]
    phase = 2 * np.pi * thickness * film * cosines[1]
    found = fresnel.film_amplitudes(medium, cosine, film, thickness)
    for index, kind in enumerate("sp"):
        q = [n * c if kind == "s" else c / n for n, c in zip((1.0, film, medium), cosines, strict=True)]
        layer = np.array([[np.cos(phase), -1j * np.sin(phase) / q[1]], [-1j * q[1] * np.sin(phase), np.cos(phase)]])
        top, bottom = layer @ np.array([1.0, q[2]])
        expected = (q[0] * top - bottom) / (q[0] * top + bottom)
        assert found[index] == pytest.approx(expected, abs=1e-12)


def test_quarter_wave_film_that_does_not_reflect() -> None:
    # Index sqrt(n), a quarter of the wave in it: no reflection at normal incidence.
    ss, pp = fresnel.film_amplitudes(1.5, 1.0, math.sqrt(1.5), 0.25 / math.sqrt(1.5))
    assert abs(ss) < 1e-15
    assert abs(pp) < 1e-15
    # Of no thickness it is not there.
    np.testing.assert_allclose(
        fresnel.film_amplitudes(ALUMINIUM, 0.4, 1.38, 0.0), fresnel.amplitudes(ALUMINIUM, 0.4), atol=1e-14
    )


def test_mueller_matrix_of_reflection_is_that_of_its_jones_matrix() -> None:
    ss, pp = fresnel.amplitudes(ALUMINIUM, 0.3)
    expected = jones.mueller(np.diag([ss, pp]))
    np.testing.assert_allclose(fresnel.reflection_mueller(ss, pp), expected, atol=1e-15)
    assert mueller.is_realizable(expected)


@pytest.mark.parametrize(("n", "cosine"), [(-1.5, 0.5), (1.5 - 1j, 0.5), (0.0, 0.5), (1.5, 1.1), (1.5, -0.1)])
def test_what_is_no_index_or_angle_is_refused(n: complex, cosine: float) -> None:
    with pytest.raises(DataError):
        fresnel.amplitudes(n, cosine)


def test_no_brewster_angle_and_no_film_of_negative_thickness() -> None:
    with pytest.raises(DataError):
        fresnel.brewster(-1.5)
    with pytest.raises(DataError):
        fresnel.film_amplitudes(1.5, 0.5, 1.3, -0.1)
