"""A session whose first blocks are damaged is refused at once, marked as being written or not."""

from __future__ import annotations

import random
import struct
import time
from pathlib import Path

import pytest
from session_records import config, sweeps

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import SessionWriter, open_session

SUPERBLOCK = 48
_ROOT = struct.Struct("<Q")
"""Where the root group begins, at byte 36 of a superblock of version 3 (HDF5 File Format, II.A)."""


def copies(path: Path) -> dict[str, bytes]:
    """A session while it is written, which HDF5 marks at byte 11, and the same when it is closed."""
    writer = SessionWriter.create(path, config(frame_shape=None))
    writer.write(sweeps(0))
    writer.flush()
    written = writer.partial.read_bytes()
    writer.close()
    return {"marked": written, "closed": path.read_bytes()}


@pytest.mark.parametrize("kind", ["marked", "closed"])
def test_damage_at_the_beginning_is_told_at_once(path: Path, kind: str) -> None:
    whole = copies(path)[kind]
    assert bool(whole[11]) == (kind == "marked")
    (root,) = _ROOT.unpack_from(whole, 36)
    copy, rng = path.with_name("copy.h5"), random.Random(5)
    copy.write_bytes(whole)
    with open_session(copy) as session:
        assert len(session.sweeps) == 1
    # The signature, version and sizes have errors of their own; the mark itself belongs to what is damaged here.
    for at in [44, *(rng.randrange(36, SUPERBLOCK) for _ in range(2)), *(root + rng.randrange(30) for _ in range(3))]:
        damaged = bytearray(whole)
        damaged[at] ^= 1 << rng.randrange(8)
        copy.write_bytes(damaged)
        began = time.monotonic()
        with pytest.raises(PolfuseError, match="use another copy"):
            open_session(copy)
        # Half a second is waited for a living writer, and HDF5's own hundred looks take minutes.
        assert time.monotonic() - began < 10


def test_a_wrong_mark_is_no_reason_to_wait(path: Path) -> None:
    closed = bytearray(copies(path)["closed"])
    closed[11] = 5
    path.write_bytes(closed)
    with pytest.raises(PolfuseError, match="use another copy"):
        open_session(path)
