"""The ray tracer against Mitsuba 3 (polarized), against itself from the other end, and Fresnel's closed forms.

Mitsuba runs in a process of its own. Each Stokes component is compared in blocks of pixels, in units of the standard
error of both; of many independent comparisons 0.27 % lie beyond 3 by chance, so that share is what is judged, and the
largest deviation against what the number of comparisons lets expect.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import norm

from benchmarks.raytrace_scenes import BODIES, BOUNCES, SURFACES, Case, case, of_blocks
from benchmarks.rows import Row
from processing.optics.fresnel import amplitudes, brewster
from processing.raytrace.backward import backward
from processing.raytrace.forward import forward
from processing.raytrace.picture import Picture
from processing.raytrace.triangles import joined
from processing.raytrace.view import View
from processing.raytrace.world import World, world

BLOCK = 4
TIMEOUT_S = 900


def run(quick: bool) -> list[Row]:
    """All comparisons; ``quick`` takes one body of each surface."""
    rows = [_fresnel_table(), _brewster(), *_both_ways(quick)]
    if importlib.util.find_spec("mitsuba") is None:
        return [*rows, Row("raytrace.mitsuba", "Mitsuba 3", None, True, "not compared: mitsuba is not installed")]
    cases = [(body, surface) for body in (BODIES[1:2] if quick else BODIES) for surface in SURFACES]
    return rows + [_against_mitsuba(case(body, surface, 32), quick) for body, surface in cases]


def prepared(given: Case) -> World:
    """The scene of a case."""
    mesh = joined([given.body.of_material(0), given.screen.of_material(1)])
    return world(mesh, given.materials, [given.lamp])


def mitsuba(given: Case, samples: int, runs: int) -> tuple[np.ndarray, np.ndarray]:
    """Mitsuba's pictures (runs, rows, columns, 4), and the seconds that each took."""
    with tempfile.TemporaryDirectory() as folder:
        scene, out = Path(folder) / "scene.json", Path(folder) / "out.npz"
        given.write(scene)
        command = [sys.executable, "-m", "benchmarks.raytrace_mitsuba", str(scene), str(out), str(samples), str(runs)]
        subprocess.run(command, check=True, timeout=TIMEOUT_S, stdout=subprocess.DEVNULL, env=os.environ)
        with np.load(out) as made:
            return made["pictures"], made["seconds"]


def _against_mitsuba(given: Case, quick: bool) -> Row:
    pictures, _ = mitsuba(given, 64, 8 if quick else 16)
    ours = backward(prepared(given), given.view, bounces=BOUNCES, samples=512 if quick else 1536)
    theirs, their_error = pictures.mean(axis=0), pictures.std(axis=0, ddof=1) / np.sqrt(len(pictures))
    return compare(f"raytrace.mitsuba.{given.name}", "Mitsuba 3", ours, theirs, their_error)


def compare(name: str, peer: str, ours: Picture, theirs: np.ndarray, their_error: np.ndarray) -> Row:
    """Blocks of both pictures in units of their standard errors."""
    mean, error = of_blocks(ours.mean, ours.standard_error, BLOCK)
    other, other_error = of_blocks(theirs, their_error, BLOCK)
    total = np.hypot(error, other_error)
    level = mean[..., 0].mean()
    # Where both say exactly the same (S3 of one reflection) there is no error to divide by, but float32's rounding.
    noisy = total > 1e-7 * level
    z = np.abs(mean - other)[noisy] / total[noisy]
    same = bool(np.all(np.abs(mean - other)[~noisy] <= 1e-6 * level))
    beyond = float(np.mean(z > 3))
    # Of n comparisons the largest is below this in 99.9 % of all runs.
    limit = float(norm.isf(0.001 / (2 * z.size)))
    allowed = 0.0027 + 4 * np.sqrt(0.0027 / z.size)
    text = (
        f"{100 * beyond:.2f} % of {z.size} beyond 3 standard errors, rms {np.sqrt(np.mean(z * z)):.2f}, largest "
        f"{z.max():.2f}; error {100 * np.sqrt(np.mean(total[..., 0] ** 2)) / level:.2f} % of the mean S0 in a block"
    )
    good = bool(same and beyond <= allowed and float(z.max()) < limit)
    return Row(name, peer, None, good, f"at most {100 * allowed:.2f} % beyond 3, none beyond {limit:.1f}", error=text)


def _both_ways(quick: bool) -> list[Row]:
    rows = []
    for body in BODIES[:1] if quick else BODIES:
        given = case(body, "rough aluminium", 16)
        # A small screen: a camera that stands in the light of a large one is lit by few rays of it.
        scene = prepared(given)
        view = View(given.view.position_m, given.view.target_m, 16, 16, given.view.field_rad)
        back = backward(scene, view, bounces=3, samples=1016)
        fore = forward(scene, view, bounces=3, rays=2_000_000)
        row = compare(f"raytrace.both_ways.{body}", "forward from the source", back, fore.mean, fore.standard_error)
        rows.append(row)
    return rows


def _fresnel_table() -> Row:
    """Reflectances by the other textbook form: tan and sin of both angles (Born and Wolf 1.5.2, dielectrics)."""
    worst = 0.0
    for n in (1.33, 1.5, 1.7, 2.4):
        angle = np.radians(np.arange(1, 90))
        inside = np.arcsin(np.sin(angle) / n)
        s = (np.sin(angle - inside) / np.sin(angle + inside)) ** 2
        p = (np.tan(angle - inside) / np.tan(angle + inside)) ** 2
        ss, pp = amplitudes(n, np.cos(angle))
        worst = max(worst, float(np.max(np.abs(np.abs(ss) ** 2 - s))), float(np.max(np.abs(np.abs(pp) ** 2 - p))))
    return Row("raytrace.fresnel", "Born and Wolf's form", None, worst < 1e-6, "below 1e-6", error=worst)


def _brewster() -> Row:
    indices = np.array([1.2, 1.33, 1.5, 2.0, 3.5])
    worst = max(float(np.abs(amplitudes(n, np.cos(brewster(n)))[1])) ** 2 for n in indices)
    return Row("raytrace.brewster", "closed form", None, worst < 1e-6, "R_p below 1e-6", error=worst)
