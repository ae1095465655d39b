"""Filters of the session file: all of them lossless, so that what is traded for time is room on the disk."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import hdf5plugin
import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import filters
from polfuse_lab.trade.rows import Row, timed

FILTERS: dict[str, dict[str, Any]] = {
    **filters.FILTERS,
    "blosc2-lz4": dict(hdf5plugin.Blosc2(cname="lz4")),
    "lzf": {"compression": "lzf"},
    "gzip-1": {"compression": "gzip", "compression_opts": 1, "shuffle": True},
}


def frames(count: int, shape: tuple[int, int]) -> NDArray[np.uint16]:
    """Frames of 12 bits with shot noise, as the thesis's camera takes them."""
    rng = np.random.default_rng(8)
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    level = 600 + 500 * np.sin(x / 70) * np.cos(y / 50)
    counts = np.rint(level + np.sqrt(level) * rng.normal(size=(count, *shape)))
    return np.asarray(np.clip(counts, 0, 4095), dtype=np.uint16)


def storage_rows(count: int, rounds: int) -> Iterator[Row]:
    """Write ``count`` frames of 782 x 582 pixels through each filter; the size over the raw size stands for the error.

    Raises:
        PolfuseError: a filter that does not give back what was written.
    """
    written = frames(count, (582, 782))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frames.h5"

        def write(options: dict[str, Any]) -> int:
            with h5py.File(path, "w") as file:
                stored = file.create_dataset(
                    "images", shape=written.shape, dtype=written.dtype, chunks=(1, 582, 782), **options
                )
                for number, frame in enumerate(written):
                    stored[number] = frame
                file.flush()
                return int(stored.id.get_storage_size())

        for name, options in FILTERS.items():
            seconds, size = timed(lambda: write(options), rounds)  # noqa: B023
            with h5py.File(path) as file:
                if not np.array_equal(file["images"][:], written):
                    raise PolfuseError(f"the filter {name} changes what is stored", where=name, advice="do not use it")
            yield Row("storage.frames", name, seconds, 20 * math.log10(size / written.nbytes))
