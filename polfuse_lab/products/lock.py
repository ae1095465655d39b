"""One writer at a time for a file that is replaced as a whole."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from polfuse_lab.errors import PolfuseError


@contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Hold the right to replace ``path``; the lock is a file beside it that ends with its holder, even when killed.

    Raises:
        PolfuseError: somebody else holds it, or the folder cannot be written.
    """
    lock = path.with_name(f"{path.name}.lock")
    try:
        descriptor = _take(lock)
    except BlockingIOError:
        raise PolfuseError(
            "is being written by another program", where=str(path), advice="wait until it has ended and try again"
        ) from None
    except OSError as error:
        raise PolfuseError(
            f"cannot be written ({error.strerror})",
            where=str(path),
            advice="check that the folder exists and may be written",
        ) from error
    try:
        yield
    finally:
        # Removed while still held: whoever waits on the old file notices that its name is gone and takes a new one.
        if sys.platform == "win32":
            os.close(descriptor)
            lock.unlink(missing_ok=True)
        else:
            lock.unlink(missing_ok=True)
            os.close(descriptor)


def _take(lock: Path) -> int:
    for _ in range(20):
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            _lock(descriptor)
            if lock.exists() and os.path.samestat(os.fstat(descriptor), lock.stat()):
                return descriptor
        except OSError:
            os.close(descriptor)
            raise
        os.close(descriptor)
    raise BlockingIOError


if sys.platform == "win32":

    def _lock(descriptor: int) -> None:
        import msvcrt

        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError from error

else:

    def _lock(descriptor: int) -> None:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
