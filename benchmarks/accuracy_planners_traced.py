"""Planners of rays, of light and of radar: what they expect against what a much denser reference measures, on random
small scenes, and what their choice costs against the best that would have met the tolerance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row
from benchmarks.traced_scenes import Yard, random_light, random_yard
from processing.radar.phase_history import history_profiles
from processing.raytrace.backward import Run
from processing.raytrace.planner import MOST_BOUNCES, trace_to
from processing.sar.backprojection import backproject
from processing.scattering.shooting import Density
from processing.scene.radar_planner import TRUTH_CELL, plan_radar
from processing.scene.radar_simulation import RadarLook, simulate_radar

SCENES, QUICK = 200, 8
QUICK_YARDS = 3
"""A radar's plan, reference and rival take some seconds each."""
FACTOR_DB = 6.02
"""A factor of two."""


@dataclass(frozen=True)
class Outcome:
    """One scene, planned, carried out and measured."""

    seed: int
    tolerance_db: float
    predicted_db: float
    measured_db: float
    cost: float
    """Of the choice over that of the cheapest that would have met the tolerance."""
    promised: bool = True
    """Whether the planner said that the tolerance is kept."""

    @property
    def off_db(self) -> float:
        """Measured over expected: positive where the planner was optimistic."""
        return self.measured_db - self.predicted_db


def carry_out_light(seed: int) -> Outcome:
    """Trace one random scene to a random tolerance; measured against up to 6000 rays of each pixel of another seed."""
    tolerance = float(np.random.default_rng(seed + 1_000_000).uniform(-30, -18))
    scene, view = random_light(seed)
    picture, plan = trace_to(scene, view, tolerance, seed=seed)
    every = np.ones((MOST_BOUNCES + 1, len(scene.sources)), dtype=bool)
    reference = Run(scene, view, False, seed + 777, every)
    shares = reference.shares()
    reference.add(int(np.clip(4 * plan.samples, 1024, 6000)), shares)
    mean, deviation = reference.statistics()
    noise = float(np.sum(deviation**2))
    size = float(np.sum(mean**2)) - noise
    # The reference has noise of its own, which is known.
    apart = max(float(np.sum((picture.mean - mean) ** 2)) - noise, 1e-3 * noise)
    # The best: for every number of bounces the rays that the reference's own variance asks for.
    light = shares[0, ..., :-1].sum(axis=2) / reference.samples
    allowed = 10 ** (tolerance / 10)
    lamps = int(np.sum(scene.sources[:, 0] != 4))
    alive = shares[0, ..., -1].sum(axis=0) / (len(light) * reference.samples)
    best = math.inf
    for bounces in range(MOST_BOUNCES + 1):
        room = allowed - float(np.sum(light[:, bounces + 1 :].sum(axis=1) ** 2)) / size
        if room > 0:
            rays = alive[: bounces + 1].sum() + lamps * alive[1 : bounces + 1].sum()
            best = min(best, rays * max(1.0, noise * reference.samples / size / room))
    # Fewer rays than the first look's are never taken.
    cost = plan.rays / max(best * len(light), plan.pilot_rays)
    return Outcome(seed, tolerance, plan.predicted_error_db, 10 * math.log10(apart / size), cost)


def carry_out_radar(seed: int) -> Outcome:
    """Simulate one random yard to a random tolerance; measured, as a picture, against denser rays from every pulse."""
    tolerance = float(np.random.default_rng(seed + 1_000_000).uniform(-24, -10))
    yard = random_yard(seed)
    plan = plan_radar(yard.scene, yard.look, tolerance)
    cells = [one.density for one in plan.considered]
    finest = min(d.cell_m / 2**d.levels for d in cells)
    cell = min(0.83 * min(d.cell_m for d in cells), TRUTH_CELL * yard.look.sweep.wavelength_m)
    dense = Density(cell, max(math.ceil(math.log2(cell / finest * 2)), 0), 7)
    segments = min(2 * plan.segments + 1, len(yard.look.track_m))
    truth = _picture(yard, replace(yard.look, density=dense, turn_rad=plan.turn_rad * plan.segments / segments))

    def off(density: Density) -> float:
        made = _picture(yard, replace(yard.look, density=density, turn_rad=plan.turn_rad))
        return float(20 * np.log10(np.linalg.norm(made - truth) / np.linalg.norm(truth)))

    # Of all that are cheaper by more than 1.5 the one that was expected to be best stands for them.
    chosen = next(one.seconds for one in plan.considered if one.density == plan.density)
    cheaper = [one for one in plan.considered if one.seconds < chosen / 1.5]
    rival = min(cheaper, key=lambda one: one.error_db, default=None)
    beaten = rival is not None and plan.reached and off(rival.density) <= tolerance
    cost = chosen / rival.seconds if rival is not None and beaten else 1.0
    return Outcome(seed, tolerance, plan.predicted_error_db, off(plan.density), cost, plan.reached)


def _picture(yard: Yard, look: RadarLook) -> NDArray[np.complex64]:
    """Focused with Hann's windows, as simulations are."""
    weights = np.hanning(len(look.track_m) + 2)[1:-1]
    profiles = history_profiles(simulate_radar(yard.scene, look).total, window="hann")
    return np.asarray(backproject(profiles, yard.grid, weights=weights))


def run(quick: bool) -> list[Row]:
    """Rows: expected errors against measured ones, and costs against the best."""
    seeds = range(QUICK if quick else SCENES)
    yards = range(QUICK_YARDS if quick else SCENES)
    return [
        *_rows("light", [carry_out_light(seed) for seed in seeds]),
        *_rows("radar", [carry_out_radar(seed) for seed in yards]),
    ]


def _rows(what: str, given: list[Outcome]) -> list[Row]:
    """Where a planner says that nothing on offer is sure to keep the tolerance, its bound is judged from above only."""
    outcomes = [one for one in given if one.promised]
    worst = max(one.off_db for one in given)
    off = np.array([one.off_db for one in outcomes])
    within = float(np.mean(np.abs(off) <= FACTOR_DB))
    cost = np.array([one.cost for one in outcomes])
    over_db = [one.measured_db - one.tolerance_db for one in outcomes]
    kept, over = float(np.mean(np.array(over_db) <= 0)), max(over_db)
    name = f"accuracy.planners_traced.{what}"
    return [
        Row(
            name,
            "measured error",
            float(10 ** (np.median(off) / 20)),
            bool(within >= 0.95 and worst <= FACTOR_DB),
            f"within a factor of 2 on 95 % of {len(off)} scenes, never optimistic by more than 6 dB",
            float(10 ** (off.min() / 20)),
            float(10 ** (off.max() / 20)),
            f"{100 * within:.1f} % within, {off.min():+.1f} to {off.max():+.1f} dB over the expected error; "
            f"{len(given) - len(outcomes)} of {len(given)} not promised",
        ),
        Row(
            f"{name}.cost",
            "cheapest setting within the tolerance",
            float(np.median(cost)),
            bool(np.mean(cost <= 1.5) >= 0.95),
            "within 1.5 times the cost of the best that would have met the tolerance, on 95 %",
            float(cost.min()),
            float(cost.max()),
            f"{100 * np.mean(cost <= 1.5):.1f} % within 1.5; the tolerance was met by {100 * kept:.1f} % of "
            f"{len(over_db)} that promised it and missed by {max(over, 0):.1f} dB at most",
        ),
    ]
