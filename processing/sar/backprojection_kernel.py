"""The compiled kernel of back-projection.

Pixels are taken sixteen at a time, a *patch* of neighbours (16 x 1, 8 x 2, … of the grid), and pulses in blocks. For
one patch and one pulse the range of the patch's centre is float64; :mod:`processing.sar.patch_ranges` tells how its
pixels follow, :mod:`processing.sar.patch_sums` how they are summed. Tables hold polynomials between bins
(:mod:`processing.sar.segments`), so that a long filter costs hardly more than a short one.

Each pixel sums its pulses in their order, whatever the number of threads.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange

from processing import simd
from processing.sar.patch_ranges import (
    KEPT,
    LANES,
    NUMBERS,
    PULSES,
    STRICT,
    Signal,
    Table,
    centre_general,
    centre_of_patch,
    centre_on_line,
    keep_exact,
    keep_small,
    lay_windows,
)
from processing.sar.patch_sums import add_gains, add_kept, add_single
from processing.simd import add_pairs, load, to_float32

__all__ = ["Ground", "Signal", "Table", "add_pulses"]

PATCHES = 16
"""Patches in a tile, which is one work unit."""

_POWERS = np.concatenate([LANES, LANES**2, LANES**3, LANES**4]).astype(np.float32)


class Ground(NamedTuple):
    """Some rows of a grid, and how its places lie in flat arrays: index steps from row to row and column to column."""

    rows: int
    columns: int
    first_row: int
    """Row of the image that the first of these is."""
    across: int
    """Columns of a patch, a divisor of 16; it has 16 / ``across`` rows."""
    line: bool
    """Whether the pixels of every patch lie on a line, equidistant."""
    x_row: int
    x_column: int
    y_row: int
    y_column: int
    z_row: int
    z_column: int


@njit(**STRICT)
def _patch(pixel: Any, ground: Any, row: int, column: int, pixels: Any, offsets: Any, centre: Any) -> bool:
    """Places of a patch's pixels (those beyond the grid repeat its edge); False where none of them exists."""
    x, y, z = pixel
    across = ground.across
    found = 0
    for k in range(7):
        centre[k] = 0.0
    for lane in range(16):
        i, j = min(row + lane // across, ground.rows - 1), min(column + lane % across, ground.columns - 1)
        px = x[i * ground.x_row + j * ground.x_column]
        py = y[i * ground.y_row + j * ground.y_column]
        pz = z[i * ground.z_row + j * ground.z_column]
        pixels[lane], pixels[16 + lane], pixels[32 + lane] = px, py, pz
        if math.isfinite(px + py + pz):
            found += 1
            centre[0] += px
            centre[1] += py
            centre[2] += pz
    if not found:
        return False
    for k in range(3):
        centre[k] /= found
    for lane in range(16):
        squares = 0.0
        for k in range(3):
            away = pixels[16 * k + lane] - centre[k]
            offsets[16 * k + lane] = away
            squares += away * away
            if abs(away) > centre[3 + k]:
                centre[3 + k] = abs(away)
        offsets[48 + lane] = squares
        if squares > centre[6]:
            centre[6] = squares
    centre[6] = math.sqrt(centre[6])
    return True


@njit(**STRICT)
def _line(pixel: Any, ground: Any, row: int, column: int, centre: Any) -> bool:
    """A patch on a line: its middle, and its half (eight pixels) along each axis; it goes on beyond the grid's edge."""
    x, y, z = pixel
    last_row, last_column = row, column
    if ground.across == 16:
        last_column = min(column + 15, ground.columns - 1)
    else:
        last_row = min(row + 15, ground.rows - 1)
    steps = max(last_row - row + last_column - column, 1)
    for k in range(3):
        if k == 0:
            places, along, over = x, ground.x_row, ground.x_column
        elif k == 1:
            places, along, over = y, ground.y_row, ground.y_column
        else:
            places, along, over = z, ground.z_row, ground.z_column
        start = places[row * along + column * over]
        half = (places[last_row * along + last_column * over] - start) * (8.0 / steps)
        centre[k] = start + half * (7.5 / 8)
        centre[3 + k] = half
    centre[6] = math.sqrt(centre[3] * centre[3] + centre[4] * centre[4] + centre[5] * centre[5])
    return True


@njit(**STRICT)
def _add_block(
    p0: int, count: int, line: bool, centre: Any, offsets: Any, pixels: Any, table: Any, layout: Any, signal: Any,
    track: Any, step: int, weights: Any, sums: Any, at: int, gains: Any, gains_at: int, numbers: Any, places: Any,
    firsts: Any, rows: Any, kept: Any, most: Any,
) -> None:  # fmt: skip
    """Add a block of pulses of all channels to a patch."""
    coarse = 1
    if signal.bistatic or signal.moving:
        wide = centre_general(p0, step, count, centre, centre[6], track, signal, places)
    elif line:
        wide, coarse = centre_on_line(p0, step, count, centre, track, signal, numbers, places, most)
    else:
        wide, coarse = centre_of_patch(p0, step, count, centre, track, signal, numbers, places, most)
    if not simd.PERMUTES:
        wide = 2
    lay_windows(7 if wide == 0 else 15, p0, count, places, layout, numbers, firsts, rows)
    turns_per_bin = np.float32(signal.turns_per_m / signal.bins_per_m)
    if coarse == 0 and wide == 0 and layout.channels == 1 and signal.exponent == 0:
        add_single(line, count, offsets, numbers, rows, turns_per_bin, layout, table, sums, at)
        return
    window = 16 if wide < 2 else 0
    if coarse == 0 and signal.exponent == 0:
        keep_small(window, line, count, offsets, numbers, turns_per_bin, layout, kept)
    else:
        if line:
            for lane in range(16):
                for k in range(3):
                    pixels[16 * k + lane] = centre[k] + LANES[lane] * centre[3 + k]
        keep_exact(window, p0, step, count, pixels, track, firsts, signal, layout, kept)
    for channel in range(layout.channels):
        shift = channel * 2 * (layout.degree + 1) * layout.stride
        add_kept(wide, count, kept, rows, shift, layout, table, sums, at + 32 * channel)
    if signal.exponent > 0:
        for k in range(weights.shape[0]):
            add_gains(count, kept, weights[k], p0, gains, gains_at + 16 * k)


@njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def add_pulses(
    table: Any, layout: Any, signal: Any, pulses: int, track: Any, weights: Any, pixel: Any, ground: Any, total: Any,
    gains: Any,
) -> None:  # fmt: skip
    """Add pulses to some rows of an image.

    Args:
        table: their profiles, weighted (:func:`processing.sar.segments.segment_tables`).
        layout: of the table.
        signal: the radar.
        pulses: how many.
        track: (10 x n,) x, y, z of transmission, of reception, velocity, and range of the first bin, one after the
            other, each n long: the next multiple of 16 above ``pulses``, the last pulse repeated.
        weights: (sets, pulses) float32 of the gains; one set for every plane of ``gains``.
        pixel: x, y and z of the rows' pixels, flat.
        ground: how they lie there.
        total: (channels, rows, columns) complex64 that weighted, turned profiles are added to.
        gains: (sets, rows, columns) float32 that weighted squared gains are added to; without a pattern not touched.
    """
    rows_all, columns_all, across = ground.rows, ground.columns, ground.across
    down = 16 // across
    high = min(PATCHES, (rows_all + down - 1) // down)
    broad = PATCHES // high
    tiles_across = (columns_all + across * broad - 1) // (across * broad)
    tiles_down = (rows_all + down * high - 1) // (down * high)
    step = track.shape[0] // 10
    height = total.shape[1]
    parts = total.reshape(-1).view(np.float32)
    channels, sets = layout.channels, weights.shape[0] if signal.exponent > 0 else 0
    for tile in prange(tiles_across * tiles_down):
        patches = high * broad
        pixels = np.empty((patches, 48))
        offsets = np.empty((patches, 64), np.float32)
        centres = np.empty((patches, 7))
        exists = np.zeros(patches, np.bool_)
        sums = np.zeros(patches * channels * 32)
        gain_sums = np.zeros(patches * max(sets, 1) * 16, np.float32)
        numbers = np.empty(NUMBERS, np.float32)
        places, firsts, most = np.empty(PULSES), np.empty(PULSES), np.empty(32)
        starts = np.empty(PULSES, np.int64)
        kept = np.empty(KEPT * min(PULSES, pulses), np.float32)
        for patch in range(patches):
            row = (tile // tiles_across * high + patch // broad) * down
            column = (tile % tiles_across * broad + patch % broad) * across
            if row >= rows_all or column >= columns_all:
                continue
            if ground.line:
                exists[patch] = _line(pixel, ground, row, column, centres[patch])
            else:
                exists[patch] = _patch(pixel, ground, row, column, pixels[patch], offsets[patch], centres[patch])
        for p0 in range(0, pulses, PULSES):
            count = min(PULSES, pulses - p0)
            for patch in range(patches):
                if exists[patch]:
                    _add_block(
                        p0, count, ground.line, centres[patch], _POWERS if ground.line else offsets[patch],
                        pixels[patch], table, layout, signal, track, step, weights, sums, patch * channels * 32,
                        gain_sums, patch * sets * 16, numbers, places, firsts, starts, kept, most,
                    )  # fmt: skip
        for patch in range(patches):
            row = (tile // tiles_across * high + patch // broad) * down
            column = (tile % tiles_across * broad + patch % broad) * across
            for i in range(row, min(row + down, rows_all)):
                n = min(across, columns_all - column)
                for channel in range(channels):
                    at = (patch * channels + channel) * 32 + (i - row) * across
                    to = ((channel * height + ground.first_row + i) * columns_all + column) * 2
                    if not exists[patch]:
                        for k in range(to, to + 2 * n):
                            parts[k] = np.nan
                    elif n == 16:
                        add_pairs(parts, to, to_float32(load(sums, at)), to_float32(load(sums, at + 16)))
                    else:
                        for lane in range(n):
                            parts[to + 2 * lane] += np.float32(sums[at + lane])
                            parts[to + 2 * lane + 1] += np.float32(sums[at + 16 + lane])
                for k in range(sets):
                    at = (patch * sets + k) * 16 + (i - row) * across
                    for lane in range(n):
                        gains[k, ground.first_row + i, column + lane] += gain_sums[at + lane]
