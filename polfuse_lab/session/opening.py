"""Open the HDF5 file of a session: whole, being written, left by a killed writer, cut short or none at all."""

from __future__ import annotations

import os
import struct
import time
from pathlib import Path

import h5py

from polfuse_lab.errors import PolfuseError, first_line
from polfuse_lab.session.naming import partial_path
from polfuse_lab.session.unflagged import SUPERBLOCK_BYTES, Unflagged, is_marked

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
# HDF5 superblock, versions 2 and 3: signature, version, sizes of offsets and lengths, flags, base address, address of
# the extension, end of file.
_SUPERBLOCK = struct.Struct("<8sBBBBQQQ")
_LOOKS, _BETWEEN_S = 10, 0.05
"""How often a file that is being written is looked at, and the pause between: the writer may just be at it."""


def open_file(path: Path, *, left_behind: bool = False) -> h5py.File:
    """Open a file for reading, also while it is written.

    Args:
        path: the file.
        left_behind: nobody writes it any more; damaged blocks are not waited for then.

    Raises:
        PolfuseError: there is no such file, it may not be read, it is cut short or not HDF5.
    """
    if not path.is_file():
        partial = partial_path(path)
        if partial.is_file():
            raise PolfuseError(
                "does not exist, but its .partial does: the collect did not end, or is under way",
                where=str(path),
                advice=f"run 'polfuse recover {partial} -o {path}' once nobody writes it",
            )
        raise PolfuseError("does not exist", where=str(path), advice="check the file's name")
    try:
        marked = _require_whole(path)
        try:
            return h5py.File(path, "r", locking="best-effort")
        except PermissionError:
            raise
        except (OSError, RuntimeError):
            if not marked:
                raise
        # A file that is being written, or was left by a killed writer, carries a mark that only SWMR readers accept.
        if left_behind:
            return h5py.File(Unflagged(path), "r")
        _require_sound(path)
        return h5py.File(path, "r", swmr=True, locking="best-effort")
    except PermissionError as error:
        raise PolfuseError("may not be read", where=str(path), advice="check its permissions") from error
    except (OSError, RuntimeError) as error:
        raise damaged(path, error) from error


def _require_whole(path: Path) -> bool:
    """Refuse a file that is shorter than its superblock says: HDF5 reads zeros, or for ever, beyond its end.

    A writer that was killed leaves a file at least as long (the superblock is written after what it counts). Returns
    whether the file is marked as being written.
    """
    with open(path, "rb") as file:
        start = file.read(SUPERBLOCK_BYTES)
        size = file.seek(0, os.SEEK_END)
    if not start.startswith(_SIGNATURE):
        raise PolfuseError("is not an HDF5 file", where=str(path), advice="check the file's name")
    if len(start) < _SUPERBLOCK.size:
        length = _SUPERBLOCK.size
    else:
        _, version, offset_bytes, _, _, _, _, length = _SUPERBLOCK.unpack_from(start)
        if version not in (2, 3) or offset_bytes != 8:
            return False
    if size < length:
        raise PolfuseError(
            f"is cut short: {size} of at least {length} bytes", where=str(path), advice="use another copy"
        )
    return is_marked(start)


def _require_sound(path: Path) -> None:
    """Refuse a marked file of which something but samples and images is damaged.

    HDF5 has 100 looks at each such block, with growing pauses, since a writer may be at it: minutes for each.
    """
    for look in range(_LOOKS):
        try:
            with h5py.File(Unflagged(path), "r") as file:
                dict(file.attrs)
                for item in file.values():
                    if not isinstance(item, h5py.Dataset):
                        raise OSError("something in it is no dataset")
                    item.id.get_storage_size()  # goes through all that is known of the chunks
                    if item.ndim == 1:
                        item[:]
        except (OSError, RuntimeError, KeyError, ValueError) as error:
            if look == _LOOKS - 1:
                raise OSError(first_line(error).strip("'\"")) from error  # a KeyError's words are in quotes
            time.sleep(_BETWEEN_S)
        else:
            return


def damaged(path: Path, error: Exception) -> PolfuseError:
    """The error for a file of which HDF5 says ``error``."""
    return PolfuseError(
        f"is not a readable HDF5 file ({first_line(error)})",
        where=str(path),
        advice="it may be cut short or not a session; use another copy",
    )
