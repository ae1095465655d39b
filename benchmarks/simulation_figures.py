"""Draws the pictures of docs/simulation.md: ``python -m benchmarks.simulation_figures docs/simulation``."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colorbar import Colorbar
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from benchmarks.warehouse_fusion import CLASSES, SUN_RAD, Fused, fuse, grid_320x150
from polfuse_lab.products.fused_colours import colour_of_class, fused_rgb
from polfuse_lab.products.pauli_space import PauliSpace, space_figure
from processing.fusion.dolp_relation import agreement_phase, relation
from processing.polarimetry.pauli import display_components, pauli_vector
from processing.scene.both_eyes import radar_picture
from processing.scene.warehouse import warehouse

CLASS_COLOURS = [colour_of_class(number) for number in range(len(CLASSES))]
FULL_DOLP = 0.15
"""DOLP of full colour."""


def relation_figure() -> Figure:
    """What red says in a Pauli picture over DOLP, for all ratios of HH and VV and phases between them."""
    figure = Figure(figsize=(7.5, 5.0), layout="constrained")
    axes = figure.subplots()
    ratio = np.linspace(0, 1, 201)
    for phase in (0, 45, 90, 135, 180):
        told = relation(1.0, 0.0, ratio * np.exp(1j * np.radians(phase)))
        axes.plot(told.exact, told.even_share, label=f"{phase}°")
    axes.plot([0, 1], [0, 1], "--", color="0.6", label="equal")
    g = np.linspace(1 / 3, 1, 101)
    met = relation(1.0, 0.0, g * np.exp(1j * agreement_phase(g)))
    axes.plot(met.exact, met.even_share, color="0.3", linewidth=3, alpha=0.4, label="where they agree")
    axes.set_xlabel("DOLP = (1 - g²) / (1 + g²), g = |VV| / |HH|")
    axes.set_ylabel("share of |HH - VV|² in the Pauli vector")
    axes.set_title("DOLP knows nothing of the phase between HH and VV")
    axes.annotate("dihedral", (0.0, 1.0), xytext=(0.06, 0.95))
    axes.annotate("trihedral, sphere, plate", (0.0, 0.0), xytext=(0.08, 0.015))
    axes.annotate("dipole", (1.0, 0.5), xytext=(0.9, 0.54))
    figure.legend(title="phase HH to VV", loc="outside right center")
    return figure


def yard_figure(fused: Fused) -> Figure:
    """The warehouse: Pauli, S0, DOLP, Pauli over S0 with DOLP as saturation, and both truths."""
    hh, hv, vh, vv = fused.radar.channels
    amplitudes = display_components(pauli_vector(hh, (hv + vh) / 2, vv))
    # -25 to +15 dBsm: the brightest folds would leave the ground black.
    rgb = np.clip((20 * np.log10(np.maximum(amplitudes, 1e-9)) + 25) / 40, 0, 1).transpose(1, 2, 0)
    s0 = fused.optics.s0 / np.nanpercentile(fused.optics.s0, 99)
    dolp = fused.optics.dolp
    overlay = np.nan_to_num(fused_rgb(fused.features, s0, full_dolp=FULL_DOLP, white=1.0))
    figure = Figure(figsize=(13.5, 10.0), layout="constrained")
    axes = figure.subplots(3, 2)
    x, y = fused.grid.x_m, fused.grid.y_m
    place = {"origin": "lower", "extent": (x[0], x[-1], y[0], y[-1]), "interpolation": "nearest"}
    titles = (
        "Radar: |HH - VV|, |HV|, |HH + VV| as red, green, blue", "Camera: S0", "Camera: DOLP",
        "Pauli colours over S0, DOLP as saturation", "What stands there", "What returns ten times all else",
    )  # fmt: skip
    pictures = (rgb, s0, dolp, overlay)
    for panel, title in zip(axes.flat, titles, strict=True):
        panel.set_title(title)
        panel.set_ylabel("y, m")
    for panel, picture in zip(axes.flat, pictures, strict=False):
        if picture.ndim == 3:
            panel.imshow(picture, **place)
        else:
            top = 1.0 if picture is s0 else 0.2
            shown = panel.imshow(picture, vmin=0, vmax=top, cmap="gray" if picture is s0 else "viridis", **place)
            _beside(panel, shown)
    for panel, truth in zip(axes.flat[4:], (fused.bodies, fused.mechanisms), strict=True):
        shown = panel.imshow(
            np.where(truth < 0, np.nan, truth), vmin=-0.5, vmax=2.5, cmap=ListedColormap(CLASS_COLOURS), **place
        )
        bar = _beside(panel, shown)
        bar.set_ticks(list(range(3)), labels=CLASSES)
        panel.set_xlabel("x, m")
    return figure


def _beside(panel: Axes, shown: AxesImage) -> Colorbar:
    """A colour bar in the margin beside a panel: panels stay below one another, with a bar or without."""
    assert isinstance(panel.figure, Figure)
    return panel.figure.colorbar(shown, cax=panel.inset_axes((1.03, 0.1, 0.03, 0.8)))


def classes_in_space(fused: Fused) -> Figure:
    """What stands there, in the space of Pauli components and with DOLP (thesis Figs. 7.21, 7.22)."""
    grid = fused.grid
    return space_figure(PauliSpace(fused.features, fused.bodies, CLASSES, grid.x_m, grid.y_m), title="")


def main() -> None:
    """Draw all into a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    scene, grid = warehouse(), grid_320x150()
    fused = fuse(scene, grid, radar_picture(scene, grid), next(iter(SUN_RAD)))
    for name, figure in (
        ("dolp-against-pauli", relation_figure()),
        ("warehouse", yard_figure(fused)),
        ("pauli-space", classes_in_space(fused)),
    ):
        figure.savefig(folder / f"{name}.png", dpi=80)


if __name__ == "__main__":
    main()
