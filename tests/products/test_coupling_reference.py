"""The look at the sky takes the antennas' coupling off without leaving its own noise in the picture."""

from __future__ import annotations

import numpy as np
import pytest

from processing.radar.ranging import above_noise, average, noise_of_average

BINS = 4000


def noise(power: float, seed: int = 3, shape: tuple[int, ...] = (BINS,)) -> np.ndarray:
    white = np.random.default_rng(seed).normal(size=(2, *shape)) * np.sqrt(power / 2)
    return white[0] + 1j * white[1]


def test_the_coupling_stays_and_the_noise_goes() -> None:
    line = np.zeros(BINS, dtype=complex)
    line[5:12] = 0.05 * np.exp(1j * np.arange(7))
    kept = above_noise(line + noise(1e-6), np.array(1e-6))
    # 0.05^2 / 1e-6 is 34 dB: kept whole, with the noise's own 1e-3 (three sigma).
    np.testing.assert_allclose(kept[5:12], line[5:12], atol=3e-3)
    # Exponentially distributed power t N keeps t N ((t - 4) / 6)^2 from t = 4 to 10 and all above: the integral of that
    # over e^-t dt is 0.0069 N; some 73 of the bins contribute, unevenly, so it is good to half of that.
    left = np.mean(np.abs(kept[20:]) ** 2) / 1e-6
    assert left == pytest.approx(0.0069, rel=0.5)


def test_a_reference_whose_noise_is_unknown_or_none_is_kept() -> None:
    line = noise(1.0, shape=(3, 1, 50))
    kept = above_noise(line, np.array([[np.nan], [0.0], [1e6]]))
    np.testing.assert_array_equal(kept[:2], line[:2])
    np.testing.assert_array_equal(kept[2], 0)


@pytest.mark.parametrize("sweeps", [2, 3, 4, 16])
def test_noise_is_known_from_the_scatter_of_the_sweeps(sweeps: int) -> None:
    profiles = noise(2e-4, shape=(sweeps, BINS)) + 1.0
    # A few bins that change from sweep to sweep do not count.
    profiles[:, :20] *= np.exp(1j * np.arange(sweeps))[:, None]
    # Sample median of 4000: 1 / sqrt(4000) / density, below 3 %; Wilson-Hilferty is good to 1.3 %.
    assert noise_of_average(profiles) == pytest.approx(2e-4 / sweeps, rel=0.06)
    left = np.mean(np.abs(average(profiles)[20:] - 1.0) ** 2)
    assert left == pytest.approx(2e-4 / sweeps, rel=0.06)


def test_the_order_of_the_sweeps_changes_no_bit() -> None:
    profiles = noise(1.0, shape=(5, 300))
    for order in ([4, 3, 2, 1, 0], [2, 0, 1, 4, 3]):
        assert noise_of_average(profiles[order]) == noise_of_average(profiles)


def test_one_sweep_tells_nothing_of_its_noise() -> None:
    assert np.isnan(noise_of_average(noise(1.0, shape=(1, 10))))
    assert noise_of_average(np.ones((3, 10), dtype=complex)) == 0.0
