"""The thesis's strip and region on images whose means are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.calibration import region_analysis as ra
from processing.errors import DataError

X, Y = np.arange(-2, 2.001, 0.1), np.arange(3, 6.001, 0.2)
CHANNELS = ("HH", "HV", "VH", "VV")


def image(s: np.ndarray, seed: int = 0) -> np.ndarray:
    """A speckled region in which every channel is a multiple S of one random amplitude."""
    random = np.random.default_rng(seed)
    common = random.normal(size=(len(Y), len(X))) + 1j * random.normal(size=(len(Y), len(X)))
    return np.stack([s["HV".index(name[1]), "HV".index(name[0])] * common for name in CHANNELS])


def test_strip_is_the_mean_of_its_columns() -> None:
    values = np.zeros((1, len(Y), len(X)), dtype=complex)
    values[0] = (np.arange(len(X)) * np.exp(1j * np.arange(len(X))))[None, :]
    # 61 cm around x = 0 on a grid of 10 cm: columns 17 to 23.
    expected = np.mean(np.arange(17, 24) ** 2)
    np.testing.assert_allclose(ra.strip_power(values, X, 0.0), expected)
    values[0, 2, 18] = np.nan
    values[0, 3] = np.nan
    strip = ra.strip_power(values, X, 0.0)
    assert strip[0, 2] == pytest.approx((7 * expected - 18**2) / 6)
    assert np.isnan(strip[0, 3])


finite = st.complex_numbers(max_magnitude=10, allow_nan=False, allow_infinity=False)


@given(finite, finite, finite, st.integers(0, 100))
def test_a_pure_target_gives_its_matrix(hv: complex, vh: complex, vv: complex, seed: int) -> None:
    # Thesis 5.11: relative to HH; powers are the squares of amplitudes.
    s = np.array([[1.0, vh], [hv, vv]])
    found = ra.region_matrices(image(2.5 * s, seed), CHANNELS, X, Y, (0.0, 4.4))
    np.testing.assert_allclose(found.complex, s, atol=1e-9)
    np.testing.assert_allclose(found.power, np.abs(s) ** 2, atol=1e-9)
    # What is not zero is a multiple of HH; below 1e-150 its square is.
    for value, coherence in zip(s.ravel(), found.coherence.ravel(), strict=True):
        if abs(value) > 1e-100:
            assert coherence == pytest.approx(1)


def test_powers_do_not_tell_a_dihedral_from_a_trihedral() -> None:
    odd, even = (ra.region_matrices(image(np.diag([1.0, sign])), CHANNELS, X, Y, (0.0, 4.4)) for sign in (1.0, -1.0))
    np.testing.assert_array_equal(odd.power, even.power)
    assert odd.complex[1, 1] == pytest.approx(1)
    assert even.complex[1, 1] == pytest.approx(-1)


def test_independent_channels_have_no_coherence_and_missing_ones_no_number() -> None:
    random = np.random.default_rng(5)
    many = np.arange(-2, 2, 0.01)
    values = random.normal(size=(2, len(Y), len(many))) + 1j * random.normal(size=(2, len(Y), len(many)))
    found = ra.region_matrices(values, ("HH", "VV"), many, Y, (0.0, 4.4))
    # 61 columns by 3 rows: |coherence| of independent samples is about 1 / sqrt(n), five times that at most.
    assert found.pixels == 61 * 3
    assert found.coherence[1, 1] < 5 / np.sqrt(found.pixels)
    assert np.isnan(found.power[0, 1])
    assert np.isnan(found.complex[1, 0])


def test_undefined_pixels_are_left_out() -> None:
    values = image(np.diag([1.0, 0.5]))
    values[3, :, 20] = np.nan
    found = ra.region_matrices(values, CHANNELS, X, Y, (0.0, 4.4))
    assert found.complex[1, 1] == pytest.approx(0.5)
    assert found.pixels == 6 * 3


def test_four_repeats() -> None:
    # Mean power of 1, 2, 3 and 4; sample sd sqrt(5 / 3), in dB 4.343 sd / mean; of the mean half of that.
    found = ra.mean_of_repeats([np.array([value, 1.0]) for value in (1.0, 2.0, 3.0, 4.0)])
    assert found.mean[0] == pytest.approx(2.5)
    assert found.sd_db[0] == pytest.approx(10 / np.log(10) * np.sqrt(5 / 3) / 2.5)
    assert found.mean_sd_db[0] == pytest.approx(found.sd_db[0] / 2)
    assert found.sd_db[1] == 0
    assert found.count == 4
    single = ra.mean_of_repeats([np.array([1.0])])
    assert np.isnan(single.sd_db).all()


def test_what_cannot_be_analysed_is_refused() -> None:
    values = image(np.eye(2))
    with pytest.raises(DataError, match="not in the image"):
        ra.strip_power(values, X, 2.0)
    with pytest.raises(DataError, match="not in the image"):
        ra.region_matrices(values, CHANNELS, X, Y, (0.0, 8.0))
    with pytest.raises(DataError, match="positive"):
        ra.strip_power(values, X, 0.0, 0.0)
    with pytest.raises(DataError, match="positive"):
        ra.strip_power(values, X, float("nan"))
    with pytest.raises(DataError, match="HH among them"):
        ra.region_matrices(values[3:], ("VV",), X, Y, (0.0, 4.4))
    with pytest.raises(DataError, match="zero or undefined"):
        ra.region_matrices(np.zeros_like(values), CHANNELS, X, Y, (0.0, 4.4))
    with pytest.raises(DataError, match="zero or undefined"):
        ra.region_matrices(np.full_like(values, np.nan), CHANNELS, X, Y, (0.0, 4.4))
    with pytest.raises(DataError, match="shape"):
        ra.strip_power(values[0], X, 0.0)
    with pytest.raises(DataError, match="shapes"):
        ra.mean_of_repeats([np.zeros(3), np.zeros(4)])
    with pytest.raises(DataError, match="at least one"):
        ra.mean_of_repeats([])
