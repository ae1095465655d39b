"""Damage within stored samples and frames is told, whatever filter they went through, and ends no process."""

from __future__ import annotations

import random
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from session_records import config, exposure, sweeps

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import SessionWriter, open_session, recover
from polfuse_lab.session.checksum import fletcher32
from polfuse_lab.session.filters import FILTERS


def by_definition(data: bytes) -> int:
    """Both sums word by word, folded after each, as HDF5's file format has it."""
    first = second = 0
    for at in range(0, len(data), 2):
        first += data[at] << 8 | (data[at + 1] if at + 1 < len(data) else 0)
        first = (first & 0xFFFF) + (first >> 16)
        second += first
        second = (second & 0xFFFF) + (second >> 16)
    return second << 16 | first


@given(st.binary(max_size=5000), st.sampled_from([1, 7]))
def test_the_checksum_is_that_of_the_definition(data: bytes, repeats: int) -> None:
    assert fletcher32(data * repeats) == by_definition(data * repeats)


@pytest.mark.parametrize("size", [0, 1, 2, 2047, 2048, 262_143, 262_144, 262_145, 600_001])
@pytest.mark.parametrize("byte", [0, 255, None])
def test_at_the_edges_of_what_is_summed_at_once(size: int, byte: int | None) -> None:
    data = random.Random(size).randbytes(size) if byte is None else bytes([byte]) * size
    assert fletcher32(data) == by_definition(data)


def test_it_is_what_hdf5_stores() -> None:
    values = np.random.default_rng(2).integers(0, 4096, (211, 97), dtype=np.uint16)
    with h5py.File("a", "w", driver="core", backing_store=False) as file:
        stored = file.create_dataset("x", data=values, chunks=values.shape, fletcher32=True)
        file.flush()
        _, raw = stored.id.read_direct_chunk((0, 0))
    assert bytes(raw) == values.tobytes() + fletcher32(values).to_bytes(4, "little")


def written(path: Path, stored: str, plain: bool) -> dict[str, list[tuple[int, int]]]:
    """A session of four records and frames; where in the file the chunks of each are: begin and length."""
    with SessionWriter.create(path, config(storage={"filter": stored})) as writer:
        for number in range(4):
            writer.write(sweeps(number), plain=plain)
            writer.write(exposure(number), plain=plain)
    with h5py.File(path) as file:
        found = {}
        for name in ("audio", "images"):
            chunks = file[name].id
            infos = [chunks.get_chunk_info(number) for number in range(chunks.get_num_chunks())]
            found[name] = [(info.byte_offset, info.size) for info in infos]
        return found


@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize("stored", list(FILTERS))
def test_a_wrong_byte_is_told_where_it_is(path: Path, stored: str, plain: bool) -> None:
    chunks = written(path, stored, plain)
    whole, rng = path.read_bytes(), random.Random(3)
    for name, read in (("audio", "audio"), ("images", "frame")):
        for begin, size in chunks[name][:3]:
            for _ in range(40):
                damaged = bytearray(whole)
                for _ in range(rng.choice((1, 1, 8))):
                    damaged[begin + rng.randrange(size)] ^= rng.randrange(1, 256)
                path.write_bytes(damaged)
                with open_session(path) as session:
                    told = 0
                    for number in range(4):
                        try:
                            getattr(session, read)(number)
                        except PolfuseError as error:
                            told += "use another copy" in str(error)
                assert told == 1
    path.write_bytes(whole)


def test_what_is_not_damaged_is_rescued(path: Path) -> None:
    chunks = written(path, "bitshuffle-lz4", False)
    damaged = bytearray(path.read_bytes())
    damaged[chunks["audio"][1][0] + 100] ^= 16
    partial = path.with_name("torn.h5.partial")
    partial.write_bytes(damaged)
    saved = path.with_name("saved.h5")
    recover(partial, saved)
    with open_session(saved) as session:
        assert len(session.frames) == 4
        assert len(session.sweeps) == 3
        for number, original in enumerate((0, 2, 3)):
            np.testing.assert_array_equal(session.audio(number), sweeps(original).block.samples)
