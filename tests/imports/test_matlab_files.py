"""MATLAB files that SciPy wrote, whole and damaged: what it reads is read, and no byte ends more than the reading."""

from __future__ import annotations

import io
import random
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.matlab import read_matlab

TYPES = ("f8", "f4", "c16", "c8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")


def written(path: Path, values: dict[str, Any], **options: Any) -> Path:
    scipy.io.savemat(path, values, **options)
    return path


@settings(max_examples=60)
@given(
    hnp.arrays(st.sampled_from(TYPES), hnp.array_shapes(min_dims=2, max_dims=4, min_side=0, max_side=5)),
    st.booleans(),
)
def test_numbers_come_as_scipy_wrote_them(tmp_path_factory, values, compressed):
    path = written(
        tmp_path_factory.mktemp("mat") / "a.mat",
        {"values": values, "inner": {"deep": {"values": values}, "one": 2.5}},
        do_compression=compressed,
    )
    found = read_matlab(path)
    assert set(found) == {"values", "inner"}
    for read in (found["values"], found["inner"]["deep"]["values"]):
        # What MATLAB has no class for (complex integers among them) does not come up here.
        assert read.dtype == values.dtype
        np.testing.assert_array_equal(read, values)
    np.testing.assert_array_equal(found["inner"]["one"], [[2.5]])


def test_what_is_no_number_is_left_out(tmp_path):
    cells = np.empty((1, 2), dtype=object)
    cells[:] = 1.0
    path = written(tmp_path / "a.mat", {"text": "words", "cells": cells, "n": 3, "none": np.empty((0, 4))})
    found = read_matlab(path)
    assert (found["text"], found["cells"]) == (None, None)
    np.testing.assert_array_equal(found["n"], [[3]])
    assert found["none"].shape == (0, 4)


def element(kind: int, content: bytes, order: str = "<") -> bytes:
    return struct.pack(order + "II", kind, len(content)) + content + bytes(-len(content) % 8)


def numbers(order: str, kind: int = 6, stored: tuple[int, bytes] = (1, b"\x01\xff"), shape: tuple[int, ...] = (1, 2)):
    return element(
        14,
        element(6, struct.pack(order + "II", kind, 0), order)
        + element(5, struct.pack(f"{order}{len(shape)}i", *shape), order)
        + element(1, b"x", order)
        + element(*stored, order),
        order,
    )


def header(order: str) -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(order + "H", 0x0100) + (b"IM" if order == "<" else b"MI")


@pytest.mark.parametrize("order", ["<", ">"])
def test_numbers_are_stored_in_any_type_and_order(tmp_path, order):
    path = tmp_path / "a.mat"
    path.write_bytes(header(order) + numbers(order))
    # A double array whose values fit into int8 (type 1): 1 and -1.
    np.testing.assert_array_equal(read_matlab(path)["x"], [[1.0, -1.0]])
    assert read_matlab(path)["x"].dtype == np.float64


def nested(levels: int) -> bytes:
    inner = b""
    for _ in range(levels):
        inner = element(
            14,
            element(6, struct.pack("<II", 2, 0))
            + element(5, struct.pack("<2i", 1, 1))
            + element(1, b"x")
            + element(5, struct.pack("<i", 4))
            + element(1, b"abc\0")
            + (inner or element(14, b"")),
        )
    return inner


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no MATLAB file of versions 5 to 7"),
        (b"MATLAB 7.3 MAT-file".ljust(126) + b"IM", "version 7.3"),
        (header("<") + b"\x0e", "ends within an element"),
        (header("<") + struct.pack("<II", 14, 4000), "ends within an element"),
        (header("<") + element(9, bytes(8)), "type 9 where 14 belongs"),
        (header("<") + numbers("<", stored=(33, b"\1\2")), "type 33 where numbers belong"),
        (header("<") + numbers("<", stored=(9, b"\1\2")), "2 bytes for numbers of 8 bytes"),
        (header("<") + numbers("<", shape=(2**30, 2**30, 2**30)), "2 numbers for an array of shape"),
        (header("<") + numbers("<", shape=(-1, -2)), "an array of shape"),
        (header("<") + numbers("<", shape=(2,)), "an array of shape"),
        (header("<") + element(14, element(6, bytes(4))), "without its flags"),
        (header("<") + element(14, element(6, bytes(8))), "lacks a part"),
        (header("<") + struct.pack("<HHI", 14, 7, 0), "7 bytes where 4 have room"),
        (header("<") + element(15, b"no zlib!"), "Error -3"),
        (header("<") + element(15, zlib.compress(numbers("<"))[:-6]), "not whole"),
        (header("<") + nested(25), "too many within one another"),
    ],
)
def test_what_does_not_hold_together_is_told(tmp_path, content, words):
    path = tmp_path / "a.mat"
    path.write_bytes(content)
    with pytest.raises(PolfuseError, match=words):
        read_matlab(path)


def test_a_variable_that_would_fill_the_memory_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr("polfuse_lab.imports.matlab.LARGEST_BYTES", 10_000)
    path = written(tmp_path / "a.mat", {"zeros": np.zeros(4000)}, do_compression=True)
    with pytest.raises(PolfuseError, match="beyond 1 GiB"):
        read_matlab(path)


@pytest.mark.parametrize("compressed", [False, True])
def test_any_wrong_byte_is_an_error_or_read(tmp_path, compressed):
    """20,000 files of which each has one wrong byte; SciPy's reader ended the process at 1 of 100 of them."""
    whole = io.BytesIO()
    inner = {"fp": np.ones((8, 8), np.complex64), "freq": np.arange(8.0), "af": {"r": np.zeros(8)}, "text": "words"}
    scipy.io.savemat(whole, {"data": inner}, do_compression=compressed)
    raw, path = whole.getvalue(), tmp_path / "a.mat"
    rng = random.Random(1)
    refusals = []
    for _ in range(20_000):
        damaged = bytearray(raw)
        damaged[rng.randrange(len(raw))] = rng.randrange(256)
        path.write_bytes(damaged[: rng.randrange(len(raw))] if rng.random() < 0.1 else damaged)
        try:
            read_matlab(path)
        except PolfuseError as error:
            refusals.append(str(error))
    assert len(refusals) > 1000
    assert all("a.mat" in words for words in refusals)
    assert max(map(len, refusals)) < 400


def test_what_cannot_be_opened_is_told(tmp_path):
    with pytest.raises(PolfuseError, match="cannot be read"):
        read_matlab(tmp_path / "missing.mat")
