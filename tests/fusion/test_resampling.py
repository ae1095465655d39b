"""Pictures between their pixels: closed forms of what splines do to waves and noise, and the degree that a tolerance
asks for against measured errors."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.planner_scenes import random_places
from polfuse_lab.trade.rows import relative_db
from processing.errors import DataError
from processing.fusion.resampling import DEGREES, noise_between, passed, power_between, sample_spline, spline_spectrum
from processing.fusion.resampling_planner import choose_resampling, resampling_errors_db


def test_spectra_by_hand() -> None:
    """B_3 = (2 + cos) / 3 and q_1 = B_3: straight lines between neighbours a and b have mean square
    (a^2 + ab + b^2) / 3. Samples of the cubic are 4/6 and 1/6."""
    nu = np.linspace(0, 0.5, 11)
    np.testing.assert_allclose(spline_spectrum(1, nu), 1.0)
    np.testing.assert_allclose(spline_spectrum(3, nu), (2 + np.cos(2 * np.pi * nu)) / 3, atol=1e-14)
    np.testing.assert_allclose(power_between(1, nu), (2 + np.cos(2 * np.pi * nu)) / 3, atol=1e-14)
    np.testing.assert_allclose(passed(1, nu), np.sinc(nu) ** 2, atol=1e-15)
    assert noise_between(1) == pytest.approx(4 / 9, rel=1e-9)


@pytest.mark.parametrize("degree", DEGREES)
def test_waves_lose_what_is_foretold(degree: int) -> None:
    """A wave in both directions, at many places far from the border: its error's power is 1 - 2 m m + q q."""
    nu, mu = 0.23, -0.11
    row, column = np.mgrid[0:200, 0:200].astype(float)
    phase = 2 * np.pi * np.random.default_rng(2).uniform(size=8)
    v, u = 60 + 80 * np.random.default_rng(3).uniform(size=(2, 4000))
    errors = []
    for start in phase:
        found = sample_spline(np.cos(2 * np.pi * (nu * row + mu * column) + start), u, v, degree)
        errors.append(np.mean((found - np.cos(2 * np.pi * (nu * v + mu * u) + start)) ** 2))
    expected = 1 - 2 * passed(degree, nu) * passed(degree, mu) + power_between(degree, nu) * power_between(degree, mu)
    assert 2 * np.mean(errors) == pytest.approx(float(expected), rel=0.02)


@pytest.mark.parametrize("degree", DEGREES)
def test_noise_between_pixels(degree: int) -> None:
    rng = np.random.default_rng(5)
    u, v = rng.uniform(10, 290, (2, 40_000))
    found = sample_spline(rng.normal(size=(300, 300)), u, v, degree)
    assert np.var(found) == pytest.approx(noise_between(degree), rel=0.03)


@pytest.mark.parametrize("degree", DEGREES)
def test_undefined_pixels_and_places_outside(degree: int) -> None:
    row, column = np.mgrid[0:60, 0:64].astype(float)
    picture = 3 + 2 * row - column
    picture[8, 9] = np.nan
    u = np.array([-0.51, 63.51, 35.3, 9.4, np.nan, -0.3])
    v = np.array([3.0, 3.0, 35.6, 8.4, 2.0, 30.0])
    found = sample_spline(picture, u, v, degree)
    assert np.isnan(found[[0, 1, 3, 4]]).all()
    # In the middle of a tilted plane splines are exact; what was filled in and the border's mirror fade out.
    assert found[2] == pytest.approx(3 + 2 * 35.6 - 35.3, abs=1e-6)
    assert found[5] == pytest.approx(63.0, abs=1e-6)
    assert np.isnan(sample_spline(np.full((4, 4), np.nan), 1.0, 1.0, degree))
    with pytest.raises(DataError, match="shape"):
        sample_spline(np.zeros(3), 0.0, 0.0, degree)


def test_expected_errors_on_random_scenes() -> None:
    """All within a factor of two; the whole campaign is the benchmark ``accuracy.planners``."""
    off = []
    for seed in range(5):
        seen = random_places(seed)
        for degree, foretold in resampling_errors_db(seen.planes, seen.variance).items():
            found = np.stack([sample_spline(plane, seen.u, seen.v, degree) for plane in seen.planes])
            off.append(relative_db(found, seen.truth) - foretold)
    assert np.abs(off).max() <= 6.02


def test_the_cheapest_that_keeps_the_tolerance() -> None:
    seen = random_places(9)  # hardly any noise
    errors = resampling_errors_db(seen.planes, seen.variance)
    assert errors[3] < errors[1] - 3
    assert choose_resampling(seen.planes, errors[1] + 2, variance=seen.variance).degree == 1
    choice = choose_resampling(seen.planes, errors[3] + 2, variance=seen.variance)
    assert (choice.degree, choice.kept) == (3, True)
    assert "cubic splines: the cheapest" in choice.explain()[0]
    assert choice.explain()[1].startswith("not by straight lines")
    # Noise alone: straight lines average more of it, and nothing keeps the tolerance.
    noise = 100 + np.random.default_rng(1).normal(size=(64, 64))
    choice = choose_resampling(noise, -60.0, variance=1.0)
    assert (choice.degree, choice.kept) == (1, False)
    assert choice.predicted_error_db == pytest.approx(-40 + 10 * np.log10(4 / 9), abs=0.4)


def test_what_cannot_be_chosen() -> None:
    picture = np.ones((32, 33))
    for bad in (0.0, 3.0, float("nan"), -float("inf")):
        with pytest.raises(DataError, match="negative number"):
            choose_resampling(picture, bad)
    with pytest.raises(DataError, match="without light"):
        resampling_errors_db(picture * 0)
    with pytest.raises(DataError, match="without light"):
        resampling_errors_db(picture * np.nan)
    with pytest.raises(DataError, match="at least 16"):
        resampling_errors_db(picture[:15])
    with pytest.raises(DataError, match="degree 2"):
        sample_spline(picture, 1.0, 1.0, 2)
    assert max(resampling_errors_db(picture).values()) < -200
