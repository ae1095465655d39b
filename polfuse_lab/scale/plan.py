"""How an image is cut into tiles and profiles into blocks, so that a limit of memory is kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.ranging import BLOCK
from polfuse_lab.scale.memory import MEGABYTE, SHARE, available_bytes, resident_bytes
from polfuse_lab.session import Session
from processing.sar.backprojection import TABLE_BYTES
from processing.sar.grid import Grid
from processing.sar.tiles import ALIGNMENT, GridTile, square_tiles, tiles

LARGEST_TILE = 1 << 20
"""Pixels of a tile, at most: some seconds of work, so that progress is seen and little is lost by an interruption."""

TILES_PER_WORKER = 4
"""Tiles for each worker, at least, so that none waits long for the last one."""

OWN_BYTES = 120 * MEGABYTE
"""What compiled code, the file's caches and the allocator's slack take while tiles are formed."""

COPIES = 5
"""Copies of a block of profiles that are in memory while it is checked and added."""

BINS = 2048
"""Bins of a profile that are counted on before its length is known."""

UNTOLD_BYTES = 2_000 * MEGABYTE
"""Memory that is used where the system does not tell how much there is."""


@dataclass(frozen=True)
class Cut:
    """Tiles of the image, and positions in a block of profiles."""

    tiles: list[GridTile]
    positions: int
    memory_bytes: int
    """The limit that it was made for."""


def default_limit() -> int:
    """The limit of memory where none is given: half of what can be had, besides what is held already."""
    available = available_bytes()
    return UNTOLD_BYTES if available is None else resident_bytes() + int(SHARE * available)


def cut(
    grid: Grid, channels: int, bins: int, *, memory_bytes: int | None, tile: int | None = None, workers: int = 1
) -> Cut:
    """Cut an image so that forming it holds no more than a limit of memory.

    Args:
        grid: of the image.
        channels: of the image.
        bins: of a range profile.
        memory_bytes: of this whole process (each worker's, with several); :func:`default_limit` where left out.
        tile: rows and columns of a tile, instead of what memory allows.
        workers: how many tiles are formed at the same time, by as many processes.

    Raises:
        PolfuseError: the limit is smaller than what the program takes by itself and for one tile.
        DataError: an empty grid, or tiles that are too small.
    """
    limit = default_limit() if memory_bytes is None else memory_bytes
    pulse = 8 * channels * bins
    # Tables of a block take a constant, of which profiles are about a sixth; at least one pulse is there.
    fixed = OWN_BYTES + TABLE_BYTES + COPIES * max(TABLE_BYTES // 6, pulse)
    pixel = 20 * channels + 16
    room = limit - resident_bytes() - fixed
    if room < pixel * ALIGNMENT**2:
        least = resident_bytes() + fixed + pixel * ALIGNMENT**2
        raise PolfuseError(
            f"{limit / MEGABYTE:.0f} MB are too little: the program itself and the smallest tile take "
            f"{least / MEGABYTE + 1:.0f} MB",
            where="memory limit",
            advice="raise the limit, or leave it out",
        )
    height, width = grid.shape
    if tile is not None:
        pieces = tiles(grid, tile, tile)
        if max(piece.shape[0] * piece.shape[1] for piece in pieces) * pixel > room:
            raise PolfuseError(
                f"tiles of {tile} x {tile} pixels do not fit into {limit / MEGABYTE:.0f} MB",
                where="memory limit",
                advice="give smaller tiles, or leave their size to the program",
            )
    else:
        enough = height * width // (TILES_PER_WORKER * workers) if workers > 1 else height * width
        most = max(min(room // pixel, LARGEST_TILE, enough), ALIGNMENT**2)
        # In powers of four: a run that goes on finds the tiles of the one before, though memory is not quite the same.
        pieces = square_tiles(grid, 4 ** ((most.bit_length() - 1) // 2))
    positions = min(max((room + fixed) // (8 * pulse), 1), BLOCK)
    return Cut(pieces, 2 ** (positions.bit_length() - 1), limit)


def needs_tiles(session: Session, grid: Grid) -> bool:
    """Whether focusing in one piece would take more memory than there is to use (:func:`default_limit`).

    In one piece profiles are in memory up to three times (and in float64 by parts), the image twice.
    """
    sweeps = session.sweeps
    channels, positions = len(np.unique(sweeps["channel"])), len(np.unique(sweeps["position"]))
    pixels = grid.shape[0] * grid.shape[1]
    samples = int(sweeps["samples"].sum(dtype=np.int64)) * 2 * 4
    return 16 * channels * pixels + samples + 24 * channels * positions * BINS > default_limit() - resident_bytes()
