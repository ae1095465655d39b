"""Picture of a polarizer series: Stokes parameters, degree and angle of linear polarization, and what is masked."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from polfuse_lab.products import style
from processing.optics.series import PolarizerSeries
from processing.optics.stokes import Flag, StokesImage

_REASONS = (
    # flag, words, colour; a later one is drawn over an earlier one
    (Flag.UNPOLARIZED, "no AOP: unpolarized", "0.8"),
    (Flag.INCOMPLETE, "incomplete", style.CLASS_COLOURS[3]),
    (Flag.SHADOW, "shadow", style.CLASS_COLOURS[0]),
    (Flag.ABOVE_ONE, "DOLP above 1", style.CLASS_COLOURS[1]),
    (Flag.SATURATED, "saturated", style.CLASS_COLOURS[5]),
)


def optics_figure(image: StokesImage, series: PolarizerSeries) -> Figure:
    """Six panels: S0, S1/S0, S2/S0, DOLP (debiased), AOP (cyclic), and the flag plane with its legend.

    Args:
        image: the planes of a series.
        series: the series, named in the title.
    """
    rows, columns = image.s0.shape
    angles = ", ".join(f"{np.degrees(angle):.4g}" for angle in series.angles_rad)
    frames = (
        f"{min(series.frames)}" if len(set(series.frames)) == 1 else f"{min(series.frames)} to {max(series.frames)}"
    )
    figure = style.new_figure(
        11.0,
        max(3.0, 2 * 2.6 * rows / columns + 1.25),
        title=f"Linear polarization: {frames} frame{'s' if frames != '1' else ''} at each of {angles} degrees",
    )
    axes = figure.subplots(2, 3, sharex=True, sharey=True)
    top = _robust_top(image.s0)
    picture = style.image(axes[0, 0], image.s0, low=0.0, high=top, colours="gray")
    style.colour_bar(picture, axes[0, 0], "counts", extend="max")
    style.panel(axes[0, 0], "S0")

    dark = (image.flags & (Flag.SHADOW.value | Flag.SATURATED.value)) != 0
    span = 0.0
    normalised = []
    for plane in (image.s1, image.s2):
        with np.errstate(divide="ignore", invalid="ignore"):
            fraction = np.where(dark, np.nan, plane / image.s0)
        normalised.append(fraction)
        span = max(span, _robust_top(np.abs(fraction)))
    for panel, fraction, name in zip(axes[0, 1:], normalised, ("S1 / S0", "S2 / S0"), strict=True):
        picture = style.image(panel, fraction, low=-span, high=span, colours=style.DIVERGING)
        style.colour_bar(picture, panel, name, extend="both")
    style.panel(axes[0, 1], "S1: horizontal (+), vertical (−)")
    style.panel(axes[0, 2], "S2: +45° (+), −45° (−)")

    picture = style.image(axes[1, 0], image.dolp, low=0.0, high=_robust_top(image.dolp), colours=style.FRACTION)
    style.colour_bar(picture, axes[1, 0], "DOLP", extend="max")
    style.panel(axes[1, 0], "Degree of linear polarization (debiased)")

    picture = style.image(axes[1, 1], np.degrees(image.aop), low=-90.0, high=90.0, colours=style.CYCLIC)
    # The cyclic map is light grey at +-90 degrees: what is undefined is darker here than elsewhere.
    picture.set_cmap(style.colour_map(style.CYCLIC).with_extremes(bad="0.5"))
    bar = style.colour_bar(picture, axes[1, 1], "AOP [degrees]")
    bar.set_ticks([-90, -45, 0, 45, 90])
    style.panel(axes[1, 1], "Angle of polarization")

    _flag_panel(axes[1, 2], image.flags)
    for panel in axes[1]:
        panel.set_xlabel("column")
    for panel in axes[:, 0]:
        panel.set_ylabel("row")
    return figure


def composite_figure(image: StokesImage) -> Figure:
    """Stokes parameters as colours (thesis 7.7): red |S1|, green S0, blue |S2|.

    Unpolarized light is green, yellow has much of S1 and cyan much of S2, whatever their signs; both share a scale.
    """
    rows, columns = image.s0.shape
    defined = np.isfinite(image.s0)
    top, span = _robust_top(image.s0), max(_robust_top(np.abs(image.s1)), _robust_top(np.abs(image.s2)))
    rgb = np.stack([np.abs(image.s1) / span, image.s0 / top, np.abs(image.s2) / span], axis=-1)
    rgb = np.where(defined[..., None], np.clip(rgb, 0.0, 1.0), float(style.UNDEFINED))
    figure = style.new_figure(
        7.0, max(3.0, 6.2 * rows / columns + 1.0), title="Stokes parameters: red |S1|, green S0, blue |S2|"
    )
    axes = figure.subplots()
    axes.imshow(rgb, interpolation="auto", origin="upper")
    style.panel(axes, f"full red or blue: {span:,.0f} counts, full green: {top:,.0f} counts; grey: undefined")
    axes.set_xlabel("column")
    axes.set_ylabel("row")
    return figure


def _flag_panel(axes: Axes, flags: NDArray[np.uint8]) -> None:
    code = np.zeros(flags.shape, dtype=np.uint8)
    legend = []
    for number, (flag, words, colour) in enumerate(_REASONS, start=1):
        here = (flags & flag.value) != 0
        code[here] = number
        share = float(np.mean(here))
        if share > 0:
            legend.append(Patch(facecolor=colour, edgecolor="0.3", label=f"{words}: {_percent(share)}"))
    colours = ListedColormap(["white", *(colour for _, _, colour in _REASONS)])
    axes.imshow(code, cmap=colours, vmin=-0.5, vmax=len(_REASONS) + 0.5, interpolation="nearest", origin="upper")
    style.panel(axes, "Flags")
    if legend:
        axes.legend(handles=legend, loc="lower right", fontsize="small", framealpha=0.9)
    else:
        axes.text(0.5, 0.5, "no pixel is flagged", transform=axes.transAxes, ha="center", va="center")


def _percent(share: float) -> str:
    return "below 0.1 %" if share < 1e-3 else f"{100 * share:.1f} %"


def _robust_top(plane: NDArray[np.floating]) -> float:
    """The 99.8th percentile of the defined values: single bright pixels do not darken the picture. 1 without any."""
    defined = plane[np.isfinite(plane)]
    top = float(np.percentile(defined, 99.8)) if defined.size else 1.0
    return top if top > 0 else 1.0
