"""Linearity and flat field against sensors that are made up with known ones."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics.flat import Corrections, Linearity, fit_linearity, flat_field
from processing.optics.mosaic import parse_mosaic, through_mosaic
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stokes import stokes_image


def counts_of(light: np.ndarray, linearity: Linearity) -> np.ndarray:
    """The counts that a sensor of that linearity gives: the inverse, by Newton's method."""
    x = light.copy()
    for _ in range(50):
        x -= (linearity.light(x) - light) / linearity.slope(x)
    return x


def test_a_made_up_sensor_is_found_and_undone() -> None:
    truth = Linearity((1.5e-6, -2e-12), 6e4)
    exposures = np.linspace(0.5e-3, 10e-3, 12)
    counts = counts_of(5.6e6 * exposures, truth)
    found = fit_linearity(counts, exposures)
    # The truth is in the family that is fitted, so what is left is rounding.
    np.testing.assert_allclose(found.coefficients, truth.coefficients, rtol=1e-6)
    assert found.residual < 1e-9
    np.testing.assert_allclose(found.light(counts), 5.6e6 * exposures, rtol=1e-6)


def test_a_linear_sensor_needs_no_coefficients_beyond_noise() -> None:
    exposures = np.geomspace(1e-3, 1e-1, 10)
    counts = 6e5 * exposures * (1 + np.random.default_rng(0).normal(0, 1e-4, 10))
    found = fit_linearity(counts, exposures)
    assert np.max(np.abs(found.light(counts) / counts - 1)) < 1e-3


@given(st.floats(-1e-6, 1e-6), st.floats(0, 6e4))
def test_slope_is_the_derivative(c1: float, x: float) -> None:
    linearity = Linearity((c1, 1e-12))
    step = 1e-2
    numeric = (linearity.light(x + step) - linearity.light(x - step)) / (2 * step)
    # Central differences of numbers up to 6e4 over 0.02: rounding of 1e-11 / 0.02; at 0 the two sides differ.
    if x > step:
        assert linearity.slope(x) == pytest.approx(numeric, abs=1e-7)


def test_negative_counts_are_noise_and_stay() -> None:
    assert Linearity((1e-3,)).light(-5.0) == -5.0


@pytest.mark.parametrize(
    ("counts", "exposures"),
    [([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]), ([1.0, 2, 3, 4], [1.0, 1, 2, 3]), ([1.0, 2, 0, 4], [1.0, 2, 3, 4])],
)
def test_series_that_say_nothing_of_linearity_are_refused(counts: list[float], exposures: list[float]) -> None:
    with pytest.raises(DataError):
        fit_linearity(counts, exposures)


def test_light_that_falls_with_counts_is_refused() -> None:
    with pytest.raises(DataError, match="falls"):
        Linearity((-1e-4,), 6e4)
    with pytest.raises(DataError, match="finite"):
        Linearity((math.nan,))


def test_a_flat_field_is_the_vignette_that_was_put_in() -> None:
    y, x = np.mgrid[-1:1:60j, -1:1:80j]
    vignette = 1 / (1 + 0.6 * (x**2 + y**2))
    vignette /= vignette.mean()
    found = flat_field(3e4 * vignette)
    np.testing.assert_allclose(found, vignette, rtol=1e-12)
    light, response = Corrections(flat=found).apply((2e4 * vignette)[None])
    np.testing.assert_allclose(light, 2e4, rtol=1e-12)
    assert response is not None
    np.testing.assert_allclose(response, vignette, rtol=1e-12)


def test_a_polarized_source_does_not_enter_the_flat_field_of_a_mosaic() -> None:
    mosaic = parse_mosaic("90-45-135-0")
    stokes = np.empty((3, 20, 24))
    stokes[:] = np.array([4e4, 1.5e4, -5e3])[:, None, None]
    found = flat_field(through_mosaic(stokes, mosaic), mosaic)
    np.testing.assert_allclose(found, 1.0, rtol=1e-12)


def test_dead_and_hot_pixels_are_undefined() -> None:
    light = np.full((8, 10), 1e4)
    light[2, 3], light[5, 6], light[7, 0] = 10.0, 1e6, np.nan
    found = flat_field(light)
    assert list(zip(*np.nonzero(np.isnan(found)), strict=True)) == [(2, 3), (5, 6), (7, 0)]
    corrected, response = Corrections(flat=found).apply(np.full((4, 8, 10), 500.0))
    assert np.isnan(corrected[:, 2, 3]).all()
    assert response is not None
    assert np.isfinite(response).all()


def test_errors_follow_the_flat_field() -> None:
    # Counts are the sensor's; where its response is half, the same light has half the counts and, for shot noise of
    # read-noise-free pixels, light known to sqrt(2) times as large an sd.
    of = PolarizerSeries(tuple(np.radians([0.0, 45, 90, 135])), (1,) * 4, (0.0,) * 4, noise=SensorNoise(5.0, 1.0))
    response = np.array([[1.0, 0.5]])
    draws = 30_000
    random = np.random.default_rng(1)
    mean = (of.matrix @ np.array([2e3, 600.0, 0.0]))[:, None, None] * np.repeat(response, draws, axis=0).T[None]
    counts = np.rint(random.poisson(mean) + random.normal(0, 5.0, mean.shape))
    gain = np.repeat(response, draws, axis=0).T
    image = stokes_image(counts / gain, np.zeros(gain.shape, bool), of, response=gain)
    for row in range(2):
        for name in ("s0", "dolp"):
            spread = float(np.std(getattr(image, name)[row], dtype=np.float64))
            told = float(np.mean(getattr(image, f"{name}_sd")[row], dtype=np.float64))
            # An sd of 30,000 draws is known to 0.4 %; first order costs 1 % at an SNR of 30.
            assert told == pytest.approx(spread, rel=0.025)


def test_nothing_to_correct_changes_nothing() -> None:
    counts = np.random.default_rng(0).normal(100, 5, (4, 3, 3))
    light, response = Corrections().apply(counts)
    np.testing.assert_array_equal(light, counts)
    assert response is None


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(DataError, match="flat field has shape"):
        Corrections(flat=np.ones((3, 3))).apply(np.ones((4, 3, 4)))
    with pytest.raises(DataError, match="flat field has shape"):
        flat_field(np.ones(5))
    with pytest.raises(DataError, match="no light"):
        flat_field(np.zeros((4, 4)))
