"""Judging targets by their channels: whatever the imbalance, in spite of crosstalk, and with reasons."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_rig import DIHEDRAL, DIHEDRAL_45, TRIHEDRAL, complex_noise, distortion
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.calibration.distortion import Distortion, channel_values
from processing.calibration.target_checks import (
    average_repeats,
    check_amplitude,
    check_different,
    check_orientation,
    fold_seen,
)
from processing.calibration.target_fit import turned
from processing.errors import DataError


@settings(deadline=None, max_examples=40)
@given(st.floats(0, 45), st.floats(-10, 10), st.floats(-10, 10), st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi))
def test_the_fold_is_seen_through_any_imbalance(fold, r_db, t_db, r_rad, t_rad) -> None:
    radar = Distortion.isolated(10 ** (r_db / 20) * np.exp(1j * r_rad), 10 ** (t_db / 20) * np.exp(1j * t_rad))
    values = channel_values(radar.apply(turned(DIHEDRAL, np.radians(fold))))
    # Rounding of a zero channel of 1e-16 shows as its root.
    assert np.degrees(fold_seen(values)) == pytest.approx(fold, abs=1e-5)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.sampled_from([("trihedral", TRIHEDRAL, 0), ("dihedral", DIHEDRAL, 90),
                                                ("dihedral", DIHEDRAL_45, 45)]))  # fmt: skip
def test_good_targets_pass_in_spite_of_crosstalk(seed, target) -> None:
    kind, s, fold = target
    values = channel_values(distortion(np.random.default_rng(seed), crosstalk_db=-18).apply(s))
    verdict = check_orientation(kind, values, np.radians(fold))
    assert verdict.ok
    assert not verdict.reason


def test_a_channel_that_only_crosstalk_reaches_may_be_empty() -> None:
    """With one antenna that leaks and one that does not, VH of a trihedral is crosstalk and HV is nothing at all."""
    assert check_orientation("trihedral", [1.0, 0.0, 0.1, 1.0]).ok
    assert check_orientation("dihedral", [-1.0, 0.0, 0.1, 1.0], np.pi / 2).ok
    assert check_orientation("dihedral", [0.1, 1.0, 1.0, 0.0], np.pi / 4).ok


@pytest.mark.parametrize(
    ("kind", "fold", "s", "words"),
    [
        ("dihedral", 90, turned(DIHEDRAL, np.radians(20)), "fold stands 20 degrees from level or upright instead of 0"),
        ("dihedral", 45, DIHEDRAL, "fold stands 0 degrees from level or upright instead of 45"),
        ("trihedral", 0, turned(DIHEDRAL, np.radians(20)), "cross-polarized return is -1.5 dB"),
        ("plate", 0, DIHEDRAL_45 + 0.1 * TRIHEDRAL, "cross-polarized return is 20.0 dB"),
        ("trihedral", 0, np.diag([1, 0]), "channel VV shows nothing"),
        ("dihedral", 45, [[0, 1], [0, 0]], "channel HV shows nothing"),
        ("dihedral", 45, np.zeros((2, 2)), "shows nothing"),
        ("trihedral", 0, np.full((2, 2), np.nan), "undefined"),
    ],
)
def test_bad_targets_are_refused_with_reason_and_advice(kind, fold, s, words) -> None:
    verdict = check_orientation(kind, channel_values(s), np.radians(fold))
    assert not verdict.ok
    assert words in verdict.reason
    assert verdict.advice


def test_a_target_that_returns_too_little_or_too_much() -> None:
    assert check_amplitude(10.0, 12.0, 0.1).ok
    assert "6.0 dB below" in check_amplitude(3.0, 12.0, 0.1).reason
    assert "6.0 dB above" in check_amplitude(48.0, 12.0, 0.1).reason
    # Angles known to 5 degrees leave 2.6 dB open.
    assert check_amplitude(3.0, 12.0, 2.6).ok
    assert not check_amplitude(float("nan"), 12.0, 0.1).ok
    assert not check_amplitude(0.0, 12.0, 0.1).ok


def test_the_same_target_twice_is_seen() -> None:
    radar = distortion(np.random.default_rng(1))
    one, other = (channel_values(radar.apply(s)) for s in (TRIHEDRAL, 2j * TRIHEDRAL))
    with pytest.raises(DataError, match="corner and upright look alike"):
        check_different(("corner", "upright"), one, other)
    check_different(("corner", "upright"), one, channel_values(radar.apply(DIHEDRAL)))
    with pytest.raises(DataError, match="look alike"):
        check_different(("corner", "upright"), np.zeros(4), other)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 1000))
def test_repeats_placed_anew_are_averaged_in_phase(seed) -> None:
    random = np.random.default_rng(seed)
    values = complex_noise(random, 4, 1.0)
    amplitudes = 1 + 0.1 * random.normal(size=5)
    repeats = amplitudes[:, None] * np.exp(2j * np.pi * random.random((5, 1))) * values
    mean, aligned = average_repeats(repeats)
    # Exact but for one phase of all: the mean of the amplitudes.
    np.testing.assert_allclose(np.abs(mean), amplitudes.mean() * np.abs(values), rtol=1e-9)
    np.testing.assert_allclose(mean / mean[0], values / values[0], rtol=1e-9)
    assert aligned.shape == (5, 4)


def test_repeats_that_are_not_whole_are_left_out() -> None:
    whole = np.array([[1, 2, 3, 4.0]], dtype=complex)
    mean, aligned = average_repeats(np.concatenate([whole, np.full((1, 4), np.nan)]))
    np.testing.assert_allclose(mean, whole[0])
    assert len(aligned) == 1
    with pytest.raises(DataError, match="no repeat"):
        average_repeats(np.full((2, 4), np.nan))
