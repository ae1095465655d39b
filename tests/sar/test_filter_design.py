"""Filters of least error over a band, against brute force and what theory knows of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.sar.filter_design import (
    least_squares_polynomials,
    least_squares_weights,
    polynomial_error_db,
    polynomials_for,
)
from processing.sar.interpolation import sinc_weights


def error_power(weights, fraction, oversampling, frequencies=801):
    """Mean square error over the band, by plain summation."""
    cycles = np.linspace(-0.5, 0.5, frequencies) / oversampling
    taps = weights.shape[-1]
    waves = np.exp(2j * np.pi * np.outer(np.arange(1 - taps // 2, taps // 2 + 1), cycles))
    return np.mean(np.abs(weights @ waves - np.exp(2j * np.pi * np.outer(fraction, cycles))) ** 2)


@pytest.mark.parametrize("taps", [4, 6, 8, 12])
@pytest.mark.parametrize("oversampling", [1.25, 1.6, 2.0, 2.4])
def test_no_weights_nearby_are_better(taps, oversampling):
    fraction = np.array([0.13, 0.5, 0.8])
    best = least_squares_weights(fraction, taps, oversampling)
    least = error_power(best, fraction, oversampling)
    rng = np.random.default_rng(0)
    # In the least a change of size e adds e^2 times a positive form, and nothing linear in e.
    for _ in range(10):
        change = 1e-2 * rng.normal(size=best.shape)
        assert error_power(best + change, fraction, oversampling) > least
    assert least <= error_power(sinc_weights(fraction, taps, oversampling), fraction, oversampling)


def test_samples_are_passed_through_and_mirrored_places_have_mirrored_weights():
    at = least_squares_weights(0.0, 8, 2.0)
    np.testing.assert_allclose(at, [0, 0, 0, 1, 0, 0, 0, 0], atol=1e-8)
    x = np.linspace(0, 1, 11)
    weights = least_squares_weights(x, 8, 1.8)
    np.testing.assert_allclose(weights, weights[::-1, ::-1], atol=1e-9)


def test_polynomials_reach_what_free_weights_do():
    # A high degree leaves the same error as weights of any form; 0.1 dB for the places that are summed over.
    x = (np.arange(400) + 0.5) / 400
    free = 10 * np.log10(error_power(least_squares_weights(x, 8, 2.0), x, 2.0))
    polynomials = least_squares_polynomials(8, 2.0, 8)
    assert polynomial_error_db(polynomials, 2.0) == pytest.approx(free, abs=0.1)
    made = np.vander(x - 0.5, 9, increasing=True) @ polynomials
    assert 10 * np.log10(error_power(made, x, 2.0)) == pytest.approx(free, abs=0.1)
    # Each degree less costs something.
    errors = [polynomial_error_db(least_squares_polynomials(8, 4.0, degree), 4.0) for degree in range(6)]
    assert (np.diff(errors) < -4).all()


@settings(max_examples=25, deadline=None)
@given(oversampling=st.floats(1.0, 20.0), error_db=st.floats(-130, -20))
def test_the_lowest_degree_that_will_do_is_taken(oversampling, error_db):
    found = polynomials_for(8, oversampling, error_db)
    reached = polynomial_error_db(found, oversampling)
    best = polynomial_error_db(least_squares_polynomials(8, oversampling, 9), oversampling)
    assert reached <= max(error_db, best + 1.5) + 0.01
    if len(found) > 2:
        lower = least_squares_polynomials(8, oversampling, len(found) - 2)
        assert polynomial_error_db(lower, oversampling) > error_db
