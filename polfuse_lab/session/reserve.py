"""Room on the disk for what is about to be written, taken before HDF5 begins to write it.

After a write that failed for want of room, HDF5 no longer knows which of its cached blocks are in the file: what had
not been flushed reads as zeros later. So room is taken first, and a full disk is noticed while the file is sound.
"""

from __future__ import annotations

import ctypes
import errno
import os
import sys
from pathlib import Path

import h5py

STEP_BYTES = 16 << 20
"""Room is taken in steps of at least so much."""
SLACK_BYTES = 256 << 10
"""Beyond the data: for the index of chunks and new chunks of tables."""
_KEEP_SIZE = 1
_UNSUPPORTED = (errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL, errno.ENODEV)


class Reserve:
    """Blocks behind the end of an open HDF5 file, whose length stays (Linux; elsewhere the free space is looked at).

    Args:
        file: the file, open for writing.
        path: its name, for the free space where blocks cannot be taken.
    """

    def __init__(self, file: h5py.File, path: Path) -> None:
        self._file = file
        self._path = path
        self._handle: int = file.id.get_vfd_handle()
        self._fallocate = _fallocate()
        self._until = 0

    def take(self, data_bytes: int) -> None:
        """Take room for so much data, and what it needs besides.

        Raises:
            OSError: there is none; nothing has been written.
        """
        # The length that HDF5 has given out, part of which may still be in its cache.
        end = self._file.id.get_filesize() + data_bytes + data_bytes // 16 + SLACK_BYTES
        if end <= self._until:
            return
        if self._fallocate is None:
            self._look(end)
            return
        size = os.fstat(self._handle).st_size
        wanted = (end + STEP_BYTES, end)
        for until in wanted:
            if self._fallocate(self._handle, _KEEP_SIZE, size, until - size) == 0:
                self._until = until
                return
        number = ctypes.get_errno()
        if number not in _UNSUPPORTED:
            raise OSError(number, os.strerror(number))
        self._fallocate = None
        self._look(end)

    def give_back(self, handle: int) -> None:
        """Free what is behind the end of the file, once HDF5 has closed it. Never raises.

        Args:
            handle: another one of the same file, still open.
        """
        if self._until:
            try:
                os.ftruncate(handle, os.fstat(handle).st_size)
            except OSError:
                return

    def _look(self, end: int) -> None:
        """Where blocks cannot be taken: compare with the free space, as of now."""
        from polfuse_lab.session.space import free_bytes

        if free_bytes(self._path) < end - os.fstat(self._handle).st_size:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _fallocate() -> ctypes._NamedFuncPointer | None:
    """The system's fallocate(2); None where there is none."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        function = ctypes.CDLL(None, use_errno=True).fallocate64
    except (OSError, AttributeError):
        return None
    function.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_int64, ctypes.c_int64)
    function.restype = ctypes.c_int
    return function
