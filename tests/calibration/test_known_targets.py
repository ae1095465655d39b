"""Whitt's closed form and the maximum-likelihood fit: exact without noise, as good as first order says with it."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_rig import DIHEDRAL, DIHEDRAL_45, THREE, TRIHEDRAL, complex_noise, distortion, measure
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.calibration.distortion import channel_values, matrices
from processing.calibration.target_fit import fit_targets, refine, turned
from processing.calibration.whitt import contrast, roles, solve_targets
from processing.errors import DataError

seeds = st.integers(0, 100_000)


def scales(random, count=3):
    return np.exp(2j * np.pi * random.random(count)) * 10 ** random.uniform(-3, 3, count)


@settings(deadline=None, max_examples=40)
@given(seeds, st.permutations([0, 1, 2]), st.floats(-30, -8), st.floats(-80, 80))
def test_whitt_is_exact_for_the_three_targets_in_any_order(seed, order, level, degrees) -> None:
    random = np.random.default_rng(seed)
    truth, a = distortion(random, level, 2.0, degrees), scales(random)
    found = solve_targets((a[:, None, None] * truth.apply(THREE))[order], THREE[order])
    # Closed form: rounding only, enlarged by the inverses of three well-conditioned matrices.
    np.testing.assert_allclose(found.distortion.receive, truth.receive, atol=1e-11)
    np.testing.assert_allclose(found.distortion.transmit, truth.transmit, atol=1e-11)
    np.testing.assert_allclose(found.scale, a[order], rtol=1e-10)


@settings(deadline=None, max_examples=40)
@given(seeds)
def test_whitt_is_exact_for_other_targets_as_well(seed: int) -> None:
    # Any three of which one is regular and which share no eigenvector: here with eigenvalues 2 : 1.
    random = np.random.default_rng(seed)
    truth = distortion(random)
    expected = np.array([TRIHEDRAL, np.diag([2, 1]), [[1, 0.6], [0.6, 0.3]]], dtype=complex)
    found = solve_targets(scales(random)[:, None, None] * truth.apply(expected), expected)
    np.testing.assert_allclose(found.distortion.receive, truth.receive, atol=1e-10)
    np.testing.assert_allclose(found.distortion.transmit, truth.transmit, atol=1e-10)


def test_the_sign_that_stays_open_keeps_the_receive_phase_within_90_degrees() -> None:
    random = np.random.default_rng(1)
    truth = distortion(random, imbalance_deg=120)
    found = solve_targets(truth.apply(THREE), THREE).distortion
    # Both sides turned by 180 degrees: co-polarized ratio as it is, S_hv of opposite sign.
    assert found.receive_gain == pytest.approx(-truth.receive_gain)
    assert found.transmit_gain == pytest.approx(-truth.transmit_gain)
    s = np.array([[1, 0.3], [0.3, 2]])
    back = matrices(found.remove(channel_values(truth.apply(s))))
    np.testing.assert_allclose(back, s * [[1, -1], [-1, 1]], atol=1e-12)


@settings(deadline=None, max_examples=40)
@given(seeds)
def test_exchanging_h_and_v_is_no_solution(seed: int) -> None:
    # Trihedral and dihedral alone are explained as well by a radar with H and V exchanged; crosstalk decides.
    truth = distortion(np.random.default_rng(seed), crosstalk_db=-3.5)
    found = solve_targets(truth.apply(THREE), THREE).distortion
    np.testing.assert_allclose(found.receive, truth.receive, atol=1e-9)


@pytest.mark.parametrize(
    "expected",
    [
        np.stack([TRIHEDRAL, TRIHEDRAL, DIHEDRAL]),
        np.stack([TRIHEDRAL, DIHEDRAL]),
        np.stack([TRIHEDRAL, DIHEDRAL, -DIHEDRAL]),
        np.stack([np.diag([1, 0]), np.diag([0, 1]), np.diag([1, 0])]).astype(complex),
    ],
)
def test_targets_that_do_not_suffice_are_refused(expected) -> None:
    assert roles(expected) is None
    with pytest.raises(DataError, match="do not determine"):
        solve_targets(expected, expected)


def test_measured_targets_that_cannot_be_used_are_refused() -> None:
    with pytest.raises(DataError, match="look alike"):
        solve_targets(np.stack([TRIHEDRAL] * 3), THREE)
    with pytest.raises(DataError, match="mixture"):
        # The 45-degree dihedral stood upright.
        solve_targets(np.stack([TRIHEDRAL, DIHEDRAL, DIHEDRAL]), THREE)
    for bad, words in ((np.nan, "undefined"), (0.0, "zero")):
        with pytest.raises(DataError, match=words):
            solve_targets(np.stack([TRIHEDRAL, DIHEDRAL * bad, DIHEDRAL_45]), THREE)
    with pytest.raises(DataError, match="shapes"):
        solve_targets(np.ones((3, 4)), THREE)
    assert contrast(TRIHEDRAL, DIHEDRAL) == pytest.approx(1)
    assert contrast(TRIHEDRAL, 3j * TRIHEDRAL) == pytest.approx(0)
    assert np.isnan(contrast(np.zeros((2, 2)), DIHEDRAL))


@settings(deadline=None, max_examples=40)
@given(seeds)
def test_the_fit_is_exact_without_noise_and_finds_how_a_dihedral_stands(seed: int) -> None:
    random = np.random.default_rng(seed)
    truth, a = distortion(random), scales(random)
    off = np.radians([0, 0.0, 4.0])
    values = channel_values(a[:, None, None] * truth.apply(turned(THREE, off)))
    noise = 1e-12 * np.abs(a[:, None]) ** 2 * np.ones(4)
    # Only the angle between the two folds shows; turning both is turning the radar. So the first is stated exactly.
    found = fit_targets(values, noise, THREE, np.radians([0, 0, 5]))
    np.testing.assert_allclose(found.parameters.turn_rad, off, atol=1e-6)
    np.testing.assert_allclose(found.distortion.receive, truth.receive, atol=1e-6)
    np.testing.assert_allclose(found.distortion.transmit, truth.transmit, atol=1e-6)


def test_a_dihedral_turned_has_its_fold_turned() -> None:
    fold = np.radians(20)
    expected = [[np.cos(2 * fold), np.sin(2 * fold)], [np.sin(2 * fold), -np.cos(2 * fold)]]
    np.testing.assert_allclose(turned(np.diag([1, -1]), fold), expected, atol=1e-15)
    np.testing.assert_allclose(turned(TRIHEDRAL, fold), TRIHEDRAL, atol=1e-15)


def test_covariance_and_chi_square_are_those_of_the_scatter() -> None:
    random = np.random.default_rng(5)
    deviations, chi = [], []
    for _ in range(120):
        truth = distortion(random)
        targets = measure(random, truth, snr_db=40)
        values, noise = np.stack([t.values for t in targets]), np.stack([t.noise for t in targets])
        fit = fit_targets(values, noise, THREE, [t.turn_sd_rad for t in targets])
        sd = np.sqrt(np.diag(fit.covariance))
        error = [
            fit.distortion.receive[0, 1] - truth.receive[0, 1],
            fit.distortion.transmit[1, 1] - truth.transmit[1, 1],
        ]
        deviations.append([error[0].real / sd[0], error[1].real / sd[5], error[1].imag / sd[14]])
        chi.append(fit.chi_square)
    # Sample standard deviation of n unit deviates: 1 +- 1 / sqrt(2 n) = 6.5 %, four of them.
    np.testing.assert_allclose(np.std(deviations, axis=0), 1, atol=4 / np.sqrt(240))
    assert fit.degrees_of_freedom == 6
    # Chi square: mean k, variance 2 k.
    assert np.mean(chi) == pytest.approx(6, abs=4 * np.sqrt(12 / 120))


def test_draws_at_once_are_the_fits_one_by_one() -> None:
    random = np.random.default_rng(8)
    targets = measure(random, distortion(random))
    values, noise = np.stack([t.values for t in targets]), np.stack([t.noise for t in targets])
    sd = np.array([t.turn_sd_rad for t in targets])
    fit = fit_targets(values, noise, THREE, sd)
    drawn = values + complex_noise(random, (4, *values.shape), noise)
    together = refine(fit.parameters, drawn, noise, THREE, sd, steps=6)
    for index, one in enumerate(drawn):
        alone = fit_targets(one, noise, THREE, sd)
        np.testing.assert_allclose(together.receive[index], alone.distortion.receive, atol=1e-9)
        np.testing.assert_allclose(together.turn_rad[index], alone.parameters.turn_rad, atol=1e-9)


def test_a_fit_needs_noise_angles_and_shapes() -> None:
    good = channel_values(THREE)
    for noise, sd, words in (
        (np.zeros((3, 4)), np.zeros(3), "noise"),
        (np.ones((3, 4)), [0, -1, 0], "negative"),
        (np.full((3, 4), np.nan), np.zeros(3), "noise"),
        (np.ones((3, 3)), np.zeros(3), "shapes"),
    ):
        with pytest.raises(DataError, match=words):
            fit_targets(good, noise, THREE, sd)
