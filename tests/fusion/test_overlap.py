"""Overlap of classes from learnt densities: normal classes by the closed form, others by a numerical integral."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from processing.errors import DataError
from processing.fusion.kmeans import UNCLASSIFIED
from processing.fusion.overlap import learn_density, likelier, overlap
from processing.fusion.separability import Statistics, bhattacharyya

SAMPLES = 2000


def _halves(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return samples[::2], samples[1::2]


@pytest.mark.parametrize("apart", [0.5, 2.0, 4.0])
def test_normal_classes_have_the_distance_of_the_closed_form(apart: float) -> None:
    random = np.random.default_rng(3)
    covariances = np.array([[1.0, 0.3], [0.3, 0.5]]), np.array([[0.6, -0.2], [-0.2, 1.2]])
    means = np.zeros(2), np.array([apart, apart / 2])
    drawn = [random.multivariate_normal(m, c, SAMPLES) for m, c in zip(means, covariances, strict=True)]
    learnt, judged = zip(*map(_halves, drawn), strict=True)
    found = overlap([learn_density(x, most=1) for x in learnt], judged)
    expected = bhattacharyya(*(Statistics("", m, c, SAMPLES) for m, c in zip(means, covariances, strict=True)))
    coefficient = math.exp(-expected)
    # The mean over n samples of a number between 0 and 1 has at most sqrt(c / n) as its deviation (here n = 2000); the
    # densities' own parameters add as much again.
    spread = 4 * 2 * math.sqrt(coefficient / SAMPLES)
    assert math.exp(-found.distance) == pytest.approx(coefficient, abs=spread)
    assert found.bounds.lower <= found.least_error <= found.bounds.upper


def test_a_class_of_two_heaps_is_not_taken_for_a_normal_one() -> None:
    """One class stands between the two heaps of the other, with its mean: numerical integrals are the truth."""

    def two(x: float) -> float:
        return float(0.5 * norm.pdf(x, -3, 0.5) + 0.5 * norm.pdf(x, 3, 0.5))

    def one(x: float) -> float:
        return float(norm.pdf(x, 0, 0.7))

    coefficient = quad(lambda x: math.sqrt(one(x) * two(x)), -8, 8, limit=200)[0]
    least = quad(lambda x: min(one(x), two(x)) / 2, -8, 8, limit=200)[0]
    random = np.random.default_rng(4)
    first = random.normal(0, 0.7, (SAMPLES, 1))
    second = random.choice([-3.0, 3.0], (SAMPLES, 1)) + random.normal(0, 0.5, (SAMPLES, 1))
    learnt, judged = zip(_halves(first), _halves(second), strict=True)
    densities = [learn_density(x, most=4) for x in learnt]
    found = overlap(densities, judged)
    assert math.exp(-found.distance) == pytest.approx(coefficient, abs=8 * math.sqrt(coefficient / SAMPLES))
    assert found.least_error == pytest.approx(least, abs=8 * math.sqrt(least / SAMPLES))
    # What the classifier gets wrong is the least error, which the bounds hold.
    wrong = np.mean([np.mean(likelier(densities, x) != k) for k, x in enumerate(judged)])
    assert found.bounds.lower <= wrong + 4 * math.sqrt(least / SAMPLES)
    assert wrong <= found.bounds.upper


def test_far_apart_equal_and_undefined_samples() -> None:
    random = np.random.default_rng(5)
    near = random.normal(0, 1, (400, 2))
    density = learn_density(near, most=1)
    same = overlap([density, density], [near, near])
    assert same.distance == 0
    assert same.least_error == 0.5
    far = learn_density(near + 1e4, most=1)
    apart = overlap([density, far], [near, near + 1e4])
    assert apart.least_error == 0
    assert apart.bounds.upper <= 1e-300
    holed = near.copy()
    holed[3, 1] = np.nan
    assert likelier([density, far], holed)[3] == UNCLASSIFIED
    with pytest.raises(DataError, match="no defined sample"):
        overlap([density, far], [np.full((3, 2), np.nan), near])
    with pytest.raises(DataError, match="1 classes"):
        overlap([density], [near])
