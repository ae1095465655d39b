"""Demosaicers against scenes that are known behind every angle, in every phase of the mosaic."""

import itertools

import numpy as np
import pytest

from benchmarks.optics_scenes import binned, fine_scene
from processing.errors import DataError
from processing.optics.analyser import least_squares, measurement_matrix
from processing.optics.demosaic import METHODS, demosaic_by, variance_share
from processing.optics.mosaic import ANGLES_DEG, Mosaic, parse_mosaic, through_mosaic

EVERY = [Mosaic(((a, b), (c, d))) for a, b, c, d in itertools.permutations(ANGLES_DEG)]
MATRIX = measurement_matrix(np.radians(ANGLES_DEG))
SOLUTION = least_squares(MATRIX)
INNER = np.s_[..., 8:-8, 8:-8]


@pytest.fixture(scope="module")
def scene() -> np.ndarray:
    return binned(fine_scene(120, 0, 4), 4)


def errors(scene: np.ndarray, mosaic: Mosaic) -> dict[str, tuple[float, float]]:
    """Root mean square error of the planes (counts) and of DOLP, by method."""
    truth = np.tensordot(MATRIX, scene, 1)
    dolp = np.hypot(scene[1], scene[2]) / scene[0]
    found = {}
    for method in METHODS:
        planes = demosaic_by(method, through_mosaic(scene, mosaic), mosaic).astype(float)
        s0, s1, s2 = np.tensordot(SOLUTION, planes, 1)
        deviation = (np.hypot(s1, s2) / s0 - dolp)[INNER]
        found[method] = (float(np.std((planes - truth)[INNER])), float(np.sqrt(np.mean(deviation**2))))
    return found


@pytest.mark.parametrize("mosaic", EVERY[::5], ids=lambda mosaic: mosaic.name)
def test_residuals_err_least_and_newton_less_than_bilinear(scene: np.ndarray, mosaic: Mosaic) -> None:
    found = errors(scene, mosaic)
    # Published gains over bilinear are 1 to 3 dB and 3 to 6 dB in the planes; Newton's polynomials gain less where rows
    # and columns pair angles 45 degrees apart, as here in one phase of three.
    assert found["newton"][0] < found["bilinear"][0]
    assert found["residual"][0] < 0.65 * found["bilinear"][0]
    assert found["residual"][1] < 0.7 * found["bilinear"][1]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("mosaic", EVERY, ids=lambda mosaic: mosaic.name)
def test_uniform_light_comes_back_exactly_and_pixels_keep_their_value(method: str, mosaic: Mosaic) -> None:
    stokes = np.empty((3, 16, 18))
    stokes[:] = np.array([1000.0, 300.0, -200.0])[:, None, None]
    image = through_mosaic(stokes, mosaic)
    planes = demosaic_by(method, image, mosaic)
    # float32 results.
    np.testing.assert_allclose(planes, np.tensordot(MATRIX, stokes, 1), rtol=1e-6)
    noisy = np.random.default_rng(0).normal(1000, 50, image.shape)
    planes = METHODS[method](noisy, mosaic)
    for plane, angle in zip(planes, ANGLES_DEG, strict=True):
        i, k = mosaic.place(angle)
        np.testing.assert_allclose(plane[i::2, k::2], noisy[i::2, k::2], rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_the_phase_is_that_of_the_region(scene: np.ndarray, method: str) -> None:
    # A region that begins a row and a column later is the same picture; its own mosaic must give the same planes.
    mosaic = parse_mosaic("90-45-135-0")
    whole = METHODS[method](through_mosaic(scene, mosaic), mosaic)
    part = METHODS[method](through_mosaic(scene, mosaic)[1:-1, 1:-1], mosaic.shifted(1, 1))
    # Windows reach 7 pixels; residuals' weights see the border a little further. float32 of 5e4.
    np.testing.assert_allclose(part[:, 24:-24, 24:-24], whole[:, 25:-25, 25:-25], rtol=1e-6, atol=0.05)


@pytest.mark.parametrize("method", METHODS)
def test_transposing_the_sensor_transposes_the_planes(scene: np.ndarray, method: str) -> None:
    mosaic = parse_mosaic("0-90-45-135")
    (a, b), (c, d) = mosaic.angles_deg
    image = through_mosaic(scene, mosaic)
    one = METHODS[method](image, mosaic)
    other = METHODS[method](np.ascontiguousarray(image.T), Mosaic(((a, c), (b, d))))
    np.testing.assert_allclose(one, np.swapaxes(other, 1, 2), rtol=1e-6, atol=0.05)


@pytest.mark.parametrize("method", METHODS)
def test_noise_is_as_large_as_its_share_says(method: str) -> None:
    mosaic = parse_mosaic("90-45-135-0")
    random = np.random.default_rng(2)
    stokes = np.empty((3, 400, 400))
    stokes[:] = np.array([2e4, 4e3, -2e3])[:, None, None]
    image = through_mosaic(stokes, mosaic) + random.normal(0, 100, (400, 400))
    planes = METHODS[method](image, mosaic)
    error = np.tensordot(SOLUTION, planes - np.tensordot(MATRIX, stokes, 1), 1)[INNER] / 100
    share, common = variance_share(method, mosaic)
    for i, row in enumerate(SOLUTION):
        told = float(np.mean(np.einsum("k,kab->ab", row**2, share)) + common * row.sum() ** 2)
        # 150,000 pixels that share samples: their variance is known to some 1 %; numbers are rounded to two digits.
        assert np.mean(error[i] ** 2) == pytest.approx(told, rel=0.06)


@pytest.mark.parametrize("method", METHODS)
def test_lost_pixels_are_lost_near_by_and_nowhere_else(method: str) -> None:
    image = np.full((40, 40), 1000.0)
    image[20, 21] = np.nan
    lost = np.isnan(METHODS[method](image, parse_mosaic("90-45-135-0"))).any(axis=0)
    assert lost[19:22, 20:23].any()
    assert not lost[:8].any()
    assert not lost[-8:].any()
    assert not lost[:, :8].any()
    assert not lost[:, -8:].any()


@pytest.mark.parametrize("method", METHODS)
def test_dark_images_are_dark(method: str) -> None:
    np.testing.assert_array_equal(METHODS[method](np.zeros((16, 16)), parse_mosaic("90-45-135-0")), 0.0)


def test_mistakes_are_answered() -> None:
    mosaic = parse_mosaic("90-45-135-0")
    with pytest.raises(DataError, match="bilinear, newton, residual"):
        demosaic_by("cubic", np.zeros((8, 8)), mosaic)
    with pytest.raises(DataError, match="bilinear, newton, residual"):
        variance_share("cubic", mosaic)
    for method, size in (("newton", 2), ("residual", 6)):
        with pytest.raises(DataError, match="at least"):
            demosaic_by(method, np.zeros((size, size)), mosaic)
