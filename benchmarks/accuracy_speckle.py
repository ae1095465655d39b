"""What speckle filters gain and what they blur, on simulated speckle over a known truth, against polsartools; and how
often CFAR raises false alarms against the rate that was set.

The truth is even ground on both sides of a step of 10 dB: looks are counted on one side, the step that is left between
the two columns beside the edge is that of the span. Deviation is the root mean square of the filtered matrix from the
truth over the truth's span, everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row
from processing.polarimetry.averaging import window_average
from processing.polarimetry.detection.cfar import Kind, Ring, cfar, ring_average
from processing.polarimetry.detection.filters import whitened
from processing.polarimetry.matrices import total_power
from processing.polarimetry.speckle.nonlocal_means import nonlocal_means
from processing.polarimetry.speckle.quality import edge_kept, equivalent_looks
from processing.polarimetry.speckle.refined_lee import refined_lee
from processing.polarimetry.speckle.simulation import speckled

Values = NDArray[Any]

GROUND = np.array([1.0, 0.3, 0.1, 0.05, -0.02, 0.5, 0.0, 0.04, 0.2])
SPAN_LOOKS = 1.93
"""Of the span of a single look at GROUND: tr(S)^2 / tr(S S)."""
RATE = 0.1
"""Part of the set rate of false alarms by which the counted one may deviate, beyond counting errors."""


def run(quick: bool) -> list[Row]:
    """Filters and false alarms; ``quick`` takes fewer pixels."""
    shape = (160, 200) if quick else (400, 500)
    return [*_filters(shape), *_alarms(1 if quick else 12)]


def _filters(shape: tuple[int, int]) -> list[Row]:
    truth = np.broadcast_to(GROUND[:, None, None], (9, *shape)).copy()
    edge = shape[1] // 2
    truth[:, :, edge:] *= 10
    t = speckled(truth, 1, np.random.default_rng(21)).astype(np.float32)
    filters: dict[str, Callable[[], Values]] = {
        "boxcar": lambda: window_average(t, 7),
        # As the peer, which takes every image for one of a single look.
        "refined_lee": lambda: refined_lee(t, 7, looks=1.0),
        "nonlocal_means": lambda: nonlocal_means(t, search=15),
    }
    measured = {name: _measure(work(), truth, edge) for name, work in filters.items()}
    peers: dict[str, tuple[float, float, float, float]] = {}
    missing = ""
    try:
        from polsartools.preprocess.filters import process_chunk_boxcar, process_chunk_rfl

        peers["boxcar"] = _measure(np.asarray(process_chunk_boxcar(list(t), 7)), truth, edge)
        peers["refined_lee"] = _measure(np.asarray(process_chunk_rfl(list(t), 7)), truth, edge)
    except ImportError as error:
        missing = f"not compared: {error}"
    rows = [Row("speckle.filters", "polsartools", None, True, missing)] if missing else []
    for name, found in measured.items():
        against = peers.get(name)
        # The best of the other filters is what a slower one has to beat.
        rival = against or measured["refined_lee"]
        ratio = rival[3] / found[3]
        target = "deviation from the truth no larger than the peer's"
        peer = "polsartools" if against else ("refined Lee" if name == "nonlocal_means" else "")
        good = ratio >= 0.995 or not peer
        rows.append(
            Row(f"speckle.{name}", peer, ratio if peer else None, bool(good), target, error=_words(found),
                peer_error=_words(rival) if peer else None)
        )  # fmt: skip
    return rows


def _measure(filtered: Values, truth: Values, edge: int) -> tuple[float, float, float, float]:
    """Looks gained, part of the edge kept, bias of the mean of the even side, deviation from the truth."""
    inner = (slice(10, -10), slice(10, -10))
    power, known = total_power(filtered), total_power(truth)
    side = power[10:-10, 10 : edge - 10]
    deviation = np.abs(filtered - truth)[:, *inner] / known[inner]
    return (
        equivalent_looks(side) / SPAN_LOOKS,
        edge_kept(power[inner], known[inner], edge - 10),
        float(side.mean() / known[0, 0] - 1),
        float(np.sqrt(np.mean(deviation**2))),
    )


def _words(found: tuple[float, float, float, float]) -> str:
    looks, kept, bias, deviation = found
    words = f"{looks:.0f} times the looks, {kept:.2f} of an edge, mean off by {100 * bias:+.1f} %"
    return f"{words}, deviation {deviation:.4f}"


def _alarms(repetitions: int) -> list[Row]:
    rows = []
    kinds: tuple[Kind, ...] = ("ca", "os")
    for kind in kinds:
        for rate, looks in ((1e-2, 1.0), (1e-3, 1.0), (1e-3, 4.0), (1e-4, 3.0)):
            hits = pixels = 0
            for seed in range(repetitions):
                x = np.random.default_rng(seed).gamma(looks, size=(300, 300))
                found = cfar(x, false_alarm=rate, looks=looks, kind=kind)
                hits, pixels = hits + int((found > 1).sum()), pixels + found.size
            rows.append(_alarm_row(f"cfar_{kind}_{looks:g}_looks", hits, pixels, rate))
    hits = pixels = 0
    truth = np.broadcast_to(GROUND[:, None, None], (9, 300, 300))
    for seed in range(repetitions):
        t = speckled(truth, 1, np.random.default_rng(seed))
        found = cfar(whitened(t, ring_average(t, Ring())), false_alarm=1e-3, looks=3.0)
        hits, pixels = hits + int((found > 1).sum()), pixels + found.size
    # The clutter's matrix is known from 360 single looks only, which makes the tail longer.
    rows.append(_alarm_row("cfar_ca_whitened_by_360_looks", hits, pixels, 1e-3, 0.5))
    return rows


def _alarm_row(name: str, hits: int, pixels: int, rate: float, allowed: float = RATE) -> Row:
    # Four standard errors of the count are no deviation.
    ratio, spread = hits / pixels / rate, 4 / np.sqrt(rate * pixels)
    target = f"{rate:g} set; within {100 * allowed:.0f} % and four standard errors ({100 * spread:.0f} %)"
    return Row(
        f"speckle.{name}", "the set rate", ratio, abs(ratio - 1) < allowed + spread, target,
        error=f"{hits} false alarms in {pixels} pixels",
    )  # fmt: skip
