"""Datasets that grow while they are written.

h5py's own indexing makes the types and selections of HDF5 anew for each write, which takes longer than a row of a table
does; here they are made once.

Compression takes longer than all the rest of writing. A writer that falls behind stores whole chunks as they are, with
their checksum; HDF5 notes for each chunk which filters were left out, and readers see no difference.
"""

from __future__ import annotations

import math
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from polfuse_lab.session.checksum import fletcher32

_WITHOUT_COMPRESSION = 1
"""Mask of a chunk whose first filter was left out."""


class GrowingDataset:
    """A dataset, chunked and resizable along its first axis, that is written behind its present end.

    Args:
        dataset: opened for writing, in the file's order of bytes.
    """

    def __init__(self, dataset: h5py.Dataset) -> None:
        self.dtype: np.dtype[Any] = dataset.dtype
        """Type of an item."""
        self.shape: tuple[int, ...] = dataset.shape[1:]
        """Shape of an item."""
        self.chunk: int = dataset.chunks[0]
        """Items in a chunk."""
        self.items: int = dataset.shape[0]
        """Items so far."""
        self._id = dataset.id
        made = dataset.id.get_create_plist()
        filters = [made.get_filter(number)[0] for number in range(made.get_nfilters())]
        # Only whole items are stored without compression, which is the first of two filters.
        self._direct = filters[1:] == [h5py.h5z.FILTER_FLETCHER32] and dataset.chunks[1:] == dataset.shape[1:]
        chunk_bytes = math.prod(dataset.chunks) * dataset.dtype.itemsize if self._direct else 0
        self._content = np.empty(chunk_bytes + 4, dtype=np.uint8)
        self._memory_type = h5py.h5t.py_create(dataset.dtype)

    def append(self, items: NDArray[Any], *, at: int | None = None, plain: bool = False) -> None:
        """Write ``items``, shape (n, *shape), at the end, or further on at ``at`` (what is skipped reads as zeros).

        Args:
            items: what is written.
            at: where the first of them goes.
            plain: without compression, where they begin with a chunk; a last chunk that they do not fill is filled up
                with zeros.

        Raises:
            OSError, RuntimeError: as h5py does where writing fails; the dataset may have grown without the items then.
        """
        first = self.items if at is None else at
        values = np.ascontiguousarray(items, dtype=self.dtype)
        end = first + len(values)
        self._id.set_extent((end, *self.shape))
        self.items = end
        if not len(values):
            return
        if plain and self._direct and first % self.chunk == 0:
            self._store_chunks(values, first)
            return
        target = self._id.get_space()
        target.select_hyperslab((first, *(0 for _ in self.shape)), values.shape)
        self._id.write(h5py.h5s.create_simple(values.shape), target, values, self._memory_type)

    def _store_chunks(self, values: NDArray[Any], first: int) -> None:
        for begin in range(0, len(values), self.chunk):
            piece = values[begin : begin + self.chunk]
            if len(piece) < self.chunk:
                piece = np.concatenate([piece, np.zeros((self.chunk - len(piece), *self.shape), self.dtype)])
            content = self._content
            content[:-4] = piece.reshape(-1).view(np.uint8)
            content[-4:] = np.frombuffer(fletcher32(piece).to_bytes(4, "little"), dtype=np.uint8)
            self._id.write_direct_chunk((first + begin, *(0 for _ in self.shape)), content, _WITHOUT_COMPRESSION)

    def append_row(self, values: tuple[Any, ...]) -> None:
        """Write one row of a table. Raises as :meth:`append`."""
        self.append(np.array([values], dtype=self.dtype))
