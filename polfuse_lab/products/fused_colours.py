"""Radar and camera in one colour: Pauli gives the hue, DOLP how much of it there is, S0 how bright it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from polfuse_lab.products import style

Floats = NDArray[np.float64]


def largest_shown(values: ArrayLike) -> float:
    """Top of a scale from zero that single bright pixels do not spoil (99.5 %); 1 where nothing is above zero."""
    known = np.asarray(values)[np.isfinite(values)]
    top = float(np.percentile(known, 99.5)) if known.size else 1.0
    return top if top > 0 else 1.0


def fused_rgb(
    features: ArrayLike, s0: ArrayLike, *, full_dolp: float | None = None, white: float | None = None
) -> Floats:
    """Pauli colours over S0 with DOLP as saturation, (..., 3) in [0, 1].

    ``S0 / white * (1 - s (1 - hue))``, s = DOLP / ``full_dolp``; the hue is (|HH-VV|, |HV|, |HH+VV|) over the largest
    of the three, as red, green and blue. Light without polarization is grey, whatever the radar sees.

    Args:
        features: (4, ...) fused vectors, as in stage "fusion" (thesis 6.12); where one is undefined, S0 stays grey.
        s0: (...) of the same pixels; undefined ones give NaN.
        full_dolp: DOLP whose colour is full; None: :func:`largest_shown` of the DOLP there is.
        white: S0 of the brightest colours; None: likewise.
    """
    vector, light = np.asarray(features, dtype=np.float64), np.asarray(s0, dtype=np.float64)
    full = largest_shown(vector[3]) if full_dolp is None else full_dolp
    brightest = largest_shown(light) if white is None else white
    defined = np.isfinite(vector).all(axis=0)
    components = np.where(defined, vector[:3], 1.0)
    hue = components / np.maximum(components.max(axis=0), 1e-12)
    share = np.where(defined, np.clip(vector[3] / full, 0, 1), 0.0)
    rgb = np.clip(light / brightest, 0, 1) * (1 - share * (1 - hue))
    return np.moveaxis(rgb, 0, -1)


def colour_of_class(number: int) -> str:
    """The colour of a class in every map, legend and plot."""
    return style.CLASS_COLOURS[number % len(style.CLASS_COLOURS)]


def class_rgb(labels: ArrayLike, colours: Sequence[str] | None = None) -> Floats:
    """(..., 3) colours of class numbers; NaN where a number is negative: no class."""
    numbers = np.asarray(labels)
    count = int(numbers.max(initial=-1)) + 1
    chosen = [colour_of_class(number) for number in range(count)] if colours is None else list(colours)
    table = np.array([*(to_rgb(colour) for colour in chosen), (np.nan,) * 3])
    return np.asarray(table[np.where(numbers < 0, len(table) - 1, numbers)])


def fused_colours_figure(fusion: Mapping[str, NDArray[Any]]) -> Figure:
    """Pauli colours over S0 on the ground with DOLP as saturation, and beside them what the colours say.

    Args:
        fusion: arrays of the stage "fusion".
    """
    x, y = fusion["x_m"], fusion["y_m"]
    features, s0 = fusion["features"], fusion["s0_on_ground"]
    full, white = largest_shown(features[3]), largest_shown(s0)
    aspect = float(np.ptp(y)) / float(np.ptp(x))
    # As wide as the picture needs at a height between 4 and 8 inches.
    height = float(np.clip(7.6 * aspect + 1.2, 4.2, 8.4))
    width = float(np.clip((height - 1.2) / aspect + 3.4, 6.4, 11.0))
    figure = style.new_figure(width, height, title="Pauli colours over S0, DOLP as saturation")
    axes, key = figure.subplots(1, 2, width_ratios=(width - 2.6, 1.0))
    rgb = fused_rgb(features, s0, full_dolp=full, white=white)
    known = np.isfinite(rgb).all(axis=-1, keepdims=True)
    style.image(axes, np.where(known, rgb, float(style.UNDEFINED)), x, y)
    style.metres(axes)
    style.panel(axes, "grey: no polarization, or no echo above the noise")
    _key(key, full)
    return figure


def _key(axes: Axes, full_dolp: float) -> None:
    """The colours of each mechanism from no polarization to the most."""
    dolp = np.linspace(0, full_dolp, 64)
    vectors = np.zeros((4, len(dolp), 3))
    vectors[3] = dolp[:, None]
    for component in range(3):
        vectors[component, :, component] = 1.0
    colours = fused_rgb(vectors, np.ones((len(dolp), 3)), full_dolp=full_dolp, white=1.0)
    axes.imshow(colours, origin="lower", extent=(-0.5, 2.5, 0, full_dolp), aspect="auto", interpolation="nearest")
    axes.set_xticks(range(3), ("|HH−VV|", "|HV|", "|HH+VV|"), rotation=90)
    axes.yaxis.set_label_position("right")
    axes.yaxis.tick_right()
    axes.set_ylabel("DOLP")
    axes.set_box_aspect(3.2)
