"""Matrix images: planes and matrices, changes of basis, eigenvectors, window averages, Mueller and Kennaugh views."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from processing.errors import DataError
from processing.polarimetry import matrices, signatures, targets
from processing.polarimetry.averaging import window_average, window_average_reference
from processing.polarimetry.eigen import hermitian_eigen_of
from processing.polarimetry.pauli import equivalent_dolp, lexicographic_vector, pauli_of_matrix, span

parts = st.floats(-10, 10, allow_subnormal=False)
angles = st.floats(-np.pi, np.pi)
scatterers = arrays(np.float64, (2, 3), elements=parts).map(lambda v: (v[0] + 1j * v[1])[np.array([[0, 1], [1, 2]])])


def random_coherency(looks: int, *, seed: int = 0, count: int = 200) -> np.ndarray:
    rng = np.random.default_rng(seed)
    k = rng.normal(size=(count, 3, looks)) + 1j * rng.normal(size=(count, 3, looks))
    return k @ k.conj().swapaxes(1, 2) / looks


def lexicographic(s: np.ndarray) -> np.ndarray:
    return lexicographic_vector(s[0, 0], s[0, 1], s[1, 1])


def test_planes_and_matrices_are_inverse() -> None:
    t = random_coherency(4)
    np.testing.assert_allclose(matrices.matrix_of_planes(matrices.planes_of_matrix(t)), t, atol=1e-14)


@given(scatterers)
@settings(max_examples=50, deadline=None)
def test_covariance_of_coherency_is_that_of_the_lexicographic_vector(s: np.ndarray) -> None:
    # Definition: C = <w w^H> with w = (hh, sqrt 2 hv, vv); T = <k k^H>.
    t = matrices.planes_of_vector(pauli_of_matrix(s)[:, None, None])
    w = lexicographic(s)
    c = matrices.covariance_of_coherency(t)
    np.testing.assert_allclose(matrices.matrix_of_planes(c)[0, 0], np.outer(w, w.conj()), atol=1e-11)
    np.testing.assert_allclose(matrices.coherency_of_covariance(c), t, atol=1e-11)
    np.testing.assert_allclose(matrices.total_power(t)[0, 0], span(w), atol=1e-10)


@given(scatterers, angles)
@settings(max_examples=50, deadline=None)
def test_a_turned_target_has_a_turned_coherency(s: np.ndarray, angle: float) -> None:
    k, turned = pauli_of_matrix(s), pauli_of_matrix(targets.turned(s, angle))
    t = matrices.coherency_turned(np.outer(k, k.conj()), angle)
    np.testing.assert_allclose(t, np.outer(turned, turned.conj()), atol=1e-10)


@given(scatterers, angles, st.floats(-np.pi / 4, np.pi / 4))
@settings(max_examples=50, deadline=None)
def test_a_unitary_basis_keeps_the_span(s: np.ndarray, orientation: float, ellipticity: float) -> None:
    basis = matrices.basis_vectors(orientation, ellipticity)
    np.testing.assert_allclose(basis.conj().T @ basis, np.eye(2), atol=1e-14)
    there = matrices.scattering_in_basis(s, basis)
    np.testing.assert_allclose(span(lexicographic(there)), span(lexicographic(s)), rtol=1e-12, atol=1e-10)
    w, seen = lexicographic(s), lexicographic(there)
    c = matrices.covariance_in_basis(np.outer(w, w.conj()), basis)
    np.testing.assert_allclose(c, np.outer(seen, seen.conj()), atol=1e-10)


def test_a_sphere_returns_circular_polarization_in_the_other_sense() -> None:
    # Textbook: a sphere has no co-polarized return in circular polarization, a dihedral no cross-polarized one.
    basis = matrices.basis_vectors(0.0, np.pi / 4)
    np.testing.assert_allclose(np.diag(matrices.scattering_in_basis(targets.trihedral(), basis)), 0, atol=1e-15)
    assert abs(matrices.scattering_in_basis(targets.dihedral(0.4), basis)[0, 1]) < 1e-15


@pytest.mark.parametrize(
    "t",
    [
        random_coherency(9),
        random_coherency(1),
        random_coherency(2),
        random_coherency(2) - random_coherency(2, seed=1),
        np.eye(3) + 1e-9 * random_coherency(4),
        1e-290 * random_coherency(4),
        1e200 * random_coherency(4),
        np.array([np.diag(d) for d in ([1.0, 1, 1], [2, 1, 1], [1, 1, 2], [0, 0, 3], [0, 0, 0], [1, 1e-6, 1e-12])]),
    ],
    ids=["nine looks", "rank 1", "rank 2", "indefinite", "nearly equal", "tiny", "huge", "diagonal"],
)
def test_eigenvalues_and_vectors_are_as_good_as_lapacks(t: np.ndarray) -> None:
    t = np.ascontiguousarray(t, dtype=np.complex128)
    values, vectors = hermitian_eigen_of(t)
    size = np.abs(t).max(axis=(1, 2))[:, None] + 1e-300
    # Backward stable: errors are a few units in the last place of the largest element.
    assert np.max(np.abs(values - np.linalg.eigvalsh(t)[:, ::-1]) / size) < 1e-14
    assert np.max(np.abs(t @ vectors - vectors * values[:, None, :]) / size[..., None]) < 1e-14
    np.testing.assert_allclose(vectors.conj().swapaxes(1, 2) @ vectors, np.broadcast_to(np.eye(3), t.shape), atol=1e-14)
    assert np.all(np.diff(values, axis=1) <= 1e-14 * size)


def noise(rows: int = 13, columns: int = 17, dtype: type = np.float64) -> np.ndarray:
    rng = np.random.default_rng(5)
    k = rng.normal(size=(3, rows, columns)) + 1j * rng.normal(size=(3, rows, columns))
    return matrices.planes_of_vector(k).astype(dtype)


@pytest.mark.parametrize("window", [1, 3, 7, 21])
def test_window_average_is_its_reference(window: int) -> None:
    planes = noise()
    planes[3, 4, 5] = np.nan
    planes[:, 9:, 12:] = np.nan
    np.testing.assert_allclose(window_average(planes, window), window_average_reference(planes, window), atol=1e-13)


def test_window_average_keeps_weak_pixels_beside_strong_ones() -> None:
    # 120 dB in one column: a running sum would leave 1e12 * 2.2e-16 = 2e-4 of error behind it.
    planes = np.ones((9, 4, 30))
    planes[:, :, 10] = 1e12
    np.testing.assert_array_equal(window_average(planes, 3)[:, :, 12:], 1.0)


def test_what_is_no_window_or_no_planes_is_refused() -> None:
    with pytest.raises(DataError, match="window of 4 pixels has no centre"):
        window_average(noise(), 4)
    with pytest.raises(DataError, match="nine real planes"):
        window_average(noise()[:8], 3)


@given(scatterers)
@settings(max_examples=40, deadline=None)
def test_mueller_and_kennaugh_matrices(s: np.ndarray) -> None:
    k = pauli_of_matrix(s)
    t = np.outer(k, k.conj())
    # Thesis 2.32: M = A (S x S*) A^-1 with A of 2.25.
    a = np.array([[1, 0, 0, 1], [1, 0, 0, -1], [0, 1, 1, 0], [0, 1j, -1j, 0]])
    mueller = (a @ np.kron(s, s.conj()) @ np.linalg.inv(a)).real
    np.testing.assert_allclose(signatures.mueller_of_coherency(t), mueller, atol=1e-10)
    kennaugh = signatures.kennaugh_of_coherency(t)
    np.testing.assert_allclose(kennaugh, kennaugh.T, atol=1e-10)
    np.testing.assert_allclose(signatures.coherency_of_kennaugh(kennaugh), t, atol=1e-10)
    # Its first column is what unpolarized light becomes (thesis 6.8).
    if mueller[0, 0] > 1e-3:
        dolp = np.hypot(mueller[1, 0], mueller[2, 0]) / mueller[0, 0]
        np.testing.assert_allclose(equivalent_dolp(t), dolp, atol=1e-9)


def test_signatures_are_returns_of_single_polarizations() -> None:
    s = np.array([[1 + 0.3j, 0.2 - 0.1j], [0.2 - 0.1j, -0.5 + 0.4j]])
    k = pauli_of_matrix(s)
    found = signatures.signature(np.outer(k, k.conj()), orientations=9, ellipticities=5)
    for row, chi in enumerate(found.ellipticity_rad):
        for column, psi in enumerate(found.orientation_rad):
            seen = matrices.scattering_in_basis(s, matrices.basis_vectors(psi, chi))
            np.testing.assert_allclose(found.co[row, column], abs(seen[0, 0]) ** 2, atol=1e-13)
            np.testing.assert_allclose(found.cross[row, column], abs(seen[1, 0]) ** 2, atol=1e-13)


def test_signature_of_a_trihedral() -> None:
    # Thesis Fig. 2.16 and van Zyl 1987: co-polarized return cos^2(2 chi), whatever the orientation; the rest is cross.
    found = signatures.signature(np.diag([2.0, 0, 0]))
    expected = np.broadcast_to(np.cos(2 * found.ellipticity_rad)[:, None] ** 2, found.co.shape)
    np.testing.assert_allclose(found.co, expected, atol=1e-14)
    np.testing.assert_allclose(found.cross, 1 - expected, atol=1e-14)
    with pytest.raises(DataError, match="without NaN"):
        signatures.signature(np.full((3, 3), np.nan))
