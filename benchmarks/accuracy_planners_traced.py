"""Planners of rays, of light and of radar: what they expect against what a much denser reference measures, on random
small scenes, and what their choice costs against the best that would have met the tolerance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.rows import Row
from benchmarks.traced_scenes import random_light
from processing.raytrace.backward import Run
from processing.raytrace.planner import MOST_BOUNCES, trace_to

SCENES, QUICK = 200, 8
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
    cost = plan.rays / (len(light) * max(best, plan.pilot_rays / len(light)))
    return Outcome(seed, tolerance, plan.predicted_error_db, 10 * math.log10(apart / size), cost)


def run(quick: bool) -> list[Row]:
    """Rows: expected errors against measured ones, and costs against the best."""
    seeds = range(QUICK if quick else SCENES)
    return _rows("light", [carry_out_light(seed) for seed in seeds])


def _rows(what: str, outcomes: list[Outcome]) -> list[Row]:
    off = np.array([one.off_db for one in outcomes])
    within = float(np.mean(np.abs(off) <= FACTOR_DB))
    cost = np.array([one.cost for one in outcomes])
    kept = float(np.mean([one.measured_db <= one.tolerance_db for one in outcomes]))
    over = max(one.measured_db - one.tolerance_db for one in outcomes)
    name = f"accuracy.planners_traced.{what}"
    return [
        Row(
            name,
            "measured error",
            float(10 ** (np.median(off) / 20)),
            bool(within >= 0.95 and off.max() <= FACTOR_DB),
            f"within a factor of 2 on 95 % of {len(off)} scenes, never optimistic by more than 6 dB",
            float(10 ** (off.min() / 20)),
            float(10 ** (off.max() / 20)),
            f"{100 * within:.1f} % within, {off.min():+.1f} to {off.max():+.1f} dB over the expected error",
        ),
        Row(
            f"{name}.cost",
            "cheapest setting within the tolerance",
            float(np.median(cost)),
            bool(np.mean(cost <= 1.5) >= 0.95),
            "within 1.5 times the cost of the best that would have met the tolerance, on 95 %",
            float(cost.min()),
            float(cost.max()),
            f"{100 * np.mean(cost <= 1.5):.1f} % within 1.5; the tolerance was met by {100 * kept:.1f} % and missed by "
            f"{max(over, 0):.1f} dB at most",
        ),
    ]
