"""Picture of the active mode: the four channels, their Pauli composite in visible light, and DOLP."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polfuse_lab.products import style
from processing.optics.active import CHANNELS, ActiveImage

LEAST_SNR = 3.0
"""Channels below this many of their sds are drawn as undefined in dB."""


def active_figure(image: ActiveImage) -> Figure:
    """Six panels: HH, HV, VH, VV in dB below the brightest, the Pauli composite of powers, and DOLP (thesis 6.8)."""
    rows, columns = image.dolp.shape
    figure = style.new_figure(
        11.0,
        max(3.0, 2 * 2.6 * rows / columns + 1.25),
        title="Active mode: polarized source, polarized camera (source then camera)",
    )
    axes = figure.subplots(2, 3, sharex=True, sharey=True)
    top = float(np.nanpercentile(image.intensities, 99.8)) if np.isfinite(image.intensities).any() else 1.0
    for panel, name, plane, sd in zip(
        (axes[0, 0], axes[0, 1], axes[1, 0], axes[1, 1]), CHANNELS, image.intensities, image.sds, strict=True
    ):
        with np.errstate(invalid="ignore", divide="ignore"):
            level = 10 * np.log10(np.where(plane > LEAST_SNR * sd, plane / top, np.nan))
        picture = style.image(panel, level, low=-30.0, high=0.0, colours=style.SEQUENTIAL)
        style.colour_bar(picture, panel, "dB", extend="min")
        style.panel(panel, f"I {name}")
    style.image(axes[0, 2], pauli_colours(image.pauli))
    style.panel(axes[0, 2], "Pauli of powers: |HH−VV|, HV, HH+VV")
    span = max(0.05, _size(image.dolp))
    picture = style.image(axes[1, 2], image.dolp, low=-span, high=span, colours=style.DIVERGING)
    style.colour_bar(picture, axes[1, 2], "S1 / S0", extend="both")
    style.panel(axes[1, 2], "(HH+VH−HV−VV) / sum")
    for panel in axes[1]:
        panel.set_xlabel("column")
    for panel in axes[:, 0]:
        panel.set_ylabel("row")
    return figure


def pauli_colours(pauli: NDArray[np.floating]) -> NDArray[np.float64]:
    """(rows, columns, 3) red |HH - VV|, green HV, blue HH + VV on one scale of square roots; grey where undefined."""
    defined = np.isfinite(pauli).all(axis=0)
    top = float(np.percentile(pauli[2][defined], 99.8)) if defined.any() else 1.0
    with np.errstate(invalid="ignore"):
        rgb = np.sqrt(np.clip(pauli / (top if top > 0 else 1.0), 0.0, 1.0))
    shown: NDArray[np.float64] = np.where(defined[..., None], np.moveaxis(rgb, 0, -1), float(style.UNDEFINED))
    return shown


def _size(plane: NDArray[np.floating]) -> float:
    defined = np.abs(plane[np.isfinite(plane)])
    return float(np.percentile(defined, 99.8)) if defined.size else 0.0
