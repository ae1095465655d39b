"""Tiles of an image grid: pieces that are formed one by one and have the very bits of the image in one piece.

What that takes, beyond pixels that depend on no other pixel:

- compiled back-projection expands ranges about the middle of patches of sixteen pixels, so every patch of a tile has to
- compiled back-projection expands ranges about the middle of patches of sixteen pixels: every patch of a tile has to
  which the whole grid asks for (:func:`processing.sar.patches.best_patch`);
- it adds pulses in blocks, rounded to complex64 after each: blocks are a function of the profiles alone, not of the
  image's size or of the memory there is (:func:`processing.sar.backprojection.pulses_in_block`).

Methods that work on the whole image at once (range migration, factorized back-projection) have no such tiles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from processing.errors import DataError
from processing.sar.grid import Grid, Places

ALIGNMENT = 16
"""Rows and columns of which every tile's first is a multiple: the pixels of a patch, in any of its shapes."""


@dataclass(frozen=True)
class GridTile:
    """Some rows and columns of a grid; itself a :class:`processing.sar.grid.Grid`.

    Raises:
        DataError: it begins beside a multiple of :data:`ALIGNMENT`, ends beside one before the grid's own end, is
            empty, or reaches beyond the grid.
    """

    whole: Grid
    first_row: int
    first_column: int
    row_count: int
    column_count: int

    def __post_init__(self) -> None:
        for first, count, length in zip(
            (self.first_row, self.first_column), (self.row_count, self.column_count), self.whole.shape, strict=True
        ):
            end = first + count
            if not (0 <= first < end <= length) or first % ALIGNMENT or (end % ALIGNMENT and end != length):
                raise DataError(
                    f"pixels {first} to {end} of {length} are no tile of the grid",
                    f"begin and end tiles at multiples of {ALIGNMENT} or at the grid's own ends",
                )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.row_count, self.column_count

    @property
    def rows(self) -> slice:
        """Its rows of the whole."""
        return slice(self.first_row, self.first_row + self.row_count)

    @property
    def columns(self) -> slice:
        """Its columns of the whole."""
        return slice(self.first_column, self.first_column + self.column_count)

    def places_m(self, rows: slice = slice(None)) -> Places:
        """Places of the pixels of some of its rows; see :class:`processing.sar.grid.Grid`."""
        some = range(self.rows.start, self.rows.stop)[rows]
        x, y, z = self.whole.places_m(slice(some.start, some.stop))
        return x[:, self.columns], y[:, self.columns], z[:, self.columns]


def tiles(grid: Grid, rows: int, columns: int) -> list[GridTile]:
    """A grid in tiles of at most so many rows and columns, row by row of tiles.

    Args:
        grid: the whole.
        rows: of a tile; rounded down to a multiple of :data:`ALIGNMENT` unless it takes in the whole height.
        columns: likewise.

    Raises:
        DataError: an empty grid, or tiles smaller than :data:`ALIGNMENT` pixels.
    """
    height, width = grid.shape
    if height < 1 or width < 1:
        raise DataError("the image grid is empty", "give at least one finite x and one finite y")
    down, across = _step(rows, height), _step(columns, width)
    return [
        GridTile(grid, row, column, min(down, height - row), min(across, width - column))
        for row in range(0, height, down)
        for column in range(0, width, across)
    ]


def _step(asked: int, length: int) -> int:
    if asked >= length:
        return length
    if asked < ALIGNMENT:
        raise DataError(f"tiles of {asked} pixels are too small", f"give at least {ALIGNMENT} rows and columns")
    return asked // ALIGNMENT * ALIGNMENT


def square_tiles(grid: Grid, pixels: int) -> list[GridTile]:
    """A grid in tiles of at most so many pixels, as square as they go (but never below the smallest tile).

    Raises:
        DataError: an empty grid, or fewer pixels than the smallest tile has.
    """
    height, width = grid.shape
    if pixels < ALIGNMENT**2 and height * width > pixels:
        raise DataError(f"tiles of {pixels} pixels are too small", f"give at least {ALIGNMENT**2} pixels")
    side = max(math.isqrt(pixels), ALIGNMENT)
    if height <= side:
        return tiles(grid, max(height, 1), max(pixels // max(height, 1), ALIGNMENT))
    if width <= side:
        return tiles(grid, max(pixels // max(width, 1), ALIGNMENT), max(width, 1))
    return tiles(grid, side, side)
