"""Whether two sessions hold the same, to the last bit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError, first_line
from polfuse_lab.session import Session, layout, open_session, versions

CIRCUMSTANCES = ("source", "host", "versions", "started", "start_unix_s", "start_host_ns", "storage")
"""Entries of the configuration that tell where and when a file was written, not what was recorded."""
STATE_FIELDS = ("state", "reason", "samples_lost", "frames_lost")
"""Fields of the state that are compared; the others tell when the file was closed."""
SLAB_BYTES = 8_000_000
"""How much of a dataset is looked at at once: sessions may be larger than memory."""


@dataclass(frozen=True)
class Difference:
    """One dataset (or entry of the configuration) in which two sessions differ."""

    dataset: str
    what: str
    """What is different, in words, with the first place where it is."""

    def __str__(self) -> str:
        return f"{self.dataset}: {self.what}"


def compare_sessions(a: Path | str, b: Path | str) -> list[Difference]:
    """Compare two sessions byte by byte: audio, images, every table, the state and the configuration.

    Left out are :data:`CIRCUMSTANCES` of the configuration and the time at which each file was closed.

    Raises:
        PolfuseError: a file cannot be read.
    """
    with open_session(a) as first, open_session(b) as second:
        found = [*_config(first, second), *_state(first, second)]
        for name in ("audio", "images", *layout.TABLES):
            try:
                found += _dataset(name, first._file.get(name), second._file.get(name))
            except (OSError, RuntimeError) as error:
                raise PolfuseError(
                    f"{name} cannot be read ({first_line(error)})",
                    where=f"{a} or {b}",
                    advice="one of the files is damaged there; use another copy",
                ) from error
        return found


def _config(a: Session, b: Session) -> list[Difference]:
    names = [name for name in {**a.config, **b.config} if name not in CIRCUMSTANCES]
    return [
        Difference(f"config.{name}", f"{_short(a.config.get(name))} and {_short(b.config.get(name))}")
        for name in names
        if a.config.get(name) != b.config.get(name)
    ]


def _state(a: Session, b: Session) -> list[Difference]:
    return [
        Difference(f"state.{name}", f"{_short(getattr(a, name))} and {_short(getattr(b, name))}")
        for name in STATE_FIELDS
        if getattr(a, name) != getattr(b, name)
    ]


def _dataset(name: str, a: h5py.Dataset | None, b: h5py.Dataset | None) -> list[Difference]:
    table = name in layout.TABLES
    if a is None or b is None:
        there = a if b is None else b
        # A table that came with a later version is as good as an empty one.
        if there is None or (table and len(there) == 0):
            return []
        return [Difference(name, f"only in the {'second' if a is None else 'first'} session")]
    if (a.dtype != b.dtype and not table) or a.shape[1:] != b.shape[1:]:
        return [Difference(name, f"{a.dtype} rows of {a.shape[1:]} and {b.dtype} rows of {b.shape[1:]}")]
    found = []
    if len(a) != len(b):
        found.append(Difference(name, f"{len(a)} and {len(b)} rows"))
    rows = max(1, SLAB_BYTES // max(_row_bytes(a), 1))
    if a.chunks:
        rows = max(a.chunks[0], rows // a.chunks[0] * a.chunks[0])
    differing, place = 0, ""
    for start in range(0, min(len(a), len(b)), rows):
        stop = min(start + rows, len(a), len(b))
        here, there = a[start:stop], b[start:stop]
        if table:
            here, there = versions.upgraded(name, here), versions.upgraded(name, there)
        if here.tobytes() == there.tobytes():
            continue
        wrong = np.flatnonzero((_bytes(here) != _bytes(there)).any(axis=1))
        if not differing:
            index = int(wrong[0])
            place = f"row {start + index}{_fields(here[index], there[index])}"
        differing += len(wrong)
    if differing:
        found.append(Difference(name, f"{differing} rows differ, the first at {place}"))
    return found


def _row_bytes(dataset: h5py.Dataset) -> int:
    return int(dataset.dtype.itemsize * np.prod(dataset.shape[1:], dtype=np.int64))


def _bytes(rows: NDArray[Any]) -> NDArray[np.uint8]:
    """Each row as its bytes: NaN is equal to NaN, and -0 is not 0."""
    rows = np.ascontiguousarray(rows)
    return rows.view(np.uint8).reshape(len(rows), -1)


def _fields(a: Any, b: Any) -> str:
    if a.dtype.names is None:
        return ""
    names = [name for name in a.dtype.names if a[name].tobytes() != b[name].tobytes()]
    return ", " + ", ".join(f"{name} {_short(a[name].item())} and {_short(b[name].item())}" for name in names)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 120 else f"{text[:117]}..."
