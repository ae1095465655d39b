"""RX against its distribution, its reference and the whole image; filters against their defining properties."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from processing.errors import DataError
from processing.fusion import anomalies as an
from processing.fusion.separability import Statistics, class_statistics

MIX = np.array([[1.0, 0.0, 0.0], [0.8, 0.5, 0.0], [-0.3, 0.2, 0.1]])


def clutter(rows: int, columns: int, seed: int = 0) -> np.ndarray:
    """Three correlated normal features."""
    noise = np.random.default_rng(seed).normal(size=(3, rows * columns))
    return (MIX @ noise + np.array([[3.0], [-1.0], [0.2]])).reshape(3, rows, columns)


def test_kernel_is_the_reference():
    image = clutter(30, 26)
    image[1, 4, 5] = np.nan
    image[:, 20:24, 3:9] = np.nan
    expected = an.local_reed_xiaoli_reference(image, guard=1, reach=4)
    told = an.local_reed_xiaoli(image, guard=1, reach=4)
    # Sums of at most 72 products about the pixel: 72 eps, times the covariance's condition (about 200) twice.
    np.testing.assert_allclose(told, expected, rtol=1e-9)
    assert np.isnan(told[4, 5])
    assert np.isfinite(told[10, 10])


def test_scores_follow_hotellings_distribution():
    # Inside, every ring has m = 17^2 - 5^2 samples; score * m (m - d) / ((m^2 - 1) d) ~ F(d, m - d) (Hotelling's T^2
    # of a new sample). Neighbours share most of their ring but not their own pixel, so every fifth is taken.
    image = clutter(137, 137, seed=4)
    scores = an.local_reed_xiaoli(image, guard=2, reach=8)[8:-8:5, 8:-8:5].ravel()
    m, d = 17**2 - 25, 3
    told = scores * m * (m - d) / ((m**2 - 1) * d)
    assert stats.kstest(told, stats.f(d, m - d).cdf).pvalue > 1e-3


def test_a_target_that_is_ordinary_elsewhere_stands_out_locally():
    image = clutter(60, 60, seed=1)
    image[0, :, 30:] += 40  # another kind of ground
    image[0, 30, 10] += 40  # ordinary there, not here
    assert an.local_reed_xiaoli(image)[30, 10] > 200
    # For the whole image it is one of two kinds of ground: chi-square with 3 degrees of freedom exceeds 16 in 0.1 %.
    assert an.reed_xiaoli(image)[30, 10] < 16


def test_what_is_constant_has_no_score():
    image = np.zeros((2, 12, 12))
    image[0] = np.random.default_rng(0).normal(size=(12, 12))
    assert np.isnan(an.local_reed_xiaoli(image)).all()
    with pytest.raises(DataError, match="reach larger"):
        an.local_reed_xiaoli(image, guard=3, reach=3)


@given(st.integers(0, 1000), st.floats(0.1, 1e3))
def test_constrained_energy_answers_one_and_least(seed, scale):
    image = clutter(12, 12, seed) * scale
    target = np.random.default_rng(seed + 1).normal(size=3) * scale
    answers = an.constrained_energy(image, target)
    x = image.reshape(3, -1)
    # The filter is linear: recover it from answers, then what defines it must hold.
    weights = np.linalg.lstsq(x.T, answers.ravel(), rcond=None)[0]
    assert weights @ target == pytest.approx(1.0, rel=1e-6)
    least = 1 / (target @ np.linalg.solve(x @ x.T / x.shape[1], target))
    assert np.mean(answers**2) == pytest.approx(least, rel=1e-6)


def test_matched_filter():
    image = clutter(200, 200, seed=3)
    known = Statistics("ground", np.array([3.0, -1.0, 0.2]), MIX @ MIX.T, 10**9)
    target = np.array([6.0, 2.0, 1.0])
    answers = an.matched_filter(image, target, known)
    away = target - known.mean
    distance = np.sqrt(away @ np.linalg.solve(known.covariance, away))
    # Over clutter: mean 0 with a standard error of 1/200 of the deviation, which is 1 / Mahalanobis distance.
    assert answers.mean() == pytest.approx(0, abs=4 / (200 * distance))
    assert answers.std() * distance == pytest.approx(1, abs=4 / np.sqrt(2 * 40_000))
    assert an.matched_filter(target[:, None, None], target, known).item() == pytest.approx(1, rel=1e-12)
    # No other linear filter that answers 1 to the target has less variance (Cauchy-Schwarz).
    other = np.array([1.0, -2.0, 0.5])
    assert np.sqrt(other @ known.covariance @ other) / abs(other @ away) > 1 / distance


def test_what_makes_no_sense_is_refused():
    image = clutter(8, 8)
    for call in (an.constrained_energy, an.matched_filter):
        with pytest.raises(DataError, match="one finite number a feature"):
            call(image, [1.0, 2.0])
        with pytest.raises(DataError, match="not all zero"):
            call(image, np.zeros(3))
    known = class_statistics(image.reshape(3, -1).T)
    with pytest.raises(DataError, match="background's mean"):
        an.matched_filter(image, known.mean, known)
    with pytest.raises(DataError, match="not positive definite"):
        an.constrained_energy(np.concatenate([image, image[:1]]), np.ones(4))
    blind = np.full((3, 4, 4), np.nan)
    with pytest.raises(DataError, match="0 defined"):
        an.constrained_energy(blind, np.ones(3))


def test_undefined_pixels_stay_undefined():
    image = clutter(8, 8)
    image[2, 3, 3] = np.nan
    for told in (an.constrained_energy(image, np.ones(3)), an.matched_filter(image, np.ones(3))):
        assert np.isnan(told).sum() == 1
        assert np.isnan(told[3, 3])
