"""Pauli and lexicographic vectors, canonical targets, and what they say in Stokes terms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from processing.polarimetry import pauli, targets

parts = st.floats(-10, 10)
complexes = st.builds(complex, parts, parts)
angles = st.floats(-np.pi, np.pi)


def unitary(data: list[complex]) -> np.ndarray:
    q, _ = np.linalg.qr(np.array(data).reshape(2, 2) + 20 * np.eye(2))
    return q


@pytest.mark.parametrize(
    ("matrix", "vector"),
    [
        # Cloude and Pottier 1996: unit-amplitude canonical targets.
        (targets.trihedral(), [np.sqrt(2), 0, 0]),
        (targets.dihedral(0.0), [0, np.sqrt(2), 0]),
        (targets.dihedral(np.pi / 4), [0, 0, np.sqrt(2)]),
        (targets.dipole(0.0), [1 / np.sqrt(2), 1 / np.sqrt(2), 0]),
        (targets.dipole(np.pi / 2), [1 / np.sqrt(2), -1 / np.sqrt(2), 0]),
        (targets.helix("left"), [0, 1 / np.sqrt(2), 1j / np.sqrt(2)]),
        (targets.helix("right"), [0, 1 / np.sqrt(2), -1j / np.sqrt(2)]),
    ],
)
def test_canonical_targets(matrix: np.ndarray, vector: list[complex]) -> None:
    np.testing.assert_allclose(pauli.pauli_of_matrix(matrix), vector, atol=1e-12)


def test_thesis_matrices() -> None:
    # Thesis 5.12.
    np.testing.assert_array_equal(targets.trihedral(), [[1, 0], [0, 1]])
    np.testing.assert_array_equal(targets.dihedral(), [[1, 0], [0, -1]])


@given(complexes, complexes, complexes)
def test_pauli_and_matrix_are_inverse(hh: complex, hv: complex, vv: complex) -> None:
    s = np.array([[hh, hv], [hv, vv]])
    np.testing.assert_allclose(pauli.matrix_of_pauli(pauli.pauli_of_matrix(s)), s, atol=1e-12)


@given(arrays(np.float64, (2, 3, 4), elements=parts))
def test_span_is_the_frobenius_norm_in_every_basis(values: np.ndarray) -> None:
    hh, hv, vv = values[0] + 1j * values[1]
    expected = np.abs(hh) ** 2 + 2 * np.abs(hv) ** 2 + np.abs(vv) ** 2
    np.testing.assert_allclose(pauli.span(pauli.pauli_vector(hh, hv, vv)), expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(pauli.span(pauli.lexicographic_vector(hh, hv, vv)), expected, rtol=1e-12, atol=1e-12)


@given(complexes, complexes, complexes, st.lists(complexes, min_size=4, max_size=4))
def test_span_is_invariant_under_a_change_of_polarization_basis(hh, hv, vv, data) -> None:
    # Backscatter alignment: S' = U^T S U for a unitary U keeps the Frobenius norm and the symmetry.
    s, u = np.array([[hh, hv], [hv, vv]]), unitary(data)
    before, after = (pauli.span(pauli.pauli_of_matrix(m)) for m in (s, u.T @ s @ u))
    assert after == pytest.approx(before, rel=1e-10, abs=1e-10)


@given(complexes, complexes, complexes, angles)
def test_turning_keeps_odd_bounce_and_mixes_the_other_two(hh, hv, vv, angle) -> None:
    s = np.array([[hh, hv], [hv, vv]])
    k, turned = pauli.pauli_of_matrix(s), pauli.pauli_of_matrix(targets.turned(s, angle))
    c, d = np.cos(2 * angle), np.sin(2 * angle)
    np.testing.assert_allclose(turned, [k[0], c * k[1] - d * k[2], d * k[1] + c * k[2]], atol=1e-11)


def test_a_turned_dihedral_is_a_dihedral_with_a_turned_fold() -> None:
    np.testing.assert_allclose(targets.turned(targets.dihedral(0.1), 0.3), targets.dihedral(0.4), atol=1e-12)
    np.testing.assert_allclose(targets.turned(targets.dipole(0.1), 0.3), targets.dipole(0.4), atol=1e-12)


def test_display_order() -> None:
    hh, hv, vv = 3 + 1j, 0.5j, -1 + 2j
    shown = pauli.display_components(pauli.pauli_vector(hh, hv, vv))
    np.testing.assert_allclose(shown, [abs(hh - vv), abs(hv), abs(hh + vv)], rtol=1e-12)


@given(complexes, complexes, complexes)
def test_equivalent_stokes_is_the_first_column_of_the_mueller_matrix(hh, hv, vv) -> None:
    # Thesis 2.25 and 2.32: M = A (J x J*) A^-1.
    s = np.array([[hh, hv], [hv, vv]])
    a = np.array([[1, 0, 0, 1], [1, 0, 0, -1], [0, 1, 1, 0], [0, 1j, -1j, 0]])
    mueller = (a @ np.kron(s, s.conj()) @ a.conj().T / 2).real
    k = pauli.pauli_of_matrix(s)
    found = pauli.equivalent_stokes(pauli.coherency_matrix(k))
    np.testing.assert_allclose(found, mueller[:3, 0], rtol=1e-10, atol=1e-10)


def test_dolp_of_targets_and_of_received_powers() -> None:
    def dolp(matrix: np.ndarray) -> float:
        return float(pauli.equivalent_dolp(pauli.coherency_matrix(pauli.pauli_of_matrix(matrix))))

    # A dihedral has the largest |HH - VV| and no DOLP; a dipole polarizes wholly.
    assert dolp(targets.trihedral()) == pytest.approx(0, abs=1e-12)
    assert dolp(targets.dihedral(0.2)) == pytest.approx(0, abs=1e-12)
    assert dolp(targets.dipole(0.7)) == pytest.approx(1, abs=1e-12)
    # Thesis 5.5 and 6.9: VV/HH = 0.43 (dihedral) and 0.80 (trihedral) give (1 - r) / (1 + r) = 0.399 and 0.111.
    assert pauli.received_power_dolp(1.0, 0.0, 0.0, 0.43) == pytest.approx(0.399, abs=5e-4)
    assert pauli.received_power_dolp(1.0, 0.0, 0.0, 0.80) == pytest.approx(0.111, abs=5e-4)
    assert np.isnan(pauli.received_power_dolp(0.0, 0.0, 0.0, 0.0))
    # Names are transmit-then-receive: VH is received with H and counts with HH (6.6).
    assert pauli.received_power_dolp(0.0, 0.0, 1.0, 0.0) == 1.0


def test_received_powers_cannot_tell_a_dihedral_from_a_trihedral() -> None:
    for target, amplitudes in ((targets.dihedral(), [2, 0, 0]), (targets.trihedral(), [0, 0, 2])):
        np.testing.assert_allclose(pauli.display_components(pauli.pauli_of_matrix(target)), amplitudes, atol=1e-12)
        power = np.abs(target) ** 2
        found = pauli.received_power_components(power[0, 0], power[0, 1], power[1, 1])
        np.testing.assert_allclose(found, [0, 0, 2], atol=1e-12)


def test_received_power_components_of_the_thesis_dihedral() -> None:
    # Thesis 5.14 and 6.14: HH = 1, VV = 0.43 of received power.
    np.testing.assert_allclose(pauli.received_power_components(1.0, 0.1, 0.43), [0.57, 0.1, 1.43])


def test_undefined_pixels() -> None:
    k = pauli.pauli_vector([1.0, np.nan], [0.0, 0.0], [1.0, 1.0])
    assert np.isnan(pauli.span(k)[1])
    np.testing.assert_allclose(pauli.coherency_matrix(k)[0, 0], 2.0)
    assert np.isnan(pauli.coherency_matrix(np.full((3, 2), np.nan))).all()
