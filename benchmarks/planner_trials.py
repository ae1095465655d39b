"""One random scene for each planner, planned and carried out in every way that matters for the verdict."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy_focus_planner import form, task_of
from benchmarks.focus_geometries import random_collect, relative_error_db
from benchmarks.planner_scenes import random_mosaic, random_places, random_stokes
from benchmarks.shifted_scenes import random_series
from polfuse_lab.plans.storage import expected_frame
from polfuse_lab.rig import CameraSection
from polfuse_lab.session.filter_planner import Demand, choose_filter, forecast
from polfuse_lab.trade.rows import relative_db, timed
from processing.fusion.resampling import DEGREES, sample_spline
from processing.fusion.resampling_planner import SAFETY_DB as RESAMPLING_SAFETY_DB
from processing.fusion.resampling_planner import choose_resampling
from processing.optics.demosaic import METHODS, demosaic_by
from processing.optics.demosaic_planner import SAFETY_DB as DEMOSAIC_SAFETY_DB
from processing.optics.demosaic_planner import choose_demosaicer
from processing.optics.shift_planner import LEFT, choose_registration, measured_again, measured_on_pieces
from processing.optics.shift_planner import SAFETY_DB as REGISTRATION_SAFETY_DB
from processing.optics.shifts import put_back
from processing.polarimetry.averaging import window_average
from processing.polarimetry.matrices import planes_of_matrix
from processing.polarimetry.speckle.simulation import speckled
from processing.polarimetry.window_planner import SAFETY_DB as WINDOW_SAFETY_DB
from processing.polarimetry.window_planner import WINDOWS, choose_window
from processing.sar.focus_costs import RANGING_NS, machine_scale
from processing.sar.planner import Choice, choices, choose, fits

FACTOR_DB = 6.02


@dataclass(frozen=True)
class Trial:
    """One scene."""

    chosen: str
    off_db: float
    """Measured over expected error of the chosen setting (or size, 20 log10)."""
    promised: bool
    """Whether the planner expected to keep the tolerance by its margin."""
    kept: bool
    cost: float
    """Of the chosen setting, s."""
    least_cost: float
    """Of the cheapest that keeps the tolerance; infinite where none does."""


def _one_thread(trial: Callable[[int], Trial]) -> Callable[[int], Trial]:
    """Kernels on one thread: where others work too, threads wait for each other, which counts as processor time."""

    @functools.wraps(trial)
    def alone(seed: int) -> Trial:
        before = numba.get_num_threads()
        numba.set_num_threads(1)
        try:
            return trial(seed)
        finally:
            numba.set_num_threads(before)

    return alone


def _judged(
    chosen: str, expected_db: float, promised: bool, tolerance_db: float, measured: dict[str, tuple[float, float]]
) -> Trial:
    """From (error, cost) of every setting."""
    error, cost = measured[chosen]
    enough = [seconds for error_db, seconds in measured.values() if error_db <= tolerance_db]
    return Trial(chosen, error - expected_db, promised, error <= tolerance_db, cost, min(enough, default=math.inf))


@_one_thread
def focus_trial(seed: int) -> Trial:
    """Focusing: the choice, and every way that is expected to be cheaper and may keep the tolerance."""
    rng = np.random.default_rng(seed + 2_000_000)
    collect = random_collect(seed + 500)
    tolerance = float(rng.uniform(-105, -25))
    task = task_of(collect)
    choice = choose(task, tolerance)
    truth = collect.image()

    def carried_out(way: Choice) -> tuple[float, float]:
        profiles = collect.profiles(way.oversampling)
        seconds, image = timed(lambda: form(way, profiles, collect, tolerance), 3)
        # The closed form stands in for range compression.
        ranging = 1e-9 * RANGING_NS * way.oversampling * task.cells * task.pulses * machine_scale()
        return relative_error_db(image, truth), seconds + ranging

    error, cost = carried_out(choice)
    least = cost if error <= tolerance else math.inf
    for way in choices(task, tolerance):
        # What is expected to miss by more than a factor of two does.
        if way.seconds < choice.seconds and way.predicted_error_db <= tolerance + FACTOR_DB:
            other, seconds = carried_out(way)
            if other <= tolerance:
                least = min(least, seconds)
    off = error - choice.predicted_error_db
    return Trial(choice.method, off, fits(choice, tolerance), error <= tolerance, cost, least)


@_one_thread
def window_trial(seed: int) -> Trial:
    """A decomposition's window: even ground of any coherency, one to three mechanisms, up to 30 dB apart."""
    rng = np.random.default_rng(seed)
    vectors = rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3))
    powers = 10.0 ** -rng.uniform(0, 3, 3) * rng.uniform(0.1, 10)
    matrix = np.einsum("m,mi,mj->ij", powers, vectors, vectors.conj()) + 1e-4 * np.eye(3)
    truth = np.broadcast_to(planes_of_matrix(matrix)[:, None, None], (9, 48, 48)).copy()
    looks = int(rng.integers(1, 9))
    seen = speckled(truth, looks, rng)
    tolerance = float(rng.uniform(-22, -4))
    choice = choose_window(seen, tolerance, looks=looks)
    measured = {}
    for width in WINDOWS:
        seconds, made = timed(lambda: window_average(seen, width), 3)  # noqa: B023
        measured[str(width)] = (relative_db(made, truth), seconds)
    promised = choice.predicted_error_db <= tolerance - WINDOW_SAFETY_DB
    return _judged(str(choice.window), choice.predicted_error_db, promised, tolerance, measured)


@_one_thread
def demosaic_trial(seed: int) -> Trial:
    """Demosaicers."""
    seen = random_mosaic(seed + 10_000)
    tolerance = float(np.random.default_rng(seed + 3_000_000).uniform(-45, -18))
    choice = choose_demosaicer(seen.image, seen.mosaic, tolerance, variance=seen.variance)
    measured = {}
    for method in METHODS:
        seconds, planes = timed(lambda: demosaic_by(method, seen.image, seen.mosaic), 3)  # noqa: B023
        measured[method] = (relative_db(planes, seen.truth), seconds)
    promised = choice.predicted_error_db <= tolerance - DEMOSAIC_SAFETY_DB
    return _judged(choice.method, choice.predicted_error_db, promised, tolerance, measured)


@_one_thread
def resampling_trial(seed: int) -> Trial:
    """Pictures between their pixels."""
    seen = random_places(seed + 10_000)
    tolerance = float(np.random.default_rng(seed + 4_000_000).uniform(-60, -25))
    choice = choose_resampling(seen.planes, tolerance, variance=seen.variance)

    def between(degree: int) -> NDArray[np.float64]:
        return np.stack([sample_spline(plane, seen.u, seen.v, degree) for plane in seen.planes])

    measured = {}
    for degree in DEGREES:
        seconds, found = timed(lambda: between(degree), 3)  # noqa: B023
        measured[str(degree)] = (relative_db(found, seen.truth), seconds)
    promised = choice.predicted_error_db <= tolerance - RESAMPLING_SAFETY_DB
    return _judged(str(choice.degree), choice.predicted_error_db, promised, tolerance, measured)


@_one_thread
def registration_trial(seed: int) -> Trial:
    """Registration: shifts are measured with the noise, and what is out of place is seen without it."""
    seen = random_series(seed + 10_000)
    tolerance = float(np.random.default_rng(seed + 5_000_000).uniform(-60, -20))
    saturated = np.zeros(seen.light.shape[1:], dtype=bool)
    choice = choose_registration(seen.light, saturated, tolerance, variance=seen.variance)
    looking, shifts = timed(lambda: measured_on_pieces(seen.light, saturated), 3)
    again, better = 0.0, shifts
    if choice.way.whole:
        again, better = timed(lambda: measured_again(seen.light, saturated, shifts), 1)
    measured = {}
    for way in choice.ways:
        if way.whole and not choice.way.whole:
            continue  # dearer than what was chosen
        known, seconds, placed = better if way.whole else shifts, 0.0, seen.bare
        if way.degree != LEFT:
            seconds, _ = timed(lambda: put_back(seen.light, saturated, known, way.undo, way.degree), 3)  # noqa: B023
            placed, _ = put_back(seen.bare, saturated, known, way.undo, way.degree)
        measured[way.name] = (relative_db(placed, seen.truth), looking + (again if way.whole else 0.0) + seconds)
    promised = choice.predicted_error_db <= tolerance - REGISTRATION_SAFETY_DB
    return _judged(choice.way.name, choice.predicted_error_db, promised, tolerance, measured)


@_one_thread
def storage_trial(seed: int) -> Trial:
    """Filters: records of a radar foretold by a piece that was heard before, frames by the rig file alone.

    The disk is of any speed, and has room for a part of the raw bytes or for all of them.
    """
    rng = np.random.default_rng(seed)
    kind, (sample, whole) = ("audio", _audio(rng)) if rng.random() < 0.5 else ("images", _frames(rng))
    chunk = len(sample) if kind == "audio" else 1
    demand = Demand(
        raw_bytes={kind: whole.nbytes},
        bytes_per_s=10 ** rng.uniform(4, 8),
        disk_bytes_per_s=10 ** rng.uniform(6, 9.3),
        free_bytes=int(whole.nbytes * rng.uniform(0.1, 1.5)) if rng.random() < 0.5 else None,
    )
    choice = choose_filter({kind: forecast(sample, chunk)}, demand)
    costs, sizes, suits = {}, {}, {}
    for name, told in forecast(whole, chunk).items():
        sizes[name] = told.ratio * whole.nbytes
        costs[name] = 1e-9 * told.ns_per_byte * whole.nbytes + sizes[name] / demand.disk_bytes_per_s
        in_time = costs[name] * demand.bytes_per_s <= whole.nbytes
        suits[name] = in_time and (demand.free_bytes is None or sizes[name] <= demand.free_bytes)
    enough = [costs[name] for name, does in suits.items() if does]
    off = 20 * math.log10(sizes[choice.filter] / choice.predicted_bytes)
    return Trial(
        choice.filter, off, choice.kept, suits[choice.filter], costs[choice.filter], min(enough, default=math.inf)
    )


def _audio(rng: np.random.Generator) -> tuple[NDArray[Any], NDArray[Any]]:
    """A record of beat and sync, and eight more of another level each."""
    dtype = np.dtype(str(rng.choice(["int16", "int32", "float32"])))
    count = int(rng.integers(4_000, 40_000))
    noise, tone, cycle = 10 ** rng.uniform(-4.5, -1.5), 10 ** rng.uniform(-4, -0.5), rng.uniform(0.01, 0.4)

    def record(gain: float) -> NDArray[Any]:
        t = np.arange(count)
        beat = gain * tone * np.sin(2 * np.pi * cycle * t + rng.uniform(0, 6))
        both = np.stack([beat, np.where(t % 1920 < 960, 0.5, -0.5)], axis=1) + noise * rng.normal(size=(count, 2))
        both = np.clip(both, -1, 1)
        return both.astype(dtype) if dtype.kind == "f" else np.rint(both * np.iinfo(dtype).max).astype(dtype)

    return record(1.0), np.concatenate([record(2 ** rng.uniform(-1, 1)) for _ in range(8)])


def _frames(rng: np.random.Generator) -> tuple[NDArray[Any], NDArray[Any]]:
    """What the rig file makes expect of a camera, and frames of a random scene at any exposure."""
    pixel, full = (("Mono8", 255), ("Mono12", 4095), ("Mono16", 65_535))[int(rng.integers(3))]
    size = 192
    camera = CameraSection(
        driver="harvesters", width_px=size, height_px=size, pixel_format=pixel, exposure_s=0.01, focal_length_m=0.008,
        pixel_pitch_m=5e-6, saturation_counts=full, electrons_per_count=10 ** rng.uniform(-0.5, 2),
        read_noise_counts=float(rng.uniform(0, 5)),
    )  # fmt: skip
    light = random_stokes(rng, size)[0]
    light *= rng.uniform(0.2, 1.0) * full / np.quantile(light, 0.99)
    sd = np.sqrt(light / camera.electrons_per_count + camera.read_noise_counts**2)
    counts = np.rint(light + sd * rng.normal(size=(6, size, size)))
    return expected_frame(camera)[None], np.clip(counts, 0, full).astype(camera.counts_dtype)
