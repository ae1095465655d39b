"""The compiled kernels of factorized back-projection: merging of parts, and the image.

Each works on lines of up to ``BLOCK`` places. A first loop, which the compiler turns into vectors, finds where each
place lies on a part's grid and by how many turns its phase differs, in float64; a second one reads and sums the samples
(:mod:`processing.sar.patch_sum`). Lines are shared among threads; every sum has one order, whatever their number.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange

from processing.sar.patch_sum import COLUMNS, PLACES, ROWS, TABLE_STEPS, patches_sum, types
from processing.sar.turns import MATH, phasor

BLOCK = 64
"""Places of a line that one turn of the loops holds; their buffers stay in the core's own cache."""

CHUNK = 16
"""Parts that are summed at a time."""

HALF = ROWS // 2


@njit(inline="always", fastmath=MATH, error_model="numpy")
def _line(
    frame: Any, part: int, row: int, column: int, count: int, z: float, r: Any, x: Any, y: Any, excess: Any
) -> None:
    """Fill R, x, y and excess of ``count`` places of one line of a part's grid, as ``polar_places`` defines them."""
    s = frame[part, 9] + row * frame[part, 10]
    height = z - frame[part, 2]
    square = height * height
    for i in range(count):
        distance = frame[part, 7] + (column + i) * frame[part, 8]
        along = s * distance
        left = distance * distance - square - along * along
        ahead = math.sqrt(max(left, 0.0))
        r[i] = distance
        excess[i] = min(left, 0.0)
        x[i] = frame[part, 0] + along * frame[part, 3] + ahead * frame[part, 5]
        y[i] = frame[part, 1] + along * frame[part, 4] + ahead * frame[part, 6]


@njit(inline="always", fastmath=MATH, error_model="numpy")
def _read_part(
    frame: Any, layout: Any, part: int, turns: float, z: float, count: int, r: Any, x: Any, y: Any,
    excess: Any, place: Any, row_entry: Any, column_entry: Any, row_part: Any, column_part: Any, cosine: Any,
    sine: Any,
) -> None:  # fmt: skip
    columns = layout[part, 2]
    per_r, per_s = 1.0 / frame[part, 8], 1.0 / frame[part, 10]
    cx, cy, dz = frame[part, 0], frame[part, 1], z - frame[part, 2]
    ax, ay, first_r, first_s = frame[part, 3], frame[part, 4], frame[part, 7], frame[part, 9]
    last_s, last_r = layout[part, 1] - HALF - 1.0, columns - COLUMNS // 2 - 1.0
    for i in range(count):
        dx, dy = x[i] - cx, y[i] - cy
        distance = math.sqrt(max(dx * dx + dy * dy + dz * dz + excess[i], 1e-12))
        s = (dx * ax + dy * ay) / distance
        at_r, at_s = (distance - first_r) * per_r, (s - first_s) * per_s
        held_r = min(max(at_r, COLUMNS // 2 - 1.0), last_r)
        held_s = min(max(at_s, HALF - 1.0), last_s)
        whole_r, whole_s = math.floor(held_r), math.floor(held_s)
        step_r, step_s = (held_r - whole_r) * TABLE_STEPS, (held_s - whole_s) * TABLE_STEPS
        lower_r, lower_s = math.floor(step_r), math.floor(step_s)
        row, column = np.int32(whole_s) - np.int32(HALF - 1), np.int32(whole_r) - np.int32(COLUMNS // 2 - 1)
        place[i] = row * np.int32(columns) + column
        row_entry[i], column_entry[i] = np.int32(lower_s), np.int32(lower_r)
        row_part[i], column_part[i] = np.float32(step_s - lower_s), np.float32(step_r - lower_r)
        c, q = phasor(turns * (distance - r[i]))
        inside = np.float32(1) if held_r == at_r and held_s == at_s else np.float32(np.nan)
        cosine[i], sine[i] = c * inside, q * inside


@njit(inline="always", fastmath=MATH, error_model="numpy")
def _add_parts(
    channels: int, first: int, last: int, frame: Any, layout: Any, samples: Any, turns: float, along: Any,
    across: Any, z: float, count: int, r: Any, x: Any, y: Any, excess: Any, sums: Any,
) -> None:  # fmt: skip
    total = samples.size // (2 * channels)
    place = np.empty((CHUNK, BLOCK), np.int32)
    entries, parts = np.empty((2, CHUNK, BLOCK), np.int32), np.empty((2, CHUNK, BLOCK), np.float32)
    phase = np.empty((2, CHUNK, BLOCK), np.float32)
    begin, pitch = np.empty(CHUNK, np.int64), np.empty(CHUNK, np.int64)
    for chunk in range(first, last, CHUNK):
        held = min(CHUNK, last - chunk)
        for k in range(held):
            _read_part(frame, layout, chunk + k, turns, z, count, r, x, y, excess, place[k], entries[0, k],
                      entries[1, k], parts[0, k], parts[1, k], phase[0, k], phase[1, k])  # fmt: skip
            pitch[k] = layout[chunk + k, 2]
        for channel in range(channels):
            for k in range(held):
                begin[k] = channel * total + layout[chunk + k, 0]
            for i in range(count):
                re, im = patches_sum(
                    samples, begin, pitch, ROWS, along, across, place, entries, parts, phase, CHUNK, BLOCK, i, held
                )
                sums[channel, 0, i] += re
                sums[channel, 1, i] += im


@njit(parallel=True, cache=True, nogil=True, fastmath=MATH, error_model="numpy")
def merge(
    channels: int, span: Any, child_frame: Any, child_layout: Any, samples: Any, turns: float, along: Any,
    across: Any, z: float, frame: Any, layout: Any, jobs: Any, out: Any,
) -> None:  # fmt: skip
    """Sum, for each part of a level, the parts ``span[part]`` to ``span[part + 1]`` of the finer level into ``out``.

    ``samples`` and ``out`` are flat float32, channel after channel; ``jobs`` holds part and row of each line.
    """
    total = out.size // (2 * channels)
    for job in prange(len(jobs)):
        part, row = jobs[job, 0], jobs[job, 1]
        columns = layout[part, 2]
        r, x, y, excess = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
        sums = np.empty((channels, 2, BLOCK), np.float32)
        for column in range(0, columns, BLOCK):
            count = min(BLOCK, columns - column)
            _line(frame, part, row, column, count, z, r, x, y, excess)
            sums[:] = 0
            _add_parts(channels, span[part], span[part + 1], child_frame, child_layout, samples, turns, along,
                      across, z, count, r, x, y, excess, sums)  # fmt: skip
            begin = layout[part, 0] + row * columns + column
            for channel in range(channels):
                for i in range(count):
                    out[2 * (channel * total + begin + i)] = sums[channel, 0, i]
                    out[2 * (channel * total + begin + i) + 1] = sums[channel, 1, i]


# Written out, so that places may be read-only views of any layout without compiling anew.
@njit(
    types.void(
        types.float64[:, ::1], types.int64[:, ::1], types.float32[::1], types.float64, types.float32[::1],
        types.float32[::1], PLACES, PLACES, types.float64, types.complex64[:, :, ::1],
    ),
    parallel=True, cache=True, nogil=True, fastmath=MATH, error_model="numpy",
)  # fmt: skip
def form(
    child_frame: Any, child_layout: Any, samples: Any, turns: float, along: Any, across: Any, x: Any, y: Any,
    z: float, image: Any,
) -> None:  # fmt: skip
    """Sum all parts of a level at places x, y (rows, columns), with their whole phase put back, into ``image``.

    ``image`` is (channels, rows, columns); NaN where a place is off a part's grid.
    """
    channels, lines, columns = image.shape
    blocks = (columns + BLOCK - 1) // BLOCK
    for job in prange(lines * blocks):
        line, column = job // blocks, (job % blocks) * BLOCK
        count = min(BLOCK, columns - column)
        zero, px, py = np.zeros(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
        sums = np.zeros((channels, 2, BLOCK), np.float32)
        for i in range(count):
            px[i], py[i] = x[line, column + i], y[line, column + i]
        _add_parts(channels, 0, len(child_frame), child_frame, child_layout, samples, turns, along, across, z,
                  count, zero, px, py, zero, sums)  # fmt: skip
        for channel in range(channels):
            for i in range(count):
                image[channel, line, column + i] = complex(sums[channel, 0, i], sums[channel, 1, i])
