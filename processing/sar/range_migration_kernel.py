"""The compiled loops of range migration: positions to k_x, k_y to rows, k_x to columns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange

from processing.sar.turns import phasor

_MATH = {"contract", "reassoc", "nsz", "arcp"}


@njit(parallel=True, cache=True, nogil=True, fastmath=_MATH, error_model="numpy")
def spread_track(values: Any, first: Any, weights: Any, out: Any) -> None:
    """Add each position's values, times its weights, to samples along the track.

    Args:
        values: (wavenumbers, positions) complex64.
        first: (positions,) first sample.
        weights: (positions, taps) complex64.
        out: (wavenumbers, samples) complex64, periodic along samples.
    """
    samples = out.shape[1]
    taps = weights.shape[1]
    for row in prange(out.shape[0]):
        for sample in range(samples):
            out[row, sample] = 0.0
        for n in range(first.size):
            value = values[row, n]
            start = first[n]
            if start + taps <= samples:
                for tap in range(taps):
                    out[row, start + tap] += value * weights[n, tap]
            else:
                for tap in range(taps):
                    out[row, (start + tap) % samples] += value * weights[n, tap]


@njit(parallel=True, cache=True, nogil=True, fastmath=_MATH, error_model="numpy")
def read_rows(
    fine: Any, first: Any, weights: Any, offset: Any, slant: Any, size: Any, across: Any, phase: Any, second: Any,
    factor: Any, limits: Any, along_first: float, along_step: float, middle: int, out: Any,
) -> None:  # fmt: skip
    """Read lines at the image's rows, turn them by their carrier, and roll them off beyond what each row needs.

    Args:
        fine: (samples, 2 lines) float32, real and imaginary parts in turn: lines across the rail, without their
            carrier.
        first: (rows,) first sample of each row.
        weights: (rows, taps) float32.
        offset: (rows,) distance from the middle, m.
        slant: (rows,) distance from the rail, m.
        size: (rows,) float32 amplitude.
        across: (lines,) k_y of the carrier.
        phase: (lines,) phase of each line, rad.
        second: (lines,) phase times the row's distance from the rail, rad m: the expansion's second term.
        factor: (lines,) float32.
        limits: (4, rows) outer and inner low, inner and outer high k_x, see
            :class:`processing.sar.range_migration_plan.Edges`.
        along_first: k_x of the first line.
        along_step: from line to line.
        middle: line that comes to the first place of ``out``.
        out: (rows, 2 length) float32 likewise; lines stand around 0, periodically, added where they share a place.
    """
    samples = fine.shape[0]
    lines = fine.shape[1] // 2
    length = out.shape[1] // 2
    taps = weights.shape[1]
    turn = 1 / (2 * math.pi)
    for row in prange(out.shape[0]):
        for place in range(2 * length):
            out[row, place] = np.float32(0)
        low = max(0, math.ceil((limits[0, row] - along_first) / along_step))
        high = min(lines, math.floor((limits[3, row] - along_first) / along_step) + 1)
        count = high - low
        # Real and imaginary parts alternate; loops from 0 over plain numbers become vectors.
        read = np.zeros(2 * count, dtype=np.float32)
        roll = np.empty(count, dtype=np.float32)
        turns = np.empty(count, dtype=np.float64)
        for tap in range(taps):
            weight = weights[row, tap]
            source = fine[(first[row] + tap) % samples, 2 * low : 2 * high]
            for i in range(2 * count):
                read[i] += weight * source[i]
        factors = factor[low:high]
        for i in range(count):
            roll[i] = size[row] * factors[i]
        for i in range(count):
            along = along_first + along_step * (low + i)
            if along >= limits[1, row]:
                break
            part = max(along - limits[0, row], 0.0) / (limits[1, row] - limits[0, row])
            roll[i] *= np.float32(part * part * part * (10.0 - 15.0 * part + 6.0 * part * part))
        for i in range(count - 1, -1, -1):
            along = along_first + along_step * (low + i)
            if along <= limits[2, row]:
                break
            part = max(limits[3, row] - along, 0.0) / (limits[3, row] - limits[2, row])
            roll[i] *= np.float32(part * part * part * (10.0 - 15.0 * part + 6.0 * part * part))
        distance = offset[row] * turn
        nearness = turn / slant[row]
        carriers, phases, seconds = across[low:high], phase[low:high], second[low:high]
        for i in range(count):
            turns[i] = carriers[i] * distance + phases[i] * turn + seconds[i] * nearness
        for i in range(count):
            c, s = phasor(turns[i])
            re = roll[i] * read[2 * i]
            im = roll[i] * read[2 * i + 1]
            read[2 * i] = re * c - im * s
            read[2 * i + 1] = re * s + im * c
        begin = low
        while begin < high:
            # Stretches that are whole in the output, whose places need no remainder.
            shift = (begin - middle) % length - begin
            end = min(high, length - shift)
            target = out[row, 2 * (begin + shift) : 2 * (end + shift)]
            part_of = read[2 * (begin - low) : 2 * (end - low)]
            for i in range(2 * (end - begin)):
                target[i] += part_of[i]
            begin = end


@njit(parallel=True, cache=True, nogil=True, fastmath=_MATH, error_model="numpy")
def read_columns(fine: Any, first: Any, weights: Any, carrier: Any, out: Any) -> None:
    """Read rows at the image's columns.

    Args:
        fine: (rows, samples) complex64, periodic.
        first: (columns,) first sample.
        weights: (columns, taps) float32.
        carrier: (columns,) complex64 that each is multiplied by.
        out: (rows, columns) complex64.
    """
    samples = fine.shape[1]
    columns, taps = weights.shape
    for row in prange(out.shape[0]):
        for column in range(columns):
            total = weights[column, 0] * fine[row, first[column]]
            for tap in range(1, taps):
                sample = first[column] + tap
                if sample >= samples:
                    sample -= samples
                total += weights[column, tap] * fine[row, sample]
            out[row, column] = total * carrier[column]
