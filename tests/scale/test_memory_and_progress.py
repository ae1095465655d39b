"""Sizes as people write them, limits of memory, and how progress is told."""

import numpy as np
import pytest

from polfuse_lab.errors import PolfuseError
from polfuse_lab.scale.memory import available_bytes, parse_size, resident_bytes
from polfuse_lab.scale.plan import OWN_BYTES, cut
from polfuse_lab.scale.progress import Counter, Progress
from processing.sar.grid import ImageGrid

GRID = ImageGrid(np.arange(5000.0), np.arange(3000.0), 0.0)


@pytest.mark.parametrize(
    ("text", "size"), [("500MB", 500e6), ("1.5 GB", 1.5e9), ("2GiB", 2**31), ("1000000", 1e6), ("3k", 3e3)]
)
def test_sizes(text, size):
    assert parse_size(text) == size


@pytest.mark.parametrize("text", ["", "much", "-1GB", "0", "1.2.3MB", "5 apples", "nan"])
def test_what_is_no_size(text):
    with pytest.raises(PolfuseError, match="is no size"):
        parse_size(text)


def test_tiles_grow_with_the_limit_and_stay_within_it():
    sizes = []
    for extra in (300, 600, 1200):
        limit = resident_bytes() + OWN_BYTES + extra * 1_000_000
        pieces = cut(GRID, 4, 500, memory_bytes=limit)
        rows, columns = pieces.tiles[0].shape
        # A tile of four channels: image 8 bytes and gains 4 bytes of each.
        assert 12 * 4 * rows * columns < limit - resident_bytes()
        sizes.append(rows * columns)
    assert sizes == sorted(sizes)
    with pytest.raises(PolfuseError, match="do not fit into"):
        cut(GRID, 4, 500, memory_bytes=resident_bytes() + OWN_BYTES + 150_000_000, tile=3000)


def test_workers_share_the_tiles():
    assert len(cut(GRID, 1, 500, memory_bytes=None, workers=50).tiles) >= 4 * 50


def test_memory_of_this_machine():
    assert resident_bytes() > 1_000_000
    assert available_bytes() is None or available_bytes() > 1_000_000


def test_progress_is_told_in_words():
    assert str(Progress("tiles", 3, 12, 80.0)) == "3 of 12 tiles (25 %), 1 min 20 s left"
    assert str(Progress("tiles", 12, 12, 0.0)) == "12 of 12 tiles (100 %)"
    assert str(Progress("tiles", 1, 3, 7300.0)) == "1 of 3 tiles (33 %), 2 h 1 min left"


def test_a_counter_tells_the_first_and_the_last_and_not_all_between():
    told = []
    counter = Counter("tiles", 100, told.append, already=10, every_s=60.0)
    for _ in range(90):
        counter.add()
    assert [item.done for item in told] == [11, 100]
