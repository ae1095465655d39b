import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.radar.antenna import one_way_gain
from processing.sar.sensitivity import antenna_gain, beam_swath_m, noise_equivalent_rcs_m2, window_loss
from processing.sar.sharpness import image_contrast, image_entropy

RADAR = {
    "wavelength_m": 0.125,
    "power_w": 1.0,
    "gain": 10.0,
    "noise_figure_db": 0.0,
    "seconds": 1.0,
    "window": "rectangular",
}


@pytest.mark.parametrize("beamwidth_deg", [10, 40, 70, 110])
def test_gain_is_that_of_the_pattern_integrated(beamwidth_deg):
    # 4 pi over the integral of the power pattern over the half space, by 20000 steps of the midpoint rule.
    angle = (np.arange(20_000) + 0.5) / 20_000 * np.pi / 2
    pattern = one_way_gain(np.cos(angle), np.radians(beamwidth_deg))
    solid = 2 * np.pi * np.sum(pattern * np.sin(angle)) * (angle[1] - angle[0])
    assert antenna_gain(np.radians(beamwidth_deg)) == pytest.approx(4 * np.pi / solid, rel=1e-6)


def test_noise_as_rcs_is_the_radar_equation():
    # By hand: (4 pi)^3 = 1984.40, kT = 4.00388e-21 J, R^4 = 1e4, G^2 lambda^2 = 1.5625: 5.0849e-14 m^2.
    assert noise_equivalent_rcs_m2(10.0, **RADAR) == pytest.approx(5.0849e-14, rel=1e-4)
    # Hann: mean square 3/8 over mean squared 1/4.
    assert window_loss("hann") == pytest.approx(1.5, rel=1e-6)
    assert window_loss("rectangular") == pytest.approx(1.0, rel=1e-12)


def test_swath_is_where_the_beam_meets_the_ground():
    near, far = beam_swath_m(2.0, np.radians(45), np.radians(30))
    assert (near, far) == (pytest.approx(2 / np.tan(np.radians(60))), pytest.approx(2 / np.tan(np.radians(30))))
    assert beam_swath_m(2.0, np.radians(80), np.radians(40))[0] == 0.0
    assert beam_swath_m(2.0, 0.0, np.radians(40))[1] == np.inf


@pytest.mark.parametrize("wrong", [{"power_w": 0.0}, {"seconds": -1.0}, {"gain": np.nan}, {"window": "square"}])
def test_what_has_no_sensitivity_is_refused(wrong):
    with pytest.raises(DataError):
        noise_equivalent_rcs_m2(10.0, **{**RADAR, **wrong})


def test_beams_that_miss_the_ground_are_refused():
    with pytest.raises(DataError, match="does not meet"):
        beam_swath_m(1.0, np.radians(-60), np.radians(40))
    with pytest.raises(DataError, match="does not meet"):
        beam_swath_m(0.0, 0.3, 0.3)


@settings(deadline=None)
@given(st.integers(1, 40), st.floats(1e-3, 1e3))
def test_entropy_of_equal_pixels_is_the_log_of_their_number(count, scale):
    image = np.zeros((8, 8), dtype=complex)
    image.flat[:count] = scale * np.exp(1j * np.arange(count))
    assert image_entropy(image) == pytest.approx(np.log(count), abs=1e-9)
    # Mean square over squared mean of n ones and 64 - n zeros: 64 / n; contrast is sqrt(64 / n - 1).
    assert image_contrast(image) == pytest.approx(np.sqrt(64 / count - 1), abs=1e-7)


def test_speckle_has_contrast_one_and_its_entropy():
    # Exponential power: contrast 1; -E[p ln p] = ln n + Euler's gamma - 1. 200 x 200: 3 / sqrt(n) is 0.015.
    rng = np.random.default_rng(0)
    image = rng.normal(size=(200, 200)) + 1j * rng.normal(size=(200, 200))
    assert image_contrast(image) == pytest.approx(1.0, abs=0.03)
    assert image_entropy(image) == pytest.approx(np.log(40_000) + np.euler_gamma - 1, abs=0.015)
    both = np.stack([image, 0.5 * image])
    assert image_entropy(both) == pytest.approx(image_entropy(image), abs=1e-12)
    image[3, 4] = np.nan
    assert np.isfinite([image_entropy(image), image_contrast(image)]).all()


@pytest.mark.parametrize("image", [np.zeros((3, 3)), np.full((3, 3), np.nan), np.zeros(5), np.zeros((0, 4))])
def test_images_without_power_have_no_entropy(image):
    for measure in (image_entropy, image_contrast):
        with pytest.raises(DataError):
            measure(image)
