"""One pass over a mosaic's frame against its definition in float64, and what it says of light it cannot judge."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics.analyser import least_squares, measurement_matrix
from processing.optics.mosaic import ANGLES_DEG, Mosaic, parse_mosaic, through_mosaic
from processing.optics.mosaic_stokes import ideal_solution, mosaic_stokes, mosaic_stokes_reference

SONY = parse_mosaic("90-45-135-0")
EVERY = [Mosaic(((a, b), (c, d))) for a, b, c, d in itertools.permutations(ANGLES_DEG)]


def compare(found: np.ndarray, expected: np.ndarray) -> None:
    """Each plane within 1e-6 of the definition, relative, where S0 > 0; undefined at the same pixels."""
    for plane, wanted in zip(found, expected, strict=True):
        np.testing.assert_array_equal(np.isnan(plane), np.isnan(wanted))
    lit = expected[0] > 0
    for plane, wanted in zip(found[:4, lit], expected[:4, lit], strict=True):
        np.testing.assert_allclose(plane, wanted, rtol=1e-6)
    # AOP of -90 and +90 degrees are one.
    angle = found[4, lit] - expected[4, lit]
    angle = np.remainder(angle + np.pi / 2, np.pi) - np.pi / 2
    defined = np.isfinite(angle)
    assert np.all(np.abs(angle[defined]) <= 1e-6 * np.maximum(np.abs(expected[4, lit][defined]), 1e-30))


@settings(deadline=None, max_examples=40)
@given(
    mosaic=st.sampled_from(EVERY),
    rows=st.integers(1, 8),
    columns=st.integers(1, 30),
    dtype=st.sampled_from([np.uint8, np.uint16]),
    threads=st.sampled_from([1, 2]),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_kernel_is_its_definition(
    mosaic: Mosaic, rows: int, columns: int, dtype: type, threads: int, seed: int
) -> None:
    top = np.iinfo(dtype).max
    image = np.random.default_rng(seed).integers(0, top, (2 * rows, 2 * columns), dtype=dtype, endpoint=True)
    for black, saturation in ((0.0, math.inf), (top / 8, 0.95 * top)):
        found = mosaic_stokes(image, mosaic, black_level=black, saturation=saturation, threads=threads)
        compare(found, mosaic_stokes_reference(image, mosaic, black_level=black, saturation=saturation))


def test_any_solution_is_taken_and_float_frames_with_lost_pixels() -> None:
    random = np.random.default_rng(0)
    image = random.uniform(100, 5000, (20, 38)).astype(np.float32)
    image[3, 5] = np.nan
    solution = least_squares(measurement_matrix(np.radians(ANGLES_DEG) + 0.02, 40.0)) * [[1.0], [1.1], [0.9]]
    found = mosaic_stokes(image, SONY, solution=solution)
    expected = mosaic_stokes_reference(image, SONY, solution=solution)
    # Means of float32 counts are rounded to float32, two roundings of S0: what is small beside S0 errs by as much.
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    error = np.abs(found[:3] - expected[:3]) / np.abs(expected[0])
    assert np.nanmax(error) < 4 * 2.0**-24
    np.testing.assert_allclose(found[3], expected[3], rtol=1e-6, atol=4 * 2.0**-24)
    assert np.isnan(found[:, 2:5, 4:7]).all()


@pytest.mark.parametrize("degrees", [-89.9, -45, -1e-4, 0, 22.5, 22.6, 45, 67.5, 89.9, 90])
@pytest.mark.parametrize("mosaic", EVERY[::7], ids=lambda mosaic: mosaic.name)
def test_known_states_come_back(degrees: float, mosaic: Mosaic) -> None:
    angle = math.radians(degrees)
    stokes = np.empty((3, 8, 20))
    stokes[:] = np.array([1e4, 4e3 * math.cos(2 * angle), 4e3 * math.sin(2 * angle)])[:, None, None]
    found = mosaic_stokes(
        through_mosaic(stokes, mosaic, 300.0).astype(np.float32), mosaic, solution=ideal_solution(300.0)
    )
    np.testing.assert_allclose(found[3], 0.4, rtol=1e-6)
    # float32 intensities of 1e4 err by 3e-4 counts, over 2 x 4e3.
    assert np.all(np.abs(np.remainder(found[4] - angle + np.pi / 2, np.pi) - np.pi / 2) < 3e-7)


def test_the_ideal_solution_is_that_of_least_squares() -> None:
    for ratio in (2.0, 300.0, math.inf):
        expected = least_squares(measurement_matrix(np.radians(ANGLES_DEG), ratio))
        np.testing.assert_allclose(ideal_solution(ratio), expected, atol=1e-12)


def test_equal_intensities_are_unpolarized_and_have_no_angle() -> None:
    found = mosaic_stokes(np.full((4, 20), 777, np.uint16), SONY)
    np.testing.assert_array_equal(found[:4, 2, 5], [1554, 0, 0, 0])
    assert np.isnan(found[4]).all()


def test_darkness_and_saturation_are_undefined() -> None:
    dark = mosaic_stokes(np.full((2, 2), 100, np.uint16), SONY, black_level=100.0)
    np.testing.assert_array_equal(dark[:3], 0.0)
    assert np.isnan(dark[3:]).all()
    below = mosaic_stokes(np.full((2, 2), 90, np.uint16), SONY, black_level=100.0)
    np.testing.assert_array_equal(below[0], -20.0)
    assert np.isnan(below[3:]).all()
    assert np.isnan(mosaic_stokes(np.full((6, 34), 4095, np.uint16), SONY, saturation=4095)).all()


def test_a_given_array_is_filled() -> None:
    image = np.random.default_rng(1).integers(0, 4096, (6, 40), dtype=np.uint16)
    out = np.empty((5, 6, 40), np.float32)
    assert mosaic_stokes(image, SONY, out=out) is out
    np.testing.assert_array_equal(out, mosaic_stokes(image, SONY))


@pytest.mark.parametrize(
    ("image", "options", "words"),
    [
        (np.zeros((3, 4), np.uint16), {}, "mosaic image has shape"),
        (np.zeros((4, 4), np.int32), {}, "int32"),
        (np.zeros((4, 4), np.uint16), {"solution": np.ones((3, 3))}, "solution"),
        (np.zeros((4, 4), np.uint16), {"solution": np.full((3, 4), np.nan)}, "solution"),
        (np.zeros((4, 4), np.uint16), {"black_level": math.nan}, "black level"),
        (np.zeros((4, 4), np.uint16), {"out": np.zeros((5, 4, 4))}, "array to fill"),
        (np.zeros((4, 4), np.uint16), {"threads": 0}, "threads"),
    ],
)
def test_mistakes_are_answered(image: np.ndarray, options: dict[str, object], words: str) -> None:
    with pytest.raises(DataError, match=words):
        mosaic_stokes(image, SONY, **options)  # type: ignore[arg-type]
