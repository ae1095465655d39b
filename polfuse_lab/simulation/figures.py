"""One figure of a simulated scene: both eyes' pictures and the truth, on the ground."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from polfuse_lab.products import style
from processing.polarimetry.pauli import display_components, pauli_vector, span
from processing.sar.grid import ImageGrid
from processing.scene.both_eyes import OpticalPicture, RadarPicture
from processing.scene.radar_simulation import MECHANISMS

SPAN_DB = 45.0
"""From the noise to the brightest level shown, dB: folds may be 80 dB above it and would leave the ground black."""
OVER_NOISE = 4.0
"""A mechanism is shown where its span is so many times the noise's."""
MECHANISM_NAMES = {"single": "one bounce", "double": "two or more", "multiple": "volume"}


def both_eyes_figure(
    radar: RadarPicture,
    optics: OpticalPicture,
    grid: ImageGrid,
    kinds: Mapping[str, NDArray[np.bool_]],
    title: str,
) -> Figure:
    """Six panels: Pauli colours, span, strongest mechanism; S0, DOLP, bodies.

    Args:
        radar: the radar's picture.
        optics: the camera's.
        grid: of both.
        kinds: where (ny, nx) each kind of body stands.
        title: of the figure.
    """
    x, y = grid.x_m, grid.y_m
    aspect = float(np.ptp(y)) / float(np.ptp(x))
    height = 2 * (2.65 * float(np.clip(aspect, 0.4, 1.6)) + 0.7) + 0.5
    figure = style.new_figure(12.0, height, title=title)
    figure.set_layout_engine("constrained", w_pad=0.12, h_pad=0.06)
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    hh, hv, vh, vv = radar.channels
    k = pauli_vector(hh, (hv + vh) / 2, vv)
    noise_db = 10 * np.log10(radar.noise)
    low, high = noise_db, noise_db + SPAN_DB
    colours = np.clip((np.nan_to_num(style.decibels(display_components(k)), nan=low) - low) / SPAN_DB, 0, 1)
    style.image(panels[0, 0], np.moveaxis(colours, 0, -1), x, y)
    style.panel(panels[0, 0], "R, G, B = |HH−VV|, |HV|, |HH+VV|")
    level = style.decibels(np.sqrt(span(k)))
    shown = style.image(panels[0, 1], level, x, y, low=low, high=high, colours=style.SEQUENTIAL)
    style.colour_bar(shown, panels[0, 1], "dBsm", extend="both")
    style.panel(panels[0, 1], "Span")
    strongest = np.argmax(radar.powers, axis=0)
    strong = np.max(radar.powers, axis=0) > OVER_NOISE * radar.noise
    names = [MECHANISM_NAMES[name] for name in MECHANISMS]
    _map(panels[0, 2], np.where(strong, strongest, -1), names, x, y, "below noise")
    style.panel(panels[0, 2], "What returns most to the radar")
    top = float(np.nanpercentile(optics.s0, 99.5)) if np.isfinite(optics.s0).any() else 1.0
    shown = style.image(panels[1, 0], optics.s0, x, y, low=0.0, high=top or 1.0, colours="gray")
    style.colour_bar(shown, panels[1, 0], "of white in the sun", extend="max")
    style.panel(panels[1, 0], "S0")
    defined = optics.dolp[np.isfinite(optics.dolp)]
    top = max(0.01, float(np.percentile(defined, 99.5))) if defined.size else 1.0
    shown = style.image(panels[1, 1], optics.dolp, x, y, low=0.0, high=top, colours=style.FRACTION)
    style.colour_bar(shown, panels[1, 1], "DOLP", extend="max")
    style.panel(panels[1, 1], "Degree of linear polarization")
    classes = np.full(grid.shape, -1)
    for number, where in enumerate(kinds.values()):
        classes[where] = number
    _map(panels[1, 2], classes, list(kinds), x, y, "nothing")
    style.panel(panels[1, 2], "What stands there")
    for row in panels:
        for axes in row:
            style.metres(axes, x="", y="")
        row[0].set_ylabel("y [m]")
    for axes in panels[1]:
        axes.set_xlabel("along the track x [m]")
    return figure


def _map(
    axes: Axes, classes: NDArray[np.int64], names: list[str], x: NDArray[np.float64], y: NDArray[np.float64],
    none: str,
) -> None:  # fmt: skip
    """A map of classes with its legend below; -1 is grey."""
    colours = [style.CLASS_COLOURS[number % len(style.CLASS_COLOURS)] for number in range(len(names))]
    shown = style.image(axes, np.where(classes < 0, np.nan, classes), x, y)
    shown.set_cmap(ListedColormap(colours).with_extremes(bad=style.UNDEFINED))
    shown.set_norm(BoundaryNorm(np.arange(len(names) + 1) - 0.5, len(names)))
    present = [number for number in range(len(names)) if np.any(classes == number)]
    patches = [Patch(color=colours[number], label=names[number]) for number in present]
    if np.any(classes < 0):
        patches.append(Patch(color=style.UNDEFINED, label=none))
    axes.legend(
        handles=patches, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, fontsize="small",
        frameon=False,
    )  # fmt: skip
