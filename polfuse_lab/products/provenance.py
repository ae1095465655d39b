"""Where a product comes from: its inputs' hashes, the settings, the versions, when and on which machine."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from polfuse_lab.errors import PolfuseError

PACKAGES = ("polfuse-lab", "numpy", "scipy", "numba", "h5py", "scikit-learn", "matplotlib")
"""Packages whose versions can change a number or a picture."""


PART_BYTES = 16_000_000
"""Bytes of an array that are looked at at a time."""


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, hexadecimal.

    Raises:
        PolfuseError: the file cannot be read.
    """
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise PolfuseError(
            f"the input cannot be read for its hash ({error.strerror})", where=str(path), advice="check the path"
        ) from error


def arrays_sha256(arrays: Mapping[str, Any]) -> str:
    """SHA-256 over names, types, shapes and bytes of arrays, in the order of their names.

    Two stages with the same hash hold the same numbers to the last bit. Data sets of HDF5 are read in parts.
    """
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name}|{array.dtype.str}|{array.shape}|".encode())
        for part in _parts(array):
            digest.update(np.ascontiguousarray(part).data.cast("B") if part.size else b"")
    return digest.hexdigest()


def _parts(array: Any) -> Iterator[np.ndarray[Any, Any]]:
    """An array or data set in parts of few megabytes, in the order of its bytes."""
    shape = array.shape
    inner = int(np.prod(shape[1:], dtype=np.int64)) * array.dtype.itemsize
    if not shape or not inner:
        yield np.asarray(array[()])
    elif len(shape) > 1 and inner > PART_BYTES:
        for index in range(shape[0]):
            yield from _parts(_Row(array, index))
    else:
        step = max(PART_BYTES // inner, 1)
        for first in range(0, shape[0], step):
            yield np.asarray(array[first : first + step])


class _Row:
    """One entry of the first axis of an array or data set, read only where it is looked at."""

    def __init__(self, array: Any, index: int) -> None:
        self._array, self._index = array, index
        self.shape, self.dtype = array.shape[1:], array.dtype

    def __getitem__(self, where: Any) -> np.ndarray[Any, Any]:
        rest = where if isinstance(where, tuple) else (where,)
        return np.asarray(self._array[(self._index, *rest)])


def describe_inputs(inputs: Iterable[Path | str]) -> list[dict[str, Any]]:
    """One entry per input file: ``path``, ``bytes``, ``sha256``. Raises as :func:`file_sha256`."""
    described = []
    for item in inputs:
        path = Path(item)
        sha256 = file_sha256(path)
        described.append({"path": str(path.resolve()), "bytes": path.stat().st_size, "sha256": sha256})
    return described


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that the numbers depend on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def circumstances() -> dict[str, Any]:
    """When and where: ``time_utc``, ``host``, ``system``, ``versions``."""
    return {
        "time_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "host": platform.node(),
        "system": f"{platform.system()} {platform.machine()}",
        "versions": versions(),
    }
