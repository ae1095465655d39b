"""The classes of a fused picture as points in the space of Pauli components, and of Pauli components and DOLP."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from polfuse_lab.products import style
from polfuse_lab.products.fused_colours import colour_of_class, largest_shown
from polfuse_lab.products.places import pixel_of
from polfuse_lab.products.store import Products

Floats = NDArray[np.float64]

AXES = ("|HH−VV| / norm", "|HV| / norm", "|HH+VV| / norm", "DOLP")
"""Of the fused vector's components, in its order."""
ACROSS, AWAY, UP = 2, 0, (1, 3)
"""Components on the axes: |HH+VV| to the right, |HH-VV| away, and upwards |HV| or DOLP (thesis Figs. 7.21, 7.22)."""
SPACE = "fusion.space"
MOST = 1200
"""Points of a class that are shown; more of them hide each other."""


@dataclass(frozen=True, eq=False)
class PauliSpace:
    """Fused vectors with the classes they are in, and where on the ground they are."""

    features: NDArray[np.floating]
    """(4, ny, nx) fused vectors; NaN where undefined."""
    labels: NDArray[np.integer]
    """(ny, nx) class; negative: none."""
    names: tuple[str, ...]
    """Of the classes."""
    x_m: NDArray[np.floating]
    y_m: NDArray[np.floating]

    def groups(self, most: int = MOST, seed: int = 0) -> dict[str, Floats]:
        """Each class's vectors (4, n); no more than ``most``, drawn evenly."""
        random = np.random.default_rng(seed)
        flat, labels = self.features.reshape(len(self.features), -1), self.labels.ravel()
        defined = np.isfinite(flat).all(axis=0)
        found = {}
        for number, name in enumerate(self.names):
            chosen = np.flatnonzero(defined & (labels == number))
            if len(chosen) > most:
                chosen = np.sort(random.choice(chosen, most, replace=False))
            found[name] = flat[:, chosen].astype(np.float64)
        return found

    def at(self, x_m: float, y_m: float) -> Floats | None:
        """The vector (4,) of the pixel at a place on the ground; None beside the picture and where it is undefined."""
        column, row = (pixel_of(axis, value) for axis, value in ((self.x_m, x_m), (self.y_m, y_m)))
        if column is None or row is None:
            return None
        vector = self.features[:, row, column].astype(np.float64)
        return vector if np.isfinite(vector).all() else None


def space_names(products: Products) -> list[tuple[str, str]]:
    """Name and title of what a file can show in that space, as pictures have them."""
    return [(SPACE, "Classes in Pauli space")] if "fusion" in products.stages() else []


def load_space(products: Products) -> PauliSpace:
    """The classes of a fused products file. Raises :class:`PolfuseError` where it is not fused."""
    arrays, settings = products.read("fusion"), products.settings("fusion")
    names = class_names(settings, arrays["classes"])
    return PauliSpace(arrays["features"], arrays["classes"], names, arrays["x_m"], arrays["y_m"])


def class_names(settings: Mapping[str, Any], labels: NDArray[np.integer]) -> tuple[str, ...]:
    """Names of the classes on a map of them, from the settings of stage "fusion"."""
    # Files that were written before classes had names number them.
    numbered = [f"class {number + 1}" for number in range(int(labels.max(initial=-1)) + 1)]
    return tuple(settings.get("class_names", numbered))


def space_figure(space: PauliSpace, *, title: str = "Classes in the space of Pauli components") -> Figure:
    """Two plots in space: the three Pauli components, and two of them with DOLP upwards."""
    figure = style.new_figure(11.0, 5.6, title=title)
    groups = {name: points for name, points in space.groups().items() if points.size}
    for column, up in enumerate(UP):
        axes: Axes3D = figure.add_subplot(1, 2, column + 1, projection="3d")
        _scatter(axes, groups, space.names, up)
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4), markerscale=4)
    return figure


def _scatter(axes: Axes3D, groups: Mapping[str, Floats], names: tuple[str, ...], up: int) -> None:
    top, beyond = 1.0, ""
    if up == UP[1] and groups:
        heights = np.concatenate([points[up] for points in groups.values()])
        top = min(1.0, 1.1 * largest_shown(heights))
        beyond = " (more: at the top)" if heights.max() > top else ""
    for name, points in groups.items():
        # Without the limit a few points would be drawn above the box.
        height = np.minimum(points[up], top)
        axes.scatter(points[ACROSS], points[AWAY], height, s=3, color=colour_of_class(names.index(name)), label=name)
    axes.set(xlim=(0, 1), ylim=(0, 1), zlim=(0, top), xlabel=AXES[ACROSS], ylabel=AXES[AWAY])
    axes.zaxis.set_rotate_label(False)
    axes.set_zlabel(AXES[up] + beyond, rotation=90, labelpad=8)
    axes.view_init(elev=24, azim=-58)
    axes.set_box_aspect((1, 1, 0.9), zoom=0.9)
