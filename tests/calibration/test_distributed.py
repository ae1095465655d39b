"""Quegan's and Ainsworth's estimates on clutter whose covariance and whose radar are known."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_rig import complex_noise, distortion

from processing.calibration.distortion import channel_values
from processing.calibration.distributed import estimate_crosstalk
from processing.errors import DataError

COUNT = 20_000


def clutter(random, truth, *, slope=0.0, count=COUNT, noise=0.0, cross=0.4):
    """Channels (4, n) of reciprocal clutter with a partly coherent HH and VV, and HV by ``slope`` coherent with HH."""
    hh = complex_noise(random, count, 2.0)
    vv = 0.5 * hh + 0.8 * complex_noise(random, count, 2.0)
    x = cross * complex_noise(random, count, 2.0) + slope * hh
    s = np.moveaxis(np.array([[hh, x], [x, vv]]), -1, 0)
    return channel_values(truth.apply(s)).T + complex_noise(random, (4, count), noise)


def columns(matrix):
    """Crosstalk outside the gains: each column over its diagonal element."""
    return matrix / np.diag(matrix)


def test_quegan_finds_crosstalk_and_imbalance_of_clutter_without_slope() -> None:
    random = np.random.default_rng(1)
    truth = distortion(random)
    found = estimate_crosstalk(clutter(random, truth), method="quegan")
    trihedral = found.without_crosstalk(channel_values(truth.apply(np.eye(2))))
    made = found.distortion(trihedral[3] / trihedral[0])
    # Each crosstalk is a mean of n products over the power: |x| / |hh| / sqrt(n) = 0.3 %, a few of them: -45 dB.
    assert truth.residual(made).worst_crosstalk_db < -40
    assert made.co_db == pytest.approx(truth.co_db, abs=0.05)
    assert made.co_deg == pytest.approx(truth.co_deg, abs=0.5)
    assert found.coherence == pytest.approx(1, abs=1e-6)
    assert found.pixels == COUNT
    # The scatter between parts of the region says how good it is.
    error = abs(found.receive[1, 0] - columns(truth.receive)[1, 0])
    assert error < 4 * found.sd["u"] < 0.06


def test_standard_deviations_are_those_of_the_scatter() -> None:
    random = np.random.default_rng(4)
    truth = distortion(random)
    errors, sds = [], []
    for _ in range(25):
        found = estimate_crosstalk(clutter(random, truth, count=1500))
        errors.append(found.receive[1, 0] - columns(truth.receive)[1, 0])
        sds.append(found.sd["u"])
    # Both from 25 trials: 1 / sqrt(50) = 14 % and a bias of the second order; three of them.
    rms = np.sqrt(np.mean(np.abs(errors) ** 2))
    assert np.sqrt(np.mean(np.square(sds))) == pytest.approx(rms, rel=0.45)


@pytest.mark.parametrize("slope", [0.0, 0.15])
def test_ainsworth_makes_channels_reciprocal_whatever_the_slope(slope: float) -> None:
    random = np.random.default_rng(2)
    truth = distortion(random)
    image = clutter(random, truth, slope=slope)
    found = estimate_crosstalk(image, method="ainsworth")
    out = found.without_crosstalk(image)
    # Reciprocity is all that it asks for, and without noise it is met exactly.
    left = out[1] - found.cross_ratio * out[2]
    assert np.linalg.norm(left) < 1e-6 * np.linalg.norm(out[1])
    # What differs between the two paths is found; what they have in common stays (none in this estimate).
    u, v = found.receive[1, 0], found.transmit[0, 1]
    assert u / np.sqrt(found.cross_ratio) == pytest.approx(-v * np.sqrt(found.cross_ratio), abs=0.02)


def test_ainsworth_leaves_the_slope_in_and_quegan_takes_it_for_crosstalk() -> None:
    random = np.random.default_rng(6)
    truth = distortion(random, crosstalk_db=-80)
    image = clutter(random, truth, slope=0.05)
    assert abs(estimate_crosstalk(image, method="ainsworth").receive[1, 0]) < 1e-3
    assert abs(estimate_crosstalk(image, method="quegan").receive[1, 0]) > 0.02


def test_noise_does_not_bias_the_cross_ratio() -> None:
    random = np.random.default_rng(7)
    truth = distortion(random, crosstalk_db=-30)
    found = estimate_crosstalk(clutter(random, truth, noise=0.05))
    assert 0.5 < found.coherence < 0.97
    # Total least squares; sd sqrt((1 - c^2) / (2 n)) / c is 0.3 %.
    assert found.cross_ratio == pytest.approx(truth.receive_gain / truth.transmit_gain, rel=0.02)


def test_masks_and_undefined_pixels_are_left_out() -> None:
    random = np.random.default_rng(8)
    truth = distortion(random)
    image = clutter(random, truth, count=4000)
    spoilt = image.copy()
    spoilt[0, :100] = np.nan
    spoilt[:, 100:200] *= 1000
    mask = np.arange(4000) >= 200
    np.testing.assert_allclose(
        estimate_crosstalk(spoilt, mask=mask).receive, estimate_crosstalk(image[:, 200:]).receive, rtol=1e-12
    )


def test_regions_that_tell_nothing_are_refused() -> None:
    random = np.random.default_rng(9)
    truth = distortion(random)
    good = clutter(random, truth, count=500)
    single = np.outer([1, 0.1, 0.1, 0.7], complex_noise(random, 500, 1.0))
    dead = good.copy()
    dead[2] = 0
    for image, words in (
        (good[:, :20], "too few"),
        (good[:3], "not four channels"),
        (dead, "channel VH is empty"),
        (np.full((4, 500), np.nan), "too few"),
        (np.zeros((4, 500)), "empty"),
        (complex_noise(random, (4, 500), 1.0), "above -6 dB"),
        (clutter(random, distortion(random, crosstalk_db=-80), noise=1.0, cross=0.1), "have a coherence of 0.0"),
        (single, "one and the same"),
        (clutter(np.random.default_rng(0), truth, slope=1j, count=500), "above -6 dB"),
    ):
        with pytest.raises(DataError, match=words):
            estimate_crosstalk(image)
    with pytest.raises(DataError, match="no method"):
        estimate_crosstalk(good, method="freeman")  # type: ignore[arg-type]
