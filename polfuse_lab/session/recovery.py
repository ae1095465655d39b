"""Rescue a session that was left by a crash: copy every whole record into a clean file."""

from __future__ import annotations

import contextlib
import multiprocessing
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session.copying import SessionCopy
from polfuse_lab.session.naming import move_without_replacing
from polfuse_lab.session.reader import open_session
from polfuse_lab.session.space import ballast_path, in_use, require_free

STALL_S = 60.0
"""Longest that reading one record may take; what is left by a crash can make HDF5 search for ever."""

EXPECTED = (OSError, RuntimeError, KeyError, ValueError, TypeError)
"""What HDF5's reader raises for damaged files, besides our own errors; told as one sentence."""


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
    _refuse_while_written(partial)
    if partial.suffix == ".partial":
        # The dead writer's; on a disk that takes no changes any more it stays.
        with contextlib.suppress(OSError):
            ballast_path(partial.with_suffix("")).unlink(missing_ok=True)
    require_free(out, partial.stat().st_size)
    answer = _in_a_process(partial, out)
    if isinstance(answer, RecoverResult):
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
    except EXPECTED as error:
        sender.send(("error", f"cannot be recovered ({error})", str(partial), "use another copy"))


def _unfinished(out: Path) -> Path:
    return out.with_name(out.name + ".recovering")


def copy_whole_records(partial: Path, out: Path, on_record: Callable[[], None] = lambda: None) -> RecoverResult:
    """The copy itself, in the calling process; ``on_record`` is called for each record. Raises as :func:`recover`."""
    _refuse_while_written(partial)
    unfinished = _unfinished(out)
    unfinished.unlink(missing_ok=True)
    try:
        with (
            open_session(partial, left_behind=True) as session,
            h5py.File(unfinished, "x", libver=("v110", "v110")) as file,
        ):
            source = session._file
            copy = SessionCopy(file, bytes(source["config"][:]), session, session if "images" in source else None)
            copy.append(session, on_record=on_record)
            recovered = copy.finish(_state(source["state"][:], copy))
            lost = session.missing_records + copy.found - copy.copied
        target = move_without_replacing(unfinished, out)
    finally:
        unfinished.unlink(missing_ok=True)
    return RecoverResult(recovered, lost, target)


def _refuse_while_written(partial: Path) -> None:
    if partial.suffix == ".partial" and in_use(ballast_path(partial.with_suffix(""))):
        raise PolfuseError(
            "is still being written", where=str(partial), advice="wait until the collect has ended, or abort it"
        )


def _state(state: NDArray[np.void], copy: SessionCopy) -> NDArray[np.void]:
    """How it ended; of a file that was never closed, that nobody knows."""
    if bytes(state["state"][0]) == b"recording":
        state["state"] = b"engine lost"
        state["reason"] = b"recovered from a file that was never closed"
        state["samples_lost"] = copy.samples_lost
        state["frames_lost"] = copy.frames_lost
    return state
