"""Detectors and classes: closed forms, references, false alarms counted against the rate that was set."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from processing.errors import DataError
from processing.polarimetry import targets
from processing.polarimetry.averaging import window_average
from processing.polarimetry.detection.cfar import Kind, Ring, cfar, cfar_reference, factor, ring_average
from processing.polarimetry.detection.filters import gain, matched, whitened
from processing.polarimetry.h_a_alpha import h_a_alpha
from processing.polarimetry.matrices import matrix_of_planes, planes_of_matrix, planes_of_vector, total_power
from processing.polarimetry.pauli import pauli_of_matrix
from processing.polarimetry.speckle.quality import equivalent_looks
from processing.polarimetry.speckle.simulation import speckled
from processing.polarimetry.wishart import wishart_assign, wishart_assign_reference, wishart_classify
from processing.polarimetry.zones import NAMES, h_alpha_zones

CLUTTER = np.array([1.0, 0.3, 0.1, 0.05, -0.02, 0.5, 0.0, 0.04, 0.2])
SIZE = 200


def clutter(looks: int, seed: int = 3) -> np.ndarray:
    return speckled(np.broadcast_to(CLUTTER[:, None, None], (9, SIZE, SIZE)), looks, np.random.default_rng(seed))


@pytest.mark.parametrize("looks", [1, 4])
def test_whitening_makes_three_channels_of_equal_power(looks: int) -> None:
    # Novak and Burl 1990: mean 1, variance 1 / 3L whatever the clutter; the span has fewer looks.
    # 40000 pixels: standard error of the mean 0.3 %, of the looks 0.7 % and more for single looks (kurtosis).
    t = clutter(looks)
    power = whitened(t, CLUTTER)
    np.testing.assert_allclose(power.mean(), 1, atol=0.01)
    np.testing.assert_allclose(equivalent_looks(power), 3 * looks, rtol=0.05)
    assert equivalent_looks(total_power(t)) < 2.2 * looks
    # One matrix, or the same for every pixel.
    np.testing.assert_allclose(whitened(t, np.broadcast_to(CLUTTER[:, None, None], t.shape)), power, rtol=1e-12)


@pytest.mark.parametrize("looks", [1, 3])
def test_matched_filter_in_clutter_and_on_its_target(looks: int) -> None:
    # |w^H k|^2 over its mean is exponential (gamma of L looks); a target of amplitude a comes out with |a|^2 times the
    # gain t^H S^-1 t, which no other weight exceeds (Schwarz).
    target = pauli_of_matrix(targets.dihedral(0.4))
    power = matched(clutter(looks), CLUTTER, target)
    assert stats.kstest(power.ravel()[::7], "gamma", args=(looks, 0, 1 / looks)).pvalue > 1e-3
    s = matrix_of_planes(CLUTTER)
    np.testing.assert_allclose(gain(CLUTTER, target), (target.conj() @ np.linalg.inv(s) @ target).real, rtol=1e-12)
    alone = matched(planes_of_vector((3 * target)[:, None, None]), CLUTTER, target)
    np.testing.assert_allclose(alone, 9 * gain(CLUTTER, target), rtol=1e-12)
    rng = np.random.default_rng(4)
    for _ in range(20):
        w = rng.normal(size=3) + 1j * rng.normal(size=3)
        assert abs(np.vdot(w, target)) ** 2 / (w.conj() @ s @ w).real <= gain(CLUTTER, target) * (1 + 1e-12)
    # Better than the span, whose contrast is the target's power over the clutter's.
    assert gain(CLUTTER, target) > np.vdot(target, target).real / s.trace().real


def test_clutter_without_an_inverse_gives_no_number() -> None:
    t = clutter(1)[:, :4, :4].copy()
    t[2, 1, 1] = np.nan
    around = np.broadcast_to(CLUTTER[:, None, None], t.shape).copy()
    around[:, 0, 0] = 0
    around[:, 0, 1] = planes_of_vector(np.array([1.0, 1j, 0.5]))
    around[4, 0, 2] = np.nan
    for power in (whitened(t, around), matched(t, around, [1, 0, 0])):
        undefined = np.zeros((4, 4), dtype=bool)
        undefined[[0, 0, 0, 1], [0, 1, 2, 1]] = True
        np.testing.assert_array_equal(np.isnan(power), undefined)
    # 120 dB up or down changes nothing but the clutter's own scale.
    np.testing.assert_allclose(whitened(t * 1e12, CLUTTER * 1e12), whitened(t, CLUTTER), rtol=1e-9)


@pytest.mark.parametrize("kind", ["ca", "os"])
@pytest.mark.parametrize("looks", [1.0, 2.5, 6.0])
def test_false_alarms_are_as_frequent_as_set(kind: Kind, looks: float) -> None:
    # 200 x 200 pixels of clutter with a strong gradient-free power, 1 % set: 400 +- 20 if independent; neighbours share
    # their threshold, which widens that a little. Five of these. Borders have fewer training pixels and are counted.
    x = np.random.default_rng(int(10 * looks)).gamma(looks, 7.0, size=(SIZE, SIZE))
    found = cfar(x, false_alarm=0.01, looks=looks, kind=kind)
    assert np.isfinite(found).all()
    assert abs((found > 1).mean() - 0.01) < 5 * 0.0005
    border = np.ones(x.shape, dtype=bool)
    border[10:-10, 10:-10] = False
    assert abs((found[border] > 1).mean() - 0.01) < 5 * np.sqrt(0.01 / border.sum())


@pytest.mark.parametrize("kind", ["ca", "os"])
def test_whitened_clutter_of_unknown_matrix_keeps_the_rate(kind: Kind) -> None:
    # Clutter's matrix from each pixel's ring: 360 pixels are enough to come near 3 looks; the estimate's own scatter
    # (Hotelling: 3 / 360 of the power, and fewer pixels at borders) makes tails a little longer.
    t = clutter(1, 12)
    power = whitened(t, ring_average(t, Ring()))
    found = cfar(power, false_alarm=0.01, looks=3.0, kind=kind)
    assert 0.008 < (found > 1).mean() < 0.013


def test_rings_leave_their_middle_out() -> None:
    t = clutter(1)[:, :40, :40].copy()
    t[5, 3, 3] = np.nan
    found = ring_average(t, Ring(9, 3))
    # The mean of a whole window is made of the ring's 72 pixels and the middle's 9.
    whole, middle = window_average(t, 9), window_average(t, 3)
    np.testing.assert_allclose((72 * found + 9 * middle)[:, 20, 20] / 81, whole[:, 20, 20], rtol=1e-12)
    # A target of 120 dB is no part of its own clutter, and an undefined pixel of nobody's.
    t[:, 20, 20] *= 1e12
    np.testing.assert_array_equal(ring_average(t, Ring(9, 3))[:, 20, 20], found[:, 20, 20])
    assert np.isfinite(found).all()
    assert np.isnan(ring_average(t[:, :3, :3], Ring(9, 3))).all()


def test_factors_in_closed_form() -> None:
    for n in (16, 50, 360, 1500):
        for rate in (0.3, 1e-3, 1e-8, 1e-14):
            # Single look, cell averaging: (1 + factor / N)^-N.
            ca = factor(n, false_alarm=rate, looks=1.0)
            np.testing.assert_allclose(n * (rate ** (-1 / n) - 1), ca, rtol=1e-10)
            # Single look, ordered statistic: Rohling 1983, eq. 17.
            alpha = factor(n, false_alarm=rate, looks=1.0, kind="os")
            i = np.arange(int(np.ceil(0.75 * n)))
            np.testing.assert_allclose(np.sum(np.log(n - i) - np.log(n - i + alpha)), np.log(rate), atol=1e-7)
    # More looks, cell averaging: Fisher's distribution.
    np.testing.assert_allclose(factor(40, false_alarm=1e-4, looks=2.5), stats.f.isf(1e-4, 5, 200), rtol=1e-9)


@pytest.mark.parametrize("kind", ["ca", "os"])
def test_cfar_is_its_reference(kind: Kind) -> None:
    x = np.random.default_rng(2).gamma(2.0, size=(37, 45))
    x[3, 4], x[30, 40], x[:9, 30:] = np.nan, np.inf, np.nan
    x[20, 20] = 1e12
    for ring in (Ring(9, 3), Ring(21, 9), Ring(41, 1)):
        options = {"false_alarm": 1e-3, "looks": 2.0, "ring": ring, "kind": kind}
        found, expected = cfar(x, **options), cfar_reference(x, **options)  # type: ignore[arg-type]
        # Sums of up to 1680 values in another order.
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        assert np.isnan(found[[3, 30], [4, 40]]).all()
        assert np.isnan(found[2, 38]), "undefined itself"
        assert found[20, 20] > 1e9


def test_a_strong_neighbour_hides_a_target_from_the_mean_but_not_from_the_ordered_value() -> None:
    x = np.random.default_rng(9).exponential(size=(60, 60))
    x[30, 30], x[30, 38] = 60.0, 1e5
    found = {kind: cfar(x, false_alarm=1e-6, looks=1.0, kind=kind)[30, 30] for kind in ("ca", "os")}
    assert found["ca"] < 1 < found["os"]


def test_too_few_training_pixels_or_none_with_power() -> None:
    x = np.ones((30, 30))
    x[:, 3:] = np.nan
    found = cfar(x[:4], false_alarm=0.1, looks=1.0, ring=Ring(7, 3))
    assert np.isnan(found).all()
    assert np.isnan(cfar(np.zeros((30, 30)), false_alarm=0.1, looks=1.0)).all()


def test_what_cannot_be_detected_is_refused() -> None:
    x = np.ones((30, 30))
    for outer, guard in ((8, 3), (9, 4), (5, 5), (5, 3), (9, -1)):
        with pytest.raises(DataError, match="is no ring of 16 pixels"):
            Ring(outer, guard) if (outer, guard) != (5, 3) else Ring(5, 5)
    with pytest.raises(DataError, match="false-alarm rate of 0"):
        cfar(x, false_alarm=0.0, looks=1.0)
    with pytest.raises(DataError, match="looks are no speckle"):
        cfar(x, false_alarm=0.1, looks=-1.0)
    with pytest.raises(DataError, match="no CFAR of kind 'so'"):
        cfar(x, false_alarm=0.1, looks=1.0, kind="so")  # type: ignore[arg-type]
    with pytest.raises(DataError, match="is no image"):
        cfar(x[0], false_alarm=0.1, looks=1.0)
    with pytest.raises(DataError, match="do not fit"):
        whitened(x, CLUTTER)
    with pytest.raises(DataError, match="scattering vector of three"):
        matched(clutter(1)[:, :3, :3], CLUTTER, [0, 0, 0])


def test_zones_are_those_of_cloude_and_pottier() -> None:
    # One point inside each zone of Fig. 5 of Cloude and Pottier 1997, and the borders.
    entropy = [0.95, 0.95, 0.95, 0.7, 0.7, 0.7, 0.2, 0.2, 0.2, np.nan, 0.5, 0.9, 0.49]
    alpha = [70, 48, 20, 70, 45, 20, 70, 45, 20, 30, 40, 40, 42.4]
    found = h_alpha_zones(entropy, np.radians(alpha))
    assert found.tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 9, 0, 5, 2, 9]
    with pytest.raises(DataError, match="do not fit"):
        h_alpha_zones([0.1], [0.1, 0.2])


@given(st.lists(st.floats(-3, 3), min_size=36, max_size=36))
@settings(max_examples=60, deadline=None)
def test_every_target_has_a_zone(numbers: list[float]) -> None:
    # Zone 3 lies beyond what eigenvalues allow, except for a sliver below 55 degrees that counts as zone 2.
    k = np.array(numbers[:18]).reshape(3, 6) + 1j * np.array(numbers[18:]).reshape(3, 6)
    t = k @ k.conj().T
    if t.trace().real > 1e-6:
        found = h_a_alpha(planes_of_matrix(t)[:, None, None])
        zone = int(h_alpha_zones(found[0], found[2])[0, 0])
        assert 1 <= zone < len(NAMES)
        assert zone != 3


def mixture(looks: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Three kinds of ground side by side and their classes."""
    kinds = [np.diag([1.0, 0.1, 0.05]), np.diag([0.2, 1.0, 0.2]), np.diag([0.5, 0.4, 0.4])]
    labels = np.repeat([1, 2, 3], 20)[None, :] * np.ones((45, 1), dtype=int)
    truth = np.stack([planes_of_matrix(kind) for kind in kinds])[labels - 1].transpose(2, 0, 1)
    return speckled(truth, looks, np.random.default_rng(14)), labels


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_assignment_is_its_reference_and_the_least_distance(dtype: type) -> None:
    t, labels = mixture()
    t[4, 3, 3], t[:, 4, 4] = np.nan, 0
    centres = np.stack(
        [t[:, labels == n][:, np.isfinite(t[:, labels == n]).all(axis=0)].mean(axis=1) for n in (1, 2, 3)]
    )
    centres = np.stack([*centres, np.full(9, np.nan), planes_of_vector(np.array([1.0, 0, 0]))], axis=1)
    found, distance = wishart_assign(t.astype(dtype), centres)
    expected, distances = wishart_assign_reference(t.astype(dtype), centres)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(distance, distances, rtol=1e-12, atol=1e-13)
    assert found[3, 3] == found[4, 4] == 0
    assert np.isnan(distance[[3, 4], [3, 4]]).all()
    # ln |V| + tr(V^-1 T), by NumPy, of one pixel.
    v, m = matrix_of_planes(centres[:, 1]), matrix_of_planes(t[:, 10, 30].astype(dtype).astype(float))
    expected_one = np.linalg.slogdet(v)[1] + np.trace(np.linalg.inv(v) @ m).real
    np.testing.assert_allclose(distance[10, 30], expected_one, rtol=1e-12)
    assert (found == labels).mean() > 0.97


def test_iteration_finds_the_classes_and_ends() -> None:
    t, labels = mixture()
    h = h_a_alpha(window_average(t, 3))
    initial = h_alpha_zones(h[0], h[2])
    found = wishart_classify(t, initial, iterations=200, least_change=0.0)
    # Each step lowers the mean distance, and the last one changes nothing.
    assert (np.diff(found.distance) <= 1e-12).all()
    assert found.changed[-1] == 0
    assert len(found.changed) < 200
    # Every kind of ground lies in classes of its own: the most frequent label of each class explains nearly all.
    agree = sum(np.bincount(labels[found.classes == n]).max() for n in range(1, 10) if (found.classes == n).any())
    assert agree / labels.size > 0.95
    assert found.pixels.sum() == labels.size
    with_mean = found.centres[:, int(found.pixels.argmax())]
    np.testing.assert_allclose(t[:, found.classes == found.pixels.argmax() + 1].mean(axis=1), with_mean, rtol=1e-10)


def test_classes_that_cannot_be_are_refused() -> None:
    t, _ = mixture()
    with pytest.raises(DataError, match="do not fit an image"):
        wishart_classify(t, np.zeros((3, 3)))
    with pytest.raises(DataError, match="no class has a regular mean"):
        wishart_classify(planes_of_vector(np.ones((3, 4, 4))), np.ones((4, 4)))
    with pytest.raises(DataError, match="are no classes"):
        wishart_assign(t, np.zeros((9, 0)))
    with pytest.raises(DataError, match="0 iterations"):
        wishart_classify(t, np.ones(t.shape[1:]), iterations=0)
