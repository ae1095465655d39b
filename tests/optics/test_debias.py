"""Coverage and bias of the degree of polarization, against the Rice distribution and Monte Carlo."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import i0e

from processing.optics.debias import debias, polarization, widening
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stokes import stokes_image

STANDARD = tuple(np.radians([0.0, 45.0, 90.0, 135.0]))


@pytest.mark.parametrize("true", [0.0, 0.1, 0.3, 0.7, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 10.0])
def test_the_interval_covers_95_percent_of_rice_distributed_intensities(true: float) -> None:
    # The polarized intensity of unit-variance S1 and S2 is Rice distributed; its density is integrated numerically.
    p = np.linspace(1e-6, 20.0, 200_001)
    density = p * np.exp(-((p - true) ** 2) / 2) * i0e(p * true)
    covered = np.abs(debias(p, 1.0) - true) <= 1.959964 * widening(p, 1.0)
    coverage = float(np.sum(density * covered) * (p[1] - p[0]))
    assert 0.949 <= coverage <= 0.977


def test_widening_goes_from_its_largest_to_none() -> None:
    assert widening(0.0, 4.0) == pytest.approx(1.7)
    assert widening(20.0, 4.0) == pytest.approx(1.0, abs=1e-9)
    assert widening(3.0, 0.0) == 1.0


@given(st.floats(0, 1e5), st.floats(1e-3, 1e6))
def test_widening_is_between_one_and_its_largest(p: float, variance: float) -> None:
    assert 1.0 <= float(widening(p, variance)) <= 1.7


@pytest.mark.parametrize("dolp", [0.0, 0.1, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("s0", [150.0, 1500.0, 60_000.0])
def test_coverage_and_bias_of_simulated_pixels(s0: float, dolp: float) -> None:
    draws = 40_000
    of = PolarizerSeries(STANDARD, (4,) * 4, (0.0,) * 4, 800.0, SensorNoise(2.0, 1.0))
    true = np.array([s0, s0 * dolp * math.cos(1.1), s0 * dolp * math.sin(1.1)])
    random = np.random.default_rng(round(s0 + 10 * dolp))
    mean = of.matrix @ true
    counts = np.rint(random.poisson(mean[:, None, None], (4, 4, draws)) + random.normal(0, 2.0, (4, 4, draws)))
    image = stokes_image(counts.mean(axis=1)[:, None, :], np.zeros((1, draws), bool), of)
    found, sd = image.dolp.astype(float), image.dolp_sd.astype(float)
    defined = np.isfinite(found)
    assert defined.mean() > 0.99
    covered = float(np.mean(np.abs(found - dolp)[defined] <= 1.959964 * sd[defined]))
    # 40,000 draws know a coverage of 95 % to 0.11 %; noise estimated from few counts costs up to 0.6 %.
    assert covered > 0.942
    if dolp / float(np.median(sd)) > 10:
        assert abs(float(np.mean(found[defined])) - dolp) < 0.005


def test_a_noisy_s0_biases_no_quotient() -> None:
    # Read noise alone, p = S0, S0 known to 1/14: without the second-order term the mean would be 1 / 14^2 = 0.5 % high.
    draws = 400_000
    random = np.random.default_rng(4)
    sd = 1 / 14
    s0, s1 = 1 + random.normal(0, sd, draws), 1 + random.normal(0, math.sqrt(2) * sd, draws)
    s2 = random.normal(0, math.sqrt(2) * sd, draws)
    covariance = np.diag([1.0, 2.0, 2.0]) * sd**2
    stokes = np.stack([s0, s1, s2], axis=-1)
    found, raw, *_ = polarization(stokes, np.broadcast_to(covariance, (draws, 3, 3)))
    sem = 0.13 / math.sqrt(draws)
    assert float(np.mean(raw)) - 1 > 0.008
    assert abs(float(np.mean(found)) - 1) < 0.001 + 4 * sem


def test_dolp_of_one_is_not_cut_off_at_one() -> None:
    # Fully polarized light: half of the debiased values are above 1 by noise; they stay, and the mean is right.
    draws = 20_000
    of = PolarizerSeries(STANDARD, (1,) * 4, (0.0,) * 4, math.inf, SensorNoise(3.0, 1.0))
    mean = of.matrix @ np.array([2000.0, 2000.0, 0.0])
    random = np.random.default_rng(0)
    counts = np.rint(random.poisson(mean[:, None], (4, draws)) + random.normal(0, 3.0, (4, draws)))
    image = stokes_image(counts[:, None, :], np.zeros((1, draws), bool), of)
    assert np.isfinite(image.dolp).mean() > 0.99
    assert 0.3 < np.mean(image.dolp > 1) < 0.7
    assert np.nanmean(image.dolp) == pytest.approx(1, abs=0.002)
