"""How all figures look: matplotlib's object interface on Agg (no pyplot, no window), readable fonts, honest colours.

Amplitudes are shown in dB on a perceptually uniform map with a labelled colour bar, angles on a cyclic map, undefined
pixels in grey; ground pictures have metres on both axes and equal scales. Saved files depend on nothing but their
content, so the same picture gives the same bytes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import ArrayLike, NDArray

from polfuse_lab.errors import PolfuseError

SEQUENTIAL = "inferno"
"""Map of amplitudes in dB: perceptually uniform, dark is little."""
FRACTION = "viridis"
"""Map of fractions from 0 to 1 such as the degree of linear polarization."""
DIVERGING = "RdBu_r"
"""Map of signed quantities around zero."""
CYCLIC = "twilight"
"""Map of angles: both ends are the same colour."""
UNDEFINED = "0.72"
"""Grey of undefined pixels."""
CLASS_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#F0E442", "#000000")
"""Colours of classes and lines, distinguishable with colour-blind eyes (Okabe and Ito)."""
DPI = 150
"""Dots per inch of saved figures."""


def new_figure(width_in: float = 7.0, height_in: float = 4.6, *, title: str = "") -> Figure:
    """An empty white figure that arranges its own axes; fonts are meant for this width (about 7 in)."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title, fontsize="large", fontweight="bold")
    return figure


def colour_map(name: str) -> Colormap:
    """A map of matplotlib's by name, with grey for undefined pixels."""
    return mpl.colormaps[name].with_extremes(bad=UNDEFINED)


def decibels(amplitude: ArrayLike, *, reference: float = 1.0) -> NDArray[np.float64]:
    """``20 log10(|amplitude| / reference)``; zero and undefined amplitudes are NaN."""
    magnitude = np.abs(np.asarray(amplitude)).astype(np.float64) / reference
    return 20 * np.log10(np.where(magnitude > 0, magnitude, np.nan))


def metres(axes: Axes, *, x: str = "along the rail x [m]", y: str = "ground range y [m]") -> None:
    """Label both axes in metres with equal scales, as on the ground."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_aspect("equal")
    axes.tick_params(direction="out")


def image(
    axes: Axes,
    values: ArrayLike,
    x: NDArray[np.floating] | None = None,
    y: NDArray[np.floating] | None = None,
    *,
    low: float | None = None,
    high: float | None = None,
    colours: str = FRACTION,
) -> AxesImage:
    """Show an image; with axes ``x`` (columns) and ``y`` (rows) row 0 is at the bottom, as camera pixels at the top."""
    shown = np.asarray(values)
    options: dict[str, Any] = {"origin": "upper"}
    if x is not None and y is not None:
        half_x, half_y = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
        options = {"origin": "lower", "extent": (x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y)}
    if shown.ndim == 2:
        options |= {"cmap": colour_map(colours), "vmin": low, "vmax": high}
    # 'auto' antialiases when it has to shrink: narrow peaks then keep their place and do not vanish between pixels.
    picture = axes.imshow(shown, interpolation="auto", **options)
    if x is not None:
        axes.set_aspect("equal")
    return picture


def db_image(
    axes: Axes,
    amplitude: ArrayLike,
    x: NDArray[np.floating] | None = None,
    y: NDArray[np.floating] | None = None,
    *,
    span_db: float = 50.0,
    top_db: float | None = None,
) -> AxesImage:
    """Show amplitudes in dB over ``span_db`` below ``top_db`` (default: the largest value present, rounded up)."""
    values = decibels(amplitude)
    if top_db is None:
        top_db = float(np.ceil(np.nanmax(values))) if np.isfinite(values).any() else 0.0
    return image(axes, values, x, y, low=top_db - span_db, high=top_db, colours=SEQUENTIAL)


def colour_bar(picture: AxesImage, axes: Axes | list[Axes], label: str, *, extend: str = "neither") -> Colorbar:
    """A colour bar with its quantity and unit: as tall as the picture of one axes, or shared by several."""
    if isinstance(axes, list):
        return axes[0].figure.colorbar(picture, ax=axes, label=label, extend=extend, shrink=0.9, pad=0.02, aspect=32)
    # An inset stays as tall as the picture where equal scales make that lower than its axes' share of the figure.
    beside = axes.inset_axes((1.03, 0.0, 0.045, 1.0))
    return axes.figure.colorbar(picture, cax=beside, label=label, extend=extend)


def panel(axes: Axes, title: str) -> None:
    """Title of one panel, left, so that long ones do not run into the neighbour's."""
    axes.set_title(title, loc="left", fontsize="medium")


def save(figure: Figure, path: Path | str) -> Path:
    """Write a figure (PNG, PDF or SVG by its suffix) and return its path.

    Raises:
        PolfuseError: an unknown suffix, or the file cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower().removeprefix(".")
    empty: dict[str, dict[str, None]] = {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
        "svg": {"Date": None, "Creator": None},
    }
    if kind not in empty:
        raise PolfuseError(f"figures cannot be '.{kind}'", where=str(path), advice="use .png, .pdf or .svg")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context({"svg.hashsalt": "polfuse"}):
            figure.savefig(path, metadata=empty[kind])
    except OSError as error:
        raise PolfuseError(
            f"the figure cannot be written ({error.strerror})", where=str(path), advice="check the folder"
        ) from error
    return path
