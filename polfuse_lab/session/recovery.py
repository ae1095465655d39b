"""Rescue a session that was left by a crash: copy every whole record into a clean file."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import layout
from polfuse_lab.session.naming import move_without_replacing
from polfuse_lab.session.reader import Session, open_session
from polfuse_lab.session.space import ballast_path, in_use, require_free

STALL_S = 60.0
"""Longest that reading one record may take; what is left by a crash can make HDF5 search for ever."""


@dataclass(frozen=True)
class RecoverResult:
    """What was rescued."""

    recovered_records: int
    """Audio records, frames and table rows in the new file."""
    lost_records: int
    """Rows whose data never reached the old file or cannot be read from it."""
    session: Path
    """The new file."""


def recover(partial: Path | str, out: Path | str) -> RecoverResult:
    """Copy every whole record of ``partial`` to the new session ``out``.

    The damaged file is read by a process of its own, since what is left by a crash can end its reader.

    Raises:
        PolfuseError: ``partial`` cannot be read, is still being written, or ``out`` exists.
    """
    partial, out = Path(partial), Path(out)
    if out.exists() or out.is_symlink():
        raise PolfuseError("exists and is never overwritten", where=str(out), advice="choose another name")
    if not partial.is_file():
        raise PolfuseError("does not exist", where=str(partial), advice="check the file's name")
    if not out.parent.is_dir():
        raise PolfuseError("the folder does not exist", where=str(out.parent), advice="make it, or check the name")
    require_free(out, partial.stat().st_size)
    answer = _in_a_process(partial, out)
    if isinstance(answer, RecoverResult):
        if partial.suffix == ".partial":
            ballast_path(partial.with_suffix("")).unlink(missing_ok=True)
        return answer
    raise answer


def _in_a_process(partial: Path, out: Path) -> RecoverResult | PolfuseError:
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_work, args=(partial, out, sender), daemon=True)
    child.start()
    sender.close()
    what = "ended the reader"
    try:
        while receiver.poll(STALL_S):
            kind, *values = receiver.recv()
            if kind == "done":
                return RecoverResult(*values)
            if kind == "error":
                return PolfuseError(values[0], where=values[1], advice=values[2])
        what = f"did not come forward for {STALL_S:.0f} s"
    except EOFError:
        pass
    finally:
        receiver.close()
        child.join(1.0)
        if child.is_alive():
            child.kill()
            child.join(5.0)
        if not out.exists():
            _unfinished(out).unlink(missing_ok=True)
    return PolfuseError(
        f"is damaged so badly that reading it {what}",
        where=str(partial),
        advice="use another copy",
    )


def _work(partial: Path, out: Path, sender: Any) -> None:
    try:
        result = copy_whole_records(partial, out, on_record=lambda: sender.send(("alive",)))
        sender.send(("done", result.recovered_records, result.lost_records, result.session))
    except PolfuseError as error:
        sender.send(("error", error.what, error.where, error.advice))
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        sender.send(("error", f"cannot be recovered ({error})", str(partial), "use another copy"))


def _unfinished(out: Path) -> Path:
    return out.with_name(out.name + ".recovering")


def copy_whole_records(partial: Path, out: Path, on_record: Callable[[], None] = lambda: None) -> RecoverResult:
    """The copy itself, in the calling process; ``on_record`` is called for each record. Raises as :func:`recover`."""
    _refuse_while_written(partial)
    unfinished = _unfinished(out)
    unfinished.unlink(missing_ok=True)
    try:
        with open_session(partial) as session, h5py.File(unfinished, "x", libver=("v110", "v110")) as file:
            kept = _copy(session, file, on_record)
            recovered = sum(len(file[name]) for name in layout.TABLES)
            lost = session.missing_records + sum(count - good for count, good in kept)
        target = move_without_replacing(unfinished, out)
    finally:
        unfinished.unlink(missing_ok=True)
    return RecoverResult(recovered, lost, target)


def _refuse_while_written(partial: Path) -> None:
    if partial.suffix == ".partial" and in_use(ballast_path(partial.with_suffix(""))):
        raise PolfuseError(
            "is still being written", where=str(partial), advice="wait until the collect has ended, or abort it"
        )


def _copy(session: Session, file: h5py.File, on_record: Callable[[], None]) -> list[tuple[int, int]]:
    """Copy configuration, tables, audio and images; return (rows found, rows copied) of the two with data."""
    source = session._file
    file.attrs["schema"] = layout.SCHEMA
    # Tables are read, and so written, in the present layout whatever the version of the partial file.
    file.attrs["version"] = layout.VERSION
    file.create_dataset("config", data=source["config"][:])
    for name in layout.TABLES:
        if name not in ("sweeps", "frames"):
            _table(file, name, getattr(session, name))
    counts = [_copy_audio(session, file, on_record), _copy_images(session, file, on_record)]
    state = source["state"][:]
    if bytes(state["state"][0]) == b"recording":
        state["state"] = b"engine lost"
        state["reason"] = b"recovered from a file that was never closed"
        state["samples_lost"] = int(file["sweeps"]["lost"].sum())
        state["frames_lost"] = int(file["frames"]["lost_before"].sum() + file["frames"]["incomplete"].sum())
    file.create_dataset("state", data=state)
    return counts


def _copy_audio(session: Session, file: h5py.File, on_record: Callable[[], None]) -> tuple[int, int]:
    old = session._file["audio"]
    new = layout.declare_audio(file, old.shape[1], old.dtype.name, old.chunks[0])
    chunk = new.chunks[0]
    rows = []
    for index, row in enumerate(session.sweeps):
        on_record()
        try:
            samples = session.audio(index)
        except PolfuseError:
            continue
        first = -(-new.shape[0] // chunk) * chunk
        new.resize(first + len(samples), axis=0)
        new[first:] = samples
        copied = row.copy()
        copied["first_sample"] = first
        rows.append(copied)
    _table(file, "sweeps", np.array(rows, dtype=layout.SWEEPS))
    return len(session.sweeps), len(rows)


def _copy_images(session: Session, file: h5py.File, on_record: Callable[[], None]) -> tuple[int, int]:
    rows: list[np.void] = []
    if "images" in session._file:
        old = session._file["images"]
        new = layout.declare_images(file, old.shape[1:], old.dtype.name)
        for index, row in enumerate(session.frames):
            on_record()
            try:
                image = session.frame(index)
            except PolfuseError:
                continue
            new.resize(len(rows) + 1, axis=0)
            new[len(rows)] = image
            rows.append(row)
    _table(file, "frames", np.array(rows, dtype=layout.FRAMES))
    return len(session.frames), len(rows)


def _table(file: h5py.File, name: str, rows: np.ndarray[Any, Any]) -> None:
    dataset = layout.declare_table(file, name)
    dataset.resize(len(rows), axis=0)
    dataset[:] = rows
