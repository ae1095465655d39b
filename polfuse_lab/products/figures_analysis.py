"""Pictures of the thesis's analysis: power and RCS against range, matrices of a region, noise of the sky."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polfuse_lab.products import style
from processing.calibration.rcs import to_dbsm
from processing.radar.antenna import one_way_gain

Arrays = Mapping[str, NDArray[Any]]

SPAN_DB = 60.0
"""Depth of plots in dB below their largest value."""
LINES = ("-", (0, (4, 3)))
"""Lines of channels that may lie on one another: the second of two lets the first shine through."""


def strip_figure(analysis: Arrays, settings: Mapping[str, Any]) -> Figure:
    """Mean of the strip against ground range: received power (linear) and, below, RCS in dBsm (or power in dB).

    The place of the target is marked, as in thesis Fig. 5.17 and 5.19; bands are one standard deviation of a repeat.

    Args:
        analysis: arrays of the stage "analysis".
        settings: its settings.
    """
    repeats = int(settings["repeats"])
    width = f"mean over {100 * float(settings['strip_m']):.0f} cm across range"
    title = "Target against range: before and after calibration" if settings["calibrated"] else "Target against range"
    figure = style.new_figure(7.4, 6.4, title=title)
    before, after = figure.subplots(2, 1, sharex=True)
    y, power = analysis["y_m"], analysis["power"]
    largest = float(np.nanmax(power)) if np.isfinite(power).any() else 0.0
    exponent = 3 * int(np.floor(np.log10(largest) / 3)) if largest > 0 else 0
    unit = 10.0**-exponent
    for index, name in enumerate(settings["channels"]):
        colour = style.CLASS_COLOURS[index % len(style.CLASS_COLOURS)]
        line = LINES[int(name in ("VV", "VH"))]
        before.plot(y, unit * power[index], color=colour, linestyle=line, label=str(name))
        spread = power[index] * analysis["power_sd_db"][index] * np.log(10) / 10
        if repeats > 1:
            low, high = unit * (power[index] - spread), unit * (power[index] + spread)
            before.fill_between(y, low, high, color=colour, alpha=0.2, linewidth=0)
        level = to_dbsm(analysis["rcs_m2"][index]) if settings["calibrated"] else to_dbsm(power[index])
        after.plot(y, level, color=colour, linestyle=line, label=str(name))
        if repeats > 1:
            sd = analysis["rcs_sd_db" if settings["calibrated"] else "power_sd_db"][index]
            after.fill_between(y, level - sd, level + sd, color=colour, alpha=0.2, linewidth=0)
        if "noise_power" in analysis:
            noise = analysis["noise_power"][index]
            after.plot(y, to_dbsm(noise * _per_power(analysis, index)), color=colour, linestyle=":", linewidth=1)
    before.set_ylabel(f"received power [{'' if exponent == 0 else f'10{_raised(exponent)} '}full scale² m⁴]")
    before.set_ylim(bottom=0)
    style.panel(before, f"Received power, {width}" + (f", mean of {repeats}" if repeats > 1 else ""))
    after.set_ylabel("RCS [dBsm]" if settings["calibrated"] else "received power [dB]")
    after.set_xlabel("ground range y [m]")
    mode = {"offset": "one constant", "thesis": "line through target and noise"}.get(settings["calibration_mode"], "")
    style.panel(after, f"Calibrated ({mode})" if settings["calibrated"] else "The same in dB")
    top = _finite_top(after)
    after.set_ylim(top - SPAN_DB, top + 4)
    for axes in (before, after):
        _mark(axes, float(settings["place_m"][1]))
        axes.grid(alpha=0.3)
        axes.margins(x=0)
    before.legend(ncols=5, fontsize="small", loc="upper right")
    return figure


def matrices_figure(analysis: Arrays, settings: Mapping[str, Any]) -> Figure:
    """The region's scattering matrix relative to HH, from received powers (thesis 5.11) and from amplitudes."""
    figure = style.new_figure(7.4, 3.9, title="Scattering matrix of the region, relative to HH")
    powers, amplitudes = figure.subplots(1, 2)
    power, relative = analysis["matrix_power"], analysis["matrix_complex"]
    coherence = analysis["matrix_coherence"]
    _matrix(powers, power, [[f"{v:.3g}" if np.isfinite(v) else "no data" for v in row] for row in power])
    style.panel(powers, "mean received power")
    words = [
        [
            f"{abs(relative[i, j]):.3f}\n{np.degrees(np.angle(relative[i, j])):+.0f}°\ncoherence {coherence[i, j]:.2f}"
            if np.isfinite(relative[i, j])
            else "no data"
            for j in range(2)
        ]
        for i in range(2)
    ]
    shown = _matrix(amplitudes, np.abs(relative), words)
    style.panel(amplitudes, "complex amplitude")
    style.colour_bar(shown, [powers, amplitudes], "relative to HH")
    return figure


def sky_figure(analysis: Arrays, settings: Mapping[str, Any]) -> Figure:
    """Received power of the sky against range, compensated for range as images are (thesis Fig. 5.21)."""
    figure = style.new_figure(7.4, 4.2, title="The radar towards the sky")
    axes = figure.add_subplot()
    r = analysis["sky_range_m"]
    for index, name in enumerate(settings["channels"]):
        colour = style.CLASS_COLOURS[index % len(style.CLASS_COLOURS)]
        axes.plot(r, to_dbsm(analysis["sky_power"][index]), color=colour, linewidth=0.9, alpha=0.7, label=str(name))
        axes.plot(r, to_dbsm(analysis["sky_floor"][index]), color=colour, linestyle=LINES[index % 2], linewidth=1.8)
    levels = to_dbsm(analysis["sky_floor"])
    levels = levels[np.isfinite(levels)]
    if levels.size:
        axes.set_ylim(float(levels.max()) - SPAN_DB, float(levels.max()) + 6)
    axes.set_xlabel("range [m]")
    axes.set_ylabel("received power [dB]")
    axes.grid(alpha=0.3)
    axes.margins(x=0)
    axes.legend(ncols=4, fontsize="small", loc="lower right")
    style.panel(axes, "thin: measured; thick: noise, white before compensation for range and so growing as R⁴")
    return figure


def pattern_figure(analysis: Arrays, settings: Mapping[str, Any]) -> Figure:
    """Two-way pattern of the antennas by direction, as the calibration target shows it, and the model that is used."""
    figure = style.new_figure(7.0, 3.8, title="Antenna pattern from the calibration target")
    axes = figure.add_subplot()
    order = np.argsort(analysis["azimuth_rad"])
    azimuth = np.degrees(analysis["azimuth_rad"])[order]
    for index, name in enumerate(settings["pattern_channels"]):
        level = analysis["pattern_db"][index][order]
        colour = style.CLASS_COLOURS[(0, 3)[index]]
        axes.plot(azimuth, level, ".-", color=colour, linewidth=0.8, label=f"{name}, measured")
    if settings["beamwidth_rad"] is not None:
        # Two antennas: the two-way amplitude pattern is the one-way power pattern.
        gain = one_way_gain(np.cos(analysis["off_axis_rad"][order]), float(settings["beamwidth_rad"]))
        beam = np.degrees(float(settings["beamwidth_rad"]))
        axes.plot(azimuth, style.decibels(gain / gain.max()), "--", color="0.4", label=f"model, {beam:.0f}° beam")
    levels = analysis["pattern_db"][np.isfinite(analysis["pattern_db"])]
    axes.set_ylim(min(-6.0, float(np.floor(levels.min())) - 1 if levels.size else -6.0), 1.0)
    axes.set_xlabel("azimuth of the target from the antenna [°]")
    axes.set_ylabel("two-way power [dB]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", ncols=3, loc="lower center")
    style.panel(axes, "echo at each position over the target's own response, neighbours averaged coherently")
    return figure


def figures_of(analysis: Arrays, settings: Mapping[str, Any]) -> dict[str, Figure]:
    """All pictures of the stage by the name of their file; the sky's only where it was looked at."""
    found = {"analysis": strip_figure(analysis, settings), "matrices": matrices_figure(analysis, settings)}
    if "pattern_db" in analysis:
        found["pattern"] = pattern_figure(analysis, settings)
    return found | ({"sky": sky_figure(analysis, settings)} if "sky_power" in analysis else {})


def _mark(axes: Axes, y_m: float) -> None:
    axes.axvline(y_m, color="black", linestyle=":", linewidth=1.2, label="target")


def _raised(number: int) -> str:
    """A whole number in superscript digits."""
    return str(number).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _per_power(analysis: Arrays, index: int) -> float:
    """RCS over received power of a channel, m^2; 1 where nothing is calibrated (dB then are those of the power)."""
    if "rcs_m2" not in analysis:
        return 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = analysis["rcs_m2"][index] / analysis["power"][index]
    return float(np.nanmedian(ratio)) if np.isfinite(ratio).any() else float("nan")


def _finite_top(axes: Axes) -> float:
    values = np.concatenate([np.asarray(line.get_ydata(), dtype=np.float64) for line in axes.lines])
    values = values[np.isfinite(values)]
    return float(np.ceil(values.max())) if values.size else 0.0


def _matrix(axes: Axes, values: NDArray[np.float64], words: list[list[str]]) -> Any:
    shown = axes.imshow(np.ma.masked_invalid(values), vmin=0, vmax=1, cmap=style.colour_map(style.FRACTION))
    for i in range(2):
        for j in range(2):
            dark = not np.isfinite(values[i, j]) or values[i, j] < 0.6
            colour = "white" if dark and np.isfinite(values[i, j]) else "black"
            axes.text(j, i, words[i][j], ha="center", va="center", color=colour, fontsize="medium")
    axes.set_xticks([0, 1], ["H", "V"])
    axes.set_yticks([0, 1], ["H", "V"])
    axes.set_xlabel("transmitted")
    axes.set_ylabel("received")
    return shown
