"""Finding targets, calibration constants, imbalance and noise, on images whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.calibration import imbalance as im
from processing.calibration import noise as nz
from processing.calibration import offset as of
from processing.errors import DataError

X, Y = np.arange(-3, 3.001, 0.1), np.arange(5, 12.001, 0.2)


def gaussian_target(x0: float, y0: float, amplitudes: list[complex], noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Image with a Gaussian main lobe, for which the logarithmic parabola is exact; its phase turns along y."""
    envelope = np.exp(-((X[None, :] - x0) ** 2) / 0.08 - (Y[:, None] - y0) ** 2 / 0.7) * np.exp(40j * Y[:, None])
    image = np.array(amplitudes)[:, None, None] * envelope
    random = np.random.default_rng(seed)
    white = random.normal(size=(2, *image.shape)) * noise / np.sqrt(2)
    return image + white[0] + 1j * white[1]


@given(st.floats(-1, 1), st.floats(7, 10))
def test_peak_between_pixels(x0: float, y0: float) -> None:
    image = gaussian_target(x0, y0, [2.0, 1j])
    found = of.locate_target(image, X, Y, (x0 + 0.2, y0 - 0.3), radius_m=1.0)
    assert found.x_m == pytest.approx(x0, abs=1e-9)
    assert found.y_m == pytest.approx(y0, abs=1e-9)
    assert found.power == pytest.approx(4.0, rel=1e-9)
    assert np.abs(found.values[0]) == pytest.approx(2.0, rel=1e-9)
    assert found.values[1] / found.values[0] == pytest.approx(0.5j, rel=1e-9)


def test_brightest_of_several_near_the_place_counts() -> None:
    image = gaussian_target(0, 8, [1.0]) + gaussian_target(-1.5, 8, [3.0]) + gaussian_target(2.5, 8, [9.0])
    assert of.locate_target(image, X, Y, (-0.6, 8), radius_m=1.2).x_m == pytest.approx(-1.5, abs=0.02)


def test_bad_targets_are_refused_with_the_reason() -> None:
    image = gaussian_target(0, 8, [1.0], noise=0.01)
    with pytest.raises(DataError, match="outside the image"):
        of.locate_target(image, X, Y, (5.0, 8.0), radius_m=1.0)
    with pytest.raises(DataError, match="outside the image"):
        of.locate_target(image, X, Y, (float("nan"), 8.0), radius_m=1.0)
    with pytest.raises(DataError, match="dB above the background"):
        of.locate_target(image, X, Y, (2.0, 10.5), radius_m=0.7)
    with pytest.raises(DataError, match="no peak within"):
        of.locate_target(gaussian_target(0, 8, [1.0]), X, Y, (2.0, 8.0), radius_m=0.7)
    with pytest.raises(DataError, match="no peak within"):
        of.locate_target(np.zeros((1, len(Y), len(X)), dtype=complex), X, Y, (0.0, 8.0), radius_m=0.7)
    with pytest.raises(DataError, match="no peak within"):
        of.locate_target(np.full((1, len(Y), len(X)), np.nan + 0j), X, Y, (0.0, 8.0), radius_m=0.7)
    undefined = gaussian_target(0, 8, [1.0, 1.0])
    undefined[1] = np.nan
    with pytest.raises(DataError, match="undefined in a channel"):
        of.locate_target(undefined, X, Y, (0.0, 8.0), radius_m=0.7)


def test_nan_pixels_beside_the_peak_do_not_spoil_it() -> None:
    image = gaussian_target(0, 8, [1.0])
    image[0, np.argmin(np.abs(Y - 8)), np.argmin(np.abs(X)) + 1] = np.nan
    found = of.locate_target(image, X, Y, (0.0, 8.0), radius_m=0.7)
    assert np.isfinite(found.power)
    assert found.x_m == pytest.approx(0, abs=0.05)


def test_background_of_noise_and_the_sd_that_it_gives() -> None:
    # Mean power 0.01^2; a median over n exponential samples has a relative sd of 1 / (ln 2 sqrt n).
    n = len(X) * len(Y)
    image = gaussian_target(0, 8, [0.0], noise=0.01)
    assert of.background_power(image[0]) == pytest.approx(1e-4, rel=5 / (np.log(2) * np.sqrt(n)))
    # Monte Carlo of 10 log10 |1 + n|^2 at 25 dB; sd of a sample sd is sd / sqrt(2 n).
    random = np.random.default_rng(4)
    white = (random.normal(size=20_000) + 1j * random.normal(size=20_000)) * np.sqrt(10**-2.5 / 2)
    spread = np.std(10 * np.log10(np.abs(1 + white) ** 2))
    assert of.snr_sd_db(25.0) == pytest.approx(spread, rel=5 / np.sqrt(40_000) + 0.01)
    assert np.isnan(of.background_power(np.full((3, 3), np.nan)))


@given(st.floats(1e-9, 1e3), st.floats(1e-3, 1e4))
def test_offset_gives_the_target_its_rcs_and_keeps_ratios(power: float, rcs: float) -> None:
    amplitudes = of.offset_map(power, rcs)
    assert amplitudes.rcs_dbsm(power) == pytest.approx(10 * np.log10(rcs), abs=1e-9)
    image = np.array([1 + 1j, -0.3j, 0.0, np.nan]) * np.sqrt(power)
    scattering = amplitudes.scattering(image)
    np.testing.assert_allclose(scattering, image * np.sqrt(rcs / power), rtol=1e-9)


def test_two_point_map_of_the_thesis() -> None:
    # Thesis 5.9 with its own figures: 1.02e-3 W is 30.78 dBsm, 1e-7 W is 0 dBsm: slope 30.78 / 40.1 = 0.77.
    amplitudes = of.two_point_map(1.02e-3, 10**3.078, 1e-7)
    assert amplitudes.slope == pytest.approx(30.78 / (10 * np.log10(1.02e4)), rel=1e-12)
    assert amplitudes.slope == pytest.approx(0.77, abs=0.005)
    assert amplitudes.rcs_dbsm(1.02e-3) == pytest.approx(30.78, abs=1e-9)
    assert amplitudes.rcs_dbsm(1e-7) == pytest.approx(0.0, abs=1e-9)
    value = 1e-2 * np.exp(0.4j)
    scattering = amplitudes.scattering(np.array([value, 0.0, np.nan]))
    assert np.angle(scattering[0]) == pytest.approx(0.4)
    assert 20 * np.log10(abs(scattering[0])) == pytest.approx(float(amplitudes.rcs_dbsm(1e-4)))
    assert scattering[1] == 0
    assert np.isnan(scattering[2])
    with pytest.raises(DataError, match="as strong as"):
        of.two_point_map(1.0, 1.0, 2.0)
    with pytest.raises(DataError, match="positive"):
        of.offset_map(0.0, 1.0)


phases = st.floats(-1.2, 1.2)
gains = st.floats(0.5, 2.0)


@given(gains, phases, gains, phases, st.integers(0, 1000))
def test_imbalance_is_recovered_and_removed(ar, pr, at, pt, seed) -> None:
    # M = R S T with diagonal R and T (relative phase below 90 degrees): trihedral and reciprocal clutter give both.
    f_r, f_t = ar * np.exp(1j * pr), at * np.exp(1j * pt)
    r, t = np.diag([1, f_r]), np.diag([1, f_t])
    random = np.random.default_rng(seed)
    cross = random.normal(size=40) + 1j * random.normal(size=40)
    clutter = np.stack([np.stack([np.ones(40), cross], axis=-1), np.stack([cross, np.ones(40)], axis=-1)], axis=-2)
    measured = r @ clutter @ t
    trihedral = r @ np.eye(2) @ t
    ratio = im.cross_ratio(measured[:, 1, 0], measured[:, 0, 1], np.ones(40, dtype=bool))
    assert ratio is not None
    assert ratio.coherence == pytest.approx(1, abs=1e-9)
    found = im.imbalance(trihedral[1, 1] / trihedral[0, 0], ratio.ratio)
    assert found.receive_gain == pytest.approx(f_r, rel=1e-6)
    assert found.transmit_gain == pytest.approx(f_t, rel=1e-6)
    # HV is transmit H, receive V: M[V, H].
    image = np.stack([measured[:, 0, 0], measured[:, 1, 0], measured[:, 0, 1], measured[:, 1, 1]])
    balanced = found.remove(image)
    np.testing.assert_allclose(balanced, [np.ones(40), cross, cross, np.ones(40)], rtol=1e-6)


def test_imbalance_in_decibels_and_degrees() -> None:
    found = im.imbalance(10 ** (0.8 / 20) * np.exp(1j * np.radians(15)), None)
    assert found.co_db == pytest.approx(0.8)
    assert found.co_deg == pytest.approx(15)
    assert found.receive_gain == pytest.approx(found.transmit_gain)
    with pytest.raises(DataError, match="VV / HH"):
        im.imbalance(0.0, None)


def test_cross_ratio_needs_enough_coherent_pixels() -> None:
    random = np.random.default_rng(1)
    a, b = random.normal(size=(2, 200)) + 1j * random.normal(size=(2, 200))
    everything = np.ones(200, dtype=bool)
    assert im.cross_ratio(a, b, everything) is None
    assert im.cross_ratio(a, a, np.arange(200) < 5) is None
    assert im.cross_ratio(np.zeros(200), np.zeros(200), everything) is None
    undefined = a.copy()
    undefined[:100] = np.nan
    found = im.cross_ratio(undefined, 2 * a, everything)
    assert found is not None
    assert found.pixels == 100
    assert found.ratio == pytest.approx(0.5)


def test_crosstalk_and_cross_polarized_pixels() -> None:
    found = im.crosstalk_db({"HH": 2.0, "VV": 1.0, "HV": 0.02j, "VH": 0.1})
    assert found == pytest.approx({"HV": -40.0, "VH": -20.0})
    assert im.crosstalk_db({"HH": 1.0, "HV": 0.0}) == {"HV": -np.inf}
    assert im.crosstalk_db({"HH": 1.0, "VH": 0.1}) == pytest.approx({"VH": -20.0})
    image = {"HH": [1.0, 1.0, 1.0], "VV": [1.0, 1.0, 1.0], "HV": [0.5, 0.2, 0.5], "VH": [0.5, 0.5, 0.5]}
    # 10 dB above a crosstalk of -20 dB is an amplitude of 0.316.
    levels = {"HV": -20.0, "VH": -20.0}
    np.testing.assert_array_equal(im.cross_polarized_pixels(image, levels, {"HV": 0.0, "VH": 0.0}), [True, False, True])
    np.testing.assert_array_equal(
        im.cross_polarized_pixels(image, levels, {"HV": 0.1, "VH": 0.0}), [False, False, False]
    )


def test_noise_floor_of_white_noise_and_its_focused_value() -> None:
    random = np.random.default_rng(3)
    range_m = np.arange(0, 40, 0.25)
    sigma = 3e-4
    white = (random.normal(size=(2, 30, 160)) + 1j * random.normal(size=(2, 30, 160))) * sigma / np.sqrt(2)
    floor = nz.noise_floor(white * range_m**2, range_m, window_m=10.0, range_compensated=True)
    # 41 bins of 30 positions: relative sd of the median 1 / (ln 2 sqrt n), fewer bins (about 20) at the ends.
    error = floor[:, 1:] / (sigma**2 * range_m[1:] ** 4) - 1
    assert np.abs(error).max() < 5 / (np.log(2) * np.sqrt(20 * 30))
    plain = nz.noise_floor(white, range_m, window_m=10.0, range_compensated=False)
    np.testing.assert_allclose(plain[:, 1:] * range_m[1:] ** 4, floor[:, 1:], rtol=0.2)
    y = np.array([3.0, 12.0, 39.9])
    focused = nz.focused_noise(floor, range_m, y, -9.0, 1 / 30)
    slant = np.hypot(y, 9.0)
    np.testing.assert_allclose(focused[:, :2], np.tile(sigma**2 * slant[:2] ** 4 / 30, (2, 1)), rtol=0.35)
    assert np.isnan(focused[:, 2]).all()


def test_noise_floor_ignores_a_stray_echo_and_missing_positions() -> None:
    random = np.random.default_rng(8)
    range_m = np.arange(1, 41, 0.25)
    white = (random.normal(size=(1, 4, 160)) + 1j * random.normal(size=(1, 4, 160))) / np.sqrt(2)
    clean = nz.noise_floor(white, range_m, window_m=10.0, range_compensated=False)
    white[:, :, 80:83] = 1000
    white[:, 3] = np.nan
    spoilt = nz.noise_floor(white, range_m, window_m=10.0, range_compensated=False)
    # Three of four positions are left and 3 of 41 bins are an echo: the median moves by a few tens of percent.
    np.testing.assert_allclose(spoilt, clean, rtol=0.5)
    nothing = nz.noise_floor(np.full((1, 2, 160), np.nan), range_m, window_m=1.0, range_compensated=False)
    assert np.isnan(nothing).all()
    with pytest.raises(DataError, match="shape"):
        nz.noise_floor(white[0], range_m, window_m=1.0, range_compensated=False)


def test_background_by_row() -> None:
    random = np.random.default_rng(2)
    levels = np.array([1.0, 4.0, np.nan])
    white = (random.normal(size=(1, 3, 4000)) + 1j * random.normal(size=(1, 3, 4000))) / np.sqrt(2)
    found = nz.background_by_row(white * np.sqrt(levels)[None, :, None])
    np.testing.assert_allclose(found[0, :2], levels[:2], rtol=5 / (np.log(2) * np.sqrt(4000)))
    assert np.isnan(found[0, 2])
