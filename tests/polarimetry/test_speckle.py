"""Speckle filters: kernels against references, looks gained and edges kept on simulated speckle with known truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.polarimetry.averaging import window_average
from processing.polarimetry.matrices import (
    basis_vectors,
    covariance_in_basis,
    covariance_of_coherency,
    matrix_of_planes,
    planes_of_matrix,
    total_power,
)
from processing.polarimetry.speckle.nonlocal_means import calibration, nonlocal_means, nonlocal_means_reference
from processing.polarimetry.speckle.quality import edge_kept, equivalent_looks, estimated_looks, matrix_looks
from processing.polarimetry.speckle.refined_lee import refined_lee, refined_lee_reference
from processing.polarimetry.speckle.simulation import speckled

Filter = Callable[[np.ndarray], np.ndarray]
FILTERS: dict[str, Filter] = {
    "refined-lee": lambda t: refined_lee(t, 7, looks=2.0),
    "nonlocal": lambda t: nonlocal_means(t, search=9),
}
GROUND = (1.0, 0.3, 0.1, 0.05, -0.02, 0.5, 0.0, 0.04, 0.2)
"""T of some ground: eigenvalues well apart, all elements in use."""


def even(shape: tuple[int, int]) -> np.ndarray:
    return np.broadcast_to(np.array(GROUND)[:, None, None], (9, *shape)).copy()


def step(shape: tuple[int, int], edge: int, by: float) -> np.ndarray:
    truth = even(shape)
    truth[:, :, edge:] *= by
    return truth


def rough(dtype: type = np.float64) -> np.ndarray:
    """Speckle over a step, with undefined pixels and a powerless patch."""
    t = speckled(step((34, 41), 20, 6.0), 1, np.random.default_rng(5))
    t[3, 5, 6], t[0, 0, 0], t[8, 20, 21] = np.nan, np.inf, np.nan
    t[:, 24:32, 3:11] = 0
    return t.astype(dtype)


def test_simulated_speckle_has_the_truth_as_its_mean_and_the_looks_that_it_should() -> None:
    for looks in (1, 4):
        t = speckled(even((200, 200)), looks, np.random.default_rng(looks))
        # Standard error of the mean of 40000 pixels of power 1: 1 / 200 per look; 5 of them.
        np.testing.assert_allclose(t.mean(axis=(1, 2)), GROUND, atol=0.025)
        # Of one element the variance is that of a gamma distribution of L looks; the span's is
        # tr(S S) / tr(S)^2 / L, and the trace moments count L itself.
        np.testing.assert_allclose(equivalent_looks(t[0]), looks, rtol=0.05)
        s = matrix_of_planes(np.array(GROUND))
        span_looks = looks * s.trace().real ** 2 / np.trace(s @ s).real
        np.testing.assert_allclose(equivalent_looks(total_power(t)), span_looks, rtol=0.05)
        np.testing.assert_allclose(matrix_looks(t), looks, rtol=0.05)
        # Unknown ground: the mode of many windows' looks, which scatter by a quarter with 49 pixels each.
        np.testing.assert_allclose(estimated_looks(total_power(t)), span_looks, rtol=0.3)


def test_looks_are_found_although_half_of_the_image_has_texture() -> None:
    truth = even((280, 280))
    truth[:, :, 140:] *= np.random.default_rng(8).gamma(1.0, 1.0, size=(280, 140))
    t = total_power(speckled(truth, 4, np.random.default_rng(9)))
    assert equivalent_looks(t) < 2.5
    np.testing.assert_allclose(estimated_looks(t), equivalent_looks(t[:, :140]), rtol=0.3)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("window", [5, 7, 9, 11])
def test_refined_lee_is_its_reference(dtype: type, window: int) -> None:
    t = rough(dtype)
    found, expected = refined_lee(t, window, looks=2.0), refined_lee_reference(t, window, looks=2.0)
    assert found.dtype == dtype
    scale = np.nanmax(total_power(window_average(t.astype(float), window)))
    # Sums of up to 66 values in another order; float32: rounding of the result.
    np.testing.assert_allclose(found / scale, expected / scale, atol=6e-8 if dtype == np.float32 else 1e-14)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("looks", "search", "patch", "level"), [(1, 9, 3, 0.01), (4, 5, 1, 0.2), (2, 7, 5, 0.05)])
def test_nonlocal_means_is_its_reference(dtype: type, looks: int, search: int, patch: int, level: float) -> None:
    t = rough(dtype)
    options = {"looks": looks, "search": search, "patch": patch, "level": level}
    found, expected = nonlocal_means(t, **options), nonlocal_means_reference(t, **options)  # type: ignore[arg-type]
    assert found.dtype == dtype
    scale = np.nanmax(total_power(t.astype(float)))
    # Logarithms of determinants whose floor is 1e-5 of the power lose 15 of 53 bits at most: 1e-11 of a weight.
    np.testing.assert_allclose(found / scale, expected / scale, atol=6e-8 if dtype == np.float32 else 1e-11)


@pytest.mark.parametrize("name", FILTERS)
def test_undefined_pixels_stay_so_and_spoil_nothing(name: str) -> None:
    t = rough()
    found = FILTERS[name](t)
    np.testing.assert_array_equal(np.isnan(found).all(axis=0), ~np.isfinite(t).all(axis=0))
    np.testing.assert_array_equal(np.isnan(found).any(axis=0), ~np.isfinite(t).all(axis=0))
    # What an undefined pixel holds beside its NaN changes no other one.
    other = t.copy()
    other[5, 5, 6] = 1e12
    np.testing.assert_array_equal(FILTERS[name](other), found)


@pytest.mark.parametrize("name", FILTERS)
def test_what_is_filtered_stays_a_mixture_of_matrices(name: str) -> None:
    found = FILTERS[name](rough())
    values = np.linalg.eigvalsh(matrix_of_planes(found[:, np.isfinite(found).all(axis=0)]))
    assert values.min() >= -1e-14 * values.max()


@pytest.mark.parametrize("name", FILTERS)
@given(st.floats(-3, 3), st.floats(-0.7, 0.7), st.sampled_from([1e-12, 1e-3, 1e12]))
@settings(max_examples=8, deadline=None)
def test_neither_basis_nor_unit_matters(name: str, orientation: float, ellipticity: float, level: float) -> None:
    # Filters weigh whole matrices by what does not depend on their basis: span, determinants.
    c = covariance_of_coherency(speckled(step((20, 22), 11, 4.0), 2, np.random.default_rng(3)))
    basis = basis_vectors(orientation, ellipticity)

    def turned(planes: np.ndarray) -> np.ndarray:
        return planes_of_matrix(covariance_in_basis(matrix_of_planes(planes), basis))

    np.testing.assert_allclose(FILTERS[name](turned(c) * level) / level, turned(FILTERS[name](c)), atol=1e-9)


@pytest.mark.parametrize("name", FILTERS)
def test_an_image_of_one_value_does_not_change(name: str) -> None:
    np.testing.assert_allclose(FILTERS[name](even((18, 12))), even((18, 12)), rtol=1e-14)
    np.testing.assert_array_equal(FILTERS[name](np.zeros((9, 18, 12))), 0)
    single = np.array(GROUND)[:, None, None]
    np.testing.assert_allclose(FILTERS[name](single), single, rtol=1e-15)


@pytest.mark.parametrize("name", FILTERS)
def test_a_pixel_120_db_above_the_others_spoils_none_that_is_far(name: str) -> None:
    t = speckled(even((40, 40)), 1, np.random.default_rng(6))
    expected = FILTERS[name](t)
    t[:, 20, 20] *= 1e12
    found = FILTERS[name](t)
    far = np.ones((40, 40), dtype=bool)
    far[14:27, 14:27] = False
    np.testing.assert_array_equal(found[:, far], expected[:, far])
    # It keeps its power; of refined Lee (1999, eq. 9) what the weight leaves to one of the n = 28 pixels of a half
    # whose relative variance is n - 1, with noise of 1/2: b = (27 - 1/2) / (27 * 3/2), 1/28 + 27/28 b.
    kept = 1 / 28 + 27 / 28 * (26.5 / 40.5) if name == "refined-lee" else 1.0
    np.testing.assert_allclose(total_power(found)[20, 20], kept * total_power(t)[20, 20], rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "filtered", "looks", "kept"),
    [
        # Even ground: a mean over n single looks has n times the looks, counted to 11 % (178 independent means; three
        # of these). Refined Lee cannot gain more than its half of 28 pixels, non-local means not more than 225.
        # The edge: a boxcar of 7 leaves 1/7 of a step by its definition. Lower limits of the others: what makes them
        # worth their time.
        ("boxcar", lambda t: window_average(t, 7), (33, 65), (0.10, 0.19)),
        ("refined-lee", lambda t: refined_lee(t, 7, looks=1.93), (10, 28), (0.5, 1.1)),
        ("nonlocal", lambda t: nonlocal_means(t, search=15), (60, 225), (0.7, 1.1)),
    ],
)
def test_looks_gained_and_edge_kept(
    name: str, filtered: Filter, looks: tuple[float, float], kept: tuple[float, float]
) -> None:
    truth = step((160, 200), 100, 10.0)
    t = filtered(speckled(truth, 1, np.random.default_rng(21)))
    power = total_power(t)
    s = matrix_of_planes(np.array(GROUND))
    gained = equivalent_looks(power[16:-16, 16:84]) / (s.trace().real ** 2 / np.trace(s @ s).real)
    assert looks[0] < gained < looks[1]
    # No filter changes the mean: its standard error over 128 x 68 pixels of the speckle that went in is 0.8 %.
    np.testing.assert_allclose(power[16:-16, 16:84].mean(), total_power(truth)[0, 0], rtol=0.05)
    assert kept[0] < edge_kept(power[16:-16], total_power(truth)[16:-16], 100) < kept[1]


def test_equal_patches_are_refused_as_rarely_as_told() -> None:
    # Calibrated with the identity, measured on another matrix and another seed: 1 % refused, half with full weight.
    from processing.polarimetry.speckle.nonlocal_means import _dissimilarity, _floored

    likely, largest = calibration(2, 3, 0.01)
    means = _floored(window_average(speckled(even((200, 200)), 2, np.random.default_rng(77)), 3))[:, 2:-2, 2:-2]
    d = np.lib.stride_tricks.sliding_window_view(_dissimilarity(means[:, :, 9:], means[:, :, :-9]), (3, 3))
    distance = d.mean(axis=(-2, -1))
    # 36000 overlapping patches are about 36000 / 25 independent ones: 1 % +- 0.26 %.
    assert 0.002 < (distance > largest).mean() < 0.02
    assert 0.45 < (distance < likely).mean() < 0.55


def test_what_cannot_be_filtered_is_refused() -> None:
    t = even((8, 8))
    for window in (3, 6, 33):
        with pytest.raises(DataError, match="cannot be halved along edges"):
            refined_lee(t, window, looks=1)
    with pytest.raises(DataError, match="0 looks are no speckle"):
        refined_lee(t, looks=0)
    with pytest.raises(DataError, match="search window of 4 pixels has no centre"):
        nonlocal_means(t, search=4)
    with pytest.raises(DataError, match="leaves no weights"):
        nonlocal_means(t, level=0.6)
    with pytest.raises(DataError, match="0 looks are no image"):
        nonlocal_means(t, looks=0)
    with pytest.raises(DataError, match="0 looks are no image"):
        speckled(t, 0, np.random.default_rng(0))
    with pytest.raises(DataError, match="no edge at column 3"):
        edge_kept(t[0], t[0], 3)
    with pytest.raises(DataError, match="cannot be estimated"):
        estimated_looks(t[0])
    with pytest.raises(DataError, match="without power in two pixels"):
        equivalent_looks(np.zeros((3, 3)))
    with pytest.raises(DataError, match="fewer than two pixels"):
        matrix_looks(np.full((9, 4), np.nan))
