"""Clock fits against lines that are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polfuse_lab.clocks import fit_clock, fit_clocks, sync_rms_s
from polfuse_lab.session.layout import TABLES

T0_NS = 9_000_000_000_000_000_000
"""A host that has been up for 285 years: nanoseconds must not go through a float64 whole."""


def fixes(n, *, drift_ppm=0.0, noise_s=0.0, seed=0, every_s=5.0):
    device = 100.0 + every_s * np.arange(n)
    host = T0_NS + np.round((device - 100.0) * (1 + drift_ppm * 1e-6) * 1e9).astype(np.int64)
    host += np.round(np.random.default_rng(seed).normal(0, noise_s * 1e9, n)).astype(np.int64)
    return device, host, np.full(n, 20_000, np.int64)


@given(st.floats(-200, 200), st.integers(4, 60))
def test_drift_of_a_perfect_line_is_found(drift_ppm, n):
    fit = fit_clock("radar", *fixes(n, drift_ppm=drift_ppm))
    assert fit is not None
    # Host stamps are rounded to 1 ns over at least 15 s: 0.5 ns / 15 s = 3.3e-11 at each end. The model's least scatter
    # is 10 ns, which over 15 s leaves (10 ns / 11 s / 500 ppm)^2 = 3e-12 of the drift to the prior, and with few pairs
    # larger scatters are still possible: 1e-5 of at most 200 ppm.
    assert abs(fit.drift_ppm - drift_ppm) < 2e-3
    assert fit.residual_rms_s < 1e-8
    assert abs(fit.host_ns(100.0 + 5.0 * (n - 1)) - fixes(n, drift_ppm=drift_ppm)[1][-1]) <= 30  # 15 s of 2e-9


def test_residual_is_the_noise_of_the_fixes():
    # The estimate of a standard deviation from n - 2 = 398 residuals has a standard error of 1 / sqrt(2 * 398) = 3.5 %.
    fit = fit_clock("radar", *fixes(400, noise_s=70e-6, drift_ppm=20.0))
    assert fit is not None
    assert fit.residual_rms_s == pytest.approx(70e-6, rel=4 * 0.035)


def test_a_late_answer_does_not_bend_the_line():
    device, host, trip = fixes(20, noise_s=50e-6, drift_ppm=20.0)
    clean = fit_clock("radar", device, host, trip)
    host[7] += 80_000_000
    fit = fit_clock("radar", device, host, trip)
    assert clean is not None
    assert fit is not None
    assert fit.rejected >= 1
    assert abs(fit.drift_ppm - clean.drift_ppm) < 1.0
    assert fit.residual_rms_s < 100e-6


def test_too_few_fixes_are_known_to_half_the_round_trip():
    assert fit_clock("radar", *(column[:0] for column in fixes(4))) is None
    for n in (1, 2, 3):
        fit = fit_clock("radar", *fixes(n, noise_s=1e-3))
        assert fit is not None
        assert fit.residual_rms_s == pytest.approx(10e-6)


def test_repeated_readings_of_a_clock_that_stands_still():
    device, host, trip = fixes(6)
    fit = fit_clock("radar", np.full_like(device, 100.0), host, trip)
    assert fit is not None
    assert np.isfinite([fit.rate, fit.drift_sd_ppm, fit.residual_rms_s]).all()
    assert np.isfinite(fit.sd_s(100.0, near_ns=host)).all()


def test_the_worst_device_counts():
    rows = np.zeros(20, TABLES["clocks"])
    for k, (name, noise) in enumerate((("radar", 50e-6), ("camera", 900e-6))):
        part = rows[10 * k : 10 * k + 10]
        part["device"] = name.encode()
        part["t_device_s"], part["t_host_ns"], part["round_trip_ns"] = fixes(10, noise_s=noise, seed=k)
    fits = fit_clocks(rows)
    assert set(fits) == {"radar", "camera"}
    assert sync_rms_s(rows) == fits["camera"].residual_rms_s
    assert sync_rms_s(rows[:0]) is None
