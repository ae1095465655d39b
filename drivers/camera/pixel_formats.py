"""Monochrome pixel formats by their names of the pixel format naming convention (PFNC 2.4), and how to unpack them.

Polarization cameras deliver the same bytes under names of their own (``Polarized8``, ``PolarizeMono12p``): a mosaic of
polarizers changes what a pixel saw, not how it is packed. Values keep their bits: 12 bits give counts from 0 to 4095.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Counts = NDArray[np.unsignedinteger[Any]]
Bytes = NDArray[np.uint8]

_NAME = re.compile(r"(?:Mono|Polarized|PolarizeMono)(8|10|12|14|16)(p|Packed)?", re.ASCII)
_PACKED = {(10, "p"): 10, (12, "p"): 12, (14, "p"): 14, (10, "Packed"): 12, (12, "Packed"): 12}
"""Bits on the wire of the packed formats, by (bits of the value, kind of packing)."""
PREFERRED = ("Mono16", "Mono12p", "Mono12Packed", "Mono12", "Mono10p", "Mono10Packed", "Mono10", "Mono8")
"""What is taken when nothing is asked for: most bits first, then fewest bytes."""


@dataclass(frozen=True)
class PixelFormat:
    """One monochrome format."""

    name: str
    bits: int
    """Bits of a value."""
    packing: str
    """``""`` (whole bytes, little-endian), ``"p"`` (PFNC: bits follow one another, lowest first) or ``"Packed"``
    (GigE Vision: two pixels in three bytes, their lowest bits in the middle one)."""

    @property
    def wire_bits(self) -> int:
        """Bits that a pixel takes on the wire."""
        return _PACKED[self.bits, self.packing] if self.packing else -(-self.bits // 8) * 8

    @property
    def full_scale(self) -> int:
        """Largest count."""
        return (1 << self.bits) - 1

    @property
    def dtype(self) -> type[np.uint8] | type[np.uint16]:
        """Type of unpacked counts."""
        return np.uint8 if self.bits <= 8 else np.uint16

    def size(self, pixels: int) -> int:
        """Bytes that so many pixels take when they follow one another without padding."""
        return -(-pixels * self.wire_bits // 8)


def pixel_format(name: str) -> PixelFormat:
    """The format of that name.

    Raises:
        ValueError: no monochrome format that can be unpacked is called so; says which are.
    """
    match = _NAME.fullmatch(name)
    if match is not None:
        bits, packing = int(match[1]), match[2] or ""
        if not packing or (bits, packing) in _PACKED:
            return PixelFormat(name, bits, packing)
    raise ValueError(f"pixel_format: found {name!r}, allowed: {', '.join(PREFERRED)}, and Polarized… of the same")


def choose(offered: tuple[str, ...]) -> PixelFormat | None:
    """The best of what a camera offers, None where it offers nothing that can be unpacked."""
    known = []
    for name in offered:
        try:
            known.append(pixel_format(name))
        except ValueError:
            continue
    # Among equals the plain Mono formats come first: they are what other software shows.
    return min(known, key=lambda one: (-one.bits, one.wire_bits, one.name not in PREFERRED), default=None)


def unpack(data: Bytes, wanted: PixelFormat, shape: tuple[int, int], *, line_padding: int = 0) -> Counts:
    """Counts of an image from the bytes that came over the wire; always a copy.

    Args:
        data: uint8 (N,); bytes after the image (chunks, padding at its end) are not looked at.
        wanted: how the pixels are packed.
        shape: rows and columns.
        line_padding: bytes after each row.

    Returns:
        (rows, columns) uint8 or uint16.

    Raises:
        ValueError: fewer bytes than the image takes, or padding after rows that do not end with a whole byte.
    """
    rows, columns = shape
    if line_padding:
        if columns * wanted.wire_bits % 8:
            raise ValueError(f"rows of {columns} pixels of {wanted.name} with padding do not end with a whole byte")
        line = wanted.size(columns)
        stride = line + line_padding
        if data.size < stride * rows - line_padding:
            raise ValueError(f"{data.size} bytes came for {rows} rows of {stride}")
        padded = np.lib.stride_tricks.as_strided(data, (rows, line), (stride * data.strides[0], data.strides[0]))
        data = np.ascontiguousarray(padded).reshape(-1)
    pixels = rows * columns
    needed = wanted.size(pixels)
    if data.size < needed:
        raise ValueError(f"{data.size} bytes came for an image of {needed}")
    data = np.ascontiguousarray(data[:needed])
    return _counts(data, wanted, pixels).reshape(shape)


def unpack_reference(data: Bytes, wanted: PixelFormat, pixels: int) -> Counts:
    """Bit by bit, as the standards draw it: the definition of what :func:`unpack` does for one row of pixels."""
    values = np.zeros(pixels, dtype=wanted.dtype)
    for pixel in range(pixels):
        value = 0
        for bit in range(wanted.bits):
            if wanted.packing == "Packed":
                # Three bytes hold two pixels: upper bits of the first, lower bits of both, upper bits of the second.
                lower = wanted.bits - 8
                base = pixel // 2 * 24
                middle, own = base + 8 + (4 if pixel % 2 else 0), base + (16 if pixel % 2 else 0)
                position = middle + bit if bit < lower else own + bit - lower
            else:
                position = pixel * wanted.wire_bits + bit
            value |= (int(data[position // 8]) >> position % 8 & 1) << bit
        values[pixel] = value
    return values


def _counts(data: Bytes, wanted: PixelFormat, pixels: int) -> Counts:
    if wanted.packing == "p" and wanted.bits == 12:
        return _pairs(data, pixels, lambda a, b, c: (a | (b & 0xF) << 8, b >> 4 | c << 4))
    if wanted.packing == "Packed":
        lower = wanted.bits - 8
        mask = (1 << lower) - 1
        return _pairs(data, pixels, lambda a, b, c: (a << lower | b & mask, c << lower | b >> 4 & mask))
    if wanted.packing == "p":
        return _fours(data, pixels, wanted.bits)
    return data.copy() if wanted.wire_bits == 8 else data.view("<u2").astype(np.uint16)


def _pairs(data: Bytes, pixels: int, split: Any) -> Counts:
    """Two pixels in three bytes. The last, odd pixel takes two."""
    whole = pixels // 2
    counts = np.empty(pixels, dtype=np.uint16)
    trios = data[: whole * 3].reshape(-1, 3)
    a, b, c = (trios[:, k].astype(np.uint16) for k in range(3))
    counts[: whole * 2 : 2], counts[1 : whole * 2 : 2] = split(a, b, c)
    if pixels % 2:
        a, b = (data[whole * 3 + k : whole * 3 + k + 1].astype(np.uint16) for k in range(2))
        counts[-1:] = split(a, b, np.zeros(1, dtype=np.uint16))[0]
    return counts


def _fours(data: Bytes, pixels: int, bits: int) -> Counts:
    """Four pixels in five (10 bits) or seven (14 bits) bytes, whose bits follow one another."""
    octets = bits // 2
    groups = -(-pixels // 4)
    padded = np.zeros((groups, octets + 2), dtype=np.uint8)
    filled = np.zeros(groups * octets, dtype=np.uint8)
    filled[: data.size] = data
    padded[:, :octets] = filled.reshape(groups, octets)
    counts = np.empty((groups, 4), dtype=np.uint16)
    mask = np.uint32((1 << bits) - 1)
    for k in range(4):
        first, shift = divmod(k * bits, 8)
        word = padded[:, first].astype(np.uint32)
        word |= padded[:, first + 1].astype(np.uint32) << 8
        word |= padded[:, first + 2].astype(np.uint32) << 16
        counts[:, k] = word >> shift & mask
    return counts.reshape(-1)[:pixels]
