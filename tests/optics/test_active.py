"""The active mode against Mueller matrices of surfaces and Monte Carlo."""

import math

import numpy as np
import pytest

from processing.errors import DataError
from processing.optics.active import CHANNELS, active_image, channel_weights
from processing.optics.analyser import measurement_matrix, polarizer, transmittances
from processing.optics.series import SensorNoise
from processing.optics.stokes import Flag

CROSSED = np.radians([0.0, 90.0])
ROUND = np.radians([0.0, 60.0, 120.0])
# Mueller matrices (linear part) of powers: a mirror of the plate kind, one that turns by 45 degrees, and a diffuser.
SURFACES = {
    "single bounce": np.diag([1.0, 1.0, -1.0]),
    "diattenuating": np.array([[1.0, 0.3, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 0.9]]),
    "depolarizing": np.array([[1.0, 0.05, 0.02], [0.0, 0.2, 0.01], [0.01, 0.0, 0.2]]),
}


def seen(mueller: np.ndarray, source: np.ndarray, sensor: np.ndarray, ratios: tuple[float, float]) -> np.ndarray:
    """(J, K) intensities, by whole Mueller chains and not by the measurement matrices that are under test."""
    full = np.zeros((4, 4))
    full[:3, :3] = mueller
    lamp = np.array([2.0, 0, 0, 0])
    return np.array(
        [
            [
                (polarizer(k, *transmittances(ratios[1])) @ full @ polarizer(j, *transmittances(ratios[0])) @ lamp)[0]
                for k in sensor
            ]
            for j in source
        ]
    )


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize(("source", "sensor"), [(CROSSED, CROSSED), (ROUND, ROUND), (CROSSED, ROUND), (ROUND, CROSSED)])
def test_channels_are_those_behind_ideal_polarizers(name: str, source: np.ndarray, sensor: np.ndarray) -> None:
    ratios = (200.0, 50.0)
    weights = channel_weights(source, sensor, source_extinction=ratios[0], sensor_extinction=ratios[1])
    found = np.tensordot(weights, seen(SURFACES[name], source, sensor, ratios), 2)
    expected = seen(SURFACES[name], CROSSED, CROSSED, (math.inf, math.inf)).ravel()
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_without_leakage_crossed_polarizers_are_the_channels_themselves() -> None:
    weights = channel_weights(CROSSED, CROSSED)
    np.testing.assert_allclose(weights.reshape(4, 4), np.eye(4), atol=1e-12)
    assert CHANNELS == ("HH", "HV", "VH", "VV")


@pytest.mark.parametrize("degrees", [(0.0,), (0.0, 45.0), (10.0, 100.0), (0.0, 180.0), (90.0, 270.0)])
def test_angles_that_do_not_tell_horizontal_from_vertical_are_refused(degrees: tuple[float, ...]) -> None:
    with pytest.raises(DataError, match="does not tell horizontal from vertical"):
        channel_weights(np.radians(degrees), CROSSED)
    with pytest.raises(DataError, match="sensor's polarizer"):
        channel_weights(CROSSED, np.radians(degrees))


def planes(mueller: np.ndarray, draws: int, seed: int, level: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    mean = level * seen(mueller, CROSSED, CROSSED, (800.0, 800.0))[:, :, None, None]
    ambient = np.array([300.0, 200.0])[:, None, None]
    light = random.poisson(np.broadcast_to(mean + ambient, (2, 2, 1, draws))) + random.normal(0, 3, (2, 2, 1, draws))
    off = random.poisson(np.broadcast_to(ambient, (2, 1, draws))) + random.normal(0, 3, (2, 1, draws))
    return np.rint(light), np.rint(off), mean


@pytest.mark.parametrize("name", SURFACES)
def test_sds_are_those_of_many_pixels_and_ambient_light_is_taken_off(name: str) -> None:
    draws = 30_000
    light, off, _ = planes(SURFACES[name], draws, 5, 8000.0)
    weights = channel_weights(CROSSED, CROSSED, source_extinction=800.0, sensor_extinction=800.0)
    one = np.ones((2, 2), int)
    image = active_image(
        light, np.zeros((1, draws), bool), weights, one, SensorNoise(3.0, 1.0), ambient=off, ambient_frames=one[0]
    )
    truth = 8000.0 * seen(SURFACES[name], CROSSED, CROSSED, (math.inf, math.inf)).ravel()
    for plane, sd, true in zip(image.intensities, image.sds, truth, strict=True):
        # An sd of 30,000 draws is known to 0.4 %, means to 1/170 of it.
        assert np.mean(sd) == pytest.approx(np.std(plane), rel=0.02)
        assert abs(np.mean(plane) - true) < 5 * np.std(plane) / math.sqrt(draws)
    hh, hv, vh, vv = truth
    assert np.mean(image.dolp) == pytest.approx((hh + vh - hv - vv) / truth.sum(), abs=2e-4)
    assert np.mean(image.dolp_sd) == pytest.approx(np.std(image.dolp), rel=0.02)
    np.testing.assert_allclose(image.pauli[2], image.intensities[0] + image.intensities[3])


def test_dolp_is_equation_6_9_for_equal_cross_channels() -> None:
    # Thesis 6.9: (HH - VV) / (HH + VV + 2 HV), with its dihedral's VV / HH = 0.43 and no HV: 0.399.
    light = np.array([[1.0, 0.0], [0.0, 0.43]])[:, :, None, None] * 1e6
    image = active_image(
        light, np.zeros((1, 1), bool), channel_weights(CROSSED, CROSSED), np.ones((2, 2), int), SensorNoise()
    )
    assert image.dolp[0, 0] == pytest.approx(0.57 / 1.43, rel=1e-9)
    assert image.pauli[0, 0, 0] == pytest.approx(0.57e6, rel=1e-9)


def test_flags_say_why() -> None:
    light = np.full((2, 2, 1, 4), 1000.0)
    light[..., 1] = 1.0
    light[0, 1, 0, 2] = np.nan
    image = active_image(
        light,
        np.array([[False, False, False, True]]),
        channel_weights(CROSSED, CROSSED),
        np.ones((2, 2), int),
        SensorNoise(5.0, 1.0),
    )
    assert list(image.flags[0]) == [0, Flag.SHADOW, Flag.INCOMPLETE, Flag.SATURATED]
    assert list(np.isfinite(image.dolp[0])) == [True, False, False, False]
    assert list(np.isfinite(image.intensities[0, 0])) == [True, True, False, False]


def test_a_dark_image_is_common_to_all() -> None:
    # Dark noise d in each of four intensities: the sum of the channels of crossed ideal polarizers gets 16 d^2 / n.
    light = np.zeros((2, 2, 1, 1))
    weights = channel_weights(CROSSED, CROSSED)
    saturated, one = np.zeros((1, 1), bool), np.ones((2, 2), int)
    noise = SensorNoise(6.0, 1.0)
    image = active_image(light, saturated, weights, one, noise, dark_frames=4)
    assert image.sds[0, 0, 0] == pytest.approx(math.sqrt(noise.floor * (1 + 1 / 4)))


def test_shapes_that_do_not_fit_are_refused() -> None:
    weights = channel_weights(CROSSED, CROSSED)
    one, saturated = np.ones((2, 2), int), np.zeros((3, 3), bool)
    with pytest.raises(DataError, match="intensities have shape"):
        active_image(np.ones((2, 2, 3, 4)), saturated, weights, one, SensorNoise())
    with pytest.raises(DataError, match="ambient"):
        active_image(np.ones((2, 2, 3, 3)), saturated, weights, one, SensorNoise(), ambient=np.ones((2, 3, 3)))
    assert measurement_matrix(CROSSED).shape == (2, 3)
