"""How well moving targets are found and their velocities measured, in simulated collects with the geometry of thesis
Table 8.1 (240 m/s, 15 km, 4.5 degrees, 80 MHz, 362.53 Hz), behind ground clutter and noise.

Each collect holds one target of random place, random speed along the track of 3 to 12 m/s and in slant range of 3 to
18 m/s (the pulses are unambiguous up to 21.6), both ways. The clutter lies 39 dB, the noise 45 dB below a focused
target: a lorry of 30 dBsm on ground of -17 dB. The error is the length of the velocity's error vector on the ground
over the velocity's length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.rows import Row
from processing.errors import DataError
from processing.motion.estimate import EstimateSettings, MovingTarget, estimate_motion
from processing.motion.prediction import Passage, appearance
from processing.motion.radon import RadonSettings, line_scores, threshold
from processing.motion.search import Found, cell_px, find_moving
from processing.motion.simulation import (
    Collect,
    MovingPoint,
    ground_clutter,
    history_of,
    moving_history,
    receiver_noise,
    strip_collect,
)
from processing.radar.phase_history import history_profiles
from processing.radar.profiles import RangeProfiles
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid

SPEED, HEIGHT = 240.0, 15_000.0
WITHIN = 0.05
CLUTTER, NOISE = 20.0, 12.5
"""Mean power of an echo; a target's is 1, and 57 dB more when all its pulses and frequencies are summed."""
LOOK = ImageGrid(np.arange(-1900.0, 1901.0, 2.0), np.arange(14_820.0, 15_071.0, 2.0), -HEIGHT)


def run(quick: bool) -> list[Row]:
    """Velocities, their uncertainties, and false alarms; ``quick`` takes 4 targets instead of 20 and less ground."""
    collect = strip_collect()
    trials = [_trial(collect, seed) for seed in range(4 if quick else 20)]
    return [*_velocities(trials), _known_place(trials), *_alarms(2 if quick else 12)]


@dataclass(frozen=True)
class _Trial:
    point: MovingPoint
    found: Found
    by_place: MovingTarget | None
    """Measured with the place known to 5 m, behind clutter and noise that are 6 dB stronger."""


def _trial(collect: Collect, seed: int) -> _Trial:
    random = np.random.default_rng(1000 + seed)
    along, slant = random.uniform([3, 3], [12, 18]) * random.choice([-1, 1], 2)
    place = (float(random.uniform(-100, 100)), 15_000.0 + float(random.uniform(-30, 30)), -HEIGHT)
    away = slant * float(np.hypot(place[1], HEIGHT)) / place[1]
    point = MovingPoint(place, (float(along), float(away), 0.0))
    echoes = moving_history([point], collect).echoes[0]
    behind = ground_clutter(collect, CLUTTER, random) + receiver_noise(collect, NOISE, random)
    profiles = _profiles(echoes + behind, collect)
    found = find_moving(profiles, collect.time_s, LOOK, beamwidth_rad=collect.beamwidth_rad)
    by_place = None
    if found.targets:
        known = place[0] + float(random.normal(0, 5.0))
        settings = EstimateSettings(place_x_m=known, place_sd_m=5.0)
        # Where the search saw it: the path's own place at the moment it was abeam.
        at = (place[0] + found.targets[0].shift_m, found.targets[0].path.y_m, -HEIGHT)
        try:
            by_place = estimate_motion(
                _profiles(echoes + 2 * behind, collect), collect.time_s, at, beamwidth_rad=None, settings=settings
            )
        except DataError:
            by_place = None
    return _Trial(point, found, by_place)


def collected(point: MovingPoint, collect: Collect, random: np.random.Generator) -> RangeProfiles:
    """Range profiles of one target behind the clutter and noise of this benchmark."""
    behind = ground_clutter(collect, CLUTTER, random) + receiver_noise(collect, NOISE, random)
    return _profiles(moving_history([point], collect).echoes[0] + behind, collect)


def seen_at(point: MovingPoint) -> tuple[float, float, float]:
    """Where the picture of what stands shows a point, from the geometry alone."""
    x, y, z = point.position_m
    along, away, _ = point.velocity_m_s
    abeam = x / (SPEED - along)
    y += away * abeam
    slant = float(np.hypot(y, z))
    shift = -away * y / SPEED
    return x + along * abeam + shift, float(np.sqrt(slant**2 - shift**2 - z**2)), z


def _profiles(echoes: np.ndarray, collect: Collect) -> RangeProfiles:
    return history_profiles(history_of(echoes, collect), oversampling=2)


def _error(target: MovingTarget, point: MovingPoint) -> float:
    truth = np.asarray(point.velocity_m_s)
    return float(np.linalg.norm(np.asarray(target.velocity_m_s) - truth) / np.linalg.norm(truth))


def _velocities(trials: list[_Trial]) -> list[Row]:
    found = [(trial.found.targets[0], trial.point) for trial in trials if trial.found.targets]
    extra = sum(max(len(trial.found.targets) - 1, 0) for trial in trials)
    errors = [_error(target, point) for target, point in found]
    worst = max(errors, default=float("inf"))
    good = sum(error < WITHIN for error in errors)
    rows = [
        Row("motion.velocity", "the truth", worst / WITHIN, good == len(trials) and extra == 0,
            f"all of {len(trials)} random targets within 5 %, nothing else found",
            error=f"{good} within, worst {100 * worst:.2f} %, median {100 * float(np.median(errors)):.2f} %, "
                  f"{len(trials) - len(found)} missed, {extra} false")
    ]  # fmt: skip
    for name, axis, sd in (("azimuth", 0, "azimuth_sd_m_s"), ("range", 1, "ground_sd_m_s")):
        scaled = [(t.velocity_m_s[axis] - p.velocity_m_s[axis]) / getattr(t, sd) for t, p in found]
        rms = float(np.sqrt(np.mean(np.square(scaled))))
        away = [abs(t.velocity_m_s[axis] - p.velocity_m_s[axis]) for t, p in found]
        # Errors of n targets over their sds have an rms of 1 within some 1 / sqrt(2 n).
        allowed = 3 / np.sqrt(2 * len(found))
        rows.append(
            Row(f"motion.uncertainty_{name}", "its standard deviation", rms, bool(abs(rms - 1) < allowed),
                f"rms of error over sd within {allowed:.2f} of 1",
                error=f"{float(np.median(away)):.4f} m/s median, {max(away):.4f} m/s largest error")
        )  # fmt: skip
    return rows


def _known_place(trials: list[_Trial]) -> Row:
    told = [(trial.by_place, trial.point) for trial in trials if trial.by_place is not None]
    errors = [_error(target, point) for target, point in told]
    worst = max(errors, default=float("inf"))
    passage = Passage(SPEED, HEIGHT * np.sqrt(2), 0.2384, 6.95, 362.53)
    per_metre = 1 / abs(appearance(passage, 0.0, 1.0).shift_m)
    return Row(
        "motion.velocity_by_place", "the truth", worst / WITHIN, worst < WITHIN and len(told) == len(trials),
        "within 5 % behind 6 dB more clutter and noise, where the place is known to 5 m (road, camera)",
        error=f"{len(told)} of {len(trials)} measured, worst {100 * worst:.2f} %; a metre is {per_metre:.4f} m/s",
    )  # fmt: skip


def _alarms(collects: int) -> list[Row]:
    """Tiles of focused ground without any target, side by side, against the rate that was set."""
    collect = strip_collect(seconds=10.0, swath_m=1900.0)
    grid = ImageGrid(np.arange(-600.0, 601.0, 2.0), np.arange(14_300.0, 15_700.0, 2.0), -HEIGHT)
    rates = (1e-1, 1e-2, 1e-3)
    alarms, tiles_seen = dict.fromkeys(rates, 0), 0
    for seed in range(collects):
        random = np.random.default_rng(seed)
        echoes = ground_clutter(collect, 1.0, random) + receiver_noise(collect, 0.1, random)
        profiles = _profiles(echoes, collect)
        power = np.abs(backproject(profiles, grid)[0].astype(np.complex128)) ** 2
        side = RadonSettings().tile_px
        tiles = np.stack(
            [
                power[r : r + side, c : c + side]
                for r in range(0, power.shape[0] - side + 1, side)
                for c in range(0, power.shape[1] - side + 1, side)
            ]
        )
        tiles_seen += len(tiles)
        cell = cell_px(profiles, grid, collect.beamwidth_rad)
        for rate in rates:
            settings = RadonSettings(false_alarm=rate)
            largest = np.nanmax(line_scores(tiles, settings), axis=(1, 2))
            alarms[rate] += int((largest > threshold(settings, cell)).sum())
    rows = []
    for rate, count in alarms.items():
        expected = rate * tiles_seen
        # Three Poisson sds, and a half for a threshold whose tail is fitted.
        allowed = 0.5 * expected + 3 * np.sqrt(expected)
        rows.append(
            Row(f"motion.false_alarms_{rate:g}", "the set rate", count / expected, abs(count - expected) <= allowed,
                f"{rate:g} for each tile of 64 x 64; within half of it and three counting errors",
                error=f"{count} streaks in {tiles_seen} tiles of focused ground, before any look at their motion")
        )  # fmt: skip
    return rows
