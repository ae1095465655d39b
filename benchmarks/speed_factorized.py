"""Factorized back-projection against fastsar's, on one core, from the echoes' frequencies to the image.

Both form the same spotlight scene (15 GHz, 750 MHz, 8 km, 1.25 pixels per cell of 0.2 m) from the same unweighted
echoes of point targets, turn by turn in one process; process time is compared, so that other load weighs less. Errors
are taken on a lattice of pixels against the exact float64 sum over pulses and frequencies. The last row fits cost
against the image's side N, with as many pulses as the side asks for, by ``N^2 log N`` and by ``N^3``.
"""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row
from processing.radar.phase_history import PhaseHistory, history_profiles
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.factorized import factorized
from processing.sar.grid import ImageGrid

CENTRE_HZ, BANDWIDTH_HZ, RANGE_M, HEIGHT_M, PIXEL_M = 15e9, 750e6, 8e3, 3e3, 0.16
OVERSAMPLING = {-50.0: 2, -70.0: 3}
"""Range bins per cell that ours reads for a tolerance; the transform is part of its time."""


def scene(side: int, pulses: int, targets: int = 40) -> tuple[PhaseHistory, NDArray[np.float64]]:
    """A straight flight past random point targets: echoes as complex64, and the targets (n, 3)."""
    rng = np.random.default_rng(0)
    span = side * PIXEL_M
    cell = SPEED_OF_LIGHT_M_S / 2 / BANDWIDTH_HZ
    count = 2 * int(0.8 * span / cell)
    step = BANDWIDTH_HZ / count
    frequency = CENTRE_HZ + step * (np.arange(count) - count // 2)
    length = RANGE_M * SPEED_OF_LIGHT_M_S / CENTRE_HZ / (2 * cell)
    along = np.linspace(-0.5, 0.5, pulses) * length
    antenna = np.column_stack([along, np.full(pulses, -np.sqrt(RANGE_M**2 - HEIGHT_M**2)), np.full(pulses, HEIGHT_M)])
    places = np.column_stack([rng.uniform(-0.45, 0.45, (targets, 2)) * span, np.zeros(targets)])
    reference = np.linalg.norm(antenna, axis=1)
    echoes = np.zeros((1, pulses, count), dtype=np.complex64)
    for place in places:
        away = np.linalg.norm(place - antenna, axis=1) - reference
        echoes[0] += np.exp(-4j * np.pi / SPEED_OF_LIGHT_M_S * np.outer(away, frequency)).astype(np.complex64)
    return PhaseHistory(echoes, float(frequency[0]), step, antenna, reference, ("HH",)), places


def exact(
    history: PhaseHistory, targets: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """``1 / PK sum exp(j 4 pi f (R - R_target) / c)`` at places, its geometric sums over frequency in closed form."""
    count = history.echoes.shape[2]
    k0 = 4 * np.pi / SPEED_OF_LIGHT_M_S * history.first_hz
    dk = 4 * np.pi / SPEED_OF_LIGHT_M_S * history.step_hz
    total = np.zeros(x.shape, dtype=complex)
    for antenna in history.antenna_m:
        away = np.sqrt((x - antenna[0]) ** 2 + (y - antenna[1]) ** 2 + antenna[2] ** 2)
        for place in np.linalg.norm(targets - antenna, axis=1):
            half = 0.5 * dk * (away - place)
            sine = np.sin(half)
            ratio = np.where(np.abs(sine) < 1e-9, count, np.sin(count * half) / np.where(sine == 0, 1, sine))
            total += ratio * np.exp(1j * (k0 * (away - place) + (count - 1) * half))
    return total / (count * len(history.antenna_m))


def ours(history: PhaseHistory, grid: ImageGrid, tolerance_db: float) -> NDArray[np.complex64]:
    """Range transform and image, as ``polfuse focus --method ffbp`` does it."""
    profiles = history_profiles(history, window="rectangular", oversampling=OVERSAMPLING[tolerance_db])
    return factorized(profiles, grid, tolerance_db=tolerance_db)[0]


def error_db(image: NDArray[np.complexfloating], truth: NDArray[np.complex128]) -> float:
    """Root mean square error, dB, after the one complex factor by which scales may differ."""
    factor = np.vdot(image, truth) / np.vdot(image, image)
    return float(20 * np.log10(np.linalg.norm(factor * image - truth) / np.linalg.norm(truth)))


def run(quick: bool) -> list[Row]:
    """Speed and error at the default and at -70 dB, and how cost grows."""
    import numba

    os.environ.setdefault("OMP_NUM_THREADS", "1")
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        side, pulses = (512, 600) if quick else (2048, 2400)
        return [*_against_fastsar(side, pulses, 3 if quick else 5), _growth(quick)]
    finally:
        numba.set_num_threads(threads)


def _against_fastsar(side: int, pulses: int, rounds: int) -> list[Row]:
    history, targets = scene(side, pulses)
    axis = (np.arange(side) - side / 2) * PIXEL_M
    grid = ImageGrid(axis, axis, 0.0)
    near = np.unique(np.clip(np.rint(targets[:, :2] / PIXEL_M + side / 2).astype(int), 0, side - 1)[:, 0])
    rows = np.unique(np.clip(np.rint(targets[:12, 1] / PIXEL_M + side / 2).astype(int), 0, side - 1))
    x, y = np.meshgrid(axis[near], axis[rows])
    truth = exact(history, targets, x, y)
    tasks: dict[str, Callable[[], NDArray[np.complexfloating]]] = {
        "default": lambda: ours(history, grid, -50.0),
        "-70 dB": lambda: ours(history, grid, -70.0),
    }
    reason = ""
    try:
        fastsar = importlib.import_module("fastsar")
        former = fastsar.ImageFormer(
            history.antenna_m, history.first_hz, history.step_hz, history.echoes.shape[2], side, side, PIXEL_M, PIXEL_M,
            backend="cpu", window=False,
        )  # fmt: skip
        # fastsar's images are (x, y).
        tasks["fastsar"] = lambda: former(history.echoes[0]).T
    except Exception as error:
        reason = f"fastsar cannot be used here ({type(error).__name__}: {error})"
    errors = {name: error_db(task()[np.ix_(rows, near)], truth) for name, task in tasks.items()}
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(rounds):
        for name, task in tasks.items():
            begun = time.process_time()
            task()
            seconds[name].append(time.process_time() - begun)
    made = []
    for name, limit, wanted in (("default", -50.0, 1.5), ("-70 dB", -70.0, None)):
        rate = side * side * pulses / np.median(seconds[name]) / 1e6
        told = f"{side} x {side} x {pulses}, {np.median(seconds[name]):.2f} s, {rate:.0f} million pixel x pulse/s/core"
        ok = errors[name] < limit
        if "fastsar" not in tasks:
            made.append(Row(f"speed.factorized {name}", "fastsar", None, ok, f"{told}; {reason}", error=errors[name]))
            continue
        ratios = np.array(seconds["fastsar"]) / np.array(seconds[name])
        ratio = float(np.median(ratios))
        target = f"below {limit:g} dB" + ("" if wanted is None else f", {wanted:g} times as fast")
        good = ok and (wanted is None or ratio >= wanted)
        made.append(
            Row(
                f"speed.factorized {name}: {told}", "fastsar factorized", ratio, good,
                target, float(ratios.min()), float(ratios.max()), errors[name], errors["fastsar"],
            )
        )  # fmt: skip
    return made


def _growth(quick: bool) -> Row:
    sides = np.array([128, 256, 512] if quick else [256, 512, 1024, 2048])
    best = []
    for side in sides:
        history, _ = scene(int(side), int(side * 1.17), targets=1)
        profiles = history_profiles(history, window="rectangular", oversampling=OVERSAMPLING[-50.0])
        axis = (np.arange(side) - side / 2) * PIXEL_M
        grid = ImageGrid(axis, axis, 0.0)
        factorized(profiles, grid)
        trials = []
        for _ in range(3):
            begun = time.process_time()
            factorized(profiles, grid)
            trials.append(time.process_time() - begun)
        best.append(min(trials))
    measured = np.array(best)
    spread = {}
    for name, law in (("N^2 log N", sides**2 * np.log(sides)), ("N^3", sides.astype(float) ** 3)):
        ratio = np.log(measured / law)
        spread[name] = float(np.std(ratio))
    slope = float(np.polyfit(np.log(sides), np.log(measured), 1)[0])
    told = ", ".join(f"{side}: {second:.3f} s" for side, second in zip(sides, best, strict=True))
    good = bool(spread["N^2 log N"] < spread["N^3"] and slope < 2.5)
    return Row(
        f"speed.factorized growth: {told}", "N^2 log N", slope / 2, good,
        f"exponent {slope:.2f}; spread about N^2 log N {spread['N^2 log N']:.2f}, about N^3 {spread['N^3']:.2f} (log)",
    )  # fmt: skip
