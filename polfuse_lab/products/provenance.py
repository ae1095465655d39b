"""Where a product comes from: its inputs' hashes, the settings, the versions, when and on which machine."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from polfuse_lab.errors import PolfuseError

PACKAGES = ("polfuse-lab", "numpy", "scipy", "numba", "h5py", "scikit-learn", "matplotlib")
"""Packages whose versions can change a number or a picture."""


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


def arrays_sha256(arrays: Mapping[str, np.ndarray[Any, Any]]) -> str:
    """SHA-256 over names, types, shapes and bytes of arrays, in the order of their names.

    Two stages with the same hash hold the same numbers to the last bit.
    """
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        digest.update(f"{name}|{array.dtype.str}|{array.shape}|".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


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
