"""Write a session file. In a collect this runs in a process of its own; importers use it directly."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import time
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn

import h5py
import numpy as np
from numpy.typing import NDArray

from drivers.records import ClockFix, PolarizerFix, SwitchState, TrolleyFix
from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import Event, Exposure, Note, Observed, Record, SourceFix, Sweeps
from polfuse_lab.session import layout
from polfuse_lab.session.birth import BOUNDS, declare, write_again
from polfuse_lab.session.growing import GrowingDataset
from polfuse_lab.session.layout import SessionConfig
from polfuse_lab.session.naming import check_free_name, move_without_replacing, partial_path, taken, unborn_path
from polfuse_lab.session.reserve import Reserve
from polfuse_lab.session.space import Ballast, ballast_path, explain, free_bytes, is_disk_full, require_free

MIN_BALLAST_BYTES = 2_000_000
REMEMBERED_BYTES = 256_000_000
"""Records are kept until they are flushed, up to so many bytes."""


class SessionWriter:
    """An open session file. Not thread-safe. Use :meth:`create`."""

    def __init__(self, path: Path, partial: Path, file: h5py.File, ballast: Ballast, config: SessionConfig) -> None:
        self.path = path
        """Name of the file once it is closed cleanly."""
        self.partial = partial
        """Name of the file while it is written."""
        self.samples_lost = 0
        self.frames_lost = 0
        self.records = 0
        self._file: h5py.File | None = file
        self._ballast = ballast
        self._config = config
        self._unflushed: list[Record] | None = []
        self._unflushed_bytes = 0
        self._sound = True
        self._attach(file)
        self._flushed = self._counts()

    def _attach(self, file: h5py.File) -> None:
        self._tables = {name: GrowingDataset(file[name]) for name in layout.TABLES if name in file}
        self._audio = GrowingDataset(file["audio"])
        self._images = GrowingDataset(file["images"]) if "images" in file else None
        self._reserve = Reserve(file, self.partial)

    @classmethod
    def create(
        cls,
        path: Path | str,
        config: SessionConfig,
        *,
        expected_bytes: int = 0,
        ballast_bytes: int | None = None,
    ) -> SessionWriter:
        """Declare every dataset of a new session and begin to write it as ``<path>.partial``.

        Args:
            path: the file's name when it is finished; neither it nor its ``.partial`` may exist.
            config: what is known before the first record.
            expected_bytes: size that the finished file may reach; checked against the free space.
            ballast_bytes: reserve for closing on a full disk; by default four of the largest blocks, at least 2 MB.

        Raises:
            PolfuseError: the file exists, its folder does not, or there is too little room.
        """
        path = Path(path)
        partial = partial_path(path)
        check_free_name(path)
        size = max(MIN_BALLAST_BYTES, 4 * config.largest_block_bytes) if ballast_bytes is None else ballast_bytes
        require_free(path, expected_bytes + size)
        ballast = Ballast(ballast_path(path), size)
        ballast.take()
        try:
            file = declare(unborn_path(path), partial, config)
        except FileExistsError as error:
            ballast.free()
            raise taken(partial) from error
        except (OSError, RuntimeError, PolfuseError) as error:
            ballast.free()
            if isinstance(error, PolfuseError):
                raise
            raise PolfuseError(
                f"cannot be created ({explain(error)})",
                where=str(partial),
                advice="check the folder and its permissions",
            ) from error
        return cls(path, partial, file, ballast, config)

    def write(self, record: Record, *, plain: bool = False) -> None:
        """Append a record. It is safe from a crash of the process once :meth:`flush` has returned.

        Args:
            record: what is written.
            plain: leave out compression, because the writer is behind: twice as fast, and up to twice as large.

        Raises:
            PolfuseError: the disk is full (the session has then been closed cleanly, without this record), the record
                does not fit the session's configuration, or the session is closed.
        """
        self._open_file()
        size = self._size(record)
        try:
            self._reserve.take(size)
        except OSError as error:
            self._fail(error)
        try:
            self._append(record, plain=plain)
        except (OSError, RuntimeError) as error:
            self._sound = False
            self._fail(error)
        self.records += 1
        self._remember(record, size)

    def flush(self, *, durable: bool = False) -> int:
        """Give everything to the operating system, or with ``durable`` to the disk; return the free bytes there.

        Raises:
            PolfuseError: the disk is full, or the file has vanished from its folder; the session has been closed.
        """
        file = self._open_file()
        try:
            file.flush()
            if durable:
                os.fsync(file.id.get_vfd_handle())
        except (OSError, RuntimeError) as error:
            self._sound = False
            self._fail(error)
        self._flushed = self._counts()
        self._unflushed, self._unflushed_bytes = [], 0
        try:
            # Raises where the file has been deleted, or its disk taken away.
            self.partial.stat()
            free = free_bytes(self.partial)
        except OSError as error:
            self._fail(error)
        if free < 2 * self._config.largest_block_bytes:
            # Rather now, in good order, than in the middle of the next record.
            self._fail(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
        return free

    def close(self, state: str = "finished", reason: str = "") -> Path:
        """End the session and give it its final name.

        Args:
            state: ``"finished"``, ``"aborted"``, ``"failed"`` or ``"engine lost"``.
            reason: one sentence.

        Returns:
            The file's name: that asked for, or with a number added where a file of that name has appeared meanwhile.

        Raises:
            PolfuseError: closing failed; the data are in the ``.partial`` file, to be recovered.
        """
        file = self._file
        if file is None:
            return self.path
        self._file = None
        self._ballast.free()
        # Keeps the content when the name has been deleted.
        handle = os.dup(file.id.get_vfd_handle())
        try:
            if not self._sound:
                file = self._written_again(file)
            self._end(file, state, reason)
            self._reserve.give_back(handle)
            if not self.partial.exists():
                write_again(handle, self.partial)
            self.path = move_without_replacing(self.partial, self.path)
        except (OSError, RuntimeError) as error:
            raise PolfuseError(
                f"could not be closed ({explain(error)})",
                where=str(self.partial),
                advice=f"run 'polfuse recover {self.partial} -o NEW.h5', with NEW.h5 on another disk if need be",
            ) from error
        finally:
            os.close(handle)
        return self.path

    def __enter__(self) -> SessionWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        elif self._file is not None:
            self.close("failed", str(error) or kind.__name__ if kind else "")

    def _open_file(self) -> h5py.File:
        if self._file is None:
            raise PolfuseError("is closed", where=str(self.path), advice="write to a new session")
        return self._file

    def _end(self, file: h5py.File, state: str, reason: str) -> None:
        row = np.zeros(1, layout.STATE)
        row["state"] = layout.encode_text(state, 32)
        row["reason"] = layout.encode_text(reason)
        row["end_unix_s"] = time.time()
        row["end_host_ns"] = time.monotonic_ns()
        row["samples_lost"] = self.samples_lost
        row["frames_lost"] = self.frames_lost
        file["state"][:] = row
        file.flush()
        with contextlib.suppress(OSError):
            os.fsync(file.id.get_vfd_handle())
        file.close()

    def _remember(self, record: Record, size: int) -> None:
        """Keep a record until it is flushed; where nobody flushes, none."""
        if self._unflushed is not None:
            self._unflushed.append(record)
            self._unflushed_bytes += size
            if self._unflushed_bytes > REMEMBERED_BYTES:
                self._unflushed = None

    def _counts(self) -> dict[str, int]:
        """Items of each dataset."""
        counts = {name: table.items for name, table in self._tables.items()} | {"audio": self._audio.items}
        return counts if self._images is None else counts | {"images": self._images.items}

    def _size(self, record: Record) -> int:
        """Bytes of what is stored in whole chunks; rows of tables are small."""
        if isinstance(record, Sweeps):
            chunks = -(-len(record.block.samples) // self._audio.chunk)
            return int(chunks * self._audio.chunk * record.block.samples[:1].nbytes)
        return record.frame.image.nbytes if isinstance(record, Exposure) else 0

    def _written_again(self, file: h5py.File) -> h5py.File:
        """Cut off what has not been flushed, and write it again; the file, opened anew.

        After a write that failed, HDF5 does not know which of its cached blocks are in the file: what was not flushed
        would read as zeros. Raises OSError or RuntimeError when this fails as well.
        """
        again = self._cut(file)
        for record in self._unflushed or ():
            try:
                self._reserve.take(self._size(record))
            except OSError:
                break
            try:
                self._append(record)
            except (OSError, RuntimeError):
                return self._cut(again)
        return again

    def _cut(self, file: h5py.File) -> h5py.File:
        """Cut off what has not been flushed; the file, opened anew. Raises OSError or RuntimeError."""
        file.close()
        again = h5py.File(self.partial, "r+", libver=BOUNDS)
        for name, items in self._flushed.items():
            again[name].resize(items, axis=0)
        again.flush()
        self._attach(again)
        self.samples_lost = int(again["sweeps"]["lost"].sum())
        self.frames_lost = int(again["frames"]["lost_before"].sum() + again["frames"]["incomplete"].sum())
        return again

    def _fail(self, error: Exception) -> NoReturn:
        """Close the session without the record that could not be written, and say why. Raises :class:`PolfuseError`."""
        go_on = "go on in another place with 'polfuse collect RIG.toml PLAN.toml --continue {} -o NEW.h5'"
        if is_disk_full(error):
            what = "the disk is full"
        elif isinstance(error, FileNotFoundError):
            what = "the session's file was deleted while it was written, or its disk was taken away"
        else:
            what, go_on = f"writing failed ({explain(error)})", "check the disk, then " + go_on
        try:
            saved = self.close("failed", what)
        except PolfuseError as worse:
            raise PolfuseError(
                f"{what}, and the session {worse.what}", where=worse.where, advice=worse.advice
            ) from error
        raise PolfuseError(
            f"{what}; everything before that is kept in {saved.name}", where=str(saved), advice=go_on.format(saved)
        ) from error

    def _append(self, record: Record, *, plain: bool = False) -> None:
        match record:
            case Sweeps():
                self._append_sweeps(record, plain)
            case Exposure():
                self._append_exposure(record, plain)
            case TrolleyFix() | SwitchState() | PolarizerFix() | SourceFix():
                self._append_fix(record, layout.UNASKED)
            case Observed(state, number):
                self._append_fix(state, number)
            case ClockFix(device, t_device_s, t_host_ns, round_trip_ns):
                self._row("clocks", (layout.encode_text(device, 32), t_device_s, t_host_ns, round_trip_ns))
            case Note(text, t_host_ns):
                for piece in layout.split_text(text):
                    self._row("notes", (piece, t_host_ns))
            case Event(kind, text, t_host_ns):
                self._row("events", (layout.encode_text(kind, 32), layout.encode_text(text), t_host_ns))

    def _append_fix(self, fix: TrolleyFix | SwitchState | PolarizerFix | SourceFix, number: int) -> None:
        match fix:
            case TrolleyFix(x_m, sd_m, moving, t_host_ns, state):
                self._row("trolley", (x_m, sd_m, moving, t_host_ns, layout.encode_text(state, 32), number))
            case SwitchState(transmit, receive, verified, t_host_ns):
                self._row("switches", (transmit.encode(), receive.encode(), verified, t_host_ns, number))
            case PolarizerFix(angle_rad, sd_rad, moving, t_host_ns):
                self._row("polarizer", (angle_rad, sd_rad, moving, t_host_ns, number))
            case SourceFix(PolarizerFix(angle_rad, sd_rad, moving, t_host_ns)):
                self._row("source_polarizer", (angle_rad, sd_rad, moving, t_host_ns, number))

    def _append_sweeps(self, record: Sweeps, plain: bool) -> None:
        block = record.block
        samples = self._checked_samples(block.samples)
        chunk = self._audio.chunk
        # Each record begins at a chunk's first row, so that no compressed chunk is ever written twice.
        first = -(-self._audio.items // chunk) * chunk
        self._audio.append(samples, at=first, plain=plain)
        self._row(
            "sweeps",
            (
                first,
                len(samples),
                int(record.channel),
                record.position,
                record.x_m,
                record.x_sd_m,
                record.sweeps_requested,
                record.attempt,
                block.t_host_ns,
                block.t_device_s,
                block.first_frame,
                block.lost_frames,
                int(record.flags),
            ),
        )
        self.samples_lost += block.lost_frames

    def _append_exposure(self, record: Exposure, plain: bool) -> None:
        frame = record.frame
        if self._images is None:
            raise self._misfit("it was declared without a camera and a frame arrived")
        shape = self._images.shape
        if frame.image.shape != shape or not np.can_cast(frame.image.dtype, self._images.dtype, "safe"):
            raise self._misfit(
                f"a frame of {frame.image.shape} {frame.image.dtype} arrived where {shape} {self._images.dtype}"
                " was declared"
            )
        self._images.append(frame.image[np.newaxis], at=self._tables["frames"].items, plain=plain)
        self._row(
            "frames",
            (
                record.angle_rad,
                record.angle_sd_rad,
                frame.exposure_s,
                frame.gain_db,
                frame.frame_id,
                frame.t_host_ns,
                frame.t_device_s,
                frame.incomplete,
                record.dark,
                frame.lost_before,
                record.attempt,
                math.nan if record.source_angle_rad is None else record.source_angle_rad,
                math.nan if record.source_angle_rad is None else record.source_angle_sd_rad,
                int(record.flags),
            ),
        )
        self.frames_lost += frame.lost_before + int(frame.incomplete)

    def _checked_samples(self, samples: NDArray[np.generic]) -> NDArray[Any]:
        (channels,) = self._audio.shape
        if samples.ndim != 2 or samples.shape[1] != channels or samples.dtype != self._audio.dtype:
            raise self._misfit(
                f"an audio block of {samples.shape} {samples.dtype} arrived where (frames, {channels})"
                f" {self._audio.dtype} was declared"
            )
        return samples

    def _misfit(self, what: str) -> PolfuseError:
        return PolfuseError(what, where=str(self.partial), advice="declare it in the session's configuration")

    def _row(self, table: str, values: tuple[Any, ...]) -> None:
        self._tables[table].append_row(values)
