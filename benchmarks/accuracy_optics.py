"""Stokes imaging against the truth of simulated pixels and scenes: coverage of the errors, bias, demosaicing, shifts.

Pixels are drawn from the camera's noise (Poisson photo-electrons, read noise, rounding, averages of frames) at S0 from
1 to 60,000 counts and DOLP from 0 to 1. A reported pixel is covered when the truth lies within 1.96 of its reported sd.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.optics_scenes import binned, fine_scene
from benchmarks.rows import Row
from processing.optics.analyser import least_squares, measurement_matrix
from processing.optics.demosaic import METHODS, demosaic_by
from processing.optics.mosaic import ANGLES_DEG, Mosaic, parse_mosaic, through_mosaic
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.shifts import measure_shift
from processing.optics.stokes import Flag, stokes_image

LEVELS = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4, 3e4, 6e4)
"""S0, counts."""
DOLPS = (0.0, 0.02, 0.1, 0.3, 0.6, 0.9, 1.0)
CAMERAS = {
    # read noise in counts, photo-electrons per count, frames, polarizer angles in degrees
    "thesis": (SensorNoise(12.0, 1.0), 4, (0.0, 45.0, 90.0, 135.0)),
    "quiet": (SensorNoise(2.0, 1.0), 1, (0.0, 45.0, 90.0, 135.0)),
    "three angles": (SensorNoise(2.0, 0.5), 16, (0.0, 60.0, 120.0)),
}
COVERAGE = 0.95
SLACK = 0.01
"""By which coverage may fall short in one cell: noise is known from the counts themselves; few counts are skewed."""
BIAS = 0.005
CLEAR = 10.0
"""Polarized intensity over its sd from which the bias is judged: below, what is never negative cannot be unbiased."""
_LEAST = 0.5
"""Share of a cell's pixels that must be reported for it to be judged: what shadow masks is not wrong, but absent."""

Floats = NDArray[np.float64]


def run(quick: bool) -> list[Row]:
    """All rows; ``quick`` draws fewer pixels."""
    rows = []
    for name, (noise, frames, degrees) in CAMERAS.items():
        rows += _coverage(name, noise, frames, degrees, 4_000 if quick else 40_000)
    scenes = [_scene(160 if quick else 320, seed) for seed in range(1 if quick else 3)]
    return [*rows, *_demosaicing(scenes), _shifts(4 if quick else 24)]


def _coverage(camera: str, noise: SensorNoise, frames: int, degrees: tuple[float, ...], draws: int) -> list[Row]:
    angles = tuple(np.radians(degrees))
    of = PolarizerSeries(angles, (frames,) * len(angles), (0.0,) * len(angles), 800.0, noise)
    random = np.random.default_rng(7)
    judged: list[float] = []
    s0_judged: list[float] = []
    biases: list[float] = []
    masked = 0
    covered = reported = 0.0
    for s0 in LEVELS:
        for dolp in DOLPS:
            angle = random.uniform(-math.pi / 2, math.pi / 2)
            true = np.array([s0, s0 * dolp * math.cos(2 * angle), s0 * dolp * math.sin(2 * angle)])
            image = stokes_image(_light(of, true, draws, random), np.zeros((1, draws), bool), of)
            found, sd = image.dolp[0].astype(float), image.dolp_sd[0].astype(float)
            defined = np.isfinite(found)
            masked += int(np.count_nonzero(image.flags & Flag.SHADOW.value))
            # Where few pixels are reported, those are the ones whose S0 is too large by noise.
            if defined.mean() < _LEAST:
                continue
            inside = np.abs(found - dolp)[defined] <= 1.959964 * sd[defined]
            covered, reported = covered + float(inside.sum()), reported + float(defined.sum())
            judged.append(float(inside.mean()))
            s0_judged.append(float(np.mean(np.abs(image.s0[0] - s0) <= 1.959964 * image.s0_sd[0])))
            if dolp > CLEAR * float(np.median(sd[defined])):
                biases.append(float(np.mean(found[defined])) - dolp)
    share = masked / (draws * len(LEVELS) * len(DOLPS))
    least, worst = min(judged), max(map(abs, biases))
    target = (
        f"{100 * COVERAGE:g} % of {reported:.0f} pixels, {100 * (COVERAGE - SLACK):g} % in each of {len(judged)} cells"
    )
    return [
        Row(
            f"optics.coverage.{camera.replace(' ', '_')}",
            "Monte Carlo truth",
            None,
            covered / reported >= COVERAGE - 0.001 and least >= COVERAGE - SLACK,
            f"{target}; {100 * share:.0f} % are shadow",
            error=f"{100 * covered / reported:.2f} % covered, {100 * least:.2f} to {100 * max(judged):.2f} % by cell; "
            f"S0 {100 * min(s0_judged):.2f} to {100 * max(s0_judged):.2f} %",
        ),
        Row(
            f"optics.bias.{camera.replace(' ', '_')}",
            "Monte Carlo truth",
            None,
            worst < BIAS,
            f"mean DOLP off by less than {BIAS} where it exceeds {CLEAR:g} of its sds ({len(biases)} cells)",
            error=worst,
        ),
    ]


def _light(of: PolarizerSeries, true: Floats, draws: int, random: np.random.Generator) -> Floats:
    """(K, 1, draws) means over the frames of counts above black."""
    mean = (of.matrix @ true)[:, None, None]
    shape = (len(of.angles_rad), of.frames[0], draws)
    electrons = random.poisson(np.broadcast_to(mean * of.noise.electrons_per_count, shape))
    counts = electrons / of.noise.electrons_per_count + random.normal(0, of.noise.read_noise_counts, shape)
    averaged: Floats = np.rint(counts).mean(axis=1)[:, None, :]
    return averaged


def _demosaicing(scenes: list[Floats]) -> list[Row]:
    """Root mean square error of DOLP and of the planes over all phases that differ, against bilinear interpolation."""
    matrix = measurement_matrix(np.radians(ANGLES_DEG))
    solution = least_squares(matrix)
    phases: list[Mosaic] = [parse_mosaic("90-45-135-0").shifted(row, column) for row in (0, 1) for column in (0, 1)] + [
        parse_mosaic("0-90-45-135"),
        parse_mosaic("0-45-90-135"),
    ]
    inner = np.s_[..., 12:-12, 12:-12]
    dolp_errors: dict[str, list[float]] = {name: [] for name in METHODS}
    plane_errors: dict[str, list[float]] = {name: [] for name in METHODS}
    for number, scene in enumerate(scenes):
        truth, dolp = np.tensordot(matrix, scene, 1), np.hypot(scene[1], scene[2]) / scene[0]
        for mosaic in phases:
            light = np.random.default_rng(number).poisson(np.maximum(through_mosaic(scene, mosaic), 0)).astype(float)
            for name in METHODS:
                planes = demosaic_by(name, light, mosaic).astype(float)
                s0, s1, s2 = np.tensordot(solution, planes, 1)
                dolp_errors[name].append(float(np.mean((np.hypot(s1, s2) / s0 - dolp)[inner] ** 2)))
                plane_errors[name].append(float(np.mean((planes - truth)[inner] ** 2)))
    dolps = {name: math.sqrt(np.mean(values)) for name, values in dolp_errors.items()}
    planes_rms = {name: math.sqrt(np.mean(values)) for name, values in plane_errors.items()}
    return [
        Row(
            f"optics.demosaic.{name}",
            "bilinear",
            dolps[name] / dolps["bilinear"],
            planes_rms[name] <= planes_rms["bilinear"]
            and (name != "residual" or dolps[name] < 0.7 * dolps["bilinear"]),
            "error of DOLP over that of bilinear; residual below 0.7, none worse in its planes",
            error=f"DOLP {dolps[name]:.4f}, planes {planes_rms[name]:.0f} counts rms",
            peer_error=f"DOLP {dolps['bilinear']:.4f}, planes {planes_rms['bilinear']:.0f} counts rms",
        )
        for name in METHODS
    ]


def _shifts(count: int) -> Row:
    """Known shifts between images behind different angles of polarized scenes."""
    over, size = 8, 160
    matrix = measurement_matrix(np.radians(ANGLES_DEG))
    errors, pulls = [], []
    for seed in range(count):
        fine = fine_scene(size, seed, over, strongest=0.5)
        random = np.random.default_rng(seed)
        images = []
        steps = [(0, 0), *(tuple(map(int, random.integers(-20, 21, 2))) for _ in range(3))]
        for row, step in zip(matrix, steps, strict=True):
            light = binned(np.roll(np.tensordot(row, fine, 1), step, (0, 1)), over)
            images.append(random.poisson(np.maximum(light, 0)).astype(float))
        for image, (down, right) in zip(images[1:], steps[1:], strict=True):
            found = measure_shift(image, images[0])
            error = np.array([found.down - down / over, found.right - right / over])
            errors += list(np.abs(error))
            pulls += list(error / [found.down_sd, found.right_sd])
    rms = float(np.sqrt(np.mean(np.square(errors))))
    return Row(
        "optics.shifts",
        "simulated shifts up to 2.5 px",
        None,
        rms < 0.05,
        "root mean square error below 0.05 px",
        error=f"{rms:.3f} px, largest {max(errors):.3f}; {np.sqrt(np.mean(np.square(pulls))):.2f} of the reported sd",
    )


def _scene(size: int, seed: int) -> Floats:
    return binned(fine_scene(size, seed, 4), 4)
