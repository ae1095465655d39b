"""Pictures of moving targets: in the radar's picture, and before and after the correction of a polarizer series."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from polfuse_lab.products import style
from polfuse_lab.products.motion import MotionResult
from polfuse_lab.products.motion_history import HistoryResult


def targets_figure(result: HistoryResult, name: str) -> Figure:
    """The picture of what stands, each target's streak, and an arrow from there to where it was, with its velocity."""
    found, grid = result.found, result.grid
    figure = style.new_figure(11.0, 5.2, title=f"{name}: {len(found.targets)} moving in {found.tiles} tiles")
    axes = figure.subplots()
    decibels = 10 * np.log10(np.maximum(found.power, 1e-300))
    middle = float(np.nanmedian(decibels))
    y_m = grid.y_m + result.track_y_m
    picture = style.image(axes, decibels - middle, grid.x_m, y_m, low=-10.0, high=25.0, colours="gray")
    axes.set_aspect("auto")
    style.colour_bar(picture, axes, "power over the median [dB]", extend="both")
    for number, (streak, target) in enumerate(zip(found.streaks, found.targets, strict=True), start=1):
        x = float(np.interp(streak.column, np.arange(len(grid.x_m)), grid.x_m))
        y = float(np.interp(streak.row, np.arange(len(y_m)), y_m))
        axes.annotate(
            "",
            (target.x_m, target.y_m + result.track_y_m),
            (x, y),
            arrowprops={"arrowstyle": "->", "color": "cyan", "linewidth": 1.4},
        )
        axes.annotate(
            f"{number}: along {target.azimuth_m_s:+.2f} ± {target.azimuth_sd_m_s:.2g}, "
            f"across {target.ground_m_s:+.2f} ± {target.ground_sd_m_s:.2g} m/s",
            (x, y),
            xytext=(0, 12),
            textcoords="offset points",
            horizontalalignment="center",
            fontsize=8,
            color="white",
            bbox={"facecolor": "black", "alpha": 0.6, "edgecolor": "none", "pad": 1.5},
        )
    axes.set_xlim(float(grid.x_m[0]), float(grid.x_m[-1]))
    axes.set_ylim(float(y_m[0]), float(y_m[-1]))
    axes.set_xlabel("along the track x [m]")
    axes.set_ylabel("across the track y [m]")
    style.panel(axes, "Focused for what stands; arrows lead from a streak to where the target was at time 0")
    return figure


def exposures_figure(result: MotionResult) -> Figure:
    """DOLP and the error image, before and after."""
    rows, columns = result.error_before.shape
    figure = style.new_figure(
        10.0, max(4.0, 2 * 4.2 * rows / columns + 1.2),
        title=f"Motion between exposures: error image {result.error_down_db:.1f} dB down",
    )  # fmt: skip
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    known = result.before.dolp[np.isfinite(result.before.dolp)]
    top = float(np.percentile(known, 99.5)) if known.size else 1.0
    largest = float(np.percentile(result.error_before, 99.8))
    panels = (
        (axes[0, 0], result.before.dolp, top, "DOLP", "DOLP as taken", style.FRACTION),
        (axes[0, 1], result.after.dolp, top, "DOLP", "DOLP corrected", style.FRACTION),
        (axes[1, 0], result.error_before, largest, "counts", "|(I0 + I90) − (I45 + I135)| as taken", style.SEQUENTIAL),
        (axes[1, 1], result.error_after, largest, "counts", "the same, corrected", style.SEQUENTIAL),
    )
    for panel, plane, high, unit, title, colours in panels:
        style.colour_bar(style.image(panel, plane, low=0.0, high=high, colours=colours), panel, unit, extend="max")
        style.panel(panel, title)
    for panel in axes[1]:
        panel.set_xlabel("column")
    for panel in axes[:, 0]:
        panel.set_ylabel("row")
    return figure
