"""Polar images and ground of known height, from Python and from the command line."""

import json

import numpy as np
import pytest
from rail_data import HEIGHT_M, ground
from rail_session import AMPLITUDE, write_session
from typer.testing import CliRunner

from drivers.records import Channel
from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus import focus
from polfuse_lab.products.focus_grids import polar_grid, read_heights
from polfuse_lab.products.store import Products
from polfuse_lab.scale.focus_tiles import Scale
from polfuse_lab.session import open_session
from processing.sar.grid import HeightMapGrid

TARGET = (1.2, 8.0, 0.4)
"""On a hill, 1.5 m above the ground."""
POSITIONS = (np.arange(31) - 15) * 0.0508


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    targets = [(TARGET, np.array([[3, 0], [0, 3]]))]
    return write_session(tmp_path_factory.mktemp("hill") / "hill.h5", targets, POSITIONS, (Channel.HH,))


def write_table(path, x, y, height):
    rows = [",".join(["", *(f"{v:.6f}" for v in x)])]
    rows += [
        ",".join([f"{v:.6f}", *("" if np.isnan(h) else f"{h:.6f}" for h in line)])
        for v, line in zip(y, height, strict=True)
    ]
    path.write_text("\n".join(rows) + "\n")
    return path


def hill(x, y):
    return -HEIGHT_M + (TARGET[2] + HEIGHT_M) * np.exp(-((x - TARGET[0]) ** 2 + (y[:, None] - TARGET[1]) ** 2) / 50)


def polfuse(*arguments):
    made = CliRunner().invoke(build(), ["focus", *map(str, arguments), "--json"])
    assert made.exit_code == 0, made.output
    return json.loads(made.stdout)


def test_heights_put_the_target_where_it_stands(session, tmp_path):
    x, y = np.arange(-1.0, 3.41, 0.1), np.arange(5.0, 11.0, 0.15)
    heights = hill(x, y)
    heights[3, 4] = np.nan
    told = polfuse(session, "-o", tmp_path / "p.h5", "--heights", write_table(tmp_path / "h.csv", x, y, heights))
    stored = Products(tmp_path / "p.h5")
    arrays, settings = stored.read("focus"), stored.settings("focus")
    np.testing.assert_allclose(arrays["height_m"], heights, atol=1e-6)
    assert settings["grid"] == "heights"
    assert settings["heights_m"] == pytest.approx([np.nanmin(heights), np.nanmax(heights)], abs=1e-6)
    assert np.isnan(arrays["image"][0, 3, 4])
    assert arrays["flags"][3, 4] & settings["flags"]["UNDEFINED"]
    # A fifth of a pixel of interpolation; the peak's amplitude is that of the target, its place that on the hill.
    peak = told["peaks"][0]
    assert (peak["x_m"], peak["y_m"]) == pytest.approx(TARGET[:2], abs=0.12)
    flat = focus(session, tmp_path / "flat.h5", grid=ground(x, y))
    # Control: on flat ground the same range lies 0.1 m further away, for 8.1 m of slant range to a place 1.5 m deeper.
    at_target = focus(
        session, tmp_path / "t.h5", grid=HeightMapGrid(*(np.array([v]) for v in TARGET[:2]), np.array([[TARGET[2]]]))
    )
    assert abs(at_target.image[0, 0, 0]) == pytest.approx(3 * AMPLITUDE, rel=0.02)
    assert abs(flat.peaks[0].y_m - TARGET[1]) > abs(peak["y_m"] - TARGET[1])


def test_an_npz_is_as_good_as_a_table(tmp_path):
    x, y = np.arange(0.0, 1.0, 0.25), np.arange(5.0, 6.0, 0.5)
    np.savez(tmp_path / "h.npz", x_m=x, y_m=y, height_m=hill(x, y))
    table = read_heights(write_table(tmp_path / "h.csv", x, y, hill(x, y)))
    packed = read_heights(tmp_path / "h.npz")
    for name in ("x_m", "y_m", "height_m"):
        np.testing.assert_allclose(getattr(table, name), getattr(packed, name), atol=1e-6)


def test_polar_images_have_a_stage_of_their_own(session, tmp_path):
    out = tmp_path / "p.h5"
    plane = polfuse(session, "-o", out, "--x", "-3,5", "--y", "4,14")
    polar = polfuse(session, "-o", out, "--x", "-3,5", "--y", "4,14", "--grid", "polar")
    stored = Products(out)
    arrays, settings = stored.read("focus_polar"), stored.settings("focus_polar")
    assert arrays["image"].shape[1:] == (len(arrays["range_m"]), len(arrays["angle_rad"]))
    assert settings["grid"] == "polar"
    # Cross-range cells grow with range: far fewer pixels for the same ground.
    assert polar["pixels"] < plane["pixels"]
    # The same place as in x and y; both images lie 1.5 m below the target.
    for name in ("x_m", "y_m"):
        assert polar["peaks"][0][name] == pytest.approx(plane["peaks"][0][name], abs=0.15)
    assert "focus" in stored.stages()
    # A pixel of the polar image is that of an image in x and y at its place.
    row, column = 20, 15
    away = np.sqrt(arrays["range_m"][row] ** 2 - HEIGHT_M**2)
    here = ground([away * np.sin(arrays["angle_rad"][column])], [away * np.cos(arrays["angle_rad"][column])])
    alone = focus(session, tmp_path / "one.h5", grid=here, method="bp", oversampling=settings["oversampling"])
    assert arrays["image"][0, row, column] == pytest.approx(alone.image[0, 0, 0], rel=1e-3)


def test_grids_that_cannot_be_are_refused(session, tmp_path):
    with open_session(session) as opened, pytest.raises(PolfuseError, match="positive sizes"):
        polar_grid(opened, step=(0.0, 1.0))
    with open_session(session) as opened:
        grid = polar_grid(opened)
    with pytest.raises(PolfuseError, match="one piece"):
        focus(session, tmp_path / "p.h5", grid=grid, scale=Scale())
    for text in ("", "x,1\n2", ",1,2\n5,a,3\n", ",2,1\n5,0,0\n", ",1,2\n5,nan,nan\n", ",1,2\n5,0,inf\n"):
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(PolfuseError, match=r"bad\.csv"):
            read_heights(tmp_path / "bad.csv")
    (tmp_path / "bad.npz").write_bytes(b"PK nothing")
    for name in ("bad.npz", "missing.csv"):
        with pytest.raises(PolfuseError, match="heights"):
            read_heights(tmp_path / name)
    refused = CliRunner().invoke(build(), ["focus", str(session), "-o", str(tmp_path / "p.h5"), "--grid", "round"])
    assert refused.exit_code == 2
