"""Scene file to products and figures: the stage ``"raytrace"``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.products.store import Products
from polfuse_lab.raytrace.scene_file import SceneFile, find_scene, read_scene
from processing.raytrace.backward import backward
from processing.raytrace.forward import forward, unreachable
from processing.raytrace.picture import Picture

STAGE = "raytrace"
DEFAULT_SAMPLES = 64
_RADIANCE = "W/(m^2 sr)"


@dataclass(frozen=True)
class Simulation:
    """What was made of a scene file."""

    products: Path
    figures: tuple[Path, ...]
    picture: Picture
    notes: tuple[str, ...]
    """What a reader of the picture should know."""


def simulate(
    scene: Path | str,
    products: Path | str,
    *,
    figures: Path | str | None = None,
    progress: Callable[[float], None] | None = None,
) -> Simulation:
    """Trace a scene file and write the stage ``"raytrace"``.

    Arrays (rows, columns): ``s0`` … ``s3`` and their standard errors ``s0_se`` …, ``dolp``, ``dolp_se``, ``aop`` (rad);
    an active scene also has ``mueller`` and ``mueller_se`` (rows, columns, 4, 4), and ``hh, hv, vh, vv``.

    Args:
        scene: a scene file, or the name of one that comes with the program.
        products: the products file; its other stages are kept.
        figures: folder to draw into; nothing is drawn when left out.
        progress: called with the fraction done.

    Raises:
        PolfuseError: a file that cannot be used.
        DataError: a scene that cannot be simulated.
    """
    path = find_scene(str(scene))
    given = read_scene(path)
    picture, notes = trace(given, path.parent, progress)
    arrays, units = _arrays(picture)
    settings: dict[str, Any] = {
        "scene": given.model_dump(),
        "samples": picture.samples,
        "rays": picture.rays,
        "error": picture.error,
        "left_out": [asdict(part) for part in picture.left_out],
    }
    store = Products(products)
    store.write(STAGE, arrays, settings=settings, inputs=[path], units=units)
    drawn: tuple[Path, ...] = ()
    if figures is not None:
        from polfuse_lab.raytrace.figures import draw

        drawn = draw(picture, Path(figures), path.stem, given.title or path.stem)
    return Simulation(store.path, drawn, picture, notes)


def trace(
    given: SceneFile, folder: Path, progress: Callable[[float], None] | None = None
) -> tuple[Picture, tuple[str, ...]]:
    """The picture of a scene, and what to know of it. Raises as :func:`simulate`."""
    scene, view, how = given.world(folder), given.camera.view(), given.trace
    notes: list[str] = []
    if how.method == "forward":
        if unreachable(scene):
            notes.append("smooth surfaces do not show the sources themselves when traced forward")
        picture = forward(scene, view, rays=how.rays, bounces=how.bounces, mueller=how.active, seed=how.seed)
        return picture, tuple(notes)
    samples = how.samples if how.samples is not None or how.error is not None else DEFAULT_SAMPLES
    picture = backward(
        scene,
        view,
        bounces=how.bounces,
        samples=samples,
        error=how.error,
        mueller=how.active,
        seed=how.seed,
        progress=progress,
    )
    if how.error is not None and picture.error > how.error:
        notes.append(f"the error asked for was not reached with {picture.samples} samples for each pixel")
    return picture, tuple(notes)


def _arrays(picture: Picture) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    error = picture.standard_error[..., 0] if picture.is_mueller else picture.standard_error
    arrays: dict[str, NDArray[Any]] = {}
    for i in range(4):
        arrays[f"s{i}"], arrays[f"s{i}_se"] = picture.stokes[..., i], error[..., i]
    units = dict.fromkeys(arrays, _RADIANCE)
    with np.errstate(invalid="ignore"):
        arrays |= {"dolp": picture.dolp, "dolp_se": picture.dolp_error, "aop": picture.aop}
    units |= {"dolp": "1", "dolp_se": "1", "aop": "rad"}
    if picture.is_mueller:
        extra = {"mueller": picture.mean, "mueller_se": picture.standard_error}
        extra |= {name.lower(): plane for name, plane in picture.channels().items()}
        arrays |= extra
        units |= dict.fromkeys(extra, _RADIANCE)
    return arrays, units
