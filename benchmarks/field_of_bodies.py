"""What each body of the simulated field shows both eyes (the thesis's Tables 6.3 and 9.1): a table and a picture.

``python -m benchmarks.field_of_bodies PRODUCTS FOLDER`` reads what was made of a collect before
``examples/scenes/field_of_bodies.toml``, as docs/simulation.md tells.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hw_mocks.rig_bodies import pinhole
from hw_mocks.scene_file import SceneFile, load_scene_file
from polfuse_lab.products.store import Products
from polfuse_lab.simulation.rig_scene import read_bodies
from processing.raytrace.bvh import build
from processing.scene.rail_scene import moved
from processing.scene.solids import SolidScene

Floats = NDArray[np.float64]

SCENE = Path(__file__).resolve().parents[1] / "examples" / "scenes" / "field_of_bodies.toml"
MECHANISM = {
    "plate": "single",
    "trihedral": "triple",
    "dihedral": "double",
    "car": "folds with the ground",
    "container": "folds with the ground",
    "bush": "volume",
    "tree": "volume",
}


@dataclass(frozen=True)
class Shown:
    """What a body shows."""

    name: str
    peak_m: tuple[float, float]
    """Where the focused image of all channels is brightest: x, y."""
    rcs_dbsm: float
    """Span over 2 there."""
    shares: tuple[float, float, float]
    """Of |HH - VV|^2, |2 HV|^2 and |HH + VV|^2 in twice the span around it."""
    dolp: float
    """Of its light: the median of the camera's pixels that see it."""
    s0: float
    """Counts, median."""


def seen_by_camera(file: SceneFile, bodies: SolidScene) -> NDArray[np.int64]:
    """Number of the body (rows, columns) in each of the camera's pixels; -1: none."""
    assert file.camera is not None
    camera = pinhole(file.camera)
    mesh, owner = moved(bodies, (0.0, 0.0, -file.geometry.antenna_height_m)).mesh()
    rays = camera.rays().reshape(-1, 3)
    met = build(mesh).closest(np.tile(np.asarray(camera.position_m), (len(rays), 1)), rays).triangle
    return np.where(met >= 0, owner[np.maximum(met, 0)], -1).reshape(camera.shape)


def shown(products: Path) -> list[Shown]:
    """What each body shows, nearest first."""
    file = load_scene_file(SCENE)
    bodies = read_bodies(SCENE, file.waveform.centre_hz)
    store = Products(products)
    radar, light, image = store.read("polarimetry"), store.read("optics"), store.read("focus")["image"]
    level = np.nan_to_num(np.sum(np.abs(image) ** 2, axis=0))
    owner = seen_by_camera(file, bodies)
    powers = np.abs(radar["pauli"]) ** 2  # of HH + VV, HH - VV and 2 HV over sqrt(2)
    x, y = np.meshgrid(radar["x_m"], radar["y_m"])
    found = []
    for number, solid in enumerate(bodies.solids):
        if solid.kind == "grass":
            continue
        corners = np.concatenate([part.mesh.corners_m.reshape(-1, 3) for part in solid.parts])
        low, high = corners.min(axis=0) - 0.2, corners.max(axis=0) + 0.2
        near = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
        inside = np.where(near, level, 0)
        row, column = np.unravel_index(int(np.argmax(inside)), inside.shape)
        bright = near & (inside > inside.max() / 10)
        total = powers[:, bright].sum(axis=1)
        odd, even, cross = total / total.sum()
        pixels = (owner == number) & np.isfinite(light["dolp"])
        found.append(
            Shown(
                solid.name,
                (float(x[row, column]), float(y[row, column])),
                10 * math.log10(float(powers[:, row, column].sum()) / 2),
                (float(even), float(cross), float(odd)),
                float(np.median(light["dolp"][pixels])),
                float(np.median(light["s0"][pixels])),
            )
        )
    return found


def table(found: list[Shown]) -> str:
    """As the documentation has it."""
    lines = ["| body | bounces | brightest at | span / 2 | HH - VV | HV | HH + VV | DOLP |", f"|{8 * '---|'}"]
    for body in found:
        even, cross, odd = (f"{100 * share:.0f} %" for share in body.shares)
        lines.append(
            f"| {body.name} | {MECHANISM[body.name]} | {body.peak_m[0]:.2f}, {body.peak_m[1]:.2f} m "
            f"| {body.rcs_dbsm:.1f} dBsm | {even} | {cross} | {odd} | {body.dolp:.3f} |"
        )
    return "\n".join(lines)


def picture(products: Path, found: list[Shown]) -> Figure:
    """Both eyes, and where each body is in them."""
    store = Products(products)
    radar, light = store.read("polarimetry"), store.read("optics")
    odd, even, cross = 20 * np.log10(np.maximum(np.abs(radar["pauli"]), 1e-9))
    top = np.nanmax(odd)
    rgb = np.clip((np.stack([even, cross, odd], axis=-1) - top + 40) / 40, 0, 1)
    figure = Figure(figsize=(11, 6.2), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.2))
    left, above, below = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
    x, y = radar["x_m"], radar["y_m"]
    left.imshow(np.nan_to_num(rgb), origin="lower", extent=(x[0], x[-1], y[0], y[-1]), aspect="auto")
    for body in found:
        left.annotate(
            body.name, body.peak_m, xytext=(8, 8), textcoords="offset points", color="white", fontsize=8,
            arrowprops={"arrowstyle": "-", "color": "0.7", "linewidth": 0.6},
        )  # fmt: skip
    left.set_title("Radar: red |HH-VV|, green |HV|, blue |HH+VV|, 40 dB")
    left.set_xlabel("along the rail x [m]")
    left.set_ylabel("ground range y [m]")
    s0 = np.where(np.isfinite(light["s0"]), light["s0"], 0)
    above.imshow(np.clip(s0 / np.percentile(s0, 99), 0, 1) ** 0.6, cmap="gray")
    above.set_title("Camera: S0")
    shown_dolp = below.imshow(light["dolp"], vmin=0, vmax=0.4, cmap="viridis")
    below.set_title("Camera: DOLP")
    figure.colorbar(shown_dolp, ax=below, location="bottom", fraction=0.06)
    for axes in (above, below):
        axes.set_xticks([])
        axes.set_yticks([])
    return figure


def main() -> None:
    """Draw and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("products", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    found = shown(given.products)
    picture(given.products, found).savefig(given.folder / "field-of-bodies.png", dpi=80)
    print(table(found))


if __name__ == "__main__":
    main()
