"""Numbers and structures out of MATLAB files of versions 5 to 7 ("MAT-File Format", The MathWorks).

SciPy's reader looks element types up in a table without asking whether they are in it: of 20,000 files with one wrong
byte 193 ended the process. Here every length is checked against what there is before it is used.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError

LARGEST_BYTES = 1 << 30
"""A compressed variable that becomes larger than this is not read: a few wrong bytes can ask for any memory."""
DEEPEST = 20
"""Structures within structures, at most."""

_HEADER = 128
_INT8, _INT32, _UINT32, _MATRIX, _COMPRESSED = 1, 5, 6, 14, 15
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_STRUCTURE = 2
_COMPLEX = 0x0800


class _Damaged(Exception):
    """What does not hold together, in words."""


class _Element(NamedTuple):
    kind: int
    content: memoryview

    def of(self, kind: int) -> memoryview:
        if self.kind != kind:
            raise _Damaged(f"an element of type {self.kind} where {kind} belongs")
        return self.content


def read_matlab(path: Path) -> dict[str, Any]:
    """The variables of a file by name.

    Returns:
        Numbers as arrays of MATLAB's shape (2-d at least) and precision, structures of one element as dictionaries of
        their fields, None for all else (text, cells, sparse arrays, structures of many elements).

    Raises:
        PolfuseError: the file cannot be read, is no MATLAB file of these versions, or does not hold together.
    """
    try:
        raw = memoryview(path.read_bytes())
    except OSError as error:
        raise PolfuseError(
            f"cannot be read ({error.strerror or error})", where=str(path), advice="check its name"
        ) from error
    if bytes(raw[:10]) == b"MATLAB 7.3":
        raise PolfuseError("is of MATLAB's version 7.3", where=str(path), advice="save it again with -v7")
    order = {b"IM": "<", b"MI": ">"}.get(bytes(raw[126:_HEADER]))
    if order is None:
        raise PolfuseError("is no MATLAB file of versions 5 to 7", where=str(path), advice="check its name")
    found: dict[str, Any] = {}
    try:
        for element in _elements(raw[_HEADER:], order):
            if element.kind == _COMPRESSED:
                element = next(_elements(_inflated(element.content), order))
            name, value = _matrix(element.of(_MATRIX), order, 0)
            found[name] = value
    except _Damaged as damage:
        raise PolfuseError(
            f"is a damaged MATLAB file ({damage})", where=str(path), advice="fetch or copy it again"
        ) from damage
    return found


def _elements(raw: memoryview, order: str) -> Iterator[_Element]:
    """The elements one after the other: 8 bytes that tell type and length, or both in 4 with up to 4 of content."""
    at = 0
    while at < len(raw):
        if len(raw) - at < 8:
            raise _Damaged("it ends within an element")
        first, size = struct.unpack_from(order + "II", raw, at)
        if first >> 16:
            kind, size, begin = first & 0xFFFF, first >> 16, at + 4
            end = at + 8
            if size > 4:
                raise _Damaged(f"{size} bytes where 4 have room")
        else:
            kind, begin = first, at + 8
            # Compressed elements are not filled up to whole steps of 8 bytes.
            end = begin + (size if kind == _COMPRESSED else -(-size // 8) * 8)
            if begin + size > len(raw):
                raise _Damaged("it ends within an element")
        yield _Element(kind, raw[begin : begin + size])
        at = end


def _inflated(content: memoryview) -> memoryview:
    inflate = zlib.decompressobj()
    try:
        raw = inflate.decompress(content, LARGEST_BYTES)
    except zlib.error as error:
        raise _Damaged(str(error)) from error
    if not inflate.eof or len(raw) < 8:
        raise _Damaged("a compressed variable is not whole, or beyond 1 GiB")
    return memoryview(raw)


def _matrix(content: memoryview, order: str, depth: int) -> tuple[str, Any]:
    if not content:
        return "", np.empty((0, 0))
    parts = _elements(content, order)
    flags = _next(parts).of(_UINT32)
    if len(flags) != 8 or depth > DEEPEST:
        raise _Damaged("an array without its flags, or too many within one another")
    about = struct.unpack_from(order + "I", flags)[0]
    shape = tuple(np.frombuffer(_whole(_next(parts).of(_INT32), 4), order + "i4").tolist())
    if len(shape) < 2 or min(shape) < 0:
        raise _Damaged(f"an array of shape {shape}")
    name = bytes(_next(parts).of(_INT8)).decode("latin-1")
    kind = about & 0xFF
    if kind in _CLASSES:
        values = _numbers(_next(parts), shape, order)
        if about & _COMPLEX:
            values = values + 1j * _numbers(_next(parts), shape, order)
            return name, values.astype("c8" if _CLASSES[kind] == "f4" else "c16")
        return name, values.astype(_CLASSES[kind])
    if kind == _STRUCTURE and all(length == 1 for length in shape):
        return name, _fields(parts, order, depth)
    return name, None


def _fields(parts: Iterator[_Element], order: str, depth: int) -> dict[str, Any]:
    lengths = np.frombuffer(_whole(_next(parts).of(_INT32), 4), order + "i4")
    names = bytes(_next(parts).of(_INT8))
    if lengths.size != 1 or lengths[0] < 1 or len(names) % lengths[0]:
        raise _Damaged("names of fields that do not fit their length")
    length = int(lengths[0])
    fields: dict[str, Any] = {}
    for begin in range(0, len(names), length):
        name = names[begin : begin + length].split(b"\0")[0].decode("latin-1")
        fields[name] = _matrix(_next(parts).of(_MATRIX), order, depth + 1)[1]
    return fields


def _numbers(element: _Element, shape: tuple[int, ...], order: str) -> NDArray[Any]:
    """Numbers are stored in any type that holds them, column by column."""
    stored = _STORED.get(element.kind)
    if stored is None:
        raise _Damaged(f"an element of type {element.kind} where numbers belong")
    dtype = np.dtype(order + stored)
    values = np.frombuffer(_whole(element.content, dtype.itemsize), dtype)
    # Python's integers: the product of what damaged bytes say may be beyond 64 bits.
    count = 1
    for length in shape:
        count *= length
    if count != values.size:
        raise _Damaged(f"{values.size} numbers for an array of shape {shape}")
    return values.reshape(shape, order="F")


def _next(parts: Iterator[_Element]) -> _Element:
    element = next(parts, None)
    if element is None:
        raise _Damaged("an array lacks a part")
    return element


def _whole(content: memoryview, size: int) -> memoryview:
    if len(content) % size:
        raise _Damaged(f"{len(content)} bytes for numbers of {size} bytes")
    return content
