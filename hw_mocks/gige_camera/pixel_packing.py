"""Pixel formats: names and codes of the pixel format naming convention (PFNC), and how pixels are packed into bytes."""

from __future__ import annotations

import enum

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.unsignedinteger]


class PixelFormat(enum.IntEnum):
    """Codes of PFNC; bits 16 to 23 are the bits that a pixel takes on the wire."""

    Mono8 = 0x01080001
    Mono10 = 0x01100003
    Mono10p = 0x010A0046
    Mono12 = 0x01100005
    Mono12Packed = 0x010C0006
    Mono12p = 0x010C0047
    Mono16 = 0x01100007

    @property
    def wire_bits(self) -> int:
        """Bits that a pixel takes on the wire."""
        return (int(self) >> 16) & 0xFF

    @property
    def depth(self) -> int:
        """Bits that carry the value."""
        return _DEPTH[self]

    def size(self, pixels: int) -> int:
        """Bytes that so many pixels take: without padding between rows, the last byte filled up."""
        return -(-pixels * self.wire_bits // 8)


_DEPTH = {
    PixelFormat.Mono8: 8,
    PixelFormat.Mono10: 10,
    PixelFormat.Mono10p: 10,
    PixelFormat.Mono12: 12,
    PixelFormat.Mono12Packed: 12,
    PixelFormat.Mono12p: 12,
    PixelFormat.Mono16: 16,
}


def pack(image: Image, pixel_format: PixelFormat) -> NDArray[np.uint8]:
    """Pack an image for the wire.

    Args:
        image: uint16, any shape; a pixel's value is the upper ``depth`` bits of its 16.
        pixel_format: how to pack it.

    Returns:
        uint8 (``pixel_format.size(image.size)``,), little-endian.
    """
    values = image.reshape(-1) >> np.uint16(16 - pixel_format.depth)
    if pixel_format is PixelFormat.Mono8:
        return values.astype(np.uint8)
    if pixel_format.wire_bits == 16:
        return np.ascontiguousarray(values, dtype="<u2").view(np.uint8)
    group = {10: 4, 12: 2}[pixel_format.wire_bits]
    short = -values.size % group
    pixels = np.pad(values, (0, short)).reshape(-1, group)
    packed = np.empty((pixels.shape[0], pixel_format.wire_bits * group // 8), dtype=np.uint8)
    if pixel_format is PixelFormat.Mono12Packed:
        first, second = pixels[:, 0], pixels[:, 1]
        packed[:, 0] = first >> 4
        packed[:, 1] = (first & 0xF) | (second & 0xF) << 4
        packed[:, 2] = second >> 4
    elif pixel_format is PixelFormat.Mono12p:
        first, second = pixels[:, 0], pixels[:, 1]
        packed[:, 0] = first & 0xFF
        packed[:, 1] = first >> 8 | (second & 0xF) << 4
        packed[:, 2] = second >> 4
    else:
        packed[:, 0] = pixels[:, 0] & 0xFF
        for k in range(1, 4):
            packed[:, k] = pixels[:, k - 1] >> (10 - 2 * k) | (pixels[:, k] & ((1 << (8 - 2 * k)) - 1)) << 2 * k
        packed[:, 4] = pixels[:, 3] >> 2
    return packed.reshape(-1)[: pixel_format.size(values.size)]
