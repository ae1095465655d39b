"""A frame of 2448 x 2048 pixels of a mosaic to S0, S1, S2, DOLP and AOP: against polanalyser, and against the memory.

Ours and the peer's take turns within one run, wall time, into new arrays (whose pages the system clears first) and into
arrays that are there; agreement is held against float64. The memory's limit is the shortest time in which compiled code
writes as many bytes into the same array, through the caches or past them, by as many threads.
"""

from __future__ import annotations

import functools
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
from processing.simd import LANES, fence, splat, store, stream

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
    return [_exact(image[: 256 if quick else None]), *_against_peer(image, 3 if quick else 9), *_limits(image, quick)]


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


def _against_peer(image: NDArray[np.uint16], rounds: int) -> list[Row]:
    target = f"at least {SPEEDUP:g} times as fast"
    try:
        peer = _polanalyser()
    except ImportError as error:
        return [Row("mosaic.speed", _PEER, None, True, f"not compared: {error}")]
    peer(image[:64, :64])
    there = mosaic_stokes(image, SONY)
    theirs: Any = None
    fresh_s, shared_s, reused_s, peer_s = [], [], [], []
    for _ in range(rounds):
        fresh_s.append(_seconds(lambda: mosaic_stokes(image, SONY)))
        shared_s.append(_seconds(lambda: mosaic_stokes(image, SONY, threads=_CORES)))
        begun = time.perf_counter()
        theirs = peer(image)
        peer_s.append(time.perf_counter() - begun)
        reused_s.append(_seconds(lambda: mosaic_stokes(image, SONY, out=there)))
    truth = mosaic_stokes_reference(image[:512], SONY)
    # The peer interpolates in whole counts and treats the border differently.
    inner = np.s_[8:500, 8:-8]
    own, other = (float(np.max(np.abs(plane[:512][inner] - truth[3][inner]))) for plane in (there[3], theirs[1]))
    rows = []
    for name, text, ours_s in (
        ("speed", "one thread, new arrays", fresh_s),
        ("speed_threads", f"{_CORES} threads, new arrays", shared_s),
        ("speed_reused", "one thread, into an array that is there", reused_s),
    ):
        ratios = [b / a for a, b in zip(ours_s, peer_s, strict=True)]
        middle = float(np.median(ratios))
        told = (
            f"{target}, {text} ({1e3 * np.median(ours_s):.1f} ms, theirs {1e3 * np.median(peer_s):.0f} ms, "
            f"load {os.getloadavg()[0]:.1f})"
        )
        errors = (f"DOLP within {own:.1e}", f"DOLP within {other:.1e}")
        rows.append(Row(f"mosaic.{name}", _PEER, middle, middle >= SPEEDUP, told, min(ratios), max(ratios), *errors))
    return rows


def _limits(image: NDArray[np.uint16], quick: bool) -> list[Row]:
    """Ours over the memory's write limit, by one thread and by two, into an array that is there."""
    out = mosaic_stokes(image, SONY)
    rows = []
    for threads in (1, _CORES):
        write: list[float] = []
        ours: list[float] = []
        for streamed in (False, True):
            _write(out, threads, streamed)  # compiles
        for _ in range(10 if quick else 80):
            # The quicker of both ways, each time.
            write.append(min(_seconds(lambda way=way: _write(out, threads, way)) for way in (False, True)))  # type: ignore[misc]  # noqa: B023
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
                + f"; {1e3 * min(ours):.1f} ms, memory {speed:.1f} GB/s, load {os.getloadavg()[0]:.1f}",
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


def _write(out: NDArray[np.float32], threads: int, streamed: bool) -> None:
    numbers = out.reshape(-1)
    vectors = numbers.size // LANES
    bands = [
        (LANES * (vectors * band // threads), LANES * (vectors * (band + 1) // threads)) for band in range(threads)
    ]
    if threads == 1:
        _fill(numbers, *bands[0], streamed)
        return
    list(_pool(threads).map(lambda band: _fill(numbers, *band, streamed), bands))


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)


@numba.njit(nogil=True)
def _fill(numbers: NDArray[np.float32], first: int, end: int, streamed: bool) -> None:
    value = splat(np.float32(1.5))
    if streamed:
        for k in range(first, end, LANES):
            stream(numbers, k, value)
        fence()
    else:
        for k in range(first, end, LANES):
            store(numbers, k, value)
