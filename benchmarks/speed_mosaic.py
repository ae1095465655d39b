"""A frame of 2448 x 2048 pixels of a mosaic to S0, S1, S2, DOLP and AOP: against polanalyser, and against the memory.

Ours and the peer's take turns within one run, wall time, new arrays each; agreement is held against float64. The
memory's limit is the time to write as many bytes into the same array, by as many threads and from compiled code.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row
from processing.optics.mosaic import parse_mosaic
from processing.optics.mosaic_stokes import PLANES, mosaic_stokes, mosaic_stokes_reference

SHAPE = (2048, 2448)
SPEEDUP = 15.0
LIMIT = 1.25
EXACT = 1e-6
SONY = parse_mosaic("90-45-135-0")
_PEER = "polanalyser"
_CORES = 2


def run(quick: bool) -> list[Row]:
    """All comparisons; ``quick`` repeats them less often."""
    image = np.random.default_rng(0).integers(0, 65_536, SHAPE, dtype=np.uint16)
    mosaic_stokes(image[:4, :32], SONY)  # compiles
    return [_exact(image[: 256 if quick else None]), _against_peer(image, 3 if quick else 9), *_limits(image, quick)]


def _exact(image: NDArray[np.uint16]) -> Row:
    found, truth = mosaic_stokes(image, SONY), mosaic_stokes_reference(image, SONY)
    lit = truth[0] > 0
    worst = 0.0
    for name, ours, wanted in zip(PLANES, found[:, lit], truth[:, lit], strict=True):
        deviation = np.abs(ours - wanted)
        if name == "aop":  # -90 and +90 degrees are one
            deviation = np.minimum(deviation, np.abs(deviation - np.pi))
        defined = deviation > 0
        worst = max(worst, float(np.max(deviation[defined] / np.abs(wanted[defined]), initial=0.0)))
    same = bool(np.array_equal(np.isnan(found), np.isnan(truth)))
    return Row(
        "mosaic.exact", "float64 reference", None, same and worst < EXACT, f"relative error below {EXACT}", error=worst
    )


def _against_peer(image: NDArray[np.uint16], rounds: int) -> Row:
    target = f"at least {SPEEDUP:g} times as fast"
    try:
        peer = _polanalyser()
    except ImportError as error:
        return Row("mosaic.speed", _PEER, None, True, f"not compared: {error}")
    ratios, ours_ms = [], []
    peer(image[:64, :64])
    theirs: Any = None
    for _ in range(rounds):
        begun = time.perf_counter()
        mosaic_stokes(image, SONY)
        between = time.perf_counter()
        theirs = peer(image)
        ratios.append((time.perf_counter() - between) / (between - begun))
        ours_ms.append(1e3 * (between - begun))
    truth = mosaic_stokes_reference(image[:512], SONY)
    ours = mosaic_stokes(image[:512], SONY)
    # The peer interpolates in whole counts and treats the border differently.
    inner = np.s_[8:500, 8:-8]
    own, other = (float(np.max(np.abs(plane[:512][inner] - truth[3][inner]))) for plane in (ours[3], theirs[1]))
    return Row(
        "mosaic.speed",
        _PEER,
        float(np.median(ratios)),
        float(np.median(ratios)) >= SPEEDUP,
        f"{target}, one thread, new arrays ({np.median(ours_ms):.1f} ms, load {os.getloadavg()[0]:.1f})",
        min(ratios),
        max(ratios),
        f"DOLP within {own:.1e}",
        f"DOLP within {other:.1e}",
    )


def _limits(image: NDArray[np.uint16], quick: bool) -> list[Row]:
    """Ours over the memory's write limit, by one thread and by two, into an array that is there."""
    out = np.empty((len(PLANES), *SHAPE), dtype=np.float32)
    rows = []
    for threads in (1, _CORES):
        write: list[float] = []
        ours: list[float] = []
        _write(out, threads)
        for _ in range(10 if quick else 40):
            write.append(_seconds(lambda: _write(out, threads)))  # noqa: B023 - called at once
            ours.append(_seconds(lambda: mosaic_stokes(image, SONY, out=out, threads=threads)))  # noqa: B023
        # The shortest of many: what the machine can do, not what it was doing besides.
        ratio = min(ours) / min(write)
        ratios = sorted(a / b for a, b in zip(ours, write, strict=True))
        speed = out.nbytes / min(write) / 1e9
        rows.append(
            Row(
                f"mosaic.memory_{threads}",
                f"writing {out.nbytes / 1e6:.0f} MB",
                ratio,
                threads == 1 or ratio <= LIMIT,
                f"at most {LIMIT:g} of the time to write as much, {threads} thread{'s' if threads > 1 else ''}"
                + ("" if threads > 1 else " (told only)")
                + f"; {1e3 * min(ours):.1f} ms, memory {speed:.1f} GB/s",
                ratios[0],
                ratios[-1],
            )
        )
    return rows


def _polanalyser() -> Callable[[NDArray[np.uint16]], tuple[Any, Any, Any]]:
    import polanalyser

    angles = np.radians([0.0, 45.0, 90.0, 135.0])

    def process(image: NDArray[np.uint16]) -> tuple[Any, Any, Any]:
        stokes = polanalyser.calcStokes(polanalyser.demosaicing(image, polanalyser.COLOR_PolarMono), angles)
        return stokes, polanalyser.cvtStokesToDoLP(stokes), polanalyser.cvtStokesToAoLP(stokes)

    return process


def _seconds(call: Callable[[], Any]) -> float:
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def _write(out: NDArray[np.float32], threads: int) -> None:
    rows = out.shape[1]
    bands = [(rows * band // threads, rows * (band + 1) // threads) for band in range(threads)]
    if threads == 1:
        _fill(out, 0, rows)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda band: _fill(out, *band), bands))


@numba.njit(nogil=True)
def _fill(out: NDArray[np.float32], first: int, end: int) -> None:
    for plane in range(out.shape[0]):
        for row in range(first, end):
            for column in range(out.shape[2]):
                out[plane, row, column] = np.float32(1.5)
