"""Height maps and pictures of a chessboard as files, and what the commands make of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from benchmarks.boards import CAMERA, CORNERS, picture_of, poses
from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.camera_lens import calibrate_lens, with_lens
from polfuse_lab.products.heights_file import height_map
from polfuse_lab.rig.examples import write_examples

X, Y = np.array([-4.0, 0.0, 4.0]), np.array([3.0, 8.0, 9.0, 12.0])
HEIGHTS = np.arange(12.0).reshape(4, 3) / 10 - 1.5
"""In rig coordinates: the plane of the tests is z = -1.5."""


def test_both_formats_tell_the_same(tmp_path: Path) -> None:
    sd = np.repeat([[0.1], [0.2], [0.3], [0.4]], 3, 1)
    np.savez(tmp_path / "h.npz", x_m=X, y_m=Y, height_m=HEIGHTS, sd_m=sd)
    lines = [",".join(map(str, ["", *X])), *(",".join(map(str, [y, *row])) for y, row in zip(Y, HEIGHTS, strict=True))]
    (tmp_path / "h.csv").write_text("\n".join(lines))
    for name in ("h.npz", "h.csv"):
        found = height_map(tmp_path / name, -1.5)
        # Half way between 0.3 and 0.6 over the plane in y, at the first column.
        assert found.at(-4.0, 8.5) == pytest.approx(0.45)
        assert found.sd_at(0.0, 9.0) == pytest.approx(0.3 if name == "h.npz" else np.nan, nan_ok=True)


@pytest.mark.parametrize(
    ("name", "text"),
    [("h.tif", "II*"), ("h.csv", ",1\n2,0.5\n"), ("h.npz", "no archive"), ("none.npz", None)],
)
def test_files_that_are_no_height_map_are_told(tmp_path: Path, name: str, text: str | None) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(PolfuseError, match="holds no map of heights"):
        height_map(tmp_path / name, 0.0)
    np.savez(tmp_path / "sd.npz", x_m=X, y_m=Y, height_m=HEIGHTS, sd_m=[0.1])
    with pytest.raises(PolfuseError, match="shape"):
        height_map(tmp_path / "sd.npz", 0.0)


@pytest.fixture(scope="module")
def boards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four pictures of a board, of half the sensor's size so that they are drawn soon, and one of a wall."""
    folder = tmp_path_factory.mktemp("boards")
    random = np.random.default_rng(4)
    for number, pose in enumerate(poses(4, seed=1)):
        picture = np.clip(picture_of(*pose, random, SMALL), 0, 1)
        if number == 0:
            Image.fromarray(np.round(255 * picture).astype(np.uint8)).save(folder / "0.png")
        elif number == 1:
            Image.fromarray(np.round(60_000 * picture).astype(np.uint16)).save(folder / "1.tif")
        else:
            np.save(folder / f"{number}.npy", picture)
    np.save(folder / "wall.npy", random.normal(0.5, 0.01, SMALL.shape))
    (folder / "notes.txt").write_text("8 mm lens")
    return folder


SMALL = replace(CAMERA, pixel_pitch_m=16.6e-6, width_px=391, height_px=291, principal_offset_px=(3.0, -2.0))


def test_a_folder_of_boards_becomes_a_lens(boards: Path, tmp_path: Path) -> None:
    rig = write_examples(tmp_path / "rig")["rig"]
    lens = tmp_path / "camera.h5"
    words = ["optics", str(boards), "-o", str(lens), "--as", "camera", "--board", "6x9", "--rig", str(rig), "--json"]
    run = CliRunner().invoke(build(), words)
    assert run.exit_code == 0, run.stderr
    told = json.loads(run.stdout)
    assert (told["pictures"], told["without_board"]) == (4, ["wall.npy"])
    # Four boards of half-size pictures: within 4 of the fit's own standard deviations of the true lens.
    true = [SMALL.focal_length_px, *SMALL.principal_offset_px, *SMALL.distortion]
    found = [told["focal_length_px"], *told["principal_offset_px"], *told["distortion"]]
    sds = [told["focal_length_sd_px"], *told["principal_offset_sd_px"], *told["distortion_sd"]]
    assert np.all(np.abs(np.subtract(found, true)) < 4 * np.asarray(sds))
    assert told["rms_px"] < 0.1
    # Lines of the rig file are what it takes: 8.3 um pixels there.
    assert told["rig_lines"][0] == f"focal_length_m = {told['focal_length_px'] * 8.3e-6:.7f}"
    # Where pictures are looked at, the lens is the found one and the place the rig's.
    there = replace(SMALL, position_m=(0.1, 0.2, 0.3), distortion=(0.0,) * 4)
    seen = with_lens(there, lens)
    assert seen.position_m == (0.1, 0.2, 0.3)
    assert seen.focal_length_px == pytest.approx(told["focal_length_px"])
    assert seen.distortion == tuple(told["distortion"])
    with pytest.raises(PolfuseError, match="391 x 291 pixels"):
        with_lens(CAMERA, lens)


def test_pictures_without_a_board_are_named_in_one_sentence(boards: Path, tmp_path: Path) -> None:
    words = ["optics", str(boards), "-o", str(tmp_path / "c.h5"), "--as", "camera", "--board", "7x9"]
    run = CliRunner().invoke(build(), words)
    assert run.exit_code == 1
    last = run.stderr.strip().splitlines()[-1]
    assert "7 x 9 inner corners was found in 0 of 5 pictures (not in 0.png, 1.tif, 2.npy, 3.npy, wall.npy)" in last
    assert "count the corners" in last
    assert not (tmp_path / "c.h5").exists()
    assert CliRunner().invoke(build(), [*words[:-1], "seven"]).exit_code == 2
    (tmp_path / "empty").mkdir()
    with pytest.raises(PolfuseError, match="holds no pictures"):
        calibrate_lens(tmp_path / "empty", tmp_path / "c.h5", *CORNERS)
    with pytest.raises(PolfuseError, match="is no folder"):
        calibrate_lens(tmp_path / "c.h5", tmp_path / "c.h5", *CORNERS)
    np.save(tmp_path / "empty" / "a.npy", np.zeros((50, 60)))
    np.save(tmp_path / "empty" / "b.npy", np.zeros((60, 50)))
    with pytest.raises(PolfuseError, match="is 50 x 60 pixels"):
        calibrate_lens(tmp_path / "empty", tmp_path / "c.h5", *CORNERS)
    (tmp_path / "empty" / "b.npy").unlink()
    (tmp_path / "empty" / "c.png").write_bytes(b"no picture")
    with pytest.raises(PolfuseError, match="cannot be read as a picture"):
        calibrate_lens(tmp_path / "empty", tmp_path / "c.h5", *CORNERS)
