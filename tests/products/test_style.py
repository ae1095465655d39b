"""Figures: their numbers, their axes, and that the same content gives the same bytes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products import style


def draw() -> Figure:
    figure = style.new_figure(title="A peak")
    axes = figure.add_subplot()
    picture = style.db_image(axes, np.array([[1.0, 10.0], [0.0, np.nan]]), np.array([0.0, 1.0]), np.array([3.0, 5.0]))
    style.metres(axes)
    style.colour_bar(picture, axes, "RCS [dBsm]")
    return figure


def test_decibels_of_amplitudes() -> None:
    # 20 log10: an amplitude of 10 is 20 dB; zero has no logarithm and is undefined, not minus infinity.
    np.testing.assert_array_equal(style.decibels([1.0, 10.0, 0.0, np.nan]), [0.0, 20.0, np.nan, np.nan])
    np.testing.assert_allclose(style.decibels(3 + 4j, reference=5.0), 0.0, atol=1e-12)


def test_axes_lie_at_pixel_centres() -> None:
    axes = draw().axes[0]
    # Pixels are 1 m x 2 m around x = 0, 1 and y = 3, 5.
    assert list(axes.images[0].get_extent()) == [-0.5, 1.5, 2.0, 6.0]
    assert axes.get_aspect() == 1.0
    assert axes.images[0].get_clim() == (-30.0, 20.0)
    assert "[m]" in axes.get_xlabel()


def test_undefined_pixels_are_grey() -> None:
    shown = draw().axes[0].images[0]
    assert shown.to_rgba(np.ma.masked_invalid([[np.nan]]))[0, 0, :3].tolist() == [float(style.UNDEFINED)] * 3


def test_an_image_without_any_defined_pixel_is_drawn() -> None:
    axes = style.new_figure().add_subplot()
    assert style.db_image(axes, np.full((2, 2), np.nan)).get_clim() == (-50.0, 0.0)


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_same_picture_same_bytes(tmp_path: Path, suffix: str) -> None:
    first = style.save(draw(), tmp_path / f"a.{suffix}")
    second = style.save(draw(), tmp_path / f"b.{suffix}")
    assert first.read_bytes() == second.read_bytes()


def test_pyplot_stays_out() -> None:
    code = "import sys, polfuse_lab.products.style as s; s.new_figure(); sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


def test_figures_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(PolfuseError, match=r"cannot be '\.bmp'.*\.png"):
        style.save(draw(), tmp_path / "a.bmp")
    (tmp_path / "file").write_text("")
    with pytest.raises(PolfuseError, match="cannot be written"):
        style.save(draw(), tmp_path / "file" / "a.png")
