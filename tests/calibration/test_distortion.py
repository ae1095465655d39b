"""The distortion model: what is applied comes off again, for every set of channels; what cannot be is refused."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_rig import complex_noise, distortion
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.calibration.distortion import CHANNELS, NO_DISTORTION, Distortion, channel_values, matrices
from processing.calibration.range_dependence import RangeDistortion
from processing.errors import DataError

seeds = st.integers(0, 10_000)


@settings(deadline=None, max_examples=40)
@given(seeds)
def test_all_four_channels_give_any_scattering_back(seed: int) -> None:
    random = np.random.default_rng(seed)
    truth = distortion(random, crosstalk_db=-6)
    s = complex_noise(random, (5, 7, 2, 2), 1.0)
    image = np.moveaxis(channel_values(truth.apply(s)), -1, 0)
    np.testing.assert_allclose(truth.remove(image), np.moveaxis(channel_values(s), -1, 0), atol=1e-12)
    # The order of the channels is the caller's.
    order = [3, 1, 0, 2]
    again = truth.remove(image[order], [CHANNELS[i] for i in order])
    np.testing.assert_allclose(again, np.moveaxis(channel_values(s), -1, 0)[order], atol=1e-12)


@settings(deadline=None, max_examples=40)
@given(seeds, st.sampled_from([("HH", "HV", "VV"), ("VV", "VH", "HH")]))
def test_three_channels_give_reciprocal_scattering_back(seed: int, names: tuple[str, ...]) -> None:
    random = np.random.default_rng(seed)
    truth = distortion(random, crosstalk_db=-10)
    s = complex_noise(random, (6, 2, 2), 1.0)
    s[:, 0, 1] = s[:, 1, 0]
    rows = [CHANNELS.index(name) for name in names]
    seen, wanted = channel_values(truth.apply(s)).T[rows], channel_values(s).T[rows]
    np.testing.assert_allclose(truth.remove(seen, names), wanted, atol=1e-12)


def test_fewer_channels_are_divided_by_their_gains_and_do_not_spoil_each_other() -> None:
    truth = distortion(np.random.default_rng(0))
    image = np.array([[1.0, np.nan], [2j, 1.0]])
    balanced = truth.remove(image, ("HH", "VV"))
    np.testing.assert_allclose(balanced[1], image[1] / (truth.receive_gain * truth.transmit_gain))
    assert np.isnan(balanced[0, 1])
    # Channels that are mixed do: a pixel without VV has no HH either.
    four = np.ones((4, 2), dtype=complex)
    four[3, 1] = np.nan
    removed = truth.remove(four)
    assert np.isnan(removed[:, 1]).all()
    assert np.isfinite(removed[:, 0]).all()


def test_noise_after_is_what_noise_becomes() -> None:
    random = np.random.default_rng(3)
    truth = distortion(random, crosstalk_db=-10)
    power = np.array([1.0, 2.0, 0.5, 3.0])
    noise = complex_noise(random, (4, 40_000), power[:, None])
    # Relative sd of a mean of n exponentially distributed powers is 1 / sqrt(n) = 0.5 %.
    found = np.mean(np.abs(truth.remove(noise)) ** 2, axis=1)
    np.testing.assert_allclose(found, truth.noise_after(power), rtol=5 / np.sqrt(40_000))
    isolated = Distortion.isolated(2.0, 0.5j)
    np.testing.assert_allclose(isolated.noise_after(power), power / [1, 4, 0.25, 1])


def test_words_for_imbalance_and_crosstalk() -> None:
    found = Distortion([[2.0, 0.1], [0.4j, 4.0]], [[1.0, 0.3], [0.05, 3.0]])
    assert found.receive[0, 0] == 1
    assert found.crosstalk == pytest.approx(
        {"receive_h": 0.05, "receive_v": 0.1j, "transmit_h": 0.05, "transmit_v": 0.1}, rel=1e-12
    )
    assert found.worst_crosstalk_db == pytest.approx(-20)
    assert found.co_db == pytest.approx(20 * np.log10(6))
    assert found.gain("HV") == pytest.approx(2)
    assert found.gain("VH") == pytest.approx(3)
    assert NO_DISTORTION.worst_crosstalk_db == -np.inf
    assert not NO_DISTORTION.has_crosstalk
    assert found.residual(found).worst_crosstalk_db < -250


def test_vectors_and_matrices_are_transmit_then_receive() -> None:
    # HV transmits H (column 0) and receives V (row 1).
    np.testing.assert_array_equal(matrices([1, 2, 3, 4]), [[1, 3], [2, 4]])
    np.testing.assert_array_equal(channel_values([[1, 3], [2, 4]]), [1, 2, 3, 4])


@pytest.mark.parametrize(
    ("receive", "words"),
    [
        ([[1, 1], [1, 1 + 1e-4]], "nearly alike"),
        ([[0, 1], [1, 0]], "no gain in H"),
        ([[1, 0], [0, 0]], "no gain in V"),
        ([[1, np.nan], [0, 1]], "finite"),
        ([1, 1], "finite"),
    ],
)
def test_radars_that_cannot_be_calibrated(receive: object, words: str) -> None:
    with pytest.raises(DataError, match=words):
        Distortion(np.asarray(receive), np.eye(2)).remove(np.ones((4, 1)))


def test_wrong_channels_are_refused() -> None:
    with pytest.raises(DataError, match="no channel RL"):
        NO_DISTORTION.remove(np.ones((1, 2)), ("RL",))
    with pytest.raises(DataError, match="has not 4 channels"):
        NO_DISTORTION.remove(np.ones((3, 2)))


def test_distortion_that_changes_with_range_comes_off_row_by_row() -> None:
    random = np.random.default_rng(6)
    near, far = distortion(random), distortion(random)
    both = RangeDistortion((4.0, 8.0), (near, far))
    middle = both.at(6.0)
    np.testing.assert_allclose(middle.receive, (near.receive + far.receive) / 2, atol=1e-15)
    np.testing.assert_allclose(both.at(1.0).receive, near.receive)
    np.testing.assert_allclose(both.at(99.0).transmit, far.transmit)
    s = complex_noise(random, (3, 5, 2, 2), 1.0)
    rows = [near, middle, far]
    image = np.stack([channel_values(d.apply(one)).T for d, one in zip(rows, s, strict=True)], axis=1)
    np.testing.assert_allclose(both.remove(image, [4, 6, 8]), np.moveaxis(channel_values(s), -1, 0), atol=1e-12)
    power = np.ones((4, 3))
    np.testing.assert_allclose(both.noise_after(power, [4, 6, 8])[:, 1], middle.noise_after(np.ones(4)))
    one = RangeDistortion((5.0,), (near,))
    np.testing.assert_allclose(one.remove(image, [4, 6, 8]), near.remove(image))


def test_ranges_that_make_no_sense_are_refused() -> None:
    for ranges, count, words in (((5.0, 5.0), 2, "increase"), ((5.0,), 2, "2 distortions"), ((np.nan,), 1, "finite")):
        with pytest.raises(DataError, match=words):
            RangeDistortion(ranges, (NO_DISTORTION,) * count)
    with pytest.raises(DataError, match="for an image"):
        RangeDistortion((5.0,), (NO_DISTORTION,)).remove(np.ones((4, 3)), [1.0, 2.0])
    with pytest.raises(DataError, match="range is"):
        RangeDistortion((5.0,), (NO_DISTORTION,)).at(np.nan)
