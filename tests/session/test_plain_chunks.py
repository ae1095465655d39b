"""A writer that is behind stores chunks without compression; what is read is the same, to the last bit.

Expected values: the records themselves; the filter mask is HDF5's (bit 0: the first filter was left out).
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from session_records import config, exposure, sweeps

from polfuse_lab.engine import recorder
from polfuse_lab.engine.recorder import WriterProcess
from polfuse_lab.session import open_session
from polfuse_lab.session.writer import SessionWriter


def masks(path: Path, name: str) -> list[int]:
    with h5py.File(path, "r") as file:
        chunks = file[name].id
        return [chunks.get_chunk_info(i).filter_mask for i in range(chunks.get_num_chunks())]


def check(path: Path, count: int, frames: int) -> None:
    with open_session(path) as session:
        for number in range(count):
            expected = sweeps(number, frames).block.samples
            np.testing.assert_array_equal(session.audio(number), expected)
            np.testing.assert_array_equal(session.frame(number), exposure(number).frame.image)


@pytest.mark.parametrize("frames", [500, 499, 501, 1])
def test_plain_and_compressed_records_read_the_same(path: Path, frames: int) -> None:
    with SessionWriter.create(path, config()) as writer:
        for number in range(6):
            writer.write(sweeps(number, frames), plain=number % 2 == 0)
            writer.write(exposure(number), plain=number % 3 == 0)
    check(path, 6, frames)
    assert masks(path, "images") == [1, 0, 0, 1, 0, 0]
    assert set(masks(path, "audio")) == {0, 1}


def test_plain_records_survive_a_writer_that_is_killed(path: Path) -> None:
    from polfuse_lab.session import recover

    writer = WriterProcess(path)
    writer.open(config())
    for number in range(4):
        assert writer.offer(sweeps(number))
        assert writer.offer(exposure(number))
    ticket = writer.flush()
    while not writer.flushed(ticket):
        pass
    writer.kill()
    saved = path.with_name("saved.h5")
    recover(path.with_name(path.name + ".partial"), saved)
    check(saved, 4, 500)


def test_the_writer_hurries_when_its_queue_fills(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder, "HURRY_BYTES", -1)  # always behind
    writer = WriterProcess(path)
    writer.open(config())
    for number in range(3):
        assert writer.offer(sweeps(number))
        assert writer.offer(exposure(number))
    writer.close("finished", "")
    check(path, 3, 500)
    assert masks(path, "images") == [1, 1, 1]
    assert set(masks(path, "audio")) == {1}


def test_a_writer_that_keeps_up_compresses(path: Path) -> None:
    writer = WriterProcess(path)
    writer.open(config())
    for number in range(3):
        assert writer.offer(exposure(number))
    writer.close("finished", "")
    assert masks(path, "images") == [0, 0, 0]
