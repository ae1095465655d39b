"""The focusing planner's expected errors against measured ones on random collects: ``accuracy.focus_planner``.

Each collect draws a track (rail, bent rail, circle, flight), a scene, a waveform and a tolerance; the planner chooses,
the choice is carried out, and the image is compared with the closed form of the exact float64 matched filter.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.focus_geometries import MARGIN_CELLS, Collect, random_collect, relative_error_db
from benchmarks.rows import Row
from processing.errors import DataError
from processing.radar.profiles import RangeProfiles
from processing.sar.aperture import widest_angle_rad
from processing.sar.backprojection import backproject, backproject_reference
from processing.sar.factorized import factorized
from processing.sar.focus_costs import RANGING_NS, machine_scale
from processing.sar.planner import SAFETY_DB, Choice, Task, choose
from processing.sar.polar_format import polar_format
from processing.sar.polar_format_geometry import polar_forecast
from processing.sar.range_migration import range_migration
from processing.sar.straight_track import straight_track

COLLECTS, QUICK = 100, 8
FACTOR_DB = 6.02
"""A factor of two."""


@dataclass(frozen=True)
class Outcome:
    """One collect, planned and carried out."""

    kind: str
    choice: Choice
    tolerance_db: float
    measured_db: float
    seconds_ratio: float
    """Core time over the expected one."""

    @property
    def off_db(self) -> float:
        """Measured over expected: positive where the planner was optimistic."""
        return self.measured_db - self.choice.predicted_error_db


def task_of(collect: Collect) -> Task:
    """What the planner is told of a collect."""
    try:
        wavelength = 4 * np.pi / collect.k_rad_m
        residual: float | None = None
        if collect.kind == "rail":
            residual = straight_track(collect.antenna_m, wavelength).residual_m
    except DataError:
        residual = None
    places = np.stack([axis.ravel() for axis in collect.grid.places_m()], axis=1)
    away = np.linalg.norm(places[[0, -1]][:, None] - collect.antenna_m, axis=2)
    return Task(
        pixels=places.shape[0],
        pulses=len(collect.antenna_m),
        channels=1,
        oversampling=None,
        wavelength_m=4 * np.pi / collect.k_rad_m,
        furthest_m=float(away.max()),
        widest_rad=widest_angle_rad(collect.antenna_m, collect.grid),
        residual_m=residual,
        compensated=False,
        window=collect.window,
        antenna_m=collect.antenna_m,
        grid=collect.grid,
        bandwidth_hz=collect.bandwidth_hz,
        depth_m=float(np.ptp(away)) + 2 * MARGIN_CELLS * collect.cell_m,
        polar=polar_forecast(collect.antenna_m, collect.grid, 4 * np.pi / collect.k_rad_m, collect.bandwidth_hz),
    )


def carry_out(seed: int) -> Outcome:
    """Plan and focus the collect of one seed with a random tolerance and, often, a method asked for."""
    rng = np.random.default_rng(seed + 1_000_000)
    collect = random_collect(seed)
    tolerance = float(rng.uniform(-105, -25))
    methods = ("auto", "bp", "ffbp", "rma") if collect.kind == "rail" else ("auto", "bp", "ffbp")
    task = task_of(collect)
    if task.polar is not None:
        methods += ("pfa",)
    choice = choose(task, tolerance, str(rng.choice(methods)))
    profiles = collect.profiles(choice.oversampling)
    # Twice: the first time may compile.
    seconds = math.inf
    for _ in range(2):
        begun = time.process_time()
        image = form(choice, profiles, collect, tolerance)
        seconds = min(seconds, time.process_time() - begun)
    measured = relative_error_db(image, collect.image())
    # The closed form stands in for range compression.
    ranging = 1e-9 * RANGING_NS * choice.oversampling * task.cells * task.pulses
    return Outcome(collect.kind, choice, tolerance, measured, seconds / ((choice.seconds - ranging) * machine_scale()))


def form(choice: Choice, profiles: RangeProfiles, collect: Collect, tolerance_db: float) -> NDArray[np.complex64]:
    """Focus a collect as it was chosen."""
    if choice.method == "rma":
        image = range_migration(profiles, collect.grid)
    elif choice.method == "pfa":
        image = polar_format(profiles, collect.grid)
    elif choice.method == "ffbp":
        image = factorized(profiles, collect.grid, tolerance_db=choice.settings_db or tolerance_db)
    elif choice.method == "reference":
        image = backproject_reference(profiles, collect.grid).astype(np.complex64)
    else:
        image = backproject(profiles, collect.grid, interpolator=choice.interpolator)
    only: NDArray[np.complex64] = image[0]
    return only


def run(quick: bool) -> list[Row]:
    """Rows: how far off the predictions are, and whether tolerances that were promised are kept."""
    outcomes = [carry_out(seed) for seed in range(QUICK if quick else COLLECTS)]
    off = np.array([one.off_db for one in outcomes])
    promised = [
        one for one in outcomes if one.choice.predicted_error_db <= one.tolerance_db - SAFETY_DB[one.choice.method]
    ]
    kept = np.mean([one.measured_db <= one.tolerance_db for one in promised]) if promised else 1.0
    within = float(np.mean(np.abs(off) <= FACTOR_DB))
    rows = [
        Row(
            "accuracy.focus_planner",
            "measured error, all methods",
            float(10 ** (np.median(off) / 20)),
            bool(within == 1.0),
            f"expected within a factor of 2 of measured on {len(off)} collects",
            float(10 ** (off.min() / 20)),
            float(10 ** (off.max() / 20)),
            f"{100 * within:.0f} % within a factor of 2",
        ),
        Row(
            "accuracy.focus_planner.optimism",
            "",
            None,
            bool(off.max() <= FACTOR_DB),
            "never optimistic by more than 6 dB",
            error=f"{off.max():+.1f} dB at most",
        ),
        Row(
            "accuracy.focus_planner.tolerance",
            "",
            None,
            bool(kept >= 0.99),
            "tolerances that were promised are kept",
            error=f"{100 * kept:.0f} % of {len(promised)}",
        ),
    ]
    for method in ("bp", "ffbp", "rma", "pfa", "reference"):
        own = [one for one in outcomes if one.choice.method == method]
        if own:
            spread = [one.off_db for one in own]
            times = [one.seconds_ratio for one in own]
            rows.append(
                Row(
                    f"accuracy.focus_planner.{method}",
                    "expected core time",
                    float(np.median(times)),
                    bool(max(spread) <= FACTOR_DB),
                    f"{len(own)} collects",
                    float(min(times)),
                    float(max(times)),
                    f"{min(spread):+.1f} to {max(spread):+.1f} dB over the expected error",
                )
            )
    return rows
