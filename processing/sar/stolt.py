"""Stolt interpolation: from wavenumber to wavenumber across the rail, by a Kaiser-windowed sinc of eight taps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from processing.sar.interpolation import TABLE_STEPS, sinc_weights, tap_table

STOLT_TAPS = 8

_MATH = {"contract", "reassoc", "nsz", "arcp"}


def stolt(
    spectrum: NDArray[np.complex64],
    along: NDArray[np.float64],
    wavenumber_first: float,
    wavenumber_step: float,
    across: NDArray[np.float64],
    oversampling: float,
) -> NDArray[np.complex64]:
    """Resample each row of a spectrum from k to ``sqrt(k^2 - k_x^2)``; compiled, rows shared among threads.

    Args:
        spectrum: (rows, columns) samples at ``k = wavenumber_first + column * wavenumber_step``, rad/m.
        along: (rows,) k_x of each row, rad/m.
        wavenumber_first: k of the first column.
        wavenumber_step: step of k, > 0.
        across: (outputs,) wanted k_y, rad/m, > 0.
        oversampling: how many times finer than its Nyquist step the spectrum is sampled in k.

    Returns:
        (rows, outputs) complex64; 0 where k lies outside the spectrum.
    """
    out = np.empty((len(along), len(across)), dtype=np.complex64)
    table = tap_table("sinc8", oversampling)
    _stolt(spectrum, along, wavenumber_first, 1.0 / wavenumber_step, across, table, out)
    return out


def stolt_reference(
    spectrum: NDArray[np.complexfloating],
    along: NDArray[np.float64],
    wavenumber_first: float,
    wavenumber_step: float,
    across: NDArray[np.float64],
    oversampling: float,
) -> NDArray[np.complex128]:
    """:func:`stolt` in plain NumPy, float64: its definition."""
    columns = spectrum.shape[1]
    out = np.zeros((len(along), len(across)), dtype=np.complex128)
    for row, k_along in enumerate(along):
        place = (np.sqrt(across**2 + k_along**2) - wavenumber_first) / wavenumber_step
        inside = (place >= 0) & (place <= columns - 1)
        whole = np.floor(place).astype(np.int64)
        filters = sinc_weights(place - whole, STOLT_TAPS, oversampling)
        bins = whole[:, None] + np.arange(1 - STOLT_TAPS // 2, STOLT_TAPS // 2 + 1)
        held = (bins >= 0) & (bins < columns)
        samples = np.where(held, spectrum[row][np.clip(bins, 0, columns - 1)], 0)
        out[row] = np.where(inside, (samples * filters).sum(axis=1), 0)
    return out


@njit(parallel=True, cache=True, nogil=True, fastmath=_MATH, error_model="numpy")
def _stolt(spectrum: Any, along: Any, first: float, per_step: float, across: Any, table: Any, out: Any) -> None:
    columns = spectrum.shape[1]
    for row in prange(along.size):
        along_squared = along[row] * along[row]
        for j in range(across.size):
            place = (math.sqrt(across[j] * across[j] + along_squared) - first) * per_step
            if place < 0.0 or place > columns - 1.0:
                out[row, j] = 0.0
                continue
            whole = math.floor(place)
            entry = (place - whole) * TABLE_STEPS
            q = math.floor(entry)
            part = np.float32(entry - q)
            re = np.float32(0)
            im = np.float32(0)
            for tap in range(STOLT_TAPS):
                column = whole - (STOLT_TAPS // 2 - 1) + tap
                if 0 <= column < columns:
                    weight = table[q, tap] + part * (table[q + 1, tap] - table[q, tap])
                    re += weight * spectrum[row, column].real
                    im += weight * spectrum[row, column].imag
            out[row, j] = complex(re, im)
