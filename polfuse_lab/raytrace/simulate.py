"""Scene file to products and figures: the stage ``"raytrace"``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.store import Products
from polfuse_lab.raytrace.scene_file import SceneFile, find_scene, read_scene
from processing.raytrace.backward import backward
from processing.raytrace.forward import forward, unreachable
from processing.raytrace.picture import Picture
from processing.raytrace.planner import TracePlan, trace_to

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
    plan: TracePlan | None = None
    """How a tolerance chose rays and bounces; None where the scene file told them."""


def simulate(
    scene: Path | str,
    products: Path | str,
    *,
    figures: Path | str | None = None,
    tolerance_db: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> Simulation:
    """Trace a scene file and write the stage ``"raytrace"``.

    Arrays (rows, columns): ``s0`` … ``s3`` and their standard errors ``s0_se`` …, ``dolp``, ``dolp_se``, ``aop`` (rad);
    an active scene also has ``mueller`` and ``mueller_se`` (rows, columns, 4, 4), and ``hh, hv, vh, vv``.

    Args:
        scene: a scene file, or the name of one that comes with the program.
        products: the products file; its other stages are kept.
        figures: folder to draw into; nothing is drawn when left out.
        tolerance_db: largest error, dB below the picture: chooses samples and bounces in place of the scene's.
        progress: called with the fraction done.

    Raises:
        PolfuseError: a file that cannot be used.
        DataError: a scene that cannot be simulated.
    """
    path = find_scene(str(scene))
    given = read_scene(path)
    if tolerance_db is None:
        plan = None
        picture, notes = trace(given, path.parent, progress)
    else:
        picture, plan, notes = trace_within(given, path, tolerance_db, progress)
    arrays, units = _arrays(picture)
    settings: dict[str, Any] = {
        "scene": given.model_dump(),
        "samples": picture.samples,
        "rays": picture.rays,
        "error": picture.error,
        "left_out": [asdict(part) for part in picture.left_out],
        **({} if plan is None else told(plan)),
    }
    store = Products(products)
    store.write(STAGE, arrays, settings=settings, inputs=[path], units=units)
    drawn: tuple[Path, ...] = ()
    if figures is not None:
        from polfuse_lab.raytrace.figures import draw

        drawn = draw(picture, Path(figures), path.stem, given.title or path.stem)
    return Simulation(store.path, drawn, picture, notes, plan)


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


def trace_within(
    given: SceneFile, path: Path, tolerance_db: float, progress: Callable[[float], None] | None = None
) -> tuple[Picture, TracePlan, tuple[str, ...]]:
    """The picture of a scene with rays and bounces by a tolerance. Raises as :func:`simulate`."""
    how = given.trace
    if how.method == "forward":
        raise PolfuseError(
            "a tolerance chooses rays and bounces of tracing from the camera", where=str(path),
            advice='leave trace.method = "forward" out, or the tolerance',
        )  # fmt: skip
    picture, plan = trace_to(
        given.world(path.parent), given.camera.view(), tolerance_db, mueller=how.active, seed=how.seed,
        progress=progress,
    )  # fmt: skip
    notes: list[str] = []
    if not plan.samples:
        notes.append(f"no light was met by {plan.pilot_rays} rays")
    elif not plan.reached:
        notes.append(
            f"the tolerance of {tolerance_db:g} dB was not reached with {plan.samples} rays of a pixel: "
            f"{plan.predicted_error_db:.1f} dB are expected"
        )
    if plan.caustics:
        notes.append("what mirrors throw of the sun on other surfaces is met by chance: no error is foretold of it")
    return picture, plan, tuple(notes)


def told(plan: TracePlan) -> dict[str, Any]:
    """A plan as products and JSON keep it: plain numbers, None where there is no error or no light."""
    values = {
        name: getattr(plan, name)
        for name in ("tolerance_db", "predicted_error_db", "noise_db", "left_out_db", "forecast_db", "bounces")
    }
    plain = {name: value if math.isfinite(value) else None for name, value in values.items()}
    return {**plain, "reached": plan.reached, "explanation": plan.explain()}


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
