"""Newest data for any number of readers: a ring of slots in a memory-mapped file, one file for each stream.

The writer never waits and does not know its readers; a reader that is too slow misses items, and a reader that dies
leaves nothing behind. The file lies in the private directory of the engine (in memory, where the system keeps the
user's run-time folder in memory), so whoever removes that directory removes the rings. Named shared memory is not
used: Python's resource tracker removes it under its owner when a mere reader ends, and leaves it when all is killed.

Each slot has a sequence number: odd while the writer is in it, changed whenever it has been. A reader copies a slot
and keeps the copy only if the number was even and is still the same (a seqlock; Lameter 2005).
"""

from __future__ import annotations

import contextlib
import mmap
import os
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

SUFFIX = ".ring"
META_BYTES = 4096
"""Room of a slot for names, shapes, units and values."""
_MAGIC = 0x474E495246504C50
_LAYOUT = 1
_HEAD = 64
_TRIES = 8
_lock = threading.Lock()


@dataclass(frozen=True)
class Shown:
    """One item of a stream: arrays and numbers, ready to be shown."""

    stream: str
    number: int
    """Counts the stream's items from 1; a gap means that items were missed."""
    t_sample_ns: int
    """When the newest sample (or frame) in it arrived, on the host's monotonic clock (``time.monotonic_ns``)."""
    t_ready_ns: int
    """When it became readable, same clock."""
    arrays: Mapping[str, Array] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    """Unit of each array and of each value that has one."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """Single numbers and words."""


def _fence() -> None:
    """Nothing in memory before this is seen after what follows it, on any processor: a release, then an acquire."""
    with _lock:
        pass
    with _lock:
        pass


def _aligned(size: int) -> int:
    return -(-size // 64) * 64


class RingWriter:
    """The writing end of one stream. Used by one thread at a time.

    Args:
        path: the file; it must not exist.
        payload_bytes: largest item.
        slots: items kept.
        first: number of the first item.

    Raises:
        OSError: no room for the file.
    """

    def __init__(self, path: Path, payload_bytes: int, slots: int, first: int = 1) -> None:
        self.path, self.slots = path, max(slots, 2)
        self.payload_bytes = max(_aligned(payload_bytes), 64)
        self._slot_bytes = _HEAD + META_BYTES + self.payload_bytes
        size = _HEAD + self.slots * self._slot_bytes
        fresh = path.with_name(f"{path.name}.new")
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | getattr(os, "O_SHORT_LIVED", 0)
        handle = os.open(fresh, flags, 0o600)
        try:
            # Room is taken now: a full disk would otherwise be met as a signal that ends the process.
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(handle, 0, size)
            else:
                os.truncate(handle, size)
            self._memory = mmap.mmap(handle, size)
        except BaseException:
            fresh.unlink(missing_ok=True)
            raise
        finally:
            os.close(handle)
        self._head: NDArray[np.int64] = np.frombuffer(self._memory, np.int64, 8)
        self._number = first - 1
        self._head[1:5] = _LAYOUT, self.slots, self._slot_bytes, 0
        _fence()
        self._head[0] = _MAGIC
        os.replace(fresh, path)

    @property
    def number(self) -> int:
        """Number of the newest item."""
        return self._number

    def put(
        self, arrays: Mapping[str, Array], units: Mapping[str, str], values: Mapping[str, Any], t_sample_ns: int
    ) -> int:
        """Make an item readable; returns its number. Raises ValueError where it does not fit."""
        places, offset = [], 0
        for name, array in arrays.items():
            places.append((name, array.dtype.str, array.shape, offset))
            offset = _aligned(offset + array.nbytes)
        meta = msgspec.msgpack.encode({"arrays": places, "units": units, "values": values})
        if len(meta) > META_BYTES or offset > self.payload_bytes:
            raise ValueError(f"an item of {offset} bytes and {len(meta)} bytes of names does not fit into its ring")
        self._number += 1
        start = _HEAD + (self._number % self.slots) * self._slot_bytes
        slot = np.frombuffer(self._memory, np.int64, 8, start)
        sequence = int(slot[0])
        slot[0] = sequence | 1
        _fence()
        slot[1:3] = self._number, t_sample_ns
        slot[4:6] = len(meta), offset
        self._memory[start + _HEAD : start + _HEAD + len(meta)] = meta
        payload = start + _HEAD + META_BYTES
        for (_, _, _, at), array in zip(places, arrays.values(), strict=True):
            target = np.frombuffer(self._memory, array.dtype, array.size, payload + at)
            target.reshape(array.shape)[...] = array
        slot[3] = time.monotonic_ns()
        _fence()
        slot[0] = (sequence | 1) + 1
        _fence()
        self._head[4] = self._number
        return self._number

    def retire(self) -> None:
        """Tell readers to open the file of this name anew. Idempotent."""
        with contextlib.suppress(ValueError):
            self._head[5] = 1

    def close(self) -> None:
        """Let go of the memory; the file stays. Idempotent."""
        self._head = np.zeros(8, np.int64)
        with contextlib.suppress(BufferError):
            self._memory.close()


def ring_path(folder: Path, stream: str, generation: int) -> Path:
    """File of a stream's ring. A ring that takes another's place has a new name: the old file may still be in use."""
    return folder / f"{stream}~{generation}{SUFFIX}"


def generations(folder: Path, stream: str | None = None) -> dict[str, int]:
    """The newest generation of each stream in a folder, or of one of them."""
    found: dict[str, int] = {}
    try:
        names = os.listdir(folder)
    except OSError:
        return found
    for name in names:
        known, mark, rest = name.partition("~")
        number, dot, after = rest.partition(".")
        if mark and f"{dot}{after}" == SUFFIX and number.isdigit() and stream in (None, known):
            found[known] = max(found.get(known, 0), int(number))
    return found


def supersede(path: Path) -> int:
    """Tell readers of a ring whose writer has died that another will take its place; the number of its newest item."""
    try:
        with open(path, "r+b") as file, mmap.mmap(file.fileno(), _HEAD) as memory:
            magic, _, _, _, newest, _, _, _ = np.frombuffer(bytes(memory), np.int64)
            if magic != _MAGIC:
                return 0
            memory[40:48] = np.int64(1).tobytes()
            return int(newest)
    except (OSError, ValueError):
        return 0


class RingReader:
    """A reading end. Raises :class:`FileNotFoundError` where there is no such file, ValueError where it is no ring."""

    def __init__(self, path: Path) -> None:
        with open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            if size < _HEAD:
                raise ValueError(f"{path} is no ring")
            self._memory = mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ)
        self._head: NDArray[np.int64] = np.frombuffer(self._memory, np.int64, 8)
        self.slots, self._slot_bytes = int(self._head[2]), int(self._head[3])
        whole = int(self._head[0]) == _MAGIC and int(self._head[1]) == _LAYOUT
        if not whole or size != _HEAD + self.slots * self._slot_bytes:
            self.close()
            raise ValueError(f"{path} is no ring of this version")
        self._stream = path.name.partition("~")[0]

    @property
    def newest_number(self) -> int:
        """Number of the newest item; 0 before there is one."""
        return int(self._head[4])

    @property
    def retired(self) -> bool:
        """Whether another file has taken this one's place."""
        return bool(self._head[5])

    def get(self, number: int) -> Shown | None:
        """A copy of one item; None where it is not there (any more)."""
        start = _HEAD + (number % self.slots) * self._slot_bytes
        slot = np.frombuffer(self._memory, np.int64, 8, start)
        for _ in range(_TRIES):
            before = int(slot[0])
            _fence()
            if before & 1:
                time.sleep(0.0005)
                continue
            _, found, t_sample_ns, t_ready_ns, meta_bytes, payload_bytes = (int(value) for value in slot[:6])
            if found != number:
                return None
            room = self._slot_bytes - _HEAD - META_BYTES
            meta_bytes, payload_bytes = min(max(meta_bytes, 0), META_BYTES), min(max(payload_bytes, 0), room)
            meta = self._memory[start + _HEAD : start + _HEAD + meta_bytes]
            payload = np.empty(payload_bytes, np.uint8)
            payload[:] = np.frombuffer(self._memory, np.uint8, payload_bytes, start + _HEAD + META_BYTES)
            _fence()
            if int(slot[0]) == before:
                return _item(self._stream, number, t_sample_ns, t_ready_ns, meta, payload)
        return None

    def close(self) -> None:
        """Let go of the memory. Idempotent."""
        self._head = np.zeros(8, np.int64)
        with contextlib.suppress(BufferError):
            self._memory.close()


def _item(stream: str, number: int, t_sample_ns: int, t_ready_ns: int, meta: bytes, payload: Array) -> Shown:
    told = msgspec.msgpack.decode(meta)
    arrays = {}
    for name, kind, shape, offset in told["arrays"]:
        dtype = np.dtype(kind)
        size = dtype.itemsize * int(np.prod(shape, dtype=np.int64))
        arrays[name] = payload[offset : offset + size].view(dtype).reshape(shape)
    return Shown(stream, number, t_sample_ns, t_ready_ns, arrays, told["units"], told["values"])
