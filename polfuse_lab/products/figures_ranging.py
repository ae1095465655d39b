"""Picture of a ranging record: range over time with the tracks, range over Doppler, and the mean range profile."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polfuse_lab.products import style
from polfuse_lab.products.ranging_time import RangeTime, assumed_note

_SPAN_DB = 40.0


def ranging_figure(data: RangeTime, name: str) -> Figure:
    """Range-time picture of what moves with its tracks, the range-Doppler picture, and the profile of what stands.

    Args:
        data: pictures and targets of a record.
        name: the recording's name, for the title.
    """
    figure = style.new_figure(11.0, 8.2, title=f"{name}: {assumed_note(data)}")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.35, 1.0))
    _range_time(figure.add_subplot(grid[0, :]), data)
    _range_doppler(figure.add_subplot(grid[1, 0]), data)
    _profile(figure.add_subplot(grid[1, 1]), data)
    return figure


def _range_time(axes: Axes, data: RangeTime) -> None:
    picture = style.image(
        axes, data.moving_db.T, data.time_s, data.range_m, low=0.0, high=30.0, colours=style.SEQUENTIAL
    )
    axes.set_aspect("auto")
    style.colour_bar(picture, axes, "power over noise [dB]", extend="both")
    for number, target in enumerate(data.targets, start=1):
        track = target.track
        # Drawn where the up-ramp shows it; the numbers given elsewhere have the Doppler shift of the beat taken off.
        axes.plot([track.t0_s, track.t1_s], [track.r0_m, track.r1_m], color="cyan", linewidth=1.2)
        axes.annotate(
            f"{number}: {track.speed_m_s:+.1f} m/s",
            (track.t0_s, track.r0_m),
            xytext=(0, 9),
            textcoords="offset points",
            horizontalalignment="left" if track.t0_s < 0.85 * data.time_s[-1] else "right",
            fontsize=8,
            color="white",
            bbox={"facecolor": "black", "alpha": 0.55, "edgecolor": "none", "pad": 1.2},
        )
    axes.set_xlabel("time [s]")
    axes.set_ylabel("range in the up-ramp [m]")
    found = len(data.targets)
    style.panel(axes, f"Moving targets, background removed: {found} track{'' if found == 1 else 's'} (+ receding)")


def _range_doppler(axes: Axes, data: RangeTime) -> None:
    power_db = 10 * np.log10(np.maximum(data.doppler_power, 1e-300))
    top = float(np.ceil(np.percentile(power_db, 99.9)))
    picture = style.image(
        axes, power_db.T, data.doppler_m_s, data.range_m, low=top - _SPAN_DB, high=top, colours=style.SEQUENTIAL
    )
    axes.set_aspect("auto")
    style.colour_bar(picture, axes, "power [dB of full scale]", extend="both")
    axes.set_xlabel(f"range rate [m/s], modulo {2 * data.ambiguity_m_s:.2f}")
    axes.set_ylabel("range [m]")
    style.panel(axes, "Range-Doppler, mean of blocks of 64 sweeps")


def _profile(axes: Axes, data: RangeTime) -> None:
    still = np.abs(data.profiles.mean(axis=0)) ** 2
    total = (np.abs(data.profiles) ** 2).mean(axis=0)
    moving = np.maximum(total - still, 0.0)
    for power, label, colour in (
        (still, "stands still", style.CLASS_COLOURS[0]),
        (moving, "varies", style.CLASS_COLOURS[5]),
    ):
        axes.plot(data.range_m, 10 * np.log10(np.maximum(power, 1e-300)), label=label, color=colour, linewidth=1.2)
    levels = 10 * np.log10(np.maximum(np.concatenate([still[2:], moving[2:]]), 1e-300))
    axes.set_ylim(float(np.percentile(levels, 1)) - 10, float(levels.max()) + 5)
    axes.set_xlim(0, float(data.range_m[-1]))
    axes.set_xlabel("range [m]")
    axes.set_ylabel("power [dB of full scale]")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    style.panel(axes, "Mean range profile")
