"""A file that a killed writer left, as if it had been closed: read without the flag that says "being written".

HDF5 reads a file with that flag as a reader beside a living writer: a block whose checksum is wrong is read again and
again, a hundred times with growing pauses, since the writer may just be at it. In a damaged file that takes minutes for
each record. Here the flag is taken off on the way; nothing is written.
"""

from __future__ import annotations

import io
import os
import struct
from pathlib import Path
from typing import Any

SUPERBLOCK_BYTES = 48
"""Of version 3, with its checksum."""
_FLAGS_AT = 11
_MASK = 0xFFFFFFFF


class Unflagged(io.RawIOBase):
    """A file opened for reading, for ``h5py.File``; its superblock (version 3) is read without the flag.

    It is closed when nobody holds it any more: h5py does not close what it is given.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._handle = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        self._place = 0
        self._start = unflagged(os.read(self._handle, SUPERBLOCK_BYTES))

    def close(self) -> None:
        """Close the file. Idempotent."""
        if not self.closed:
            os.close(self._handle)
        super().close()

    def readable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place."""
        before = {os.SEEK_SET: 0, os.SEEK_CUR: self._place}
        self._place = offset + (before[whence] if whence in before else os.fstat(self._handle).st_size)
        return self._place

    def tell(self) -> int:
        """The present place."""
        return self._place

    def readinto(self, buffer: Any) -> int:
        """Read at the present place."""
        view = memoryview(buffer).cast("B")
        os.lseek(self._handle, self._place, os.SEEK_SET)
        found = os.read(self._handle, len(view))
        view[: len(found)] = found
        if self._place < len(self._start):
            end = min(len(self._start) - self._place, len(found))
            view[:end] = self._start[self._place : self._place + end]
        self._place += len(found)
        return len(found)


def unflagged(superblock: bytes) -> bytes:
    """A superblock of version 3 with no flag set and the checksum that belongs to it; any other one as it is."""
    if not is_marked(superblock):
        return superblock  # where it is damaged HDF5 shall say so
    body = superblock[:-4]
    cleared = body[:_FLAGS_AT] + b"\0" + body[_FLAGS_AT + 1 :]
    return cleared + struct.pack("<I", checksum(cleared))


def is_marked(superblock: bytes) -> bool:
    """Whether a superblock of version 3, 48 bytes that are not damaged, is marked as being written."""
    if len(superblock) != SUPERBLOCK_BYTES or superblock[8] != 3 or not superblock[_FLAGS_AT]:
        return False
    return bool(checksum(superblock[:-4]) == struct.unpack("<I", superblock[-4:])[0])


def checksum(data: bytes) -> int:
    """Checksum of HDF5's metadata: Bob Jenkins' lookup3 ("hashlittle", begun with 0), of 1 byte or more."""
    a = b = c = (0xDEADBEEF + len(data)) & _MASK
    while len(data) > 12:
        x, y, z = struct.unpack("<III", data[:12])
        a, b, c = _mixed((a + x) & _MASK, (b + y) & _MASK, (c + z) & _MASK)
        data = data[12:]
    x, y, z = struct.unpack("<III", data.ljust(12, b"\0"))
    return _final((a + x) & _MASK, (b + y) & _MASK, (c + z) & _MASK)


def _turned(value: int, bits: int) -> int:
    return ((value << bits) | (value >> (32 - bits))) & _MASK


def _mixed(a: int, b: int, c: int) -> tuple[int, int, int]:
    for bits in (4, 6, 8, 16, 19, 4):
        a = ((a - c) & _MASK) ^ _turned(c, bits)
        c = (c + b) & _MASK
        a, b, c = b, c, a
    return a, b, c


def _final(a: int, b: int, c: int) -> int:
    for bits in (14, 11, 25, 16, 4, 14, 24):
        c = ((c ^ b) - _turned(b, bits)) & _MASK
        a, b, c = b, c, a
    return b
