"""Room on the disk: asked for before, watched during, and a reserve that lets a full disk's file close cleanly."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import shutil
from pathlib import Path
from typing import BinaryIO

from polfuse_lab.errors import PolfuseError, first_line

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

MEGABYTE = 1_000_000
_ERRNO = re.compile(r"errno = (\d+)")


def free_bytes(path: Path) -> int:
    """Bytes that an ordinary user may still write to the file system that holds ``path``."""
    return shutil.disk_usage(path if path.is_dir() else path.parent).free


def require_free(path: Path, needed: int) -> None:
    """Check that ``needed`` bytes can be written beside ``path``.

    Raises:
        PolfuseError: there are fewer; says how many.
    """
    free = free_bytes(path)
    if free < needed:
        raise PolfuseError(
            f"needs about {needed / MEGABYTE:.0f} MB and the disk has {free / MEGABYTE:.0f} MB left",
            where=str(path),
            advice="free some space or write to another disk",
        )


def explain(error: BaseException) -> str:
    """What the system said, in its own words; HDF5 wraps it in lines of detail."""
    told = _ERRNO.search(str(error))
    if told is None:
        return first_line(error)
    return os.strerror(int(told[1]))


def is_disk_full(error: BaseException) -> bool:
    """Whether an error of h5py means that the disk (or quota) is full; HDF5 tells it in its text only."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return True
    text = str(error).lower()
    return any(f"errno = {number}" in text for number in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)) or (
        "no space left" in text or "quota exceeded" in text
    )


class Ballast:
    """A file of random bytes beside the session, deleted when the disk is full so that the session can be closed.

    While it is held it is locked, which tells others that the session's writer lives.
    """

    def __init__(self, path: Path, size: int) -> None:
        self.path = path
        self._size = size
        self._file: BinaryIO | None = None

    def take(self) -> None:
        """Write the file. Raises :class:`PolfuseError` where there is no room for it, or another writer holds it."""
        try:
            # Not emptied before it is locked: another's may be there.
            handle = os.open(self.path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
            self._file = os.fdopen(handle, "wb")  # held, and locked, as long as the session is written
            if not _lock(self._file):
                self._file.close()
                self._file = None
                raise PolfuseError(
                    "another collect is writing it", where=str(self.path), advice="choose another name for the session"
                )
            self._file.truncate(0)
            # Random bytes: a file system that compresses or leaves holes must hold them all the same.
            left = self._size
            while left > 0:
                left -= self._file.write(os.urandom(min(left, 1 << 20)))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            self.free()
            raise PolfuseError(
                f"cannot be written ({error.strerror})",
                where=str(self.path),
                advice="free some space, check permissions, or write to another disk",
            ) from error

    def free(self) -> None:
        """Delete the file. Idempotent; never raises."""
        if self._file is None:
            return
        file, self._file = self._file, None
        # While it is still locked, so that nobody takes it over in between; else after that.
        deleted = self._delete()
        with contextlib.suppress(OSError):
            file.close()
        if not deleted:
            self._delete()

    def _delete(self) -> bool:
        try:
            self.path.unlink(missing_ok=True)
        except OSError:
            return False
        return True


def ballast_path(session: Path) -> Path:
    """Where the ballast of a session is."""
    return session.with_name(f".{session.name}.ballast")


def in_use(ballast: Path) -> bool:
    """Whether the writer of the session with this ballast lives (always False where files cannot be locked)."""
    if fcntl is None or not ballast.is_file():
        return False
    with open(ballast, "rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            return False
    return False


def _lock(file: BinaryIO) -> bool:
    """Lock for as long as it is open; False when another process holds it."""
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            # A file system without locks: the writer goes unannounced, and nothing else suffers.
            return True
    return True
