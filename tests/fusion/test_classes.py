"""K-means and separability against independent implementations, Monte Carlo and the thesis's figures."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from sklearn.cluster import KMeans

from processing.errors import DataError
from processing.fusion import anomalies as an
from processing.fusion import kmeans as km
from processing.fusion import separability as sp


def blobs(n: int = 150, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    means = np.array([[0.9, 0.1, 0.2, 0.5], [0.1, 0.2, 0.9, 0.1], [0.4, 0.8, 0.4, 0.3]])
    return np.concatenate([mean + 0.18 * random.normal(size=(n, 4)) for mean in means])


@pytest.mark.parametrize("seed", range(4))
def test_same_fixed_point_as_scikit_learn_from_the_same_start(seed: int) -> None:
    x = blobs(seed=seed)
    start = x[np.random.default_rng(seed + 50).choice(len(x), 3, replace=False)]
    ours = km.kmeans(x, 3, start=start, stop_change=0.0)
    theirs = KMeans(3, init=start, n_init=1, tol=0.0, max_iter=500, algorithm="lloyd").fit(x)
    np.testing.assert_array_equal(ours.labels, theirs.labels_)
    np.testing.assert_allclose(ours.centres, theirs.cluster_centers_, rtol=1e-12)
    assert ours.inertia == pytest.approx(theirs.inertia_, rel=1e-12)


def test_kernel_is_the_reference() -> None:
    x, centres = blobs(seed=3), blobs(seed=4)[::90].copy()
    labels, distances = km.assign(x, centres)
    expected, squared = km.assign_reference(x, centres)
    np.testing.assert_array_equal(labels, expected)
    np.testing.assert_allclose(distances, squared, rtol=1e-13)


def test_stops_when_fewer_than_five_percent_change() -> None:
    x = blobs(400, seed=9)
    start = x[:3]
    loose, strict = km.kmeans(x, 3, start=start), km.kmeans(x, 3, start=start, stop_change=0.0)
    assert loose.changed < 0.05
    assert loose.iterations < strict.iterations
    assert strict.changed == 0
    # Every class mean of the converged state is the mean of its members.
    for k in range(3):
        np.testing.assert_allclose(strict.centres[k], x[strict.labels == k].mean(axis=0), rtol=1e-12)


@pytest.mark.parametrize("start", ["k-means++", "even"])
def test_deterministic_and_nan_aware(start: str) -> None:
    x = blobs(seed=1)
    spoilt = np.insert(x, [0, 100, len(x)], np.nan, axis=0)
    a, b = km.kmeans(spoilt, 3, seed=7, start=start), km.kmeans(x, 3, seed=7, start=start)
    defined = np.isfinite(spoilt).all(axis=1)
    np.testing.assert_array_equal(a.labels[~defined], km.UNCLASSIFIED)
    np.testing.assert_array_equal(a.labels[defined], b.labels)
    np.testing.assert_array_equal(a.centres, b.centres)
    assert set(b.labels) == {0, 1, 2}


@given(st.integers(0, 10_000), st.integers(1, 5))
def test_more_iterations_never_fit_worse(seed: int, classes: int) -> None:
    x = np.random.default_rng(seed).random((60, 3))
    fits = [km.kmeans(x, classes, seed=seed, stop_change=0.0, max_iterations=n).inertia for n in (1, 2, 4, 8, 100)]
    assert all(later <= earlier * (1 + 1e-12) for earlier, later in itertools.pairwise(fits))


def test_an_empty_class_starts_again() -> None:
    x = np.concatenate([np.zeros((20, 1)), np.ones((20, 1)), np.full((2, 1), 5.0)])
    found = km.kmeans(x, 3, start=np.array([[0.0], [1.0], [100.0]]), stop_change=0.0)
    np.testing.assert_allclose(np.sort(found.centres.ravel()), [0, 1, 5])


def test_too_few_samples_and_bad_starts() -> None:
    with pytest.raises(DataError, match="too few distinct"):
        km.kmeans(np.ones((50, 2)), 2)
    with pytest.raises(DataError, match="too few distinct"):
        km.kmeans(np.full((50, 2), np.nan), 2)
    with pytest.raises(DataError, match="start centres"):
        km.kmeans(blobs(), 3, start=np.zeros((2, 4)))
    with pytest.raises(DataError, match="classes"):
        km.kmeans(np.zeros(5), 1)


def test_bhattacharyya_is_the_overlap_integral() -> None:
    # B = -ln of the integral of sqrt(p q), by importance sampling from the mixture: sd of the mean from the samples.
    random = np.random.default_rng(5)
    means = np.array([[0.0, 0.0, 0.0], [1.2, -0.8, 0.5]])
    roots = [
        np.array([[1.0, 0, 0], [0.4, 0.8, 0], [0, 0.3, 1.1]]),
        np.array([[0.7, 0, 0], [-0.2, 1.2, 0], [0.3, 0, 0.9]]),
    ]
    covariances = [root @ root.T for root in roots]
    a, b = (sp.Statistics(str(i), means[i], covariances[i], 100) for i in range(2))
    p, q = (stats.multivariate_normal(means[i], covariances[i]) for i in range(2))
    x = np.concatenate([p.rvs(100_000, random_state=random), q.rvs(100_000, random_state=random)])
    ratio = np.sqrt(p.pdf(x) * q.pdf(x)) / (0.5 * (p.pdf(x) + q.pdf(x)))
    integral, sd = ratio.mean(), ratio.std() / np.sqrt(len(x))
    assert sp.bhattacharyya(a, b) == pytest.approx(-np.log(integral), abs=5 * sd / integral)


def test_bhattacharyya_of_one_dimension_in_closed_form() -> None:
    # (m1 - m2)^2 / (4 (s1^2 + s2^2)) + ln((s1^2 + s2^2) / (2 s1 s2)) / 2.
    a = sp.Statistics("a", np.array([1.0]), np.array([[4.0]]), 9)
    b = sp.Statistics("b", np.array([3.0]), np.array([[1.0]]), 9)
    assert sp.bhattacharyya(a, b) == pytest.approx(4 / 20 + 0.5 * np.log(5 / 4), rel=1e-12)
    assert sp.bhattacharyya(a, a) == 0.0


@given(st.integers(0, 10_000))
def test_bhattacharyya_does_not_depend_on_a_linear_change_of_features(seed: int) -> None:
    random = np.random.default_rng(seed)
    x, y = random.normal(size=(50, 3)), random.normal(size=(60, 3)) * [1, 2, 0.5] + [1, 0, 2]
    transform = random.normal(size=(3, 3)) + 4 * np.eye(3)
    before = sp.bhattacharyya(sp.class_statistics(x), sp.class_statistics(y))
    after = sp.bhattacharyya(sp.class_statistics(x @ transform), sp.class_statistics(y @ transform))
    assert after == pytest.approx(before, rel=1e-8)


@pytest.mark.parametrize(
    ("distance", "lower", "upper"),
    # Thesis Table 7.3 and 7.5: distances between single and double bounce, with the bounds that follow from them as
    # (value, half a unit of its last printed digit).
    [
        (1.72, (0.0081, 5e-5), (0.0895, 5e-5)),
        (0.63, (0.0768, 5e-5), (0.266, 5e-4)),
        (4.91, (1.4e-5, 5e-7), (3.7e-3, 5e-5)),
        (9.93, (5.9e-10, 5e-12), (2.4e-5, 5e-7)),
    ],
)
def test_bayes_bounds_of_the_thesis(distance: float, lower: tuple[float, float], upper: tuple[float, float]) -> None:
    found = sp.bayes_bounds(distance)
    assert found.lower == pytest.approx(lower[0], abs=lower[1])
    assert found.upper == pytest.approx(upper[0], abs=upper[1])


def test_thesis_claims_of_error_reduction() -> None:
    # "About 10 %" for 1.72 to 9.93, "15-20 %" for 0.63 to 8.22: between the differences of the two bounds.
    for before, after, low, high in ((1.72, 9.93, 0.008, 0.10), (0.63, 8.22, 0.07, 0.27)):
        first, second = sp.bayes_bounds(before), sp.bayes_bounds(after)
        assert first.lower - second.lower > low
        assert first.upper - second.upper < high


# exp(-2 B) underflows beyond B = 354.
@given(st.floats(0, 340), st.floats(0.01, 0.99))
def test_bayes_bounds_are_ordered_and_do_not_cancel(distance: float, prior: float) -> None:
    lower, upper = sp.bayes_bounds(distance, prior)
    assert 0 < lower <= upper * (1 + 1e-12)
    assert upper <= 0.5
    if distance > 5:
        # Series for small overlap e = P1 P2 exp(-2 B): lower = e + e^2 + ...
        small = prior * (1 - prior) * np.exp(-2 * distance)
        assert lower == pytest.approx(small, rel=2e-4)


@given(st.floats(0, 3))
def test_bayes_bounds_hold_for_shifted_normals(half_distance: float) -> None:
    # Unit normals at +-d: the Bayes error is Phi(-d), and B = (2 d)^2 / 8.
    lower, upper = sp.bayes_bounds((2 * half_distance) ** 2 / 8)
    exact = stats.norm.cdf(-half_distance)
    assert lower - 1e-12 <= exact <= upper + 1e-12


def test_equal_classes_and_wrong_arguments() -> None:
    assert sp.bayes_bounds(0.0) == (0.5, 0.5)
    assert sp.jeffries_matusita(0.0) == 0.0
    assert sp.jeffries_matusita(50.0) == pytest.approx(np.sqrt(2), rel=1e-12)
    assert sp.jeffries_matusita(1e-12) == pytest.approx(np.sqrt(2e-12), rel=1e-9)
    for distance, prior in ((-1.0, 0.5), (float("nan"), 0.5), (1.0, 0.0), (1.0, 1.0)):
        with pytest.raises(DataError):
            sp.bayes_bounds(distance, prior)


def test_singular_covariances_are_refused_or_regularized_with_the_reason() -> None:
    random = np.random.default_rng(0)
    constant = random.normal(size=(50, 3))
    constant[:, 2] = 0.4
    with pytest.raises(DataError, match="constant or depends"):
        sp.class_statistics(constant, "plate")
    with pytest.raises(DataError, match="3 samples for 3 features"):
        sp.class_statistics(constant[:3], "plate")
    with pytest.raises(DataError, match="1 defined samples"):
        sp.class_statistics(constant[:1], "plate")
    for samples in (constant, constant[:3], np.ones((5, 3)), np.zeros((5, 3))):
        mended = sp.class_statistics(samples, "plate", singular="regularize")
        assert mended.regularized
        assert np.isfinite(sp.bhattacharyya(mended, sp.class_statistics(random.normal(size=(40, 3)))))
    assert not sp.class_statistics(random.normal(size=(50, 3))).regularized


def test_mismatched_and_indefinite_classes() -> None:
    a = sp.Statistics("a", np.zeros(2), np.eye(2), 9)
    with pytest.raises(DataError, match="different numbers"):
        sp.bhattacharyya(a, sp.Statistics("b", np.zeros(3), np.eye(3), 9))
    with pytest.raises(DataError, match="positive definite"):
        sp.bhattacharyya(a, sp.Statistics("b", np.zeros(2), np.diag([1.0, 0.0]), 9))


def test_rx_scores_are_chi_square_and_find_the_odd_one_out() -> None:
    random = np.random.default_rng(6)
    root = np.array([[1.0, 0, 0, 0], [0.5, 1, 0, 0], [0, 0.2, 2, 0], [0.1, 0, 0, 0.3]])
    planes = (root @ random.normal(size=(4, 60 * 70))).reshape(4, 60, 70)
    planes[:, 0, 0] = np.nan
    scores = an.reed_xiaoli(planes)
    assert np.isnan(scores[0, 0])
    defined = scores[np.isfinite(scores)]
    # Kolmogorov-Smirnov distance to chi-square with 4 degrees of freedom: 1.95 / sqrt n at 0.1 %.
    assert stats.kstest(defined, stats.chi2(4).cdf).statistic < 1.95 / np.sqrt(defined.size)
    planes[:, 30, 40] = [0, 0, 0, 5.0]
    assert np.unravel_index(np.nanargmax(an.reed_xiaoli(planes)), (60, 70)) == (30, 40)
    # Plain definition at one pixel.
    x = planes.reshape(4, -1).T
    x = x[np.isfinite(x).all(axis=1)]
    d = planes[:, 3, 3] - x.mean(axis=0)
    expected = d @ np.linalg.inv(np.cov(x, rowvar=False)) @ d
    assert an.reed_xiaoli(planes)[3, 3] == pytest.approx(expected, rel=1e-9)
