"""Pieces of a picture that stand for all of it, where looking at all of it would take longer than the work itself."""

from __future__ import annotations

import math
from collections.abc import Iterator


def spread_pieces(shape: tuple[int, ...], side: int, most: int) -> Iterator[tuple[slice, slice]]:
    """All of a small picture, or up to ``most`` square pieces spread evenly over a larger one.

    Args:
        shape: rows and columns.
        side: of a piece, pixels; even. Pieces begin in even rows and columns, so that a mosaic has one phase in all.
        most: pieces; a picture of no more pixels than these have is taken whole.
    """
    rows, columns = shape
    if rows * columns <= most * side**2:
        yield slice(0, rows), slice(0, columns)
        return
    height, width = min(rows, side), min(columns, side)
    down = min(max(round(math.sqrt(most * rows / columns)), 1), rows // height, most)
    right = min(max(most // down, 1), columns // width)
    for i in _begins(rows, height, down):
        for k in _begins(columns, width, right):
            yield slice(i, i + height), slice(k, k + width)


def _begins(length: int, size: int, count: int) -> list[int]:
    """Even places at which ``count`` pieces begin, in the middle of equal shares of ``length``."""
    return [int((length / count * (n + 0.5) - size / 2) // 2 * 2) for n in range(count)]
