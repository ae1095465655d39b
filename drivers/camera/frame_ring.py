"""Frames in shared memory: a heartbeat and a ring of slots that one process fills and another reads."""

from __future__ import annotations

import time
from contextlib import suppress
from multiprocessing.shared_memory import SharedMemory

import numpy as np
from numpy.typing import NDArray

_HEADER = 64
_PIXEL_BYTES = 2


class FrameRing:
    """A block of shared memory. The process that creates it owns it and unlinks it.

    The writer fills slots in turn; a slot is overwritten ``slots`` frames later, so a reader that copies a frame when
    it is told of it has all that time. The first eight bytes are the writer's heartbeat.

    Args:
        shape: rows and columns of a frame, of at most 16 bits a pixel.
        slots: frames that fit.
        name: an existing block to attach to; a new one is created when left out.
    """

    def __init__(self, shape: tuple[int, int], *, slots: int = 4, name: str | None = None) -> None:
        self.shape, self.slots = shape, slots
        size = _HEADER + slots * shape[0] * shape[1] * _PIXEL_BYTES
        self._memory = SharedMemory(name=name, create=name is None, size=size)
        self._owner = name is None
        self._beat: NDArray[np.int64] | None = np.ndarray((1,), np.int64, self._memory.buf)
        self._slots: NDArray[np.uint8] | None = np.ndarray(
            (slots, shape[0] * shape[1] * _PIXEL_BYTES), np.uint8, self._memory.buf, offset=_HEADER
        )
        if self._owner:
            self.beat()

    @property
    def name(self) -> str:
        """Name to attach to from another process."""
        return self._memory.name

    def beat(self) -> None:
        """Writer: I am alive now."""
        assert self._beat is not None
        self._beat[0] = time.monotonic_ns()

    def silence_s(self) -> float:
        """Reader: seconds since the writer's last heartbeat."""
        assert self._beat is not None
        return (time.monotonic_ns() - int(self._beat[0])) * 1e-9

    def put(self, number: int, image: NDArray[np.unsignedinteger]) -> None:
        """Writer: store frame ``number`` in its slot. Raises ValueError for another shape or a wider type."""
        if image.shape != self.shape or image.dtype.kind != "u" or image.dtype.itemsize > _PIXEL_BYTES:
            raise ValueError(f"a frame is {image.dtype} {image.shape}, expected uint8 or uint16 {self.shape}")
        self._slot(number, image.dtype)[:] = image

    def get(self, number: int, dtype: str) -> NDArray[np.unsignedinteger]:
        """Reader: a copy of frame ``number``, which was stored with sample type ``dtype``."""
        return self._slot(number, np.dtype(dtype)).copy()

    def _slot(self, number: int, dtype: np.dtype[np.unsignedinteger]) -> NDArray[np.unsignedinteger]:
        assert self._slots is not None
        size = self.shape[0] * self.shape[1] * dtype.itemsize
        return self._slots[number % self.slots, :size].view(dtype).reshape(self.shape)

    def unlink(self) -> None:
        """Remove the block's name; processes that are attached keep their memory. Idempotent."""
        with suppress(FileNotFoundError):
            self._memory.unlink()

    def close(self) -> None:
        """Detach, and unlink when this process created the block. Idempotent; never raises."""
        # NumPy views must be gone before the memory can be unmapped.
        self._beat = self._slots = None
        with suppress(BufferError):
            self._memory.close()
        if self._owner:
            self._owner = False
            self.unlink()
