"""Polarizers against the thesis's tables, Malus' law and independent matrix algebra."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics.analyser import condition_number, least_squares, measurement_matrix, polarizer, transmittances

ANGLES = st.floats(-10, 10)
STANDARD = np.radians([0.0, 45.0, 90.0, 135.0])

# Thesis Table 2.1.
TABLE_2_1 = {
    "unpolarized": (1, 0, 0, 0),
    "horizontal": (1, 1, 0, 0),
    "vertical": (1, -1, 0, 0),
    "left circular": (1, 0, 0, -1),
    "right circular": (1, 0, 0, 1),
    "+45": (1, 0, 1, 0),
    "-45": (1, 0, -1, 0),
}

# Thesis Table 2.2, times two: the 3 x 3 block for S0, S1, S2.
TABLE_2_2 = {
    0: [[1, 1, 0], [1, 1, 0], [0, 0, 0]],
    90: [[1, -1, 0], [-1, 1, 0], [0, 0, 0]],
    45: [[1, 0, 1], [0, 0, 0], [1, 0, 1]],
    135: [[1, 0, -1], [0, 0, 0], [-1, 0, 1]],
}


@pytest.mark.parametrize("degrees", TABLE_2_2)
def test_mueller_matrices_are_those_of_table_2_2(degrees: int) -> None:
    matrix = polarizer(math.radians(degrees))
    np.testing.assert_allclose(2 * matrix[:3, :3], TABLE_2_2[degrees], atol=1e-15)
    assert np.all(matrix[3] == 0)
    assert np.all(matrix[:, 3] == 0)


def test_states_of_table_2_1_behind_each_polarizer() -> None:
    # Malus: a linear state passes its own polarizer wholly, the crossed one not at all, anything else by half.
    passed = {
        name: [float((polarizer(angle) @ np.array(state))[0]) for angle in STANDARD]
        for name, state in TABLE_2_1.items()
    }
    for name in ("unpolarized", "left circular", "right circular"):
        np.testing.assert_allclose(passed[name], 0.5, atol=1e-15)
    np.testing.assert_allclose(passed["horizontal"], [1, 0.5, 0, 0.5], atol=1e-15)
    np.testing.assert_allclose(passed["vertical"], [0, 0.5, 1, 0.5], atol=1e-15)
    np.testing.assert_allclose(passed["+45"], [0.5, 1, 0.5, 0], atol=1e-15)
    np.testing.assert_allclose(passed["-45"], [0.5, 0, 0.5, 1], atol=1e-15)


@given(ANGLES, ANGLES)
def test_two_polarizers_obey_malus(first: float, second: float) -> None:
    through = polarizer(second) @ polarizer(first) @ np.array([1.0, 0, 0, 0])
    assert through[0] == pytest.approx(0.5 * math.cos(second - first) ** 2, abs=1e-12)


@given(ANGLES, st.floats(0.1, 1), st.floats(0, 1))
def test_imperfect_polarizer_is_a_jones_matrix_squared(angle: float, q: float, share: float) -> None:
    # Independent road: thesis 2.32, M = A (J x J*) A^-1, with J = R(-t) diag(sqrt q, sqrt r) R(t).
    r = q * share
    c, s = math.cos(angle), math.sin(angle)
    rotation = np.array([[c, s], [-s, c]])
    jones = rotation.T @ np.diag([math.sqrt(q), math.sqrt(r)]) @ rotation
    a = np.array([[1, 0, 0, 1], [1, 0, 0, -1], [0, 1, 1, 0], [0, 1j, -1j, 0]])
    expected = a @ np.kron(jones, jones.conj()) @ np.linalg.inv(a)
    np.testing.assert_allclose(polarizer(angle, q, r), expected.real, atol=1e-12)


@given(st.lists(ANGLES, min_size=1, max_size=6), st.floats(1.001, 1e6))
def test_measurement_matrix_is_the_first_row_of_the_mueller_matrix(angles: list[float], ratio: float) -> None:
    q, r = transmittances(ratio)
    rows = measurement_matrix(angles, ratio)
    for angle, row in zip(angles, rows, strict=True):
        np.testing.assert_allclose(row, polarizer(angle, q, r)[0, :3], atol=1e-14)


def test_extinction_800_scales_dolp_by_799_801() -> None:
    # Equations, 2.18: an ideal solution applied to what an 800:1 polarizer passes sees DOLP times (E - 1) / (E + 1).
    stokes = np.array([1.0, 0.3, -0.4])
    seen = least_squares(measurement_matrix(STANDARD)) @ (measurement_matrix(STANDARD, 800.0) @ stokes)
    assert math.hypot(seen[1], seen[2]) / seen[0] == pytest.approx(0.5 * 799 / 801, rel=1e-14)
    corrected = least_squares(measurement_matrix(STANDARD, 800.0)) @ (measurement_matrix(STANDARD, 800.0) @ stokes)
    np.testing.assert_allclose(corrected, stokes, rtol=1e-13)


def test_four_angles_give_the_textbook_sums() -> None:
    # Thesis 6.1 to 6.3: S0 = sum / 2, S1 = I0 - I90, S2 = I45 - I135.
    expected = [[0.5, 0.5, 0.5, 0.5], [1, 0, -1, 0], [0, 1, 0, -1]]
    np.testing.assert_allclose(least_squares(measurement_matrix(STANDARD)), expected, atol=1e-14)


@pytest.mark.parametrize(
    ("degrees", "condition"),
    # Closed forms: W^T W is diagonal for evenly spread angles: sqrt(2); for 0, 45, 90 the eigenvalues give 1 + sqrt(2).
    [((0, 45, 90, 135), math.sqrt(2)), ((0, 60, 120), math.sqrt(2)), ((0, 45, 90), 1 + math.sqrt(2))],
)
def test_condition_numbers(degrees: tuple[float, ...], condition: float) -> None:
    assert condition_number(measurement_matrix(np.radians(degrees))) == pytest.approx(condition, rel=1e-12)


@pytest.mark.parametrize(
    "degrees", [(0, 90), (0, 90, 180, 270), (0, 0, 0), (0, 1, 2), (0, 1, 90), (0, 180, 45), (10,), ()]
)
def test_angles_that_do_not_determine_the_stokes_vector_are_refused(degrees: tuple[float, ...]) -> None:
    with pytest.raises(DataError, match="condition number"):
        least_squares(measurement_matrix(np.radians(np.asarray(degrees, dtype=float))))


@pytest.mark.parametrize("ratio", [1.0, 0.5, 0.0, -3.0, float("nan")])
def test_what_does_not_polarize_is_refused(ratio: float) -> None:
    with pytest.raises(DataError, match="does not polarize"):
        measurement_matrix(STANDARD, ratio)


def test_an_undefined_angle_is_refused() -> None:
    with pytest.raises(DataError, match="not a finite number"):
        measurement_matrix([0.0, math.nan, 1.0])


@pytest.mark.parametrize("weights", [(1, 1, 1), (1, 0, 1, 1), (1, -1, 1, 1), (1, math.inf, 1, 1)])
def test_bad_weights_are_refused(weights: tuple[float, ...]) -> None:
    with pytest.raises(DataError, match="weights"):
        least_squares(measurement_matrix(STANDARD), weights)


def test_weights_are_those_of_repeated_rows() -> None:
    # Two frames at an angle are two equal rows: the weighted solution, spread over them, is the unweighted one.
    degrees = np.radians([0.0, 50.0, 110.0, 150.0])
    counts = [1, 3, 2, 1]
    repeated = least_squares(measurement_matrix(np.repeat(degrees, counts)))
    summed = np.add.reduceat(repeated, np.cumsum([0, *counts[:-1]]), axis=1)
    np.testing.assert_allclose(least_squares(measurement_matrix(degrees), counts), summed, atol=1e-14)


@given(
    st.lists(st.floats(0, math.pi), min_size=4, max_size=7),
    st.floats(-math.pi, math.pi),
    st.floats(2, 1e5),
    st.floats(-1, 1),
    st.floats(-1, 1),
)
def test_turning_the_polarizer_by_t_turns_s1_s2_by_two_t(
    angles: list[float], turn: float, ratio: float, s1: float, s2: float
) -> None:
    matrix = measurement_matrix(angles, ratio)
    if condition_number(matrix) > 40:
        return
    light = matrix @ np.array([2.0, s1, s2])
    seen = least_squares(measurement_matrix(np.asarray(angles) + turn, ratio)) @ light
    c, s = math.cos(2 * turn), math.sin(2 * turn)
    # Condition 40 loses at most two digits of sixteen.
    np.testing.assert_allclose(seen, [2.0, c * s1 - s * s2, s * s1 + c * s2], atol=1e-11)
