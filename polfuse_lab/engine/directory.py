"""Private directories of engines: where an engine's request, its address and its socket are."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import msgspec

from polfuse_lab.engine import protocol
from polfuse_lab.errors import PolfuseError

REQUEST = "request"
ADDRESS = "address.json"
TOKEN = "token"
LOG = "engine.log"

_SOCKET_PATH_BYTES = 100
"""A Unix socket's path may have 107 bytes on Linux and 103 on macOS."""


def root() -> Path:
    """Folder of all engines of this user, made with mode 0700. Raises :class:`PolfuseError` where it is another's."""
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and os.access(runtime, os.W_OK):
        base = Path(runtime) / "polfuse-lab"
    else:
        base = Path(tempfile.gettempdir()) / f"polfuse-lab-{_user()}"
    base.mkdir(exist_ok=True, mode=0o700)
    if os.name == "posix":
        about = base.lstat()
        if not stat.S_ISDIR(about.st_mode) or about.st_uid != os.getuid():
            raise PolfuseError(
                "is not a directory of this user", where=str(base), advice="remove it, or set XDG_RUNTIME_DIR"
            )
        if stat.S_IMODE(about.st_mode) & 0o077:
            base.chmod(0o700)
    return base


def make() -> Path:
    """A new, empty, private directory."""
    return Path(tempfile.mkdtemp(prefix="engine-", dir=root()))


def transport(directory: Path) -> str:
    """``"ipc"`` where Unix sockets can be used in ``directory``, else ``"tcp"`` (loopback, guarded by the token)."""
    short = len(os.fsencode(directory / "engine.sock")) <= _SOCKET_PATH_BYTES
    return "ipc" if sys.platform != "win32" and short else "tcp"


def address(directory: Path) -> protocol.Address | None:
    """Where the engine of ``directory`` listens; None while (or when no more) it does not."""
    try:
        return msgspec.json.decode((directory / ADDRESS).read_bytes(), type=protocol.Address)
    except (OSError, msgspec.MsgspecError):
        return None


def running() -> list[Path]:
    """Directories of all engines of this user whose process lives; what dead ones left is removed."""
    found = []
    for directory in sorted(root().glob("engine-*")):
        known = address(directory)
        if known is None:
            continue
        if _alive(known.pid):
            found.append(directory)
        else:
            remove(directory)
    return found


@dataclass(frozen=True)
class EngineInfo:
    """A running engine."""

    directory: Path
    """Its private directory, by which a client attaches."""
    pid: int
    mode: protocol.Mode
    """``"collect"``, ``"bench"`` (set-up mode) or ``"replay"``."""
    rig_name: str
    rig_path: str
    plan_name: str
    """Empty in set-up mode."""
    output: str
    """The session that is written; the one that is played in a replay; empty in set-up mode."""
    since_unix_s: float
    """When it was started, seconds since 1970."""
    devices: tuple[str, ...]
    """What it holds, see :func:`polfuse_lab.engine.claims.claims`."""


def engines() -> list[EngineInfo]:
    """This user's running engines, the oldest first."""
    found = []
    for directory in running():
        known = address(directory)
        if known is not None:
            found.append(
                EngineInfo(
                    directory=directory,
                    pid=known.pid,
                    mode=known.mode,
                    rig_name=known.rig_name,
                    rig_path=known.rig_path,
                    plan_name=known.plan_name,
                    output=known.output,
                    since_unix_s=known.since_unix_s,
                    devices=tuple(known.devices),
                )
            )
    return sorted(found, key=lambda engine: engine.since_unix_s)


def remove(directory: Path) -> None:
    """Remove an engine's directory. Never raises."""
    with contextlib.suppress(OSError):
        shutil.rmtree(directory)


def _alive(pid: int) -> bool:
    if os.name != "posix":
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _user() -> str:
    return str(os.getuid()) if os.name == "posix" else os.environ.get("USERNAME", "user")
