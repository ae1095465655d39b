"""Files that a user brings, with wrong bytes anywhere: read, or refused in a sentence that names the file."""

from __future__ import annotations

import io
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmarks.fuzzing import mutated
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.camera_lens import _picture
from polfuse_lab.products.focus_grids import read_heights
from polfuse_lab.products.motion_history import _read
from polfuse_lab.products.store import Products

# NumPy leaves archives open that it cannot read.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")

COUNTS = (np.arange(30 * 40) % 4096).reshape(30, 40)


def archive(**arrays: object) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def numpy_file() -> bytes:
    file = io.BytesIO()
    np.save(file, COUNTS.astype(np.uint16))
    return file.getvalue()


def picture(kind: str) -> bytes:
    file = io.BytesIO()
    Image.fromarray(COUNTS.astype(np.uint8)).save(file, kind)
    return file.getvalue()


HEIGHTS = archive(x_m=np.arange(5.0), y_m=np.arange(4.0), height_m=np.zeros((4, 5)), sd_m=np.ones((4, 5)))
FLIGHT = archive(
    time_s=np.arange(4.0), echoes=np.ones((4, 8), complex), antenna_m=np.zeros((4, 3)), reference_m=1.0, first_hz=9e9,
    step_hz=1e6, beamwidth_rad=0.1, z_m=0.0,
)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "content", "read"),
    [
        ("heights.npz", HEIGHTS, read_heights),
        ("flight.npz", FLIGHT, _read),
        ("board.npy", numpy_file(), _picture),
        ("board.png", picture("PNG"), _picture),
        ("board.tif", picture("TIFF"), _picture),
    ],
)
def test_wrong_bytes_are_refused_in_words(
    tmp_path: Path, name: str, content: bytes, read: Callable[[Path], object]
) -> None:
    path, chance = tmp_path / name, random.Random(9)
    path.write_bytes(content)
    read(path)
    refusals = []
    for _ in range(3000):
        path.write_bytes(mutated(chance, (content,)))
        try:
            read(path)
        except PolfuseError as error:
            refusals.append(str(error))
    assert len(refusals) > 300
    assert all(name in words for words in refusals)


def test_damage_of_a_products_file_is_told_with_its_stage(tmp_path: Path) -> None:
    path = tmp_path / "products.h5"
    values = {"values": np.arange(3000.0)}
    for stage in ("focus", "optics"):
        Products(path).write(stage, values, settings={"method": stage * 40}, inputs=[], units={})
    content = path.read_bytes()
    for stage in ("focus", "optics"):
        at = content.index(b'{"method": "' + stage.encode())
        for wrong in (b"\xff", b"\0", b"["):
            path.write_bytes(content[:at] + wrong + content[at + 1 :])
            with pytest.raises(PolfuseError, match=f"its stage '{stage}' cannot be read .*use another copy"):
                Products(path).settings(stage)
            np.testing.assert_array_equal(Products(path).read(stage)["values"], values["values"])
