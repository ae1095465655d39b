"""Public functions against any array that NumPy can make: byte orders, layouts, precisions, sizes, values that are no
numbers. Asked for is the same result, or one sentence that says what is wrong; never a warning or a traceback."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from public_functions import CASES, Case

from processing.errors import DataError

LAYOUTS = {
    "other byte order": lambda a: a.astype(a.dtype.newbyteorder()),
    "every second of a larger array": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
    "backwards in memory": lambda a: np.ascontiguousarray(a[..., ::-1])[..., ::-1],
    "columns first": np.asfortranarray,
    "read-only": lambda a: _read_only(a),
}
PRECISIONS = {
    # An input of fewer digits holds the same numbers (they are chosen so); single precision inside costs 24 bits.
    "half": (np.float16, None, 1e-4),
    "single": (np.float32, np.complex64, 1e-4),
    "long double": (np.longdouble, np.clongdouble, 1e-9),
}


def _read_only(a: np.ndarray) -> np.ndarray:
    out = a.copy()
    out.flags.writeable = False
    return out


def numbers(result: Any) -> list[np.ndarray]:
    """All arrays and numbers of a result, in order."""
    if isinstance(result, (tuple, list)):
        return [array for part in result for array in numbers(part)]
    if dataclasses.is_dataclass(result):
        return numbers([getattr(result, field.name) for field in dataclasses.fields(result)])
    if result is None or isinstance(result, str):
        return []
    return [np.asarray(result)]


def close(result: Any, expected: Any, tolerance: float) -> None:
    for got, want in zip(numbers(result), numbers(expected), strict=True):
        assert got.shape == want.shape
        if want.dtype.kind in "bui" or not want.size:
            np.testing.assert_array_equal(got, want)
            continue
        scale = float(np.nanmax(np.abs(want), initial=0.0))
        np.testing.assert_allclose(
            got.astype(np.complex128), want.astype(np.complex128), rtol=tolerance, atol=tolerance * scale
        )


def told(case: Case, first: np.ndarray) -> Any:
    """The result, or the sentence of a refusal. Any other exception, and any warning, fails the test."""
    try:
        return varied(case, first)
    except DataError as refusal:
        return str(refusal)


def varied(case: Case, first: np.ndarray) -> Any:
    return case.call(first, *case.arrays[1:])


@pytest.mark.parametrize("case", CASES, ids=str)
def test_layout_and_byte_order_change_nothing(case: Case) -> None:
    expected = varied(case, case.arrays[0])
    for change in LAYOUTS.values():
        # Sums over another layout may be taken in another order: a few units in the last place.
        close(varied(case, change(case.arrays[0])), expected, 1e-6)
        assert np.array_equal(case.arrays[0], change(case.arrays[0]))  # and the input is as it was


@pytest.mark.parametrize("case", [case for case in CASES if not case.counts], ids=str)
def test_precision_of_the_input(case: Case) -> None:
    first = case.arrays[0]
    expected = varied(case, first)
    for kind, compound, tolerance in PRECISIONS.values():
        dtype = compound if first.dtype.kind == "c" else kind
        if dtype is not None:
            close(varied(case, first.astype(dtype)), expected, tolerance)


def odd_values(first: np.ndarray) -> dict[str, np.ndarray]:
    one = first.copy()
    one.flat[first.size // 2] = np.nan
    infinite = first.copy()
    infinite.flat[first.size // 2] = np.inf
    return {
        "one NaN": one,
        "all NaN": np.full_like(first, np.nan),
        "one infinite": infinite,
        "zeros": np.zeros_like(first),
        "denormal": first * 1e-310,
        "200 dB apart": np.where(np.arange(first.size).reshape(first.shape) % 7, first, first * 1e-10),
        "huge": first * 1e15,
    }


@pytest.mark.parametrize("case", [case for case in CASES if not case.counts], ids=str)
def test_values_that_are_no_measurement(case: Case) -> None:
    """A result or a sentence. Warnings are errors here, and so is everything that is not a DataError."""
    for values in odd_values(case.arrays[0]).values():
        result = told(case, values)
        assert isinstance(result, str) or result is None or numbers(result)


def cut(case: Case, length: int) -> list[np.ndarray]:
    """All arrays with the first ``length`` pixels along each axis of pixels; one that is broadcast stays whole."""
    first = case.arrays[0]
    index = [slice(None)] * first.ndim
    for axis in case.pixel_axes:
        index[axis] = slice(0, length)
    pixels = tuple(first.shape[axis] for axis in case.pixel_axes)
    others = []
    for other in case.arrays[1:]:
        if other.shape == first.shape:
            others.append(other[tuple(index)])
        elif pixels and other.shape[: len(pixels)] == pixels:
            others.append(other[tuple(slice(0, length) for _ in pixels)])
        else:
            others.append(other)
    return [first[tuple(index)], *others]


@pytest.mark.parametrize("case", [case for case in CASES if case.pixel_axes], ids=str)
def test_images_of_one_pixel_and_of_none(case: Case) -> None:
    lengths = (1,) if case.name.endswith("_reference") else (1, 0)  # definitions need a window to slide
    for length in lengths:
        first, *others = cut(case, length)
        try:
            result = case.call(first, *others)
        except DataError:
            continue
        assert numbers(result) or result is None
