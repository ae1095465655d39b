"""The strongest peaks of an image, which may be larger than memory."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.sar.grid import ImageGrid
from processing.sar.quality import TAPS, Carrier, Peak, refine_peak, with_gain, without_gain


class Rows(Protocol):
    """An image some of whose rows are asked for at a time: an array, or one that is read or worked out."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows and columns."""

    def __getitem__(self, rows: slice, /) -> NDArray[Any]:
        """Some rows, real or complex."""


REACH = 30 * 3 // 2 + TAPS
"""Rows from a pixel that finding the top near it can read."""

STRIP_PIXELS = 1 << 18
"""Pixels that are looked through for peaks at a time."""


def find_peaks(
    image: Rows,
    grid: ImageGrid,
    count: int = 10,
    *,
    floor_db: float = -40.0,
    separation_m: tuple[float, float] = (1.0, 2.0),
    range_compensated: bool = False,
    carrier: Carrier | None = None,
) -> list[Peak]:
    """Strongest local maxima, strongest first.

    Args:
        image: (ny, nx) complex or real; NaN where undefined. Some of its rows are read at a time.
        grid: where it stands.
        count: at most so many.
        floor_db: weakest peak, relative to the strongest.
        separation_m: of two maxima closer than this in x and in y only the stronger counts (its side lobes else would).
        range_compensated: whether amplitudes were multiplied by R^2, see :func:`range_gain`.
        carrier: of the image, for the peaks' phases; without it phases between pixels mean nothing.

    Raises:
        DataError: image and grid disagree.
    """
    if tuple(image.shape) != grid.shape:
        raise DataError(f"an image of shape {image.shape} does not fit a grid of {grid.shape}", "give one channel")
    # Peaks found so far hide others in so many pixels around each; no candidate further down can become one.
    near = [2 * int(extent / step) + 3 for extent, step in zip(separation_m, _steps(grid), strict=True)]
    candidates = _maxima(
        image, grid, range_compensated, max(count, 1) * min(near[0] * near[1], image.shape[0] * image.shape[1])
    )
    found: list[Peak] = []
    places: list[tuple[float, float]] = []
    for shown, row, column in candidates:
        if len(found) == count or (found and shown < abs(found[0].value) * 10 ** (floor_db / 20)):
            break
        x, y = float(grid.x_m[column]), float(grid.y_m[row])
        if any(abs(x - px) < separation_m[0] and abs(y - py) < separation_m[1] for px, py in places):
            continue
        found.append(with_gain(_refined(image, grid, row, column, range_compensated, carrier), grid, range_compensated))
        places.append((x, y))
    return found


def _steps(grid: ImageGrid) -> tuple[float, float]:
    """Least distance of neighbours along x and along y; infinite for a single one."""
    x, y = (float(np.min(np.abs(np.diff(axis)), initial=np.inf)) for axis in (grid.x_m, grid.y_m))
    return x, y


def _part(grid: ImageGrid, rows: slice) -> ImageGrid:
    return ImageGrid(grid.x_m, grid.y_m[rows], grid.z_m)


def _maxima(image: Rows, grid: ImageGrid, range_compensated: bool, most: int) -> list[tuple[float, int, int]]:
    """Level, row and column of the ``most`` strongest pixels that none of their neighbours exceeds, strongest first.

    Strongest by the image's own level, where by that without the gain.
    """
    height, width = image.shape
    strip = max(STRIP_PIXELS // width, 1)
    kept = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    for first in range(0, height, strip):
        last = min(first + strip, height)
        rows = slice(max(first - 1, 0), min(last + 1, height))
        values = np.asarray(image[rows])
        shown = np.where(np.isfinite(values), np.abs(values), -1.0)
        flat = without_gain(values, _part(grid, rows), range_compensated)
        level = np.where(np.isfinite(flat), np.abs(flat), -1.0)
        padded = np.pad(level, 1, constant_values=-1.0)
        around = np.full(level.shape, -1.0)
        for i in range(3):
            for j in range(3):
                if (i, j) != (1, 1):
                    np.maximum(around, padded[i : i + level.shape[0], j : j + width], out=around)
        own = slice(first - rows.start, last - rows.start)
        row, column = np.nonzero((level[own] >= around[own]) & (level[own] > 0))
        new = shown[own][row, column], row + first, column
        joined = [np.concatenate(pair) for pair in zip(kept, new, strict=True)]
        order = np.argsort(-joined[0], kind="stable")[:most]
        kept = joined[0][order], joined[1][order], joined[2][order]
    return [(float(shown), int(row), int(column)) for shown, row, column in zip(*kept, strict=True)]


def _refined(
    image: Rows, grid: ImageGrid, row: int, column: int, range_compensated: bool, carrier: Carrier | None
) -> Peak:
    """:func:`refine_peak` from the rows that it can reach: thirty steps of 1.5 pixels, and interpolation there."""
    reach = slice(max(row - REACH, 0), row + REACH + 1)
    part = _part(grid, slice(reach.start, min(reach.stop, len(grid.y_m))))
    flat = without_gain(np.asarray(image[slice(reach.start, reach.start + len(part.y_m))]), part, range_compensated)
    return refine_peak(flat, part, row - reach.start, column, carrier)
