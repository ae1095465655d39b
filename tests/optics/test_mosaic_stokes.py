"""One pass over a mosaic's frame against its definition in float64, and what it says of light it cannot judge."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics import mosaic_stokes as module
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
    random = np.random.default_rng(seed)
    top = np.iinfo(dtype).max
    image = random.integers(0, top, (2 * rows, 2 * columns), dtype=dtype, endpoint=True)
    # Gains of their own keep to sums and differences; the last solution is weighted in float64. All numbers are such
    # that the definition is not rounded either: where intensities cancel, nothing would be left to compare.
    gains = ideal_solution() * [[0.75], [-1.5], [0.625]]
    mixed = ideal_solution() @ np.diag([1.0, 0.75, 1.25, 1.5])
    for black, saturation, solution in (
        (0.0, math.inf, None),
        (top / 8, 0.95 * top, None),
        (round(random.uniform(0, 64 * top)) / 256, 0.95 * top, gains),
        (top / 8, 0.95 * top, mixed),
    ):
        given = {"black_level": black, "saturation": saturation, "solution": solution}
        compare(mosaic_stokes(image, mosaic, threads=threads, **given), mosaic_stokes_reference(image, mosaic, **given))


def test_any_black_level_and_extinction_ratio() -> None:
    image = np.random.default_rng(5).integers(0, 4096, (20, 64), dtype=np.uint16)
    given = {"black_level": 63.7123, "solution": ideal_solution(300.0)}
    found, expected = mosaic_stokes(image, SONY, **given), mosaic_stokes_reference(image, SONY, **given)
    # What is near 0 is rounding in float64 too.
    np.testing.assert_allclose(found[:3], expected[:3], rtol=3e-7, atol=1e-11)


def test_differences_of_whole_counts_are_exact() -> None:
    # Multiples of 1/4 up to 2^18 fit in float32, so S0, S1 and S2 are not rounded at all.
    image = np.random.default_rng(2).integers(0, 65536, (64, 160), dtype=np.uint16)
    for mosaic in EVERY[::5]:
        expected = mosaic_stokes_reference(image, mosaic)
        np.testing.assert_array_equal(mosaic_stokes(image, mosaic)[:3], expected[:3])


def test_large_results_go_past_the_caches_unchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    image = np.random.default_rng(3).integers(0, 4096, (66, 160), dtype=np.uint16)
    expected = mosaic_stokes(image, SONY)
    monkeypatch.setattr(module, "STREAMED_BYTES", 0)
    np.testing.assert_array_equal(mosaic_stokes(image, SONY, threads=2), expected)
    # Rows that begin anywhere, and arrays that do, are stored as usual.
    space = np.empty(5 * image.size + 1, np.float32)
    for begin in (0, 1):
        out = space[begin : begin + 5 * image.size].reshape(5, *image.shape)
        np.testing.assert_array_equal(mosaic_stokes(image, SONY, out=out), expected)
    narrow = np.ascontiguousarray(image[:, :138])
    compare(mosaic_stokes(narrow, SONY), mosaic_stokes_reference(narrow, SONY))


@pytest.mark.parametrize("scale", [1e-30, 1e-20, 1e20, 1e30])
def test_light_may_be_counted_in_any_unit(scale: float) -> None:
    # Squares of S1 and S2 would vanish or overflow in float32; DOLP and AOP do not depend on the unit.
    image = np.random.default_rng(4).uniform(1, 100, (8, 32)).astype(np.float32)
    usual, scaled = mosaic_stokes(image, SONY), mosaic_stokes(image * np.float32(scale), SONY)
    np.testing.assert_allclose(scaled[:3], usual[:3] * scale, rtol=1e-4)
    np.testing.assert_allclose(scaled[3:], usual[3:], rtol=1e-4, atol=1e-5)


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
