"""Newest data in memory-mapped rings: nothing torn, nobody waits, nothing is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from polfuse_lab.live import Board, LiveView
from polfuse_lab.live.ring import META_BYTES, RingReader, RingWriter


@settings(max_examples=40, deadline=None)
@given(
    array=arrays.arrays(
        dtype=st.sampled_from([np.uint8, np.uint16, np.int16, np.float32, np.float64, np.complex64]),
        shape=arrays.array_shapes(min_dims=1, max_dims=3, max_side=7),
        elements=st.just(1),
    ),
    values=st.dictionaries(st.text(max_size=8), st.one_of(st.integers(-9, 9), st.text(max_size=9), st.booleans())),
)
def test_what_is_put_is_what_is_read(tmp_path_factory, array, values):
    # Any array and any values come back as they were put: the ring adds nothing.
    folder = tmp_path_factory.mktemp("ring")
    board = Board(folder)
    array = (array * np.arange(1, array.size + 1).reshape(array.shape)).astype(array.dtype)
    board.put("a", {"one": array, "two": array.T}, t_sample_ns=7, units={"one": "m"}, values=values)
    with LiveView(folder) as view:
        item = view.newest("a")
    assert item.number == 1
    assert item.t_sample_ns == 7
    assert item.values == values
    assert item.units == {"one": "m"}
    np.testing.assert_array_equal(item.arrays["one"], array)
    np.testing.assert_array_equal(item.arrays["two"], array.T)
    assert item.arrays["one"].dtype == array.dtype
    board.close()


def test_items_come_in_order_as_far_as_the_ring_reaches_back(tmp_path):
    board, view = Board(tmp_path), LiveView(tmp_path)
    assert view.newest("a") is None
    assert view.since("a", 0) == []
    for number in range(1, 11):
        board.put("a", {"x": np.full(3, number)}, t_sample_ns=number, slots=6)
    # Six slots, of which the one after the newest is the next to be written: five can be read.
    assert [item.number for item in view.since("a", 0)] == [6, 7, 8, 9, 10]
    assert [item.number for item in view.since("a", 8)] == [9, 10]
    assert [item.number for item in view.since("a", 0, most=2)] == [9, 10]
    assert view.newest("a", after=10) is None
    assert view.newest("a", after=9).number == 10
    assert view.streams() == ("a",)
    board.close()
    view.close()


def test_a_larger_item_gets_a_larger_ring_and_numbers_go_on(tmp_path):
    board, view = Board(tmp_path), LiveView(tmp_path)
    board.put("a", {"x": np.zeros(4)}, t_sample_ns=1)
    assert view.newest("a").number == 1
    board.put("a", {"x": np.arange(5000.0)}, t_sample_ns=2)
    item = view.newest("a", after=1)
    assert item.number == 2
    np.testing.assert_array_equal(item.arrays["x"], np.arange(5000.0))
    board.close()
    # After the end what was shown last can still be read, and by those who come later too.
    assert view.newest("a").number == 2
    with LiveView(tmp_path) as late:
        assert late.newest("a").number == 2
    view.close()


def test_a_board_that_is_begun_anew_goes_on_with_the_numbers(tmp_path):
    first, view = Board(tmp_path), LiveView(tmp_path)
    for _ in range(3):
        first.put("a", {}, t_sample_ns=1)
    assert view.newest("a").number == 3
    # The writer dies here: nothing is closed or told.
    second = Board(tmp_path)
    second.put("a", {}, t_sample_ns=2)
    item = view.newest("a", after=3)
    assert item is not None
    assert (item.number, item.t_sample_ns) == (4, 2)
    second.close()
    view.close()


def test_nothing_that_is_read_is_torn(tmp_path):
    # Every element of an item is its number: a mixture of two items would show.
    board, view = Board(tmp_path), LiveView(tmp_path)
    board.put("a", {"x": np.zeros(20_000, np.int64)}, t_sample_ns=0, slots=2)
    end = time.monotonic() + 1.0
    written = [0]

    def write() -> None:
        number = 1
        while time.monotonic() < end:
            number += 1
            board.put("a", {"x": np.full(20_000, number)}, t_sample_ns=number, values={"n": number})
        written[0] = number

    writer = threading.Thread(target=write)
    writer.start()
    read = 0
    last = 1
    while writer.is_alive():
        item = view.newest("a", after=last)
        if item is None:
            continue
        assert item.number > last
        last = item.number
        assert (item.arrays["x"] == item.number).all()
        assert item.values["n"] == item.t_sample_ns == item.number
        read += 1
    writer.join()
    assert read >= 3
    assert written[0] >= read
    board.close()
    view.close()


READER = """
import sys, time
from pathlib import Path
from polfuse_lab.live import LiveView
view = LiveView(Path(sys.argv[1]))
print(view.newest("a").number, flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(os.name != "posix", reason="kills a process")
def test_a_reader_that_is_killed_leaves_nothing_behind(tmp_path):
    board = Board(tmp_path)
    board.put("a", {"x": np.ones(100)}, t_sample_ns=1)
    before = sorted(path.name for path in tmp_path.rglob("*"))
    shared = set(Path("/dev/shm").glob("*")) if Path("/dev/shm").is_dir() else set()
    reader = subprocess.Popen([sys.executable, "-c", READER, str(tmp_path)], stdout=subprocess.PIPE)
    assert reader.stdout is not None
    assert reader.stdout.readline() == b"1\n"
    reader.send_signal(signal.SIGKILL)
    reader.wait(10)
    reader.stdout.close()
    assert sorted(path.name for path in tmp_path.rglob("*")) == before
    assert not [path for path in set(Path("/dev/shm").glob("*")) - shared if path.name.startswith("psm_")]
    assert board.put("a", {"x": np.ones(100)}, t_sample_ns=2) == 2
    board.close()


def test_what_is_no_ring_is_refused(tmp_path):
    path = tmp_path / "a.ring"
    for content in (b"", b"x" * 63, b"x" * 64, b"x" * 5000):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="no ring"):
            RingReader(path)
    (tmp_path / "live").mkdir()
    path.rename(tmp_path / "live" / "a~1.ring")
    with LiveView(tmp_path) as view:
        assert view.newest("a") is None


def test_what_does_not_fit_is_refused_and_harms_nothing(tmp_path):
    writer = RingWriter(tmp_path / "a.ring", 1000, 2)
    writer.put({"x": np.arange(100.0)}, {}, {}, 1)
    with pytest.raises(ValueError, match="does not fit"):
        writer.put({"x": np.arange(1000.0)}, {}, {}, 2)
    with pytest.raises(ValueError, match="does not fit"):
        writer.put({}, {}, {"words": "w" * META_BYTES}, 2)
    reader = RingReader(tmp_path / "a.ring")
    assert reader.newest_number == 1
    np.testing.assert_array_equal(reader.get(1).arrays["x"], np.arange(100.0))
    assert reader.get(2) is None
    reader.close()
    writer.close()
