"""Sessions focused in tiles: the same product, whatever the tiles, interruptions and limits."""

import errno
import json
import os
import subprocess
import sys

import h5py
import numpy as np
import pytest
from scale_session import GRID, uneven_session
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus import default_grid, focus
from polfuse_lab.products.growing import JOURNAL, GrowingStages, partial_path
from polfuse_lab.products.store import Products
from polfuse_lab.scale.focus_tiles import Scale
from polfuse_lab.session import open_session
from processing.errors import DataError
from processing.sar.grid import ImageGrid


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    return uneven_session(tmp_path_factory.mktemp("rail") / "rail.h5")


@pytest.fixture(scope="module")
def grid(session):
    with open_session(session) as opened:
        return default_grid(opened, **GRID)


@pytest.fixture(scope="module")
def one_piece(session, grid, tmp_path_factory):
    return focus(session, tmp_path_factory.mktemp("one") / "one.h5", grid=grid, method="bp")


def assert_same_product(one, other):
    a, b = Products(one), Products(other)
    assert a.stages() == b.stages()
    for stage in ("ranging", "focus"):
        # Over every byte of every array.
        assert a.provenance(stage)["sha256"] == b.provenance(stage)["sha256"]
        assert a.settings(stage) == b.settings(stage)
        assert a.units(stage) == b.units(stage)


@pytest.mark.parametrize("tile", [16, 48, None])
def test_the_product_is_that_of_one_piece(session, grid, one_piece, tmp_path, tile):
    made = focus(session, tmp_path / "p.h5", grid=grid, method="bp", scale=Scale(tile=tile))
    assert_same_product(one_piece.products, made.products)
    np.testing.assert_array_equal(made.image, one_piece.image)
    assert repr(made.peaks) == repr(one_piece.peaks)
    assert made.warnings == one_piece.warnings
    assert [item.name for item in tmp_path.iterdir()] == ["p.h5"]


class Stop:
    """A listener that ends the run as Ctrl-C does, once so many tiles are done."""

    def __init__(self, after):
        self.after, self.seen = after, []

    def __call__(self, told):
        self.seen.append(told)
        if told.what == "tiles" and told.done >= self.after:
            raise KeyboardInterrupt


def test_an_interrupted_run_goes_on_where_it_stopped(session, grid, one_piece, tmp_path):
    path = tmp_path / "p.h5"
    Products(path).write("optics", {"dolp": np.ones(3)}, settings={}, inputs=[], units={})
    with pytest.raises(KeyboardInterrupt):
        focus(session, path, grid=grid, method="bp", scale=Scale(tile=48, listener=Stop(1)))
    # What was there before is untouched, and a lock is left to nobody.
    assert Products(path).stages() == ["optics"]
    assert sorted(item.name for item in tmp_path.iterdir()) == ["p.h5", "p.h5.tiles"]
    again = Stop(99)
    focus(session, path, grid=grid, method="bp", scale=Scale(tile=48, listener=again))
    assert [told.what for told in again.seen] == ["tiles"] * len(again.seen)
    assert again.seen[0].done == 2
    assert not partial_path(path).exists()
    # The stages that were there are kept beside the new ones.
    assert sorted(Products(path).stages()) == ["focus", "optics", "ranging"]
    assert Products(path).provenance("focus")["sha256"] == Products(one_piece.products).provenance("focus")["sha256"]
    with h5py.File(path) as file:
        assert JOURNAL not in file


def test_torn_tiles_are_formed_again(session, grid, one_piece, tmp_path):
    path = tmp_path / "p.h5"
    with pytest.raises(KeyboardInterrupt):
        focus(session, path, grid=grid, method="bp", scale=Scale(tile=48, listener=Stop(1)))
    with h5py.File(partial_path(path), "r+") as file:
        file["focus/arrays/image"][2, 5, 5] = 7
    again = Stop(99)
    focus(session, path, grid=grid, method="bp", scale=Scale(tile=48, listener=again))
    assert again.seen[0].done == 1
    assert_same_product(one_piece.products, path)


@pytest.mark.parametrize("left", ["other settings", "garbage"])
def test_what_another_run_left_is_not_mixed_in(session, grid, one_piece, tmp_path, left):
    path = tmp_path / "p.h5"
    if left == "garbage":
        partial_path(path).write_bytes(b"no HDF5" * 1000)
    else:
        with pytest.raises(KeyboardInterrupt):
            focus(session, path, grid=grid, method="bp", window="taylor", scale=Scale(tile=48, listener=Stop(1)))
    focus(session, path, grid=grid, method="bp", scale=Scale(tile=48))
    assert_same_product(one_piece.products, path)


FILLING = """
import resource, signal, sys
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.growing import Growing, GrowingStages
from pathlib import Path
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000))
try:
    GrowingStages(Path(sys.argv[1]), {}, {"focus/image": Growing((1000, 1000), "f4")}, {"tiles": 4})
except PolfuseError as error:
    print(error)
    sys.exit(3)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits of file sizes")
def test_a_disk_that_fills_up_at_the_start_is_told_and_nothing_is_left(tmp_path):
    # A limit of the file's size (EFBIG) stands for the full disk, though the system had said that there was room.
    done = subprocess.run(
        [sys.executable, "-c", FILLING, str(tmp_path / "p.h5")], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 3, done.stderr
    assert "the disk is full" in done.stdout
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


class _Full:
    """A data set whose disk is full."""

    def __setitem__(self, where, part):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_disk_that_fills_up_later_is_told_and_the_run_can_go_on(session, grid, one_piece, tmp_path, monkeypatch):
    # Where no room can be taken beforehand: the third tile meets the full disk.
    path = tmp_path / "p.h5"
    path.write_bytes(one_piece.products.read_bytes())
    real, written = GrowingStages._dataset, []

    def filling(self, name):
        written.append(name)
        return _Full() if written.count("focus/image") > 2 and name == "focus/image" else real(self, name)

    with monkeypatch.context() as patched:
        patched.setattr(GrowingStages, "_dataset", filling)
        with pytest.raises(PolfuseError, match=r"the disk is full.*run the same command again"):
            focus(session, path, grid=grid, method="bp", window="taylor", scale=Scale(tile=32))
    assert_same_product(one_piece.products, path)
    again = Stop(99)
    made = focus(session, path, grid=grid, method="bp", window="taylor", scale=Scale(tile=32, listener=again))
    assert again.seen[0].done == 3
    assert np.isfinite(made.image[0, 30, 40])


def test_too_little_room_is_told_before_anything_is_written(session, grid, tmp_path, monkeypatch):
    from polfuse_lab.session import space

    monkeypatch.setattr(space, "free_bytes", lambda path: 1000)
    with pytest.raises(PolfuseError, match=r"needs about \d+ MB and the disk has 0 MB left"):
        focus(session, tmp_path / "p.h5", grid=grid, method="bp", scale=Scale(tile=16))
    assert list(tmp_path.iterdir()) == []


def test_limits_and_methods_that_do_not_go_are_told(session, grid, tmp_path):
    path = tmp_path / "p.h5"
    with pytest.raises(PolfuseError, match="10 MB are too little"):
        focus(session, path, grid=grid, scale=Scale(memory_bytes=10_000_000))
    with pytest.raises(DataError, match="tiles of 7 pixels are too small"):
        focus(session, path, grid=grid, scale=Scale(tile=7))
    with pytest.raises(PolfuseError, match="rma works on the whole image"):
        focus(session, path, grid=grid, method="rma", scale=Scale(tile=16))
    with pytest.raises(PolfuseError, match="autofocus looks at the whole image"):
        focus(session, path, grid=grid, autofocus="auto", scale=Scale(tile=16))
    with pytest.raises(DataError, match="empty"):
        focus(session, path, grid=ImageGrid(np.array([1.0, 2.0]), np.zeros(0), -1.0), scale=Scale(tile=16))
    path.write_bytes(b"some other file")
    with pytest.raises(PolfuseError, match="cannot be read as HDF5"):
        focus(session, path, grid=grid, scale=Scale(tile=16))
    assert path.read_bytes() == b"some other file"


def test_one_pixel(session, tmp_path):
    here = ImageGrid(np.array([1.2]), np.array([8.0]), -1.069)
    one = focus(session, tmp_path / "one.h5", grid=here, method="bp")
    made = focus(session, tmp_path / "tiles.h5", grid=here, method="bp", scale=Scale(tile=16))
    np.testing.assert_array_equal(made.image, one.image)


def test_from_the_command_line_with_a_limit_of_memory(session, one_piece, tmp_path):
    path = tmp_path / "p.h5"
    common = ["--x", "-4,4", "--y", "5,17", "--pixel", "0.1,0.2", "--method", "bp", "--json"]
    done = CliRunner().invoke(build(), ["focus", str(session), "-o", str(path), *common, "--memory", "4GB"])
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["pixels"] == one_piece.pixels
    assert_same_product(one_piece.products, path)
    refused = CliRunner().invoke(build(), ["focus", str(session), "-o", str(path), *common, "--memory", "much"])
    assert refused.exit_code == 1
    assert "'much' is no size" in refused.stderr


def test_several_sessions_become_products_in_a_folder(session, one_piece, tmp_path):
    broken = tmp_path / "broken.h5"
    broken.write_bytes(b"nothing")
    common = ["--x", "-4,4", "--y", "5,17", "--pixel", "0.1,0.2", "--method", "bp", "--json"]
    done = CliRunner().invoke(build(), ["focus", str(session), str(broken), "-o", str(tmp_path / "out"), *common])
    assert done.exit_code == 1
    values = json.loads(done.stdout)
    assert values["failed"] == 1
    good, bad = values["sessions"]
    assert os.path.basename(good["products"]) == "rail-products.h5"
    assert bad["error"] in done.stderr
    assert_same_product(one_piece.products, good["products"])
    same = CliRunner().invoke(build(), ["focus", str(session), str(session), "-o", str(tmp_path / "out"), *common])
    assert same.exit_code == 1
    assert "two sessions would be written to rail-products.h5" in same.stderr
