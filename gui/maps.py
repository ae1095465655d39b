"""Colour maps for pictures, the same as in the figures: perceptually uniform for amounts, cyclic for angles."""

from __future__ import annotations

from functools import cache

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray

from polfuse_lab.products.style import CYCLIC, DIVERGING, FRACTION, SEQUENTIAL

__all__ = ["CYCLIC", "DIVERGING", "FRACTION", "SEQUENTIAL", "lookup", "percentile_levels"]

MAPS = (SEQUENTIAL, FRACTION, CYCLIC, DIVERGING, "cividis", "gray")
"""Those that can be chosen; cividis reads the same to colour-blind eyes."""


ENTRIES = 256
SPAN_DB = 70.0
"""From the brightest to the darkest level that is told apart where nothing else is said, dB."""
SETTLED = 0.03
"""Share of a colour scale by which its ends may be out while pictures come one after another."""
NOTHING_DB = -170.0
"""Levels below are of amplitudes that are zero."""


@cache
def colour_map(name: str) -> pg.ColorMap:
    """A map of matplotlib's by name."""
    # Not by pyqtgraph's own way, which loads pyplot and with it, on a new computer, every font that there is.
    from matplotlib import colormaps

    places = np.linspace(0.0, 1.0, ENTRIES)
    return pg.ColorMap(places, np.round(255 * colormaps[name](places)).astype(np.uint8), name=name)


@cache
def lookup(name: str, entries: int = 256) -> NDArray[np.uint8]:
    """Its table, (entries, 3)."""
    table: NDArray[np.uint8] = colour_map(name).getLookupTable(0.0, 1.0, entries, alpha=False)
    return table


def percentile_levels(values: NDArray[np.floating], low: float = 5.0, high: float = 99.7) -> tuple[float, float]:
    """Display limits that a few very bright or dark pixels do not spoil; (0, 1) where nothing is defined.

    At most 16,384 evenly spread pixels are looked at, so that a large picture costs no more than a small one.
    """
    flat = np.asarray(values).ravel()
    sample = flat[:: max(flat.size // 16_384, 1)]
    finite = sample[np.isfinite(sample)]
    if finite.size == 0:
        return 0.0, 1.0
    bottom, top = (float(level) for level in np.percentile(finite, (low, high)))
    return (bottom, top) if top > bottom else (bottom - 0.5, bottom + 0.5)


def settled(limits: tuple[float, float], before: tuple[float, float] | None) -> tuple[float, float]:
    """Display limits that do not dance: those from before, where they differ by less than :data:`SETTLED` of the span.

    A colour bar whose limits stay need not be drawn anew, which takes longer than the picture beside it.
    """
    if before is None:
        return limits
    allowed = SETTLED * (before[1] - before[0])
    near = all(abs(now - then) <= allowed for now, then in zip(limits, before, strict=True))
    return before if near else limits


def level_limits(level_db: NDArray[np.floating], span_db: float = SPAN_DB) -> tuple[float, float]:
    """Display limits of levels in dB: by percentiles, never wider than ``span_db``; zero amplitudes do not count."""
    low, high = percentile_levels(np.where(level_db > NOTHING_DB, level_db, np.nan), 5.0, 99.9)
    return max(low, high - span_db), high
