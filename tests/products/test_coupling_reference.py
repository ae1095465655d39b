"""The look at the sky takes the antennas' coupling off without leaving its own noise in the picture."""

from __future__ import annotations

import numpy as np
import pytest

from processing.radar.ranging import above_noise

BINS = 4000


def noise(power: float) -> np.ndarray:
    white = np.random.default_rng(3).normal(size=(2, BINS)) * np.sqrt(power / 2)
    return white[0] + 1j * white[1]


def test_the_coupling_stays_and_the_noise_goes() -> None:
    line = np.zeros(BINS, dtype=complex)
    line[5:12] = 0.05 * np.exp(1j * np.arange(7))
    kept = above_noise(line + noise(1e-6))
    # 0.05^2 / 1e-6 is 34 dB: shrunk by 4 N / P = 0.2 %, and noise of 2 % in amplitude on top.
    np.testing.assert_allclose(kept[5:12], line[5:12], atol=0.05 * 0.002 + 4e-3)
    # Exponentially distributed power t N shrinks to t N (1 - 4/t)^2 above t = 4: the integral of e^-t (t - 4)^2 / t
    # from 4 on is 0.0055 N; some 73 of the bins contribute, unevenly, so it is good to a third.
    left = np.mean(np.abs(kept[20:]) ** 2) / 1e-6
    assert left == pytest.approx(0.0055, rel=0.35)


def test_a_reference_without_noise_is_kept() -> None:
    line = np.zeros((2, 1, 50), dtype=complex)
    line[..., 3] = 0.2
    np.testing.assert_array_equal(above_noise(line), line)
    np.testing.assert_array_equal(above_noise(np.zeros(5)), np.zeros(5))
