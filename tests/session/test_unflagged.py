"""Files of killed writers, read without waiting for them."""

from __future__ import annotations

import struct
import time

import h5py
import numpy as np
import pytest
from session_records import clock, config, exposure, sweeps

from polfuse_lab.session import SessionWriter, open_session, recover
from polfuse_lab.session.unflagged import Unflagged, checksum, unflagged


def left_by_a_killed_writer(path):
    """A copy of a file that is being written."""
    writer = SessionWriter.create(path, config())
    for number in range(12):
        writer.write(sweeps(number))
        writer.write(exposure(number))
        writer.write(clock(number))
    writer.flush()
    copy = path.with_name("copy.h5.partial")
    copy.write_bytes(writer.partial.read_bytes())
    writer.close()
    return copy


def test_checksum_is_that_of_hdf5():
    # The example of Bob Jenkins' lookup3.c (driver5): hashlittle("Four score and seven years ago", 30, 0).
    assert checksum(b"Four score and seven years ago") == 0x17770551


def test_flag_is_taken_off_and_the_rest_stays(path):
    copy = left_by_a_killed_writer(path)
    content = copy.read_bytes()
    # HDF5's own checksum of the flagged superblock, and of the one that it wrote when it closed the file.
    for start in (content[:48], path.read_bytes()[:48]):
        assert checksum(start[:44]) == struct.unpack("<I", start[44:])[0]
    assert content[11] != 0
    assert unflagged(content[:48])[11] == 0
    assert unflagged(path.read_bytes()[:48]) == path.read_bytes()[:48]
    broken = bytes([*content[:20], content[20] ^ 1, *content[21:48]])
    assert unflagged(broken) == broken
    with pytest.raises(OSError, match="already open"):
        h5py.File(copy, "r")
    with h5py.File(Unflagged(copy), "r") as file:
        assert file["sweeps"].shape == (12,)
    assert copy.read_bytes() == content


def test_a_damaged_index_does_not_hold_up_the_rescue(path):
    copy = left_by_a_killed_writer(path)
    whole = copy.read_bytes()
    # The index of a dataset's chunks is an extensible array, whose block of indices begins with "EAIB": the audio's.
    for place in (place for place in range(len(whole)) if whole.startswith(b"EAIB", place)):
        content = bytearray(whole)
        content[place + 20] ^= 0xFF
        copy.write_bytes(content)
        with h5py.File(Unflagged(copy), "r") as file:
            try:
                file["audio"][:1]
            except OSError:
                break
    else:
        pytest.fail("the audio has no such index")
    began = time.monotonic()
    rescued = recover(copy, path.with_name("out.h5"))
    # Beside a living writer, HDF5 would try a hundred times for each record.
    assert time.monotonic() - began < 30
    with open_session(rescued.session) as session:
        assert rescued.lost_records + len(session.sweeps) + len(session.frames) == 24
        for index, row in enumerate(session.sweeps):
            number = int(row["t_host_ns"]) // 100_000_000
            np.testing.assert_array_equal(session.audio(index), sweeps(number).block.samples)
