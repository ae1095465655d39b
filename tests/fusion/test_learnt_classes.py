"""Classifiers, ISODATA, mixtures and their count of errors; separability of few samples against Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from sklearn.discriminant_analysis import QuadraticDiscriminantAnalysis
from sklearn.metrics import cohen_kappa_score, confusion_matrix

from processing.errors import DataError
from processing.fusion.confusion import confusion
from processing.fusion.isodata import IsodataSettings, isodata
from processing.fusion.kmeans import UNCLASSIFIED
from processing.fusion.separability import Statistics, bayes_bounds, bhattacharyya, bhattacharyya_unbiased
from processing.fusion.separability import class_statistics as statistics_of
from processing.fusion.supervised import MaximumLikelihood, gaussian_mixture, learn

MEANS = np.array([[0.9, 0.1, 0.2, 0.5], [0.1, 0.2, 0.9, 0.1], [0.4, 0.8, 0.4, 0.3]])


def blobs(n: int, seed: int = 0, sd: float = 0.12) -> list[np.ndarray]:
    random = np.random.default_rng(seed)
    return [mean + sd * random.normal(size=(n, 4)) for mean in MEANS]


def test_likelihood_is_that_of_normal_classes():
    samples = blobs(80)
    known = MaximumLikelihood(tuple(statistics_of(x) for x in samples), (1.0, 2.0, 1.0))
    x = np.concatenate(blobs(40, seed=1, sd=0.4))
    priors = np.array([0.25, 0.5, 0.25])
    expected = np.stack(
        [
            np.log(p) + stats.multivariate_normal(k.mean, k.covariance).logpdf(x)
            for p, k in zip(priors, known.classes, strict=True)
        ],
        axis=1,
    )
    np.testing.assert_allclose(known.scores(x), expected, rtol=1e-9)
    # scikit-learn's quadratic discriminant is the same classifier.
    peer = QuadraticDiscriminantAnalysis(priors=priors).fit(np.concatenate(samples), np.repeat(range(3), 80))
    np.testing.assert_array_equal(known(x), peer.predict(x))


@pytest.mark.parametrize("method", ["likelihood", "svm", "forest"])
def test_errors_lie_within_the_bounds_of_bayes(method):
    random = np.random.default_rng(2)
    spread = np.diag([0.04, 0.02, 0.03, 0.02])
    truth = [Statistics("a", MEANS[0], spread, 0), Statistics("b", MEANS[0] + 0.22, 1.5 * spread, 0)]
    draw = [[random.multivariate_normal(k.mean, k.covariance, 1500) for k in truth] for _ in range(2)]
    bounds = bayes_bounds(bhattacharyya(*truth))
    told = np.concatenate([learn(draw[0], method)(x) for x in draw[1]])
    found = confusion(np.repeat([0, 1], 1500), told, 2)
    error = 1 - found.accuracy
    # No classifier beats the lower bound; the best keeps the upper one, and the others nearly (their own variance).
    assert bounds.lower - 4 * found.accuracy_sd < error
    assert error < bounds.upper + (0.0 if method == "likelihood" else 0.02) + 4 * found.accuracy_sd


def test_undefined_samples_belong_to_no_class():
    samples = blobs(60)
    spoilt = [np.insert(x, 5, np.nan, axis=0) for x in samples]
    x = np.vstack([samples[0][:3], np.full((1, 4), np.nan)])
    for method in ("likelihood", "svm", "forest"):
        told = learn(spoilt, method)(x)
        np.testing.assert_array_equal(told, learn(samples, method)(x))
        assert told[-1] == UNCLASSIFIED
        assert (told[:3] == 0).all()


def test_what_cannot_be_learnt_is_refused():
    with pytest.raises(DataError, match="two classes"):
        learn(blobs(5)[:1], "svm")
    with pytest.raises(DataError, match="class 2 has 1 defined"):
        learn([np.ones((5, 2)), np.ones((1, 2))], "svm")
    with pytest.raises(DataError, match="different numbers"):
        learn([np.ones((5, 2)), np.ones((5, 3))], "svm")
    with pytest.raises(DataError, match="no classifier"):
        learn(blobs(5), "guess")  # type: ignore[arg-type]
    with pytest.raises(DataError, match="features a sample"):
        learn(blobs(20), "forest")(np.ones((3, 2)))
    with pytest.raises(DataError, match="priors"):
        MaximumLikelihood(tuple(map(statistics_of, blobs(9))), (1.0,)).scores(np.ones((1, 4)))


def test_isodata_finds_three_of_any_start():
    x = np.concatenate(blobs(200, sd=0.06))
    truth = np.repeat(range(3), 200)
    for begin in (2, 3, 5):
        found = isodata(x, IsodataSettings(classes=begin, widest_sd=0.15, closest=0.3))
        assert len(found.centres) == 3
        # Every class is one blob.
        table = confusion_matrix(truth, found.labels)
        assert sorted(table.max(axis=1)) == [200, 200, 200]
        assert found.changed == 0


def test_isodata_drops_what_is_too_small_and_leaves_out_the_undefined():
    x = np.concatenate([*blobs(200, sd=0.05), np.full((2, 4), 9.0), np.full((1, 4), np.nan)])
    found = isodata(x, IsodataSettings(classes=4, least_share=0.01, widest_sd=5.0, closest=0.2))
    assert len(found.centres) == 3
    assert found.labels[-1] == UNCLASSIFIED
    assert np.array_equal(found.labels, isodata(x, IsodataSettings(4, 0.01, 5.0, 0.2)).labels)
    with pytest.raises(DataError):
        isodata(x, IsodataSettings(widest_sd=0.0))


def test_mixture_finds_how_many():
    samples = blobs(300, sd=0.08)
    found = gaussian_mixture(np.vstack([*samples, np.full((1, 4), np.nan)]), most=5)
    assert len(found.classes) == 3
    assert found.labels[-1] == UNCLASSIFIED
    # Means to 4 standard errors.
    centres = np.array([k.mean for k in found.classes])
    nearest = [np.abs(centres - mean).max(axis=1).min() for mean in MEANS]
    assert max(nearest) < 4 * 0.08 / np.sqrt(300)
    assert found.weights.sum() == pytest.approx(1)
    with pytest.raises(DataError):
        gaussian_mixture(np.ones((3, 4)), 2)


@given(st.lists(st.tuples(st.integers(-1, 4), st.integers(-1, 4)), min_size=1, max_size=60))
def test_confusion_against_scikit_learn(pairs):
    truth, told = map(np.array, zip(*pairs, strict=True))
    found = confusion(truth, told, 4)
    decided = (truth >= 0) & (truth < 4) & (told >= 0) & (told < 4)
    known = (truth >= 0) & (truth < 4)
    assert found.counts.sum() + found.undecided.sum() == known.sum()
    if not decided.any():
        assert np.isnan(found.accuracy)
        return
    np.testing.assert_array_equal(found.counts, confusion_matrix(truth[decided], told[decided], labels=range(4)))
    assert found.accuracy == pytest.approx(np.mean(truth[decided] == told[decided]))
    if np.isfinite(found.kappa):
        assert found.kappa == pytest.approx(cohen_kappa_score(truth[decided], told[decided]), abs=1e-12)


@pytest.mark.parametrize(("n", "apart"), [(12, 0.0), (12, 1.0), (30, 2.0), ((10, 60), 1.0)])
def test_bias_of_few_samples_is_taken_off(n, apart):
    # Truth from the parameters; the mean over 400 draws is known to its own standard error.
    random = np.random.default_rng(5)
    counts = n if isinstance(n, tuple) else (n, n)
    first = Statistics("a", np.zeros(4), np.diag([1.0, 2.0, 0.5, 1.0]), 0)
    second = Statistics("b", np.full(4, apart), np.diag([1.5, 1.0, 0.5, 2.0]) + 0.2, 0)
    truth = bhattacharyya(first, second)
    raw, mended = [], []
    for _ in range(400):
        pair = [
            statistics_of(random.multivariate_normal(k.mean, k.covariance, count))
            for k, count in zip((first, second), counts, strict=True)
        ]
        raw.append(bhattacharyya(*pair))
        mended.append(bhattacharyya_unbiased(*pair))
    bias, left = np.mean(raw) - truth, np.mean(mended) - truth
    error = np.std(mended) / np.sqrt(400)
    assert bias > 10 * error
    # Satterthwaite's degrees of freedom are an approximation: a tenth of the bias may be left.
    assert abs(left) < 0.1 * bias + 4 * error


def test_bias_needs_samples():
    pair = [statistics_of(np.random.default_rng(k).normal(size=(6, 4))) for k in range(2)]
    with pytest.raises(DataError, match="7 pixels or more"):
        bhattacharyya_unbiased(*pair)
