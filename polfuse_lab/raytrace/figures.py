"""Pictures of a simulation: Stokes parameters, degree and angle of polarization, composites, and the active mode."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polfuse_lab.products import style
from processing.polarimetry.pauli import received_power_components
from processing.raytrace.picture import Picture

Floats = NDArray[np.float64]

LEAST = 1e-3
"""Narrowest scale of fractions: rounding errors and noise are not stretched into patterns."""


def draw(picture: Picture, folder: Path, name: str, title: str) -> tuple[Path, ...]:
    """All figures of a picture, as ``<name>_stokes.png`` and, for Mueller pictures, ``<name>_active.png``."""
    made = [style.save(stokes_figure(picture, title), folder / f"{name}_stokes.png")]
    if picture.is_mueller:
        made.append(style.save(active_figure(picture, title), folder / f"{name}_active.png"))
    return tuple(made)


def stokes_figure(picture: Picture, title: str) -> Figure:
    """Six panels: S0, S1/S0, S2/S0, DOLP, AOP (cyclic, masked where noise decides it), and thesis 7.7's composite."""
    rows, columns = picture.mean.shape[:2]
    figure = style.new_figure(11.0, max(3.4, 2 * 2.75 * rows / columns + 1.1), title=title)
    axes = _panels(figure)
    stokes = picture.stokes
    s0 = stokes[..., 0]
    dark = s0 <= 0
    top = _top(s0)
    shown = style.image(axes[0, 0], s0, low=0.0, high=top, colours="gray")
    style.colour_bar(shown, axes[0, 0], "W/(m² sr)", extend="max")
    style.panel(axes[0, 0], "S0")
    with np.errstate(divide="ignore", invalid="ignore"):
        fractions = [np.where(dark, np.nan, stokes[..., i] / s0) for i in (1, 2)]
    span = max(LEAST, _top(np.abs(np.stack(fractions))))
    for axis, fraction, label in zip(axes[0, 1:], fractions, ("S1", "S2"), strict=True):
        shown = style.image(axis, fraction, low=-span, high=span, colours=style.DIVERGING)
        style.colour_bar(shown, axis, f"{label} / S0", extend="both")
    style.panel(axes[0, 1], "S1: horizontal (+), vertical (−)")
    style.panel(axes[0, 2], "S2: +45° (+), −45° (−)")
    shown = style.image(axes[1, 0], picture.dolp, low=0.0, high=max(LEAST, _top(picture.dolp)), colours=style.FRACTION)
    style.colour_bar(shown, axes[1, 0], "DOLP", extend="max")
    style.panel(axes[1, 0], "Degree of linear polarization")
    shown = style.image(axes[1, 1], np.degrees(picture.aop), low=-90.0, high=90.0, colours=style.CYCLIC)
    # The cyclic map is light grey at +-90 degrees: what is undefined is darker here than elsewhere.
    shown.set_cmap(style.colour_map(style.CYCLIC).with_extremes(bad="0.5"))
    style.colour_bar(shown, axes[1, 1], "AOP [degrees]").set_ticks([-90, -45, 0, 45, 90])
    style.panel(axes[1, 1], "Angle of polarization")
    style.image(axes[1, 2], composite(stokes))
    style.panel(axes[1, 2], "R, G, B = S1, S0, S2")
    for axis in axes[1]:
        axis.set_xlabel("column")
    for axis in axes[:, 0]:
        axis.set_ylabel("row")
    return figure


def composite(stokes: Floats) -> Floats:
    """R, G, B = S1, S0, S2 (rows, columns, 3) of thesis Fig. 7.7; zero is half way for S1 and S2, dark for S0.

    Where there is no light it is grey, as what is undefined is elsewhere.
    """
    s0, s1, s2 = (stokes[..., i] for i in range(3))
    level = _top(s0)
    span = max(LEAST * level, _top(np.abs(stokes[..., 1:3])))
    colours = np.clip(np.stack([0.5 + s1 / (2 * span), s0 / level, 0.5 + s2 / (2 * span)], axis=-1), 0, 1)
    return np.where((s0 > 0)[..., None], colours, float(style.UNDEFINED))


def active_figure(picture: Picture, title: str) -> Figure:
    """Intensities HH, HV, VH and VV on one scale, and both Pauli composites (thesis 6.3, Fig. 4.13).

    One shows the powers as they are on one scale; the other each on its own, for the red and green are weak.
    """
    channels = picture.channels()
    rows, columns = picture.mean.shape[:2]
    figure = style.new_figure(11.0, max(3.4, 2 * 2.75 * rows / columns + 1.1), title=f"{title}: active mode")
    axes = _panels(figure)
    top = max(_top(plane) for plane in channels.values())
    places = {"HH": axes[0, 0], "HV": axes[0, 1], "VH": axes[1, 0], "VV": axes[1, 1]}
    for name, axis in places.items():
        shown = style.image(axis, channels[name], low=0.0, high=top, colours="gray")
        style.colour_bar(shown, axis, "W/(m² sr)", extend="max")
        style.panel(axis, f"{name} (transmit, receive)")
    powers = received_power_components(channels["HH"], (channels["HV"] + channels["VH"]) / 2, channels["VV"])
    style.image(axes[0, 2], np.moveaxis(np.clip(powers / max(_top(powers), 1e-300), 0, 1), 0, -1))
    style.panel(axes[0, 2], "R, G, B = |HH−VV|, HV, HH+VV")
    level = np.where(powers[2] > 0, powers[2], np.nan)
    parts = np.stack([powers[0] / level, powers[1] / level, powers[2] / _top(powers[2])])
    tops = [max(_top(parts[0]), LEAST), max(_top(parts[1]), LEAST), 1.0]
    stretched = np.clip(parts / np.reshape(tops, (3, 1, 1)), 0, 1)
    stretched = np.where(np.isfinite(level), stretched, float(style.UNDEFINED))
    style.image(axes[1, 2], np.moveaxis(stretched, 0, -1))
    style.panel(axes[1, 2], f"R, G over HH+VV (to {tops[0]:.2g}, {tops[1]:.2g})")
    for axis in axes[1]:
        axis.set_xlabel("column")
    for axis in axes[:, 0]:
        axis.set_ylabel("row")
    return figure


def _panels(figure: Figure) -> Any:
    """Two by three axes, apart so that the labels of colour bars keep clear of their neighbours."""
    figure.set_layout_engine("constrained", w_pad=0.1, h_pad=0.06)
    return figure.subplots(2, 3, sharex=True, sharey=True)


def _top(plane: Floats) -> float:
    """The 99.8th percentile of the defined values; 1 without any above zero."""
    defined = plane[np.isfinite(plane)]
    top = float(np.percentile(defined, 99.8)) if defined.size else 1.0
    return top if top > 0 else 1.0
