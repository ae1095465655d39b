"""Stokes parameters, their errors and flags: closed forms, Monte Carlo, kernel against reference, invariants."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics.analyser import measurement_matrix
from processing.optics.debias import UNKNOWN_ANGLE_SD_RAD, debias, polarization
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stokes import (
    AOP_SNR,
    PLANES,
    SHADOW_SNR,
    Flag,
    stokes_image,
    stokes_planes,
    stokes_planes_reference,
)

STANDARD = (0.0, math.pi / 4, math.pi / 2, 3 * math.pi / 4)


def series(
    angles: tuple[float, ...] = STANDARD,
    *,
    frames: int = 1,
    read: float = 1.0,
    electrons: float = 1.0,
    dark: int = 0,
    extinction: float = math.inf,
) -> PolarizerSeries:
    return PolarizerSeries(
        angles, (frames,) * len(angles), (0.0,) * len(angles), extinction, SensorNoise(read, electrons), dark
    )


def light(stokes: np.ndarray, of: PolarizerSeries) -> np.ndarray:
    """(K, 1, n) noiseless intensities of (n, 3) Stokes vectors."""
    return (of.matrix @ np.atleast_2d(stokes).T)[:, None, :]


def one(stokes: tuple[float, float, float], of: PolarizerSeries | None = None) -> dict[str, float]:
    of = of or series()
    planes, flags = stokes_planes(light(np.array(stokes), of), np.zeros((1, 1), bool), of)
    return {**dict(zip(PLANES, map(float, planes[:, 0, 0]), strict=True)), "flags": int(flags[0, 0])}


@pytest.mark.parametrize("degrees", [-89.9, -60, -45, -1, 0, 30, 45, 89, 90])
@pytest.mark.parametrize("dolp", [0.02, 0.3, 1.0])
def test_degree_and_angle_of_known_states(degrees: float, dolp: float) -> None:
    angle = math.radians(degrees)
    s0 = 4e7
    # At 4e7 counts noise and its bias are below 1e-4 of DOLP 0.02: sd(S0) / S0 = 1 / sqrt(S0) = 1.6e-4, squared / dolp.
    pixel = one((s0, s0 * dolp * math.cos(2 * angle), s0 * dolp * math.sin(2 * angle)))
    assert pixel["dolp_raw"] == pytest.approx(dolp, rel=1e-6)
    assert pixel["dolp"] == pytest.approx(dolp, abs=1.6e-4**2 / dolp)
    assert pixel["aop"] == pytest.approx(angle, abs=1e-6)
    assert pixel["flags"] == 0


def test_vertical_light_has_aop_plus_90_whatever_the_sign_of_zero() -> None:
    for s2 in (0.0, -0.0):
        covariance = np.eye(3)
        assert polarization([1e6, -1e5, s2], covariance)[3] == math.pi / 2


def test_noise_of_four_frames_has_its_closed_form() -> None:
    # Four angles, unpolarized S0: each intensity S0/2, variance v = read^2 + 1/12 + S0 / (2 g);
    # S0 = sum / 2 so var(S0) = v; S1 = I0 - I90 so var(S1) = 2 v; DOLP 0 has sd 1.7 sqrt(2 v) / S0:
    # there a Rayleigh distribution's 95 % reach to 2.45 sqrt(2 v) / S0, debiased to 2.24, below 1.96 times 1.7.
    of = series(read=3.0, electrons=2.0)
    v = 9 + 1 / 12 + 10_000 / 4
    pixel = one((10_000.0, 0.0, 0.0), of)
    assert pixel["s0_sd"] == pytest.approx(math.sqrt(v), rel=1e-6)
    assert pixel["dolp_sd"] == pytest.approx(1.7 * math.sqrt(2 * v) / 10_000, rel=1e-6)
    # A dark image from n frames adds (read^2 + 1/12) / n to each intensity alike: S0 = sum / 2 gets 4 times that.
    dark = one((10_000.0, 0.0, 0.0), series(read=3.0, electrons=2.0, dark=5))
    assert dark["s0_sd"] == pytest.approx(math.sqrt(v + 4 * (9 + 1 / 12) / 5), rel=1e-6)
    assert dark["dolp_sd"] == pytest.approx(pixel["dolp_sd"], rel=1e-6)


@pytest.mark.parametrize("angles", [STANDARD, (0.1, 1.2, 2.0), (0.0, 0.5, 1.0, 1.6, 2.5)])
@pytest.mark.parametrize("dolp", [0.1, 0.6])
def test_predicted_sds_are_those_of_many_simulated_pixels(angles: tuple[float, ...], dolp: float) -> None:
    draws = 200_000
    of = series(angles, frames=2, read=4.0, electrons=1.5, extinction=50.0)
    true = np.array([4000.0, 4000 * dolp * math.cos(0.8), 4000 * dolp * math.sin(0.8)])
    random = np.random.default_rng(11)
    mean = of.matrix @ true
    frames = np.rint(
        random.poisson(mean[:, None, None] * 1.5, (len(angles), 2, draws)) / 1.5
        + random.normal(0, 4.0, (len(angles), 2, draws))
    ).mean(axis=1)
    image = stokes_image(frames[:, None, :], np.zeros((1, draws), bool), of)
    # An sd from n draws is itself uncertain by 1 / sqrt(2 n) = 0.16 %; five of these, plus 0.5 % for the
    # first-order propagation at SNR 50.
    for name in ("s0", "dolp", "dolp_raw", "aop"):
        spread = float(np.std(getattr(image, name), dtype=np.float64))
        predicted = float(np.mean(getattr(image, "dolp_sd" if "dolp" in name else f"{name}_sd"), dtype=np.float64))
        assert predicted == pytest.approx(spread, rel=0.013), name


@pytest.mark.parametrize("dolp", [0.05, 0.1, 0.5])
def test_debiasing_removes_the_bias_of_noise(dolp: float) -> None:
    # S0 / sd(S1) = 30: raw DOLP is too large by about b^2 / (2 p S0); MAS leaves a tenth of it or less above 2 sd.
    draws = 400_000
    random = np.random.default_rng(5)
    s1 = dolp + random.normal(0, 1 / 30, draws)
    s2 = random.normal(0, 1 / 30, draws)
    raw = np.hypot(s1, s2)
    bias_raw = raw.mean() - dolp
    bias = debias(raw, np.full(draws, 1 / 900)).mean() - dolp
    assert bias_raw > 0
    if dolp >= 2 / 30:
        sem = 1 / 30 / math.sqrt(draws)
        assert abs(bias) < 0.15 * bias_raw + 4 * sem
    else:
        assert abs(bias) < bias_raw


def test_debiasing_has_its_limits() -> None:
    # Large p: p - b^2 / 2p. Small p: p / 2 (series of the exponential). Zero noise: p.
    assert debias(100.0, 4.0) == pytest.approx(100 - 4 / 200, rel=1e-15)
    assert debias(1e-6, 1.0) == pytest.approx(0.5e-6, rel=1e-9)
    assert debias(3.0, 0.0) == 3.0
    assert debias(0.0, 1.0) == 0.0
    assert np.isnan(debias(np.nan, 1.0))


@given(st.floats(0, 1e6), st.floats(0, 1e6))
def test_debiased_intensity_is_between_zero_and_the_raw_one(p: float, variance: float) -> None:
    assert 0 <= float(debias(p, variance)) <= p


def random_light(of: PolarizerSeries, seed: int, shape: tuple[int, int] = (40, 50)) -> tuple[np.ndarray, np.ndarray]:
    """Intensities from deep shadow to full scale, polarized from nothing to impossible, some saturated or undefined."""
    random = np.random.default_rng(seed)
    s0 = 10 ** random.uniform(-1, 4.8, shape)
    dolp, angle = random.uniform(0, 1.3, shape) ** 2, random.uniform(-2, 2, shape)
    stokes = np.stack([s0, s0 * dolp * np.cos(2 * angle), s0 * dolp * np.sin(2 * angle)])
    images = np.tensordot(of.matrix, stokes, axes=1) + random.normal(0, 3, (len(of.angles_rad), *shape))
    images[0, 3, 4:9] = np.nan
    images[-1, 5, 5] = np.inf
    images[:, 10, :10] = 0.0
    images[:, 11, :10] = 1000.0
    return images, random.random(shape) < 0.02


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("angles", [STANDARD, (0.1, 1.2, 2.0), tuple(np.linspace(0, 3, 9))])
@pytest.mark.parametrize("incomplete", [False, True])
def test_kernel_is_its_reference(angles: tuple[float, ...], dtype: type, incomplete: bool) -> None:
    of = series(angles, frames=3, read=3.0, electrons=0.7, dark=4, extinction=800.0)
    images, saturated = random_light(of, len(angles))
    images = images.astype(dtype)
    planes, flags = stokes_planes(images, saturated, of, incomplete=incomplete)
    expected, expected_flags = stokes_planes_reference(images, saturated, of, incomplete=incomplete)
    np.testing.assert_array_equal(flags, expected_flags)
    # Every reason occurs, or the comparison proves nothing.
    for flag in Flag:
        assert (flags & flag.value).any(), flag
    assert (flags == (Flag.INCOMPLETE if incomplete else 0)).any()
    for name, got, wanted in zip(PLANES, planes, expected, strict=True):
        np.testing.assert_array_equal(np.isnan(got), np.isnan(wanted), err_msg=name)
        # Differences of intensities are known to float64's rounding of S0, fractions and angles to that of 1; the
        # results are rounded to float32 (6e-8).
        scale = np.abs(expected[0]) if name in ("s0", "s1", "s2") else np.ones_like(wanted)
        defined = np.isfinite(wanted)
        error = np.abs(got - wanted)[defined]
        assert np.all(error <= 1e-6 * np.maximum(np.abs(wanted), scale)[defined]), name


def test_flags_say_why_values_are_undefined() -> None:
    of = series(read=1.0)
    images = light(np.array([[1e4, 2e3, 0], [1e4, 2e3, 0], [8.0, 2, 0], [1e4, 1.3e4, 0], [1e4, 5, 0]]), of)
    saturated = np.array([[False, True, False, False, False]])
    image = stokes_image(images, saturated, of)
    good, full, shadow, above, unpolarized = range(5)
    assert list(image.flags[0]) == [0, Flag.SATURATED, Flag.SHADOW, Flag.ABOVE_ONE, Flag.UNPOLARIZED]
    for name in PLANES:
        plane = getattr(image, name)[0]
        assert np.isfinite(plane[good])
        assert np.isnan(plane[full])
        assert np.isnan(plane[shadow]) == (name not in ("s0", "s1", "s2", "s0_sd"))
        assert np.isnan(plane[above]) == (name == "dolp")
        assert np.isnan(plane[unpolarized]) == (name in ("aop", "aop_sd"))
    assert image.dolp_raw[0, above] == pytest.approx(1.3, rel=1e-6)
    assert image.masked_fraction == pytest.approx(3 / 5)
    assert image.dolp_median == pytest.approx(float(np.median(image.dolp[0, [good, unpolarized]])))


def test_limits_of_shadow_and_angle_are_where_they_are_said_to_be() -> None:
    # No shot noise to speak of: var(S0) = read^2 + 1/12 = sd^2, var(S1) = 2 sd^2.
    of = series(read=10.0, electrons=1e12)
    sd = math.sqrt(100 + 1 / 12)
    for factor, shadow in ((0.999, True), (1.001, False)):
        assert bool(one((factor * SHADOW_SNR * sd, 0.0, 0.0), of)["flags"] & Flag.SHADOW) is shadow
        pixel = one((1e5, factor * AOP_SNR * math.sqrt(2) * sd, 0.0), of)
        assert bool(pixel["flags"] & Flag.UNPOLARIZED) is shadow
    assert polarization([100.0, 1e-9, 0.0], np.eye(3))[4] == UNKNOWN_ANGLE_SD_RAD


def test_all_masked_image_has_no_median() -> None:
    image = stokes_image(np.zeros((4, 2, 2)), np.zeros((2, 2), bool), series())
    assert math.isnan(image.dolp_median)
    assert image.masked_fraction == 1.0


@given(st.floats(100, 1e5), st.floats(0, 0.99), st.floats(-math.pi / 2, math.pi / 2), st.floats(-math.pi, math.pi))
def test_turning_scene_and_polarizer_together_turns_aop_only(s0: float, dolp: float, angle: float, turn: float) -> None:
    before = series(read=0.0, electrons=1e9, extinction=800.0)
    after = series(tuple(a + turn for a in STANDARD), read=0.0, electrons=1e9, extinction=800.0)
    vector = np.array([s0, s0 * dolp * math.cos(2 * angle), s0 * dolp * math.sin(2 * angle)])
    images = light(vector, before)
    saturated = np.zeros((1, 1), bool)
    first, _ = stokes_planes_reference(images, saturated, before)
    second, _ = stokes_planes_reference(images, saturated, after)
    np.testing.assert_allclose(second[[0, 3, 4, 5, 6], 0, 0], first[[0, 3, 4, 5, 6], 0, 0], rtol=1e-9, atol=1e-9)
    if np.isfinite(first[7, 0, 0]) and np.isfinite(second[7, 0, 0]):
        difference = second[7, 0, 0] - first[7, 0, 0] - turn
        # AOP of a weakly polarized pixel is the quotient of small numbers: rounding errors of 1e-13 S0 over 2 P.
        assert abs(math.remainder(difference, math.pi)) < 1e-12 / max(dolp, 1e-9)


@given(st.floats(0.01, 100))
def test_brightness_does_not_change_dolp(scale: float) -> None:
    of = series(read=0.0, electrons=1e12)
    vector = np.array([1e5, 2e4, -1e4])
    saturated = np.zeros((1, 1), bool)
    first, _ = stokes_planes_reference(light(vector, of), saturated, of)
    second, _ = stokes_planes_reference(light(scale * vector, of), saturated, of)
    # Rounding to counts is part of the noise and its debiasing: 1/12 count^2 against 1e3 counts and more.
    np.testing.assert_allclose(second[[5, 7], 0, 0], first[[5, 7], 0, 0], rtol=1e-9)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32])
def test_integer_images_are_refused_since_their_differences_wrap(dtype: type) -> None:
    images = np.full((4, 2, 2), 100, dtype=dtype)
    with pytest.raises(DataError, match="wrap"):
        stokes_planes(images, np.zeros((2, 2), bool), series())


@pytest.mark.parametrize("shape", [(3, 2, 2), (4, 2, 3), (4, 4)])
def test_shapes_that_do_not_fit_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(DataError, match="shape"):
        stokes_planes(np.zeros(shape), np.zeros((2, 2), bool), series())


@pytest.mark.parametrize(
    "wrong",
    [
        {"frames": (1, 1, 1)},
        {"angle_sd_rad": (0.0, -1.0, 0.0, 0.0)},
        {"angle_sd_rad": (0.0, math.nan, 0.0, 0.0)},
        {"frames": (1, 0, 1, 1)},
        {"dark_frames": -1},
        {"zero_sd_rad": math.inf},
        {"angles_rad": (0.0, math.pi, 0.0, math.pi)},
    ],
)
def test_impossible_series_are_refused(wrong: dict[str, object]) -> None:
    values: dict[str, object] = {"angles_rad": STANDARD, "frames": (1,) * 4, "angle_sd_rad": (0.0,) * 4}
    with pytest.raises(DataError):
        PolarizerSeries(**{**values, **wrong})  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [(-1.0, 1.0), (math.nan, 1.0), (1.0, 0.0), (1.0, math.inf)])
def test_impossible_noise_is_refused(wrong: tuple[float, float]) -> None:
    with pytest.raises(DataError):
        SensorNoise(*wrong)


def test_systematic_covariance_is_that_of_simulated_series() -> None:
    # Monte Carlo over polarizer angles and brightness per frame; 40,000 draws know an sd to 0.35 %, tolerance five.
    of = PolarizerSeries(STANDARD, (1,) * 4, (0.01, 0.02, 0.015, 0.005), 800.0, intensity_stability=0.01)
    true = np.array([1000.0, 300.0, -200.0])
    random = np.random.default_rng(2)
    turned = np.array(STANDARD) + random.normal(0, of.angle_sd_rad, (40_000, 4))
    rows = measurement_matrix(turned.ravel(), 800.0).reshape(40_000, 4, 3)
    seen = (rows @ true) * (1 + random.normal(0, 0.01, (40_000, 4)))
    covariance = np.cov((seen @ of.solution().T).T)
    predicted = of.systematic_covariance(true)
    np.testing.assert_allclose(np.sqrt(np.diag(predicted)), np.sqrt(np.diag(covariance)), rtol=0.018)
