"""Pictures of a calibration: RCS of every channel on the ground, and how weak a target may be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polfuse_lab.products import style
from processing.calibration.rcs import to_dbsm

Arrays = Mapping[str, NDArray[Any]]

SPAN_DB = 45.0
"""Span of the RCS pictures, dB."""


def rcs_figure(calibration: Arrays, settings: Mapping[str, Any]) -> Figure:
    """RCS of every channel in dBsm on the ground, with the calibration target and the check target marked.

    Args:
        calibration: arrays of the stage "calibration".
        settings: its settings.
    """
    scattering, x, y = calibration["scattering"], calibration["x_m"], calibration["y_m"]
    channels = [str(name) for name in settings["channels"]]
    columns = min(len(channels), 2)
    rows = -(-len(channels) // columns)
    panel_in = 3.05 * float(np.ptp(y)) / float(np.ptp(x))
    figure = style.new_figure(8.2, 1.1 + rows * min(max(panel_in, 1.8), 5.0) + 0.35 * rows, title="Calibrated RCS")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    level = style.decibels(scattering)
    top = float(np.ceil(np.nanmax(level))) if np.isfinite(level).any() else 0.0
    picture = None
    for index, axes in enumerate(panels.flat):
        if index >= len(channels):
            axes.set_visible(False)
            continue
        picture = style.db_image(axes, scattering[index], x, y, span_db=SPAN_DB, top_db=top)
        style.panel(axes, channels[index])
        style.metres(axes)
        axes.label_outer()
        for kind in ("target", "check"):
            if settings.get(kind) is not None:
                _mark(axes, settings[kind], settings["z_m"])
    if picture is not None:
        style.colour_bar(picture, list(panels.flat), "RCS [dBsm]", extend="min")
    return figure


def noise_figure(calibration: Arrays, settings: Mapping[str, Any]) -> Figure:
    """Noise-equivalent RCS of every channel over ground range: targets below the line drown."""
    figure = style.new_figure(7.0, 3.6, title="Noise-equivalent RCS")
    axes = figure.add_subplot()
    colours = style.CLASS_COLOURS
    for number, (name, values) in enumerate(
        zip(settings["channels"], calibration["noise_equivalent_rcs_m2"], strict=True)
    ):
        axes.plot(calibration["y_m"], to_dbsm(values), label=str(name), color=colours[number % len(colours)])
    axes.set_xlabel("ground range y [m]")
    axes.set_ylabel("RCS [dBsm]")
    axes.grid(alpha=0.3)
    axes.legend(ncols=4, fontsize="small")
    style.panel(axes, f"from the {settings['noise_source']}")
    return figure


def _mark(axes: Axes, target: Mapping[str, Any], ground_z_m: float) -> None:
    """A ring and a name where a target shows: what stands above the ground lays over towards the rail."""
    height = float(target["height_m"])
    y = float(np.sqrt(target["y_m"] ** 2 + (ground_z_m + height) ** 2 - ground_z_m**2))
    axes.plot(
        target["x_m"], y, "o", markersize=13, markerfacecolor="none", markeredgecolor="white", markeredgewidth=1.1
    )
    axes.annotate(
        str(target["kind"]),
        (target["x_m"], y),
        xytext=(0, 9),
        textcoords="offset points",
        color="white",
        fontsize="small",
        ha="center",
    )
