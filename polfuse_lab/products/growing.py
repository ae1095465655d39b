"""Stages of a products file that are written piece by piece, and gone on with after an interruption.

They grow in a file of their own beside the products file, ``NAME.tiles``, which becomes the products file when it is
whole (:meth:`polfuse_lab.products.store.Products.adopt`). All its room is taken and all its structure written at the
start; afterwards nothing but numbers changes, so that whoever is killed leaves a file that can be read. A piece counts
once its checksum is in the file, which is written after the piece itself. What the pieces are made from is told by a
text, the *recipe*: pieces made by another recipe are thrown away.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.plain import plain
from polfuse_lab.products.lock import exclusive
from polfuse_lab.products.store import Products
from polfuse_lab.session.space import explain, is_disk_full, require_free

JOURNAL = "journal"
"""Group of the checksums and the recipe; taken out when the file is whole."""

HEADER_BYTES = 1 << 20
"""Room for all that is no array."""

Index = tuple[slice, ...]


@dataclass(frozen=True)
class Growing:
    """One array that is written piece by piece."""

    shape: tuple[int, ...]
    dtype: DTypeLike
    unit: str | None = None

    @property
    def nbytes(self) -> int:
        """Its size."""
        return int(np.prod(self.shape, dtype=np.int64)) * np.dtype(self.dtype).itemsize


@dataclass(frozen=True)
class RawArray:
    """Where an array of three axes lies in a file as plain numbers, for readers without HDF5 (and its locks)."""

    path: str
    offset: int
    shape: tuple[int, ...]
    dtype: str

    def rows(self, first: int, row: slice) -> NDArray[Any]:
        """Some rows of one entry of the first axis, ``array[first, row]``, read as they are now.

        Raises:
            OSError: the file is not there (on another machine, say).
            EOFError: it is too short.
        """
        inner = int(np.prod(self.shape[2:], dtype=np.int64))
        count = (row.stop - row.start) * inner
        kind = np.dtype(self.dtype)
        with open(self.path, "rb") as stream:
            stream.seek(self.offset + (first * self.shape[1] + row.start) * inner * kind.itemsize)
            values = np.fromfile(stream, dtype=kind, count=count)
        if len(values) != count:
            raise EOFError(f"{self.path} is too short")
        return values.reshape(row.stop - row.start, *self.shape[2:])


def partial_path(products: Path) -> Path:
    """Where the stages of a products file grow."""
    return products.with_name(f"{products.name}.tiles")


class GrowingStages:
    """Arrays by stage and name (``"focus/image"``) that are written in numbered pieces. Use it with ``with``.

    Args:
        products: the products file that they are for.
        recipe: everything that the numbers depend on; anything that JSON can hold.
        arrays: the arrays by ``"stage/name"``.
        pieces: how many pieces each series of pieces has, by its name.

    Raises:
        PolfuseError: no room on the disk, the folder cannot be written, or another program is at work.
    """

    def __init__(
        self, products: Path, recipe: Mapping[str, Any], arrays: Mapping[str, Growing], pieces: Mapping[str, int]
    ) -> None:
        self.path = partial_path(products)
        self._recipe = json.dumps(plain(recipe), sort_keys=True)
        self._arrays, self._pieces = dict(arrays), dict(pieces)
        self._lock = exclusive(self.path)
        self._lock.__enter__()
        try:
            file = self._found()
            self.resumed = file is not None
            """Whether an earlier run's pieces were found."""
            self._file: h5py.File = self._created() if file is None else file
        except BaseException:
            self._lock.__exit__(None, None, None)
            raise

    def __enter__(self) -> GrowingStages:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and let others write it; what is there stays for another run. Idempotent."""
        if self._file:
            try:
                self._file.close()
            except (OSError, RuntimeError) as error:
                raise self._failure(error) from error
            finally:
                self._lock.__exit__(None, None, None)

    def done(self, series: str) -> NDArray[np.bool_]:
        """(pieces,) which pieces of a series are in the file."""
        return np.asarray(self._file[f"{JOURNAL}/{series}"][()] > 0)

    def put(self, series: str, piece: int, values: Mapping[str, tuple[Index, NDArray[Any]]]) -> None:
        """Write one piece: parts of arrays by name, with where they go. It counts when this returns.

        Raises:
            PolfuseError: the disk is full or fails; pieces written before stay.
        """
        with self._telling():
            total = 0
            for name, (where, part) in values.items():
                self._dataset(name)[where] = part
                total = zlib.crc32(np.ascontiguousarray(part).data, total)
            self._file.flush()
            self._file[f"{JOURNAL}/{series}"][piece] = (1 << 32) | total
            self._file.flush()

    def keep_sound(self, series: str, where: Mapping[int, Mapping[str, Index]]) -> int:
        """Compare the pieces of a series with their checksums, and do those again that differ (a crash of the machine).

        Args:
            series: the series.
            where: for every piece the parts that it was written to, in the order of :meth:`put`.

        Returns:
            How many are sound.
        """
        journal = self._file[f"{JOURNAL}/{series}"]
        sound = 0
        for piece in np.flatnonzero(self.done(series)):
            total = 0
            for name, index in where[int(piece)].items():
                total = zlib.crc32(np.ascontiguousarray(self._dataset(name)[index]).data, total)
            if int(journal[piece]) == (1 << 32) | total:
                sound += 1
            else:
                journal[piece] = 0
        self._file.flush()
        return sound

    def get(self, name: str, where: Index) -> NDArray[Any]:
        """A part of an array as it is in the file."""
        return np.asarray(self._dataset(name)[where])

    def raw(self, name: str) -> RawArray:
        """Where an array lies in the file; what :meth:`put` has written can be read there at once."""
        dataset = self._dataset(name)
        return RawArray(str(self.path.resolve()), int(dataset.id.get_offset()), dataset.shape, dataset.dtype.str)

    def become(self, products: Products, settings: Mapping[str, Mapping[str, Any]], inputs: Sequence[Path]) -> None:
        """Become the products file, without the journal; nothing can be written any more.

        Args:
            products: the products file; its other stages are kept.
            settings: of every stage.
            inputs: the files that the stages were made from.

        Raises:
            PolfuseError: as :meth:`polfuse_lab.products.store.Products.adopt`; the pieces stay.
        """
        with self._telling():
            self._file.close()
        try:
            products.adopt(self.path, settings, inputs=inputs, scratch=JOURNAL)
        finally:
            self._lock.__exit__(None, None, None)

    def _dataset(self, name: str) -> h5py.Dataset:
        stage, _, array = name.partition("/")
        return self._file[f"{stage}/arrays/{array}"]

    def _found(self) -> h5py.File | None:
        """The file of an earlier run of the same recipe; any other is deleted."""
        if not self.path.exists():
            return None
        try:
            file = h5py.File(self.path, "r+")
            try:
                same = file[f"{JOURNAL}/recipe"].asstr()[()] == self._recipe
                same = same and all(file[f"{JOURNAL}/{name}"].shape == (n,) for name, n in self._pieces.items())
            except (KeyError, OSError, RuntimeError, AttributeError, TypeError):
                same = False
            if same:
                return file
            file.close()
        except BlockingIOError:
            raise PolfuseError(
                "is being written by another program", where=str(self.path), advice="wait until it has ended"
            ) from None
        except (OSError, RuntimeError):
            pass  # left by a crash in an instant when it was no HDF5 file
        self.path.unlink()
        return None

    def _created(self) -> h5py.File:
        needed = sum(array.nbytes for array in self._arrays.values()) + HEADER_BYTES
        require_free(self.path, needed)
        try:
            # Tried before HDF5 begins, which does not survive a full disk; it takes the same room again.
            with self.path.open("wb") as stream:
                _take_room(stream.fileno(), needed)
            file = h5py.File(self.path, "w", track_order=True)
        except OSError as error:
            self.path.unlink(missing_ok=True)
            raise self._failure(error) from error
        with self._telling(lost=file):
            for name, array in self._arrays.items():
                stage, _, own = name.partition("/")
                inside = f"{stage}/arrays"
                group = file[inside] if inside in file else file.create_group(inside, track_order=True)
                _contiguous(group, own, array)
            for series, count in self._pieces.items():
                file.create_dataset(f"{JOURNAL}/{series}", data=np.zeros(count, dtype=np.uint64))
            file[f"{JOURNAL}/recipe"] = self._recipe
            file.flush()
            with self.path.open("rb+") as stream:
                _take_room(stream.fileno(), max(os.fstat(stream.fileno()).st_size, 1))
        return file

    @contextmanager
    def _telling(self, lost: h5py.File | None = None) -> Iterator[None]:
        try:
            yield
        except (OSError, RuntimeError) as error:
            if lost is not None:
                with suppress(OSError, RuntimeError):  # what it could not write it cannot write now
                    lost.close()
                self.path.unlink(missing_ok=True)
            raise self._failure(error) from error

    def _failure(self, error: Exception) -> PolfuseError:
        what = "the disk is full" if is_disk_full(error) else explain(error)
        return PolfuseError(
            f"the image could not be written ({what})",
            where=str(self.path),
            advice="free space or check the folder and run the same command again, which goes on where it stopped",
        )


def _contiguous(group: h5py.Group, name: str, array: Growing) -> None:
    """A data set whose room in the file is given out at once, as one run of plain numbers."""
    settings = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    settings.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    settings.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    settings.set_layout(h5py.h5d.CONTIGUOUS)
    kind = h5py.h5t.py_create(np.dtype(array.dtype), logical=True)
    space = h5py.h5s.create_simple(array.shape)
    h5py.h5d.create(group.id, name.encode(), kind, space, settings)
    if array.unit is not None:
        group[name].attrs["unit"] = array.unit


def _take_room(handle: int, size: int) -> None:
    """Make a file's holes real, where the system can, so that no later write meets a full disk."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(handle, 0, size)
