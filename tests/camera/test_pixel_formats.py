"""Unpacking of pixel formats: against a bit-level definition, bytes worked out by hand, and for speed."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera.pixel_formats import PREFERRED, choose, pixel_format, unpack, unpack_reference

NAMES = (*PREFERRED, "Mono14", "Mono14p", "Polarized8", "PolarizeMono12p", "Polarized16")


@pytest.mark.parametrize(
    ("name", "data", "values"),
    [
        # PFNC 2.4, figures of the packed formats: p puts the lowest bits first; Packed puts them into the middle byte.
        ("Mono12p", [0xBC, 0x3A, 0x12], [0xABC, 0x123]),
        ("Mono12Packed", [0xAB, 0x3C, 0x12], [0xABC, 0x123]),
        ("Mono10Packed", [0xFF, 0x12, 0x80], [0x3FE, 0x201]),
        # 1, 2, 3 and 1023 as ten bits each, lowest first: 0x001 | 0x002 << 10 | 0x003 << 20 | 0x3FF << 30.
        ("Mono10p", [0x01, 0x08, 0x30, 0xC0, 0xFF], [1, 2, 3, 1023]),
        ("Mono12", [0xBC, 0x0A, 0x23, 0x01], [0xABC, 0x123]),
        ("Mono16", [0xBC, 0x0A, 0xFF, 0xFF], [0x0ABC, 0xFFFF]),
        ("Mono8", [0xBC, 0x0A], [0xBC, 0x0A]),
        ("PolarizeMono12p", [0xBC, 0x3A, 0x12], [0xABC, 0x123]),
    ],
)
def test_bytes_worked_out_by_hand(name: str, data: list[int], values: list[int]) -> None:
    counts = unpack(np.array(data, dtype=np.uint8), pixel_format(name), (1, len(values)))
    np.testing.assert_array_equal(counts, [values])
    np.testing.assert_array_equal(
        unpack_reference(np.array(data, dtype=np.uint8), pixel_format(name), len(values)), values
    )


@given(name=st.sampled_from(NAMES), rows=st.integers(1, 4), columns=st.integers(1, 9), seed=st.integers(0, 2**32 - 1))
def test_unpacking_is_what_its_bitwise_definition_says(name: str, rows: int, columns: int, seed: int) -> None:
    wanted = pixel_format(name)
    data = np.random.default_rng(seed).integers(0, 256, wanted.size(rows * columns) + 3, dtype=np.uint8)
    if not wanted.packing and wanted.bits not in (8, 16):
        # A camera fills the unused upper bits of whole bytes with zeros.
        data[1::2] &= (1 << (wanted.bits - 8)) - 1
    counts = unpack(data, wanted, (rows, columns))
    assert counts.dtype == wanted.dtype
    assert counts.max() <= wanted.full_scale
    np.testing.assert_array_equal(counts.ravel(), unpack_reference(data, wanted, rows * columns))
    assert not np.shares_memory(counts, data)


@pytest.mark.parametrize("name", NAMES)
def test_rows_with_padding(name: str) -> None:
    wanted = pixel_format(name)
    rows, columns, padding = 3, 8, 5
    line = wanted.size(columns)
    random = np.random.default_rng(1)
    data = random.integers(0, 256, (rows, line + padding), dtype=np.uint8)
    if not wanted.packing and wanted.bits not in (8, 16):
        data[:, 1:line:2] &= (1 << (wanted.bits - 8)) - 1
    counts = unpack(data.ravel(), wanted, (rows, columns), line_padding=padding)
    for row in range(rows):
        np.testing.assert_array_equal(counts[row], unpack_reference(data[row, :line], wanted, columns))


def test_too_few_bytes_and_rows_that_end_within_a_byte_are_refused() -> None:
    with pytest.raises(ValueError, match="11 bytes came for an image of 12"):
        unpack(np.zeros(11, np.uint8), pixel_format("Mono12p"), (2, 4))
    with pytest.raises(ValueError, match="do not end with a whole byte"):
        unpack(np.zeros(99, np.uint8), pixel_format("Mono12p"), (2, 3), line_padding=1)
    with pytest.raises(ValueError, match="rows of"):
        unpack(np.zeros(10, np.uint8), pixel_format("Mono8"), (3, 4), line_padding=2)


@pytest.mark.parametrize("name", ["RGB8", "Mono9", "Mono16p", "BayerRG8", "Mono8 ", "", "Mono8p"])
def test_formats_that_cannot_be_unpacked_are_refused_by_name(name: str) -> None:
    with pytest.raises(ValueError, match=r"pixel_format: found .*, allowed: Mono16, Mono12p"):
        pixel_format(name)


def test_the_most_bits_in_the_fewest_bytes_are_chosen() -> None:
    def chosen(*offered: str) -> str:
        found = choose(offered)
        assert found is not None
        return found.name

    assert chosen("RGB8", "Mono8", "Mono12Packed", "Mono16") == "Mono16"
    assert chosen("Mono8", "Mono12", "Mono12p") == "Mono12p"
    assert chosen("Polarized8", "Mono8") == "Mono8"
    assert chosen("PolarizeMono12", "Mono8") == "PolarizeMono12"
    assert choose(("RGB8", "BayerRG12")) is None


def test_a_five_megapixel_frame_is_unpacked_within_a_frame_time() -> None:
    wanted = pixel_format("Mono12p")
    shape = (2048, 2448)
    data = np.random.default_rng(2).integers(0, 256, wanted.size(shape[0] * shape[1]), dtype=np.uint8)
    best = min(_seconds(data, wanted, shape) for _ in range(3))
    # The sensor gives 24 frames/s at most; the bound leaves room for a loaded machine.
    assert best < 0.2


def _seconds(data: np.ndarray, wanted: object, shape: tuple[int, int]) -> float:
    start = time.perf_counter()
    unpack(data, wanted, shape)  # type: ignore[arg-type]
    return time.perf_counter() - start
