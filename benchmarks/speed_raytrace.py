"""The ray tracer's speed in a scene of 100 000 triangles, beside embreex and Mitsuba 3.

A shaded ray is one from the camera that is traced to its first surface, scattered there as a Mueller matrix, and joined
with a lamp by a shadow ray. Rates are by wall clock with all cores, and by processor time (which a loaded machine
changes less) times the cores.
"""

from __future__ import annotations

import importlib.util
import math
import os
import resource
import time
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from benchmarks.accuracy_raytrace import mitsuba, prepared
from benchmarks.raytrace_scenes import BOUNCES, case
from benchmarks.rows import Row
from processing.raytrace import shapes
from processing.raytrace.backward import backward
from processing.raytrace.bvh import build
from processing.raytrace.materials import Fresnel
from processing.raytrace.sources import PointSource
from processing.raytrace.view import View
from processing.raytrace.world import World, world

TARGET_RAYS_S = 1.5e6
CELLS = 224
"""Of the ground, along each side: 100 352 triangles."""


def run(quick: bool) -> list[Row]:
    """All rows; ``quick`` with fewer rays."""
    scene, view = ground(512 if not quick else 256)
    return [
        _shaded(scene, view, quick),
        _first_hits(quick),
        _slope(quick),
        _to_the_same_error(quick),
    ]


def ground(pixels: int) -> tuple[World, View]:
    """Rough ground of aluminium that fills the picture, and a lamp."""
    mesh = shapes.rough_ground(10.0, CELLS, 0.2)
    lamp = PointSource((3.0, 3.0, 10.0), 100.0)
    scene = world(mesh, [Fresnel(1.02 + 6.84j, 0.3, specular=0.7, diffuse=0.3)], [lamp])
    return scene, View((0.0, 0.0, 12.0), (0.0, 0.0, 0.0), pixels, pixels, math.radians(40.0), (0.0, 1.0, 0.0))


def _timed(work: Callable[[], Any]) -> tuple[Any, float, float]:
    """Result, wall seconds, processor seconds over cores."""
    before, begun = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    made = work()
    seconds, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_SELF)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return made, seconds, used / numba.get_num_threads()


def _shaded(scene: World, view: View, quick: bool) -> Row:
    backward(scene, view, bounces=1, samples=1)
    rays = view.width_px * view.height_px * 2
    walls, used = [], []
    for seed in range(3 if quick else 7):
        _, seconds, processor = _timed(lambda seed=seed: backward(scene, view, bounces=1, samples=2, seed=seed))
        walls.append(rays / seconds)
        used.append(rays / processor)
    wall, own = float(np.median(walls)), float(np.median(used))
    text = (
        f"{wall / 1e6:.2f} million a second by the clock, {own / 1e6:.2f} by processor time, on "
        f"{numba.get_num_threads()} threads (load {os.getloadavg()[0]:.1f}); as many shadow rays besides"
    )
    target = (
        f"at least {TARGET_RAYS_S / 1e6} million shaded rays a second on two cores, {len(scene.material)} triangles"
    )
    ratios = [rate / TARGET_RAYS_S for rate in used]
    return Row(
        "raytrace.shaded", "", own / TARGET_RAYS_S, own >= TARGET_RAYS_S, target, min(ratios), max(ratios), error=text
    )


def _first_hits(quick: bool) -> Row:
    """First hits of rays from a camera: ours by one thread, against embreex, which has one."""
    if importlib.util.find_spec("embreex") is None:
        return Row("raytrace.first_hits", "embreex", None, True, "not compared: embreex is not installed")
    from processing.raytrace.embree import Embree

    mesh = shapes.rough_ground(10.0, CELLS, 0.2)
    side = 256 if quick else 512
    view = View((0.0, 0.0, 12.0), (0.0, 0.0, 0.0), side, side, math.radians(40.0), (0.0, 1.0, 0.0))
    column, row = np.meshgrid(np.arange(side) + 0.5, np.arange(side) + 0.5)
    direction = view.rays(column.ravel(), row.ravel())[0]
    origin = np.tile(np.array(view.position_m), (len(direction), 1))
    tree, embree = build(mesh), Embree(mesh)
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    ours, theirs = [], []
    try:
        tree.closest(origin[:10], direction[:10])
        for _ in range(3 if quick else 7):
            found, _, seconds = _timed(lambda: tree.closest(origin, direction))
            ours.append(seconds)
            other, _, seconds = _timed(lambda: embree.closest(origin, direction))
            theirs.append(seconds)
    finally:
        numba.set_num_threads(threads)
    ratios = [b / a for a, b in zip(ours, theirs, strict=True)]
    same = float(np.mean(found.triangle == other.triangle))
    # Near an edge float32 may choose the neighbour, whose plane is met at the same distance.
    near = float(np.mean(np.isclose(found.distance, other.distance, rtol=1e-5)))
    rate = len(direction) / 1e6
    text = (
        f"{rate / np.median(ours):.2f} million a second, embreex {rate / np.median(theirs):.2f} (to float64), by one "
        f"thread; the same triangle for {100 * same:.3f} %, the same distance to 1e-5 for {100 * near:.3f} %"
    )
    ratio = float(np.median(ratios))
    return Row(
        "raytrace.first_hits", "embreex", ratio, near > 0.9999, "distances agree", min(ratios), max(ratios), error=text
    )


def _slope(quick: bool) -> Row:
    """Error against processor time: a straight line of slope -1/2."""
    given = case("trihedral", "rough aluminium", 32)
    scene = prepared(given)
    backward(scene, given.view, bounces=BOUNCES, samples=1)
    truth = backward(scene, given.view, bounces=BOUNCES, samples=4_000 if quick else 30_000, seed=99)
    level, own = float(truth.mean[..., 0].mean()), float(np.mean(truth.standard_error**2))
    # From where a call's own cost no longer counts beside that of its rays.
    counts = [16, 64, 256, 1024] if quick else [16, 64, 256, 1024, 4096]
    errors, seconds = [], []
    for count in counts:
        made, _, used = _timed(lambda count=count: backward(scene, given.view, bounces=BOUNCES, samples=count))
        # What is left of the truth's own noise is taken off.
        errors.append(math.sqrt(float(np.mean((made.mean - truth.mean) ** 2)) - own) / level)
        seconds.append(used)
    slope, start = np.polyfit(np.log(seconds), np.log(errors), 1)
    off = float(np.max(np.abs(np.log(errors) - slope * np.log(seconds) - start)))
    text = f"slope {slope:.3f}, off the line by at most {100 * off:.0f} %: " + ", ".join(
        f"{100 * e:.2g} % in {s:.3g} s" for e, s in zip(errors, seconds, strict=True)
    )
    return Row("raytrace.convergence", "", None, abs(slope + 0.5) < 0.05, "slope -0.5 +- 0.05 in log-log", error=text)


def _to_the_same_error(quick: bool) -> Row:
    """Time to one error, ours and Mitsuba's, both by the clock with all cores."""
    if importlib.util.find_spec("mitsuba") is None:
        return Row("raytrace.time_to_error", "Mitsuba 3", None, True, "not compared: mitsuba is not installed")
    given = case("trihedral", "rough aluminium", 64)
    scene = prepared(given)
    samples, runs = (64, 6) if quick else (256, 8)
    pictures, their_seconds = mitsuba(given, samples, runs)
    their_error = float(np.sqrt(np.mean(pictures.var(axis=0, ddof=1)[..., 0]))) / float(pictures[..., 0].mean())
    backward(scene, given.view, bounces=BOUNCES, samples=1)
    errors, seconds = [], []
    for seed in range(runs):
        made, clock, _ = _timed(
            lambda seed=seed: backward(scene, given.view, bounces=BOUNCES, samples=samples, seed=seed)
        )
        errors.append(float(np.sqrt(np.mean(made.standard_error[..., 0] ** 2))) / float(made.mean[..., 0].mean()))
        seconds.append(clock)
    # Time goes as 1 / error^2: theirs, scaled to our error.
    scaled = their_seconds * (their_error / float(np.median(errors))) ** 2
    ratios = np.sort(scaled / np.median(seconds))
    text = f"{100 * np.median(errors):.3g} % in {np.median(seconds):.3f} s (load {os.getloadavg()[0]:.1f})"
    peer = f"{np.median(scaled):.3f} s ({100 * their_error:.3g} % in {np.median(their_seconds):.3f} s)"
    return Row(
        "raytrace.time_to_error",
        "Mitsuba 3",
        float(np.median(ratios)),
        True,
        "stated",
        float(ratios[0]),
        float(ratios[-1]),
        text,
        peer,
    )
