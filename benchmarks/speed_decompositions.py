"""Decompositions against polsartools on real L-band coherency matrices, window average included, one thread each.

The peer's functions are called on arrays in memory, so no file access of its own counts against it. Times are processor
time, in turn within one run. Agreement is the median and the 99th percentile over pixels of what differs between the
two, the borders (which the two average differently) left out. Where they differ by design, the row says why.

Beside these: whether polsartools opens the folders that this program writes, and PolSARpro's own pictures of powers.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.polsarpro_folders import opened, pictures
from benchmarks.rows import Row
from processing.polarimetry.averaging import window_average, window_average_reference
from processing.polarimetry.freeman import freeman_durden, freeman_durden_reference
from processing.polarimetry.h_a_alpha import h_a_alpha, h_a_alpha_reference
from processing.polarimetry.matrices import coherency_turned, matrix_of_planes, planes_of_matrix
from processing.polarimetry.touzi import touzi, touzi_reference
from processing.polarimetry.yamaguchi import yamaguchi, yamaguchi_reference

Values = NDArray[Any]

SPEEDUP = 5.0
WINDOW = 7
LONG_S = 60.0
"""Processor time of the peer after which three rounds are enough."""
EXACT = 1e-6
"""Largest deviation of the kernels from their float64 references, of the span, of 1 and in radians."""
_NAMES = [
    f"T{name}.bin" for name in ("11", "12_real", "12_imag", "13_real", "13_imag", "22", "23_real", "23_imag", "33")
]


@dataclass(frozen=True)
class _Case:
    name: str
    ours: Callable[[Values], Values]
    reference: Callable[[Values], Values]
    peer: Callable[[list[Values]], Values]
    """Planes in the order and units of ours, after the peer's own window average."""
    relative: bool
    """Powers, compared relative to the span."""
    agree: Callable[[Values], Values] | None = None
    """What the peer finds of averaged T, if its result is not to be compared as it is."""
    comparable: Callable[[Values], NDArray[np.bool_]] | None = None
    """Of averaged T: the pixels in which both claim to compute the same."""
    shared: tuple[int, ...] | None = None
    """Planes of ours that the peer's (in their order) are compared with; None: all."""
    why: str = ""


def run(quick: bool) -> list[Row]:
    """All comparisons; ``quick`` takes a strip of the image."""
    import numba

    folder = Path(os.environ.get("POLFUSE_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    folder = folder / "polsar" / "san_francisco_T3"
    if not folder.exists():
        return [Row("decompositions", "polsartools", None, True, f"not compared: {folder.name} is not present")]
    from polfuse_lab.imports.polsarpro import read_folder

    planes = np.ascontiguousarray(read_folder(folder).planes[:, : 160 if quick else 900])
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        rows = [_exact(case, planes, threads) for case in _cases()]
        rows += pictures(folder.parent, planes)
        try:
            import polsartools  # noqa: F401
        except ImportError as error:
            return [*rows, Row("decompositions", "polsartools", None, True, f"not compared: {error}")]
        rows += opened(planes[:, :160], WINDOW)
        return rows + [_against(case, planes, 3 if quick else 5) for case in _cases()]
    finally:
        numba.set_num_threads(threads)


def _exact(case: _Case, planes: Values, threads: int) -> Row:
    """Kernel against reference, and its speed by one thread and by all."""
    import numba

    few = planes[:, :64]
    average = window_average_reference(few, WINDOW)
    worst = float(np.nanmax(np.abs(case.ours(average) - case.reference(average)) / _scale(case, average)))
    case.ours(window_average(planes[:, :16], WINDOW))  # compiles
    seconds = []
    for count in (1, threads):
        numba.set_num_threads(count)
        begun = time.perf_counter()
        case.ours(window_average(planes, WINDOW))
        seconds.append(time.perf_counter() - begun)
    numba.set_num_threads(1)
    pixels = planes[0].size / 1e6
    text = (
        f"{worst:.1e}; {pixels / seconds[0]:.2f} million pixels/s by one thread, {pixels / seconds[1]:.2f} by {threads}"
        f" (load {os.getloadavg()[0]:.1f})"
    )
    return Row(
        f"decompositions.{case.name}", "float64 reference", None, worst < EXACT, f"error below {EXACT}", error=text
    )


def _against(case: _Case, planes: Values, rounds: int) -> Row:
    inner = (slice(None), slice(WINDOW, -WINDOW), slice(WINDOW, -WINDOW))
    average = window_average_reference(planes, WINDOW)
    truth = case.reference(average)[inner]
    kept = np.ones(truth.shape[1:], dtype=bool) if case.comparable is None else case.comparable(average[inner])
    scale = _scale(case, average[inner])
    chunks = list(planes)
    times: dict[str, list[float]] = {"ours": [], "peer": []}
    ours = theirs = truth
    for number in range(rounds):
        if number >= 3 and sum(times["peer"]) > LONG_S:
            break
        begun = time.process_time()
        ours = case.ours(window_average(planes, WINDOW))
        between = time.process_time()
        theirs = case.peer([chunk.copy() for chunk in chunks])
        times["ours"].append(between - begun)
        times["peer"].append(time.process_time() - between)
    compared = theirs[inner] if case.agree is None else case.agree(average)[inner]
    planes_shared = list(case.shared or range(len(truth)))
    own_deviation = np.abs(ours[inner] - truth) / scale
    deviations = [own_deviation, np.abs(compared - truth[planes_shared]) / scale]
    own, other = (float(np.nanpercentile(d[:, kept], 99)) for d in deviations)
    ratios = [peer / own_time for own_time, peer in zip(times["ours"], times["peer"], strict=True)]
    ratio = float(np.median(ratios))
    agreed = f"{np.nanmedian(deviations[1][:, kept]):.1e} median, {other:.1e} at 99 %"
    if case.why:
        agreed += f" in {100 * kept.mean():.1f} % of the pixels; {case.why}"
    target = (
        f"at least {SPEEDUP:g} times as fast, one thread each, {WINDOW} x {WINDOW} average included; agreement to 1e-4"
    )
    good = ratio >= SPEEDUP and other < 1e-4
    label = f"decompositions.{case.name}"
    return Row(label, "polsartools", ratio, good, target, min(ratios), max(ratios), f"{own:.1e} at 99 %", agreed)


def _scale(case: _Case, average: Values) -> Values:
    return np.asarray(average[0] + average[5] + average[8]) if case.relative else np.ones(average.shape[1:])


def _cases() -> list[_Case]:
    helix = "where helix exceeds T33 the peer's powers do not sum to the span"
    turn = (
        "compared on T that is turned already: the peer turns T33 by a T22 that it has overwritten, and by an "
        f"arctangent of one argument; {helix}"
    )
    return [
        _Case("freeman", freeman_durden, freeman_durden_reference, _peer_freeman, True),
        _Case(
            "yamaguchi_original", lambda t: yamaguchi(t, "original"), lambda t: yamaguchi_reference(t, "original"),
            lambda t: _peer_yamaguchi(t, "y4co"), True, comparable=_volume_left, why=helix,
        ),
        _Case(
            "yamaguchi_rotated", lambda t: yamaguchi(t, "rotated"), lambda t: yamaguchi_reference(t, "rotated"),
            lambda t: _peer_yamaguchi(t, "y4cr"), True, agree=lambda t: _peer_yamaguchi(list(_turned(t)), "y4cr", 1),
            comparable=lambda t: _volume_left(_turned(t)), why=turn,
        ),
        _Case(
            "yamaguchi_extended", lambda t: yamaguchi(t, "extended"), lambda t: yamaguchi_reference(t, "extended"),
            lambda t: _peer_yamaguchi(t, "y4cs"), True, agree=lambda t: _peer_yamaguchi(list(_turned(t)), "y4cs", 1),
            comparable=lambda t: _volume_left(_turned(t)), why=turn,
        ),
        _Case(
            "h_a_alpha", h_a_alpha, h_a_alpha_reference, _peer_h_a, False, shared=(0, 1),
            why="entropy and anisotropy; the peer's alpha is of the first eigenvector's three components, where Cloude "
            "and Pottier take the first component of each eigenvector",
        ),
        _Case(
            "touzi", touzi, touzi_reference, _peer_touzi, False, shared=(0, 1, 2, 6, 7, 8, 12, 14),
            why="alpha_s and tau; the peer leaves psi beyond 45 degrees and then turns the sign of phi, where the "
            "model has psi - 90 and phi + 180 degrees",
        ),
    ]  # fmt: skip


def _volume_left(t: Values) -> NDArray[np.bool_]:
    return np.asarray(t[8] > np.abs(t[7]))


def _turned(t: Values) -> Values:
    """Planes turned about the line of sight to the least T33."""
    angle = -0.25 * np.arctan2(2 * t[6], t[5] - t[8])
    return np.asarray(planes_of_matrix(coherency_turned(matrix_of_planes(t), angle)))


def _peer_freeman(chunks: list[Values]) -> Values:
    from polsartools.polsar.fp.freeman_3c import process_chunk_free3c

    return np.stack(process_chunk_free3c(chunks, WINDOW, _NAMES))


def _peer_yamaguchi(chunks: list[Values], model: str, window: int = WINDOW) -> Values:
    from polsartools.polsar.fp.yamaguchi_4c import process_chunk_yam4cfp

    return np.stack(process_chunk_yam4cfp(chunks, window, _NAMES, model))


def _peer_h_a(chunks: list[Values]) -> Values:
    from polsartools.polsar.fp.h_a_alpha_fp import process_chunk_halphafp

    found = process_chunk_halphafp(chunks, WINDOW, _NAMES)
    return np.stack([found[0], found[2]])


def _peer_touzi(chunks: list[Values]) -> Values:
    from polsartools.polsar.fp.touzi_decomposition import process_chunk_touzi

    found = np.stack(process_chunk_touzi(chunks, WINDOW, _NAMES))
    return np.radians(found[[0, 1, 2, 6, 7, 8, 12, 14]])
