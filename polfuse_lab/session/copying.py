"""Copy records of sessions into a new file, one session after another: for rescuing one and for joining several."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import filters, layout
from polfuse_lab.session.reader import Session

RECORDS_OF = {"trolley": "sweeps", "switches": "sweeps", "polarizer": "frames", "source_polarizer": "frames"}
"""What the ``record`` of each table of fixes counts."""
LOST_RECORD = -2
"""``record`` of a fix taken during a record that could not be copied."""


class SessionCopy:
    """A new session file that records are copied to.

    Args:
        file: the new, empty file.
        config: its configuration, JSON.
        first: has the audio's layout.
        pictured: has the images' layout; None where there are no images.
    """

    def __init__(self, file: h5py.File, config: bytes, first: Session, pictured: Session | None) -> None:
        self.found = 0
        """Audio records and frames that were to be copied."""
        self.copied = 0
        """Those that could be read."""
        self._file = file
        file.attrs["schema"] = layout.SCHEMA
        # Tables are read, and so written, in the present layout whatever the version of the old file.
        file.attrs["version"] = layout.VERSION
        file.create_dataset("config", data=np.frombuffer(config, dtype=np.uint8))
        audio = first._file["audio"]
        stored = str(first.config.get(layout.STORAGE, {}).get("filter", filters.USUAL))
        self._audio = layout.declare_audio(file, audio.shape[1], audio.dtype.name, audio.chunks[0], stored)
        self._images: h5py.Dataset | None = None
        if pictured is not None:
            images = pictured._file["images"]
            self._images = layout.declare_images(file, images.shape[1:], images.dtype.name, stored)
        self._tables = {name: layout.declare_table(file, name) for name in layout.TABLES}

    def append(self, session: Session, *, shift_ns: int = 0, on_record: Callable[[], None] = lambda: None) -> None:
        """Copy every record of a session that can be read; the rows of its tables follow those that are there.

        Args:
            session: where they are taken from.
            shift_ns: added to the host's times, ns.
            on_record: called for each audio record and frame.

        Raises:
            PolfuseError: a table cannot be read.
        """
        moved = {
            "sweeps": self._append_audio(session, shift_ns, on_record),
            "frames": self._append_images(session, shift_ns, on_record),
        }
        for name in layout.TABLES:
            if name in moved:
                continue
            rows = getattr(session, name).copy()
            rows["t_host_ns"] += shift_ns
            if "record" in (rows.dtype.names or ()):
                rows["record"] = _renumbered(rows["record"], moved[RECORDS_OF[name]])
            self._extend(name, rows)

    def finish(self, state: NDArray[np.void]) -> int:
        """Store how the session ended; return the number of rows in all tables."""
        self._file.create_dataset("state", data=state)
        self._file.flush()
        os.fsync(self._file.id.get_vfd_handle())
        return sum(table.shape[0] for table in self._tables.values())

    @property
    def samples_lost(self) -> int:
        """Audio frames known to be lost, by the records."""
        return int(self._tables["sweeps"]["lost"].sum())

    @property
    def frames_lost(self) -> int:
        """Camera frames known to be lost or incomplete, by the records."""
        table = self._tables["frames"]
        return int(table["lost_before"].sum() + table["incomplete"].sum())

    def _append_audio(self, session: Session, shift_ns: int, on_record: Callable[[], None]) -> list[int]:
        chunk = self._audio.chunks[0]

        def put(index: int, row: np.void) -> None:
            samples = session.audio(index)
            first = -(-self._audio.shape[0] // chunk) * chunk
            self._audio.resize(first + len(samples), axis=0)
            self._audio[first:] = samples
            row["first_sample"] = first

        return self._append_each("sweeps", session.sweeps, put, shift_ns, on_record)

    def _append_images(self, session: Session, shift_ns: int, on_record: Callable[[], None]) -> list[int]:
        def put(index: int, row: np.void) -> None:
            image = session.frame(index)
            assert self._images is not None
            number = self._tables["frames"].shape[0]
            self._images.resize(number + 1, axis=0)
            self._images[number] = image

        return self._append_each("frames", session.frames, put, shift_ns, on_record)

    def _append_each(
        self,
        name: str,
        rows: NDArray[np.void],
        put: Callable[[int, np.void], None],
        shift_ns: int,
        on_record: Callable[[], None],
    ) -> list[int]:
        """Copy what each row stands for and then the row; the new number of each, :data:`LOST_RECORD` where none."""
        numbers = []
        for index, old in enumerate(rows):
            on_record()
            row = old.copy()
            row["t_host_ns"] += shift_ns
            self.found += 1
            try:
                put(index, row)
            except PolfuseError:
                numbers.append(LOST_RECORD)
                continue
            self.copied += 1
            numbers.append(self._tables[name].shape[0])
            self._extend(name, np.array([row], dtype=layout.TABLES[name]))
        return numbers

    def _extend(self, name: str, rows: NDArray[Any]) -> None:
        table = self._tables[name]
        start = table.shape[0]
        table.resize(start + len(rows), axis=0)
        table[start:] = rows


def _renumbered(records: NDArray[np.int32], numbers: list[int]) -> NDArray[np.int32]:
    """Numbers of records in the old file as those in the new one; what was asked by a step stays so."""
    table = np.array([*numbers, LOST_RECORD], dtype=np.int32)
    known = (records >= 0) & (records < len(numbers))
    renumbered: NDArray[np.int32] = np.where(
        known, table[np.where(known, records, -1)], np.where(records < 0, records, LOST_RECORD)
    ).astype(np.int32)
    return renumbered
