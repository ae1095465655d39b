"""Speckle filters and CFAR against polsartools and SciPy on real L-band matrices, one thread each.

The peer's functions are called on arrays in memory, as its own commands call them. Times are processor time, in turn
within one run.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row
from processing.polarimetry.averaging import window_average
from processing.polarimetry.detection.cfar import Ring, cfar, factor
from processing.polarimetry.matrices import total_power
from processing.polarimetry.speckle.nonlocal_means import nonlocal_means
from processing.polarimetry.speckle.refined_lee import refined_lee
from processing.polarimetry.wishart import wishart_assign

Values = NDArray[Any]
Work = Callable[[], Any]

WINDOW = 7
FASTER = 5.0
RING = Ring(21, 9)
RATE = {"false_alarm": 1e-4, "looks": 4.0}


def run(quick: bool) -> list[Row]:
    """All comparisons; ``quick`` takes a strip of the image."""
    import numba

    folder = Path(os.environ.get("POLFUSE_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    folder = folder / "polsar" / "san_francisco_T3"
    if not folder.exists():
        return [Row("speckle", "polsartools", None, True, f"not compared: {folder.name} is not present")]
    from polfuse_lab.imports.polsarpro import read_folder

    planes = np.ascontiguousarray(read_folder(folder).planes[:, : 120 if quick else 450])
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        return _rows(planes, 3 if quick else 5)
    finally:
        numba.set_num_threads(threads)


def _rows(planes: Values, rounds: int) -> list[Row]:
    span = total_power(planes)
    centres = window_average(planes, 9)[:, ::40, ::100].reshape(9, -1)[:, :9]
    million = span.size / 1e6
    rows = [
        _alone("nonlocal_means", lambda: nonlocal_means(planes, looks=4, search=15), million, rounds, 0.02),
        _alone("wishart_assign", lambda: wishart_assign(planes, centres), million, rounds, 1.0),
        _alone("cfar_os", lambda: cfar(span, **RATE, ring=RING, kind="os"), million, rounds, 0.05),
        replace(
            _against(
                "cfar_ca", "SciPy's uniform filters", lambda: _detect(span), lambda: _peer_cfar(span), rounds, 1.0
            ),
            error=f"{_beside_a_target(lambda x: _detect(x) * factor(360, **RATE)):.1e} beside a target of 120 dB",
            peer_error=f"{_beside_a_target(_peer_cfar):.1e} there: it adds and takes away again, in the image's type; "
            "no undefined pixels, no thresholds by the number of training pixels",
        ),
    ]
    try:
        from polsartools.preprocess.filters import process_chunk_boxcar, process_chunk_rfl
    except ImportError as error:
        return [*rows, Row("speckle", "polsartools", None, True, f"not compared: {error}")]
    lists = [plane.copy() for plane in planes]
    return [
        *rows,
        _against(
            "boxcar", "polsartools", lambda: window_average(planes, WINDOW),
            lambda: process_chunk_boxcar(lists, WINDOW), rounds, FASTER,
        ),
        _against(
            "refined_lee", "polsartools (C++)", lambda: refined_lee(planes, WINDOW, looks=4.0),
            lambda: process_chunk_rfl(list(planes), WINDOW), rounds, FASTER,
        ),
    ]  # fmt: skip


def _detect(span: Values) -> Values:
    return cfar(span, **RATE, ring=RING)


def _peer_cfar(span: Values) -> Values:
    from scipy.ndimage import uniform_filter

    outer, guard = (uniform_filter(span, width) * width**2 for width in (RING.outer, RING.guard))
    with np.errstate(divide="ignore"):
        return np.asarray(span / ((outer - guard) / (RING.outer**2 - RING.guard**2)))


def _beside_a_target(detect: Callable[[Values], Values]) -> float:
    """Relative deviation of a clutter pixel over its ring's mean, with a pixel of 120 dB within the guard."""
    x = np.random.default_rng(3).gamma(4.0, size=(61, 61)).astype(np.float32)
    x[30, 30] = 1e12
    ring = np.ones((RING.outer, RING.outer), dtype=bool)
    arm = (RING.outer - RING.guard) // 2
    ring[arm:-arm, arm:-arm] = False
    at, reach = 32, RING.outer // 2
    around = x[at - reach : at + reach + 1, at - reach : at + reach + 1].astype(np.float64)
    return float(abs(detect(x)[at, at] * around[ring].mean() / x[at, at] - 1))


def _alone(name: str, work: Work, million: float, rounds: int, least: float) -> Row:
    work()  # compiles
    speeds = [million / _seconds(work) for _ in range(rounds)]
    speed = float(np.median(speeds))
    target = f"at least {least:g} million pixels/s by one thread"
    text = f"{speed:.3g} million pixels/s (load {os.getloadavg()[0]:.1f})"
    return Row(f"speckle.{name}", "", None, speed >= least, target, error=text)


def _against(name: str, peer: str, ours: Work, theirs: Work, rounds: int, least: float) -> Row:
    ours(), theirs()
    ratios = []
    for _ in range(rounds):
        own = _seconds(ours)
        ratios.append(_seconds(theirs) / own)
    ratio = float(np.median(ratios))
    target = f"at least {least:g} times as fast, one thread each"
    return Row(f"speckle.{name}", peer, ratio, ratio >= least, target, min(ratios), max(ratios))


def _seconds(work: Work) -> float:
    begun = time.process_time()
    work()
    return time.process_time() - begun
