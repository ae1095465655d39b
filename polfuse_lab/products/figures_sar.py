"""Pictures of focusing: the channels' magnitudes on the ground, the Pauli composite, and range along the rail."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from polfuse_lab.products import style
from polfuse_lab.products.figures_fusion import pauli_rgb
from polfuse_lab.products.store import Products
from processing.polarimetry.pauli import pauli_vector
from processing.sar.quality import Peak

Arrays = dict[str, NDArray[Any]]
QUAD = ("HH", "HV", "VH", "VV")
SPAN_DB = 40.0
"""From the brightest to the darkest colour, dB."""
FLIGHT_SPAN_DB = 55.0
"""The same of images from the air, in which corner reflectors stand far above all else."""


def draw_all(products: Products, path: Path | str) -> list[Path]:
    """Draw every picture of a focused products file.

    Args:
        products: file with stages "ranging" and "focus".
        path: where the magnitudes go; the others stand beside it with suffixes ``_range`` and (all four channels
            present) ``_pauli``.

    Returns:
        Paths, the magnitudes first.
    """
    path = Path(path)
    image, settings = products.read("focus"), products.settings("focus")
    channels = tuple(str(name) for name in settings["channels"])
    ranging = products.read("ranging")
    # A flight's profiles begin at ranges of their own, and have no place along a rail.
    if "start_m" in ranging:
        figures = {"": magnitude_figure(image, channels, span_db=FLIGHT_SPAN_DB)}
        for panel in figures[""].axes[: len(channels)]:
            panel.set(xlabel="x [m]", ylabel="y [m]")
            panel.label_outer()
    else:
        figures = {"": magnitude_figure(image, channels), "_range": rail_figure(ranging, channels)}
    if set(QUAD) <= set(channels):
        figures["_pauli"] = pauli_figure(image, channels)
    return [
        style.save(figure, path.with_name(f"{path.stem}{suffix}{path.suffix}")) for suffix, figure in figures.items()
    ]


def magnitude_figure(
    focus: Arrays, channels: tuple[str, ...], *, peaks: list[Peak] | None = None, span_db: float = SPAN_DB
) -> Figure:
    """Magnitude of every channel in dB below the brightest pixel of all, on the ground; circles mark ``peaks``."""
    image, x, y = focus["image"], focus["x_m"], focus["y_m"]
    columns = 1 if len(channels) == 1 else 2
    rows = -(-len(channels) // columns)
    tall = (y[-1] - y[0]) / max(x[-1] - x[0], 1e-9)
    figure = style.new_figure(8.0, 1.2 + rows * min(max(6.1 / columns * tall + 0.25, 1.6), 7.0), title="Focused image")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    reference = float(np.nanmax(np.abs(image))) if np.isfinite(image).any() else 1.0
    picture = None
    for index, panel in enumerate(axes.ravel()):
        if index >= len(channels):
            panel.set_visible(False)
            continue
        picture = style.db_image(panel, image[index] / (reference or 1.0), x, y, span_db=span_db, top_db=0.0)
        style.panel(panel, channels[index])
        style.metres(panel)
        panel.label_outer()
        for peak in peaks or []:
            panel.plot(peak.x_m, peak.y_m, "o", markersize=9, fillstyle="none", color="white", markeredgewidth=1)
    assert picture is not None
    style.colour_bar(picture, list(axes.ravel()), "magnitude, dB below the brightest pixel", extend="min")
    return figure


def pauli_figure(focus: Arrays, channels: tuple[str, ...]) -> Figure:
    """Pauli composite of the image as focused (not calibrated): |HH-VV| red, |HV| green, |HH+VV| blue."""
    by_name = dict(zip(channels, focus["image"], strict=True))
    cross = 0.5 * (by_name["HV"] + by_name["VH"])
    x, y = focus["x_m"], focus["y_m"]
    tall = (y[-1] - y[0]) / max(x[-1] - x[0], 1e-9)
    figure = style.new_figure(6.4, 1.4 + min(max(5.4 * tall, 2.0), 8.0), title="Pauli composite, not calibrated")
    axes = figure.add_subplot()
    style.image(axes, pauli_rgb(pauli_vector(by_name["HH"], cross, by_name["VV"])), x, y)
    style.metres(axes)
    names = {"red": "|HH−VV| even bounce", "lime": "|HV| cross", "blue": "|HH+VV| odd bounce"}
    figure.legend(
        handles=[Patch(color=colour, label=name) for colour, name in names.items()],
        loc="outside lower center",
        ncols=3,
        fontsize="small",
        frameon=False,
    )
    return figure


def rail_figure(ranging: Arrays, channels: tuple[str, ...]) -> Figure:
    """Range profiles along the rail, dB below the strongest channel's maximum; positions a channel misses are grey."""
    profiles, range_m = ranging["profiles"], ranging["range_m"]
    x = ranging["antenna_m"][:, 0]
    columns = min(len(channels), 4)
    rows = -(-len(channels) // columns)
    figure = style.new_figure(2.0 + 2.2 * columns, 0.9 + 4.0 * rows, title="Range profiles along the rail")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    picture = None
    edges_x, edges_r = _edges(x), _edges(range_m)
    top = float(np.nanmax(np.abs(profiles))) if np.isfinite(profiles).any() else 0.0
    for index, panel in enumerate(axes.ravel()):
        if index >= len(channels):
            panel.set_visible(False)
            continue
        values = style.decibels(profiles[index], reference=top or 1.0)
        picture = panel.pcolormesh(
            edges_x, edges_r, values.T, cmap=style.colour_map(style.SEQUENTIAL), vmin=-SPAN_DB, vmax=0.0,
            rasterized=True,
        )  # fmt: skip
        panel.set_facecolor(style.UNDEFINED)
        style.panel(panel, channels[index])
        panel.set_xlabel("antenna x [m]")
        panel.set_ylabel("range [m]")
        panel.label_outer()
    assert picture is not None
    style.colour_bar(picture, list(axes.ravel()), "dB below the maximum", extend="min")
    return figure


def _edges(centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Borders of the cells around (not necessarily even) centres."""
    if len(centres) == 1:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    middles = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[1.5 * centres[0] - 0.5 * centres[1]], middles, [1.5 * centres[-1] - 0.5 * centres[-2]]])
