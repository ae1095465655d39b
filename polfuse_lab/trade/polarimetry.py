"""Polarimetry: windows, speckle filters and precisions on simulated speckle over a known truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.trade.rows import Row, relative_db, timed
from processing.polarimetry.averaging import window_average
from processing.polarimetry.freeman import freeman_durden, freeman_durden_reference
from processing.polarimetry.h_a_alpha import h_a_alpha, h_a_alpha_reference
from processing.polarimetry.speckle.nonlocal_means import nonlocal_means
from processing.polarimetry.speckle.refined_lee import refined_lee
from processing.polarimetry.speckle.simulation import speckled

Values = NDArray[Any]

GROUND = np.array([1.0, 0.3, 0.1, 0.05, -0.02, 0.5, 0.0, 0.04, 0.2])
"""Planes of a coherency matrix with all three mechanisms."""
WINDOWS = (3, 5, 7, 9, 11)


def truth_of(size: int) -> Values:
    """(9, size, size) ground, half of it 10 dB brighter, with a band turned into another mechanism."""
    planes = np.broadcast_to(GROUND[:, None, None], (9, size, size)).copy()
    planes[:, :, size // 2 :] *= 10
    planes[[0, 5], size // 3 : 2 * size // 3] = planes[[5, 0], size // 3 : 2 * size // 3]
    return planes


def speckle_rows(size: int, rounds: int) -> Iterator[Row]:
    """Filters against the truth: what of the speckle stays, and what of edges is lost."""
    truth = truth_of(size)
    seen = speckled(truth, 1, np.random.default_rng(21)).astype(np.float32)
    filters: dict[str, Callable[[], Values]] = {"none": seen.copy}
    for window in WINDOWS:
        filters[f"boxcar {window}"] = lambda window=window: window_average(seen, window)  # type: ignore[misc]
    for window in (5, 7, 9):
        filters[f"refined Lee {window}"] = lambda window=window: refined_lee(seen, window, looks=1.0)  # type: ignore[misc]
    for search in (9, 15):
        filters[f"nonlocal means {search}"] = lambda search=search: nonlocal_means(seen, search=search)  # type: ignore[misc]
    for name, work in filters.items():
        seconds, made = timed(work, rounds)
        yield Row(f"speckle.{size}", name, seconds, relative_db(made, truth))


def decomposition_rows(size: int, rounds: int) -> Iterator[Row]:
    """Windows against the truth's decomposition; precisions against the float64 definition on the same matrices."""
    truth = truth_of(size)
    seen = speckled(truth, 1, np.random.default_rng(22))
    true = h_a_alpha_reference(truth)[:1]
    for window in WINDOWS:
        seconds, made = timed(lambda: h_a_alpha(window_average(seen, window)), rounds)  # noqa: B023
        yield Row(f"decompose.window.{size}", f"entropy, window {window}", seconds, relative_db(made[:1], true))
    averaged = window_average(seen, 7)
    single = averaged.astype(np.float32)
    for name, kernel, definition in (
        ("freeman", freeman_durden, freeman_durden_reference),
        ("h-a-alpha", h_a_alpha, h_a_alpha_reference),
    ):
        exact = definition(averaged)
        ways: dict[str, Callable[[], Values]] = {
            "float32": lambda kernel=kernel: kernel(single),  # type: ignore[misc]
            "float64": lambda kernel=kernel: kernel(averaged),  # type: ignore[misc]
        }
        for precision, work in ways.items():
            seconds, made = timed(work, rounds)
            yield Row(f"decompose.precision.{name}", precision, seconds, relative_db(made, exact))
