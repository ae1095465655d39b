"""Packing of pixels against plain integer arithmetic and the layouts of the standards."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hw_mocks.gige_camera.pixel_packing import PixelFormat, pack

IMAGES = hnp.arrays(np.uint16, hnp.array_shapes(min_dims=2, max_dims=2, max_side=9))


def unpack(packed: bytes, pixel_format: PixelFormat, count: int) -> list[int]:
    """Pixels by whole-number arithmetic over the whole stream of bits, one at a time."""
    if pixel_format is PixelFormat.Mono12Packed:
        values = []
        for k in range(count):
            high, low = packed[k // 2 * 3 + (2 if k % 2 else 0)], packed[k // 2 * 3 + 1]
            values.append(high << 4 | (low >> 4 if k % 2 else low & 0xF))
        return values
    # PFNC: "p" formats and whole bytes alike are the pixels' bits, least significant first, one behind the other.
    bits = int.from_bytes(packed, "little")
    width = pixel_format.wire_bits
    return [bits >> (k * width) & ((1 << width) - 1) for k in range(count)]


def test_codes_and_sizes() -> None:
    # Codes of the Pixel Format Naming Convention's table of monochrome formats.
    assert {entry.name: int(entry) for entry in PixelFormat} == {
        "Mono8": 0x01080001,
        "Mono10": 0x01100003,
        "Mono10p": 0x010A0046,
        "Mono12": 0x01100005,
        "Mono12Packed": 0x010C0006,
        "Mono12p": 0x010C0047,
        "Mono16": 0x01100007,
    }
    assert PixelFormat.Mono12p.size(782 * 582) == 682_686  # 1.5 bytes each
    assert PixelFormat.Mono10p.size(5) == 7  # 50 bits


@pytest.mark.parametrize(
    ("pixel_format", "expected"),
    [
        (PixelFormat.Mono8, "12 ab"),
        (PixelFormat.Mono16, "34 12 ef ab"),
        (PixelFormat.Mono12, "23 01 be 0a"),
        # GigE Vision's layout: high byte, both low nibbles, high byte.
        (PixelFormat.Mono12Packed, "12 e3 ab"),
        # PFNC's layout: least significant bits first.
        (PixelFormat.Mono12p, "23 e1 ab"),
    ],
)
def test_bytes_of_two_pixels(pixel_format: PixelFormat, expected: str) -> None:
    assert pack(np.array([[0x1234, 0xABEF]], np.uint16), pixel_format).tobytes() == bytes.fromhex(expected)


@given(IMAGES, st.sampled_from(PixelFormat))
def test_packing_loses_nothing_but_the_lowest_bits(image: np.ndarray, pixel_format: PixelFormat) -> None:
    packed = pack(image, pixel_format)
    assert packed.dtype == np.uint8
    assert packed.size == pixel_format.size(image.size)
    expected = (image >> (16 - pixel_format.depth)).reshape(-1).tolist()
    assert unpack(packed.tobytes(), pixel_format, image.size) == expected
