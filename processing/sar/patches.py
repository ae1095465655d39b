"""How a grid is handed to the kernels: as patches of sixteen pixels, its places in flat arrays."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from processing.sar.grid import Grid, ImageGrid
from processing.sar.tiles import GridTile

if TYPE_CHECKING:
    from processing.sar.backprojection_kernel import Ground

Flat = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

SHAPES = (16, 8, 4, 2, 1)
"""Columns that a patch of sixteen pixels may have."""


LINE_TURNS = 1e-7
"""Phase, turns, by which pixels may be off a straight line of equidistant places and be taken to lie on it."""


def on_lines(grid: Grid, across: int, turns_per_m: float) -> bool:
    """Whether the pixels of every patch lie on a line, equidistant; for a tile, whether those of the whole grid do.

    Args:
        grid: the grid.
        across: columns of a patch.
        turns_per_m: two-way turns of phase per metre of range.
    """
    grid = grid.whole if isinstance(grid, GridTile) else grid
    if not isinstance(grid, ImageGrid) or across not in (1, 16):
        return False
    axis = np.asarray(grid.x_m if across == 16 else grid.y_m, dtype=np.float64)
    if len(axis) < 3:
        return True
    off = 0.0
    for last in range(2, min(16, len(axis))):
        # Between the ends of every stretch of a patch's length (and of what is left of one at the grid's end).
        ends = axis[last:] - axis[:-last]
        middle = axis[last // 2 : len(axis) - last + last // 2]
        off = max(off, float(np.abs(axis[:-last] + ends * (last // 2 / last) - middle).max()))
    return off * turns_per_m <= LINE_TURNS


def flat_places(grid: Grid, across: int, rows: int, line: bool) -> Iterator[tuple[Flat, Ground]]:
    """A grid's places in flat arrays, and how they lie there; whole where its axes tell them, else some rows at a time.

    Args:
        grid: the grid.
        across: columns of a patch.
        rows: rows at a time.
        line: whether the patches' pixels lie on lines (:func:`on_lines`).
    """
    from processing.sar.backprojection_kernel import Ground

    height, width = grid.shape
    plane = isinstance(grid.whole if isinstance(grid, GridTile) else grid, ImageGrid)
    step = height if plane else rows
    for first in range(0, height, step):
        some = slice(first, min(first + step, height))
        x, y, z = (_flat(places) for places in grid.places_m(some))
        yield (x[0], y[0], z[0]), Ground(some.stop - first, width, first, across, line, *x[1:], *y[1:], *z[1:])


def _flat(places: NDArray[np.float64]) -> tuple[NDArray[np.float64], int, int]:
    """A (rows, columns) array as a flat copy without its repetitions, with index steps along rows and columns."""
    kept = places[: 1 if places.strides[0] == 0 else None, : 1 if places.strides[1] == 0 else None]
    row, column = kept.shape
    return np.array(kept, dtype=np.float64).ravel(), column if row > 1 else 0, 1 if column > 1 else 0


def best_patch(grid: Grid, track: NDArray[np.float64], bins_per_m: float) -> int:
    """Columns of the patch whose pixels lie closest in range, seen from places all over the track.

    Args:
        grid: the grid; its corners and middle are looked at, of a tile those of the whole grid.
        track: (3 or more, pulses), x, y and z first.
        bins_per_m: range bins per metre.
    """
    grid = grid.whole if isinstance(grid, GridTile) else grid
    rows, columns = grid.shape
    seen = track[:3, np.linspace(0, track.shape[1] - 1, 5).astype(int)].T
    spread = np.zeros(len(SHAPES))
    for row in {0, max(rows // 2 - 1, 0), max(rows - 2, 0)}:
        chip = np.stack(grid.places_m(slice(row, row + 2)), axis=-1)
        for column in {0, max(columns // 2 - 1, 0), max(columns - 2, 0)}:
            here = chip[0, column]
            down = chip[-1, column] - here
            right = chip[0, min(column + 1, columns - 1)] - here
            sight = here - seen
            distance = np.maximum(np.linalg.norm(sight, axis=1), 1e-12)
            for k, across in enumerate(SHAPES):
                reach = np.abs(sight @ right) * (across - 1) + np.abs(sight @ down) * (16 // across - 1)
                bins = reach / distance * bins_per_m / 2
                if np.isfinite(bins).all():
                    # Below what a window holds anyway, nearness is worth little.
                    spread[k] += np.maximum(bins, 4.0).sum()
    return SHAPES[int(np.argmin(spread))]
