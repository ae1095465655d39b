"""Join the parts of a collect that was continued in another file into one session."""

from __future__ import annotations

import contextlib
import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session.copying import SessionCopy
from polfuse_lab.session.layout import CONTINUES, PARTS
from polfuse_lab.session.naming import move_without_replacing
from polfuse_lab.session.reader import Session, open_session
from polfuse_lab.session.space import require_free

SAME_BOOT_S = 60.0
"""Host clocks that differ by less from the time of day count the same seconds since the computer was started."""
_SHARED = ("waveform", "sample_rate_hz", "sample_dtype", "audio_channels", "plan_toml")


@dataclass(frozen=True)
class JoinResult:
    """What was joined."""

    records: int
    """Rows of all tables in the new file."""
    lost_records: int
    """Audio records and frames that could not be read from their part."""
    state: str
    """How the last part ended."""
    session: Path
    """The new file."""


def join(parts: Sequence[Path | str], out: Path | str) -> JoinResult:
    """Copy the parts of one collect, in their order, to the new session ``out``; the parts are left as they are.

    The configuration is the first part's, the end the last one's. Where the computer was started anew between two
    parts, the later host times are shifted by the time of day, so that they go on from the earlier ones.

    Raises:
        PolfuseError: a part cannot be read, was never closed, or does not continue the one before it; ``out`` exists,
            or there is no room for it.
    """
    paths, out = [Path(part) for part in parts], Path(out)
    if len(paths) < 2:
        raise PolfuseError("one part is nothing to join", where="join", advice="name all parts in their order")
    if out.exists() or out.is_symlink():
        raise PolfuseError("exists and is never overwritten", where=str(out), advice="choose another name")
    if not out.parent.is_dir():
        raise PolfuseError("the folder does not exist", where=str(out.parent), advice="make it, or check the name")
    unfinished = out.with_name(out.name + ".joining")
    with contextlib.ExitStack() as opened:
        sessions = [opened.enter_context(open_session(path)) for path in paths]
        _check(sessions)
        require_free(out, sum(path.stat().st_size for path in paths))
        try:
            result = _write(sessions, unfinished)
            target = move_without_replacing(unfinished, out)
        except (OSError, RuntimeError) as error:
            raise PolfuseError(
                f"cannot be written ({error})", where=str(out), advice="free some space or write to another disk"
            ) from error
        finally:
            unfinished.unlink(missing_ok=True)
    return JoinResult(*result, sessions[-1].state, target)


def _write(sessions: Sequence[Session], unfinished: Path) -> tuple[int, int]:
    unfinished.unlink(missing_ok=True)
    config = {**sessions[0].config}
    parts = [part for session in sessions for part in _parts(session)]
    config["extra"] = {**config["extra"], PARTS: parts}
    pictured = next((session for session in sessions if "images" in session._file), None)
    with h5py.File(unfinished, "x", libver=("v110", "v110")) as file:
        copy = SessionCopy(file, json.dumps(config).encode(), sessions[0], pictured)
        shifts = [_shift_ns(sessions[0], session) for session in sessions]
        for session, shift_ns in zip(sessions, shifts, strict=True):
            copy.append(session, shift_ns=shift_ns)
        rows = copy.finish(_state(sessions, shifts[-1]))
    return rows, copy.found - copy.copied


def _state(sessions: Sequence[Session], shift_ns: int) -> NDArray[np.void]:
    state: NDArray[np.void] = sessions[-1]._file["state"][:]
    state["samples_lost"] = sum(session.samples_lost for session in sessions)
    state["frames_lost"] = sum(session.frames_lost for session in sessions)
    state["end_host_ns"] += shift_ns
    return state


def _parts(session: Session) -> list[dict[str, Any]]:
    """What a session consists of: itself, or the parts that it was joined from."""
    known: list[dict[str, Any]] | None = session.config["extra"].get(PARTS)
    own = {"session": session.path.name, "started": session.config["started"], "state": session.state,
           "reason": session.reason}  # fmt: skip
    return [own] if known is None else known


def _check(sessions: Sequence[Session]) -> None:
    """Raise :class:`PolfuseError` unless each session continues the one before it."""
    for session in sessions:
        if session.state == "recording":
            raise PolfuseError(
                "was never closed", where=str(session.path), advice="run 'polfuse recover' first, then join its copy"
            )
    for before, after in itertools.pairwise(sessions):
        origin = after.config["extra"].get(CONTINUES)
        if origin is None or origin["started"] != _parts(before)[-1]["started"]:
            known = "is no continuation" if origin is None else f"continues {origin['session']}"
            raise PolfuseError(
                f"{known}, not {before.path.name}", where=str(after.path), advice="name the parts in their order"
            )
        for name in _SHARED:
            if after.config[name] != before.config[name]:
                raise PolfuseError(
                    f"has another {name} than {before.path.name}", where=str(after.path), advice="keep them apart"
                )


def _shift_ns(first: Session, session: Session) -> int:
    """What is added to a session's host times to count on from the first one's."""

    def booted_s(config: dict[str, Any]) -> float:
        return float(config["start_unix_s"]) - float(config["start_host_ns"]) * 1e-9

    later_s = booted_s(session.config) - booted_s(first.config)
    return 0 if abs(later_s) < SAME_BOOT_S else round(later_s * 1e9)
