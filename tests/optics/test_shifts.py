"""Shifts between images behind different polarizers, against shifts of scenes that are finer than the pixels."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from benchmarks.optics_scenes import binned, fine_scene
from processing.errors import DataError
from processing.optics.analyser import least_squares, measurement_matrix
from processing.optics.shifts import Shift, mask_back, measure_shift, registered, shift_back

OVER, SIZE = 8, 144
ANGLES = np.radians([0.0, 45.0, 90.0, 135.0])
MATRIX = measurement_matrix(ANGLES)


@pytest.fixture(scope="module")
def fine() -> np.ndarray:
    return fine_scene(SIZE, 1, OVER, strongest=0.4)


def behind(fine: np.ndarray, shifts: list[tuple[int, int]], seed: int | None = 0) -> np.ndarray:
    """(4, rows, columns) images whose points are so many eighths of a pixel further down and right."""
    images = []
    for row, steps in zip(MATRIX, shifts, strict=True):
        light = binned(np.roll(np.tensordot(row, fine, 1), steps, (0, 1)), OVER)
        images.append(light if seed is None else np.random.default_rng(seed).poisson(np.maximum(light, 0)))
    return np.array(images, dtype=float)


@pytest.mark.parametrize("steps", [(0, 0), (1, -2), (3, 5), (-10, 13), (20, -30)])
def test_known_shifts_are_found_to_a_small_part_of_a_pixel(fine: np.ndarray, steps: tuple[int, int]) -> None:
    images = behind(fine, [(0, 0), steps, steps, steps])
    for image in images[1:]:
        found = measure_shift(image, images[0])
        # Contrast that changes within an edge's reach biases by a hundredth of a pixel or two; sds allow for it.
        assert abs(found.down - steps[0] / OVER) < min(0.03, 4 * found.down_sd)
        assert abs(found.right - steps[1] / OVER) < min(0.03, 4 * found.right_sd)
        assert found.down_sd < 0.05


def test_without_polarization_or_noise_hardly_anything_is_left(fine: np.ndarray) -> None:
    image = binned(np.roll(fine[0], (3, -5), (0, 1)), OVER)
    found = measure_shift(image, binned(fine[0], OVER))
    # Pixels average over an eighth of what edges' gradients are taken over: aliasing of 1e-3 px.
    assert (found.down, found.right) == (pytest.approx(3 / 8, abs=4e-3), pytest.approx(-5 / 8, abs=4e-3))


def test_edges_whose_contrast_changes_sign_stay_where_they_are() -> None:
    # A disc that is brighter than its surroundings behind one angle and darker behind the other.
    y, x = np.mgrid[0:96, 0:96].astype(float)
    disc = gaussian_filter(((x - 48) ** 2 + (y - 48) ** 2 < 400).astype(float), 1.0)
    found = measure_shift(1000 - 300 * disc, 1000 + 500 * disc)
    assert found.size < 0.01


def test_registration_takes_the_false_polarization_off_edges(fine: np.ndarray) -> None:
    steps = [(0, 0), (4, -2), (-3, 6), (5, 5)]
    truth = binned(fine, OVER)
    dolp = np.hypot(truth[1], truth[2]) / truth[0]
    inner = np.s_[8:-8, 8:-8]
    solution = least_squares(MATRIX)
    errors = []
    saturated = np.zeros((SIZE, SIZE), bool)
    for how in ("off", "auto"):
        light, _, shifts, undone = registered(behind(fine, steps), saturated, how)
        stokes = np.tensordot(solution, light, 1)
        errors.append(np.nanstd((np.hypot(stokes[1], stokes[2]) / stokes[0] - dolp)[inner]))
        assert len(shifts) == (4 if how == "auto" else 0)
    assert undone == (False, True, True, True)
    assert errors[1] < errors[0] / 4


def test_auto_leaves_images_alone_that_are_in_place(fine: np.ndarray) -> None:
    images = behind(fine, [(0, 0)] * 4)
    light, _, _, undone = registered(images, np.zeros((SIZE, SIZE), bool), "auto")
    assert not any(undone)
    np.testing.assert_array_equal(light, images)


def test_shifting_back_is_the_inverse_of_a_whole_shift() -> None:
    image = np.random.default_rng(0).normal(size=(40, 50))
    moved = np.roll(image, (2, -3), (0, 1))
    back = shift_back(moved, Shift(2.0, -3.0, 0.01, 0.01))
    defined = np.isfinite(back)
    assert defined.mean() > 0.8
    np.testing.assert_allclose(back[defined], image[defined], atol=1e-12)


def test_what_depends_on_masked_pixels_is_masked() -> None:
    mask = np.zeros((20, 20), bool)
    mask[10, 10] = True
    back = mask_back(mask, Shift(0.5, 0.0, 0.1, 0.1))
    assert back[10, 10]
    assert back[9, 10]
    assert not back[5, 10]
    # The last rows look beyond the border.
    assert back[-1].all()
    image = np.ones((20, 20))
    image[10, 10] = np.nan
    assert np.isnan(shift_back(image, Shift(0.5, 0.0, 0.1, 0.1)))[9:11, 10].all()


def test_images_without_edges_tell_nothing() -> None:
    flat = np.full((64, 64), 100.0)
    found = measure_shift(flat, flat)
    assert math.isinf(found.down_sd)
    assert math.isinf(found.right_sd)
    assert not found.significant()
    stripes = np.tile(100 + 50 * np.sin(np.arange(64) / 3)[:, None], (1, 64))
    along = measure_shift(stripes, stripes)
    assert math.isfinite(along.down_sd)
    assert math.isinf(along.right_sd)
    assert along.right == 0
    images, _, _, undone = registered(np.stack([flat, flat]), np.zeros((64, 64), bool), "on")
    assert undone == (False, False)
    np.testing.assert_array_equal(images, 100.0)


@pytest.mark.parametrize("shape", [(1, 1), (8, 200), (31, 31)])
def test_tiny_images_tell_nothing(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).normal(size=shape)
    assert math.isinf(measure_shift(image, image).down_sd)


def test_undefined_and_masked_images_tell_nothing() -> None:
    image = np.full((64, 64), np.nan)
    assert math.isinf(measure_shift(image, np.ones((64, 64))).down_sd)
    good = np.random.default_rng(0).normal(size=(64, 64))
    assert math.isinf(measure_shift(good, good, np.ones((64, 64), bool)).down_sd)


def test_mistakes_are_answered() -> None:
    with pytest.raises(DataError, match="shapes"):
        measure_shift(np.ones((40, 40)), np.ones((40, 41)))
    with pytest.raises(DataError, match="off, auto, on"):
        registered(np.ones((4, 4, 4)), np.zeros((4, 4), bool), "maybe")
