"""The compiled loops of polar format: range resampling, azimuth resampling, and reading of pixels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange

from processing.sar.turns import phasor

_MATH = {"contract", "reassoc", "nsz", "arcp"}

TAPS = 6
"""Samples that a pixel reads along each axis."""


@njit(parallel=True, cache=True, nogil=True, fastmath=_MATH, error_model="numpy")
def resample_range(
    spectrum: Any, k_first: float, per_step: float, centre: float, offset: Any, turns: Any, along: Any,
    weights: Any, k_along: Any, table: Any, out: Any,
) -> None:  # fmt: skip
    """Each pulse's spectrum at equal steps of the wavenumber along the mean line of sight (the keystone).

    Args:
        spectrum: (pulses, columns) complex64 at ``k_first + column / per_step``, referred to ``offset`` beyond the
            scene's centre.
        k_first: k of the first column.
        per_step: columns per rad/m.
        centre: k of the carrier.
        offset: (pulses,) m.
        turns: (pulses,) phase of the scene's centre at the carrier, turns.
        along: (pulses,) part of the direction along the mean line of sight, > 0.
        weights: (pulses,).
        k_along: (rows,) wavenumbers wanted.
        table: (steps + 1, taps) float32 weights.
        out: (pulses, rows) complex64, 0 off the band.
    """
    columns = spectrum.shape[1]
    taps = table.shape[1]
    half = taps // 2
    steps = table.shape[0] - 1
    for n in prange(out.shape[0]):
        stretch = 1 / along[n]
        size = weights[n] * stretch
        for j in range(k_along.size):
            k = k_along[j] * stretch
            place = (k - k_first) * per_step
            if place < half - 1.0 or place > columns - half:
                out[n, j] = 0.0
                continue
            whole = min(int(place), columns - half - 1)
            q = int((place - whole) * steps + 0.5)
            re = np.float32(0)
            im = np.float32(0)
            for tap in range(taps):
                value = spectrum[n, whole - half + 1 + tap]
                re += table[q, tap] * value.real
                im += table[q, tap] * value.imag
            c, s = phasor(turns[n] - (k - centre) * offset[n] / (2 * math.pi))
            out[n, j] = complex(np.float32(size) * (re * c - im * s), np.float32(size) * (re * s + im * c))


@njit(parallel=True, cache=True, nogil=True, fastmath=_MATH, error_model="numpy")
def resample_azimuth(
    values: Any, k_along: Any, slope: Any, k_first: float, per_step: float, table: Any, out: Any
) -> None:
    """Add each pulse's sample to the steps around its wavenumber across, row by row.

    Args:
        values: (pulses, rows) complex64.
        k_along: (rows,).
        slope: (pulses,) wavenumber across over that along.
        k_first: wavenumber across of the first column.
        per_step: columns per rad/m.
        table: (steps + 1, taps) float32 weights.
        out: (rows, columns) complex64.
    """
    taps = table.shape[1]
    half = taps // 2
    steps = table.shape[0] - 1
    for row in prange(out.shape[0]):
        for column in range(out.shape[1]):
            out[row, column] = 0.0
        for n in range(slope.size):
            place = (k_along[row] * slope[n] - k_first) * per_step
            whole = int(place)
            q = int((place - whole) * steps + 0.5)
            value = values[n, row]
            for tap in range(taps):
                out[row, whole - half + 1 + tap] += table[q, tap] * value


@njit(parallel=True, cache=True, nogil=True, fastmath=_MATH, error_model="numpy")
def read_pixels(
    fine: Any, to_rows: Any, at_columns: Any, per_m: Any, carrier: Any, table: Any, undone: Any, undone_per_m: float,
    out: Any,
) -> None:  # fmt: skip
    """Read pixels at their straightened coordinates and turn them by the carrier.

    Args:
        fine: (samples, 2 samples) float32, real and imaginary parts in turn; its period is shorter by ``TAPS - 1``,
            so that what a pixel reads is never parted.
        to_rows: (rows, nodes) interpolation of coordinates.
        at_columns: (2, nodes, columns) coordinates along and across at the nodes, m.
        per_m: (2,) samples per metre.
        carrier: (2,) wavenumbers that transforms are centred on, rad/m.
        table: (steps + 1, TAPS) float32 weights.
        undone: (2 half + 1,) float32 what azimuth resampling's kernel is undone by, 0 m in the middle.
        undone_per_m: its entries per metre.
        out: (rows, columns) complex64.
    """
    half = TAPS // 2
    steps = table.shape[0] - 1
    high = fine.shape[0] - (TAPS - 1)
    wide = fine.shape[1] // 2 - (TAPS - 1)
    columns = out.shape[1]
    middle = undone.size // 2
    turn = 1 / (2 * math.pi)
    for row in prange(out.shape[0]):
        along = np.zeros(columns)
        across = np.zeros(columns)
        for node in range(to_rows.shape[1]):
            share = to_rows[row, node]
            for column in range(columns):
                along[column] += share * at_columns[0, node, column]
                across[column] += share * at_columns[1, node, column]
        for column in range(columns):
            a, b = along[column], across[column]
            pa, pb = a * per_m[0], b * per_m[1]
            wa, wb = math.floor(pa), math.floor(pb)
            weights_a, weights_b = table[int((pa - wa) * steps + 0.5)], table[int((pb - wb) * steps + 0.5)]
            first, begin = (int(wa) - half + 1) % high, 2 * ((int(wb) - half + 1) % wide)
            re = np.float32(0)
            im = np.float32(0)
            for i in range(TAPS):
                line = fine[first + i, begin : begin + 2 * TAPS]
                part_re = np.float32(0)
                part_im = np.float32(0)
                for k in range(TAPS):
                    part_re += weights_b[k] * line[2 * k]
                    part_im += weights_b[k] * line[2 * k + 1]
                re += weights_a[i] * part_re
                im += weights_a[i] * part_im
            entry = b * undone_per_m + middle
            low = min(max(int(entry), 0), undone.size - 2)
            size = undone[low] + np.float32(entry - low) * (undone[low + 1] - undone[low])
            c, s = phasor((a * carrier[0] + b * carrier[1]) * turn)
            out[row, column] = complex(size * (re * c - im * s), size * (re * s + im * c))
