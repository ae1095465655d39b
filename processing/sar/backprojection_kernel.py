"""The compiled kernels of back-projection, one for each filter length.

The filter length is a constant of each kernel, so that the compiler unrolls the short loops over it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, prange

from processing.sar.interpolation import TABLE_STEPS

BLOCK = 256
"""Pixels of a row that one work unit holds; their buffers stay in the core's own cache."""

# Reordering and contraction only: nothing here may assume that numbers are finite.
_MATH = {"contract", "reassoc", "nsz", "arcp"}


@functools.cache
def kernel_for(taps: int) -> Callable[..., None]:
    """The kernel for a filter length; compiled at its first call, then kept on disk.

    Its arguments: profiles (pulses, 2 channels, bins) float32, real parts before imaginary ones, weighted; weights
    (pulses, channels); track (pulses, 3); x (nx,); y (ny,); z; first range; bins per metre; turns of phase per metre
    of distance; filter table (TABLE_STEPS + 1, taps) float32; the antennas' axis (3,); exponent of their pattern (0:
    none); and the image (channels, ny, nx) complex64 that it fills.
    """

    @njit(parallel=True, cache=True, nogil=True, fastmath=_MATH, error_model="numpy")
    def kernel(
        profiles: Any,
        weights: Any,
        track: Any,
        x: Any,
        y: Any,
        z: float,
        first_m: float,
        bins_per_m: float,
        turns_per_m: float,
        table: Any,
        axis: Any,
        exponent: float,
        image: Any,
    ) -> None:
        pulses, lanes, bins = profiles.shape
        channels = lanes // 2
        blocks = (x.size + BLOCK - 1) // BLOCK
        one = np.float32(1)
        for job in prange(y.size * blocks):
            row = job // blocks
            x0 = (job % blocks) * BLOCK
            count = min(BLOCK, x.size - x0)
            first = np.empty(count, np.int32)
            entries = np.empty(count, np.int32)
            parts = np.empty(count, np.float32)
            filters = np.empty((count, taps), np.float32)
            cosines = np.empty(count, np.float32)
            sines = np.empty(count, np.float32)
            outside = np.zeros(count, np.bool_)
            total = np.zeros((lanes, count), np.float64)
            gain_total = np.zeros((channels, count), np.float64)
            for pulse in range(pulses):
                dy = y[row] - track[pulse, 1]
                dz = z - track[pulse, 2]
                across = dy * dy + dz * dz
                along = axis[1] * dy + axis[2] * dz
                # Loops of one kind each: the compiler turns this one into vectors only if nothing branches in it.
                for i in range(count):
                    dx = x[x0 + i] - track[pulse, 0]
                    distance = math.sqrt(across + dx * dx)
                    # What is off the axis is held just off it, where it cannot overflow an index.
                    place = min(max((distance - first_m) * bins_per_m, -1.0 * taps), 1.0 * (bins + taps))
                    whole = math.floor(place)
                    entry = (place - whole) * TABLE_STEPS
                    entry_whole = math.floor(entry)
                    first[i] = int(whole) - (taps // 2 - 1)
                    entries[i] = int(entry_whole)
                    parts[i] = np.float32(entry - entry_whole)
                    turns = turns_per_m * distance
                    # Folded to a quarter turn, where these Taylor series are good to 6e-8, float32's own rounding.
                    angle = np.float32(turns - math.floor(turns + 0.5))
                    size = abs(angle)
                    far = size > np.float32(0.25)
                    v = (np.float32(0.5) - size if far else size) * np.float32(2 * math.pi)
                    u = v * v
                    cosine = one + u * (
                        np.float32(-1 / 2)
                        + u
                        * (
                            np.float32(1 / 24)
                            + u
                            * (
                                np.float32(-1 / 720)
                                + u
                                * (
                                    np.float32(1 / 40320)
                                    + u * (np.float32(-1 / 3628800) + u * np.float32(1 / 479001600))
                                )
                            )
                        )
                    )
                    sine = v * (
                        one
                        + u
                        * (
                            np.float32(-1 / 6)
                            + u
                            * (
                                np.float32(1 / 120)
                                + u
                                * (np.float32(-1 / 5040) + u * (np.float32(1 / 362880) + u * np.float32(-1 / 39916800)))
                            )
                        )
                    )
                    cosines[i] = -cosine if far else cosine
                    sines[i] = -sine if angle < np.float32(0) else sine
                if exponent > 0.0:
                    for i in range(count):
                        dx = x[x0 + i] - track[pulse, 0]
                        distance = math.sqrt(across + dx * dx)
                        toward = (along + axis[0] * dx) / distance if distance > 0.0 else 0.0
                        gain = toward**exponent if toward > 0.0 else 0.0
                        cosines[i] *= gain
                        sines[i] *= gain
                        for c in range(channels):
                            gain_total[c, i] += weights[pulse, c] * gain * gain
                else:
                    for c in range(channels):
                        gain_total[c] += weights[pulse, c]
                for i in range(count):
                    if first[i] < 0 or first[i] > bins - taps:
                        outside[i] = True
                        first[i] = 0
                    q = entries[i]
                    part = parts[i]
                    for k in range(taps):
                        filters[i, k] = table[q, k] + part * (table[q + 1, k] - table[q, k])
                for c in range(channels):
                    re = profiles[pulse, c]
                    im = profiles[pulse, channels + c]
                    for i in range(count):
                        b = first[i]
                        vr = np.float32(0)
                        vi = np.float32(0)
                        for k in range(taps):
                            vr += filters[i, k] * re[b + k]
                            vi += filters[i, k] * im[b + k]
                        total[c, i] += vr * cosines[i] - vi * sines[i]
                        total[channels + c, i] += vr * sines[i] + vi * cosines[i]
            for c in range(channels):
                for i in range(count):
                    if outside[i] or gain_total[c, i] <= 0.0:
                        image[c, row, x0 + i] = complex(np.nan, np.nan)
                    else:
                        image[c, row, x0 + i] = complex(
                            total[c, i] / gain_total[c, i], total[channels + c, i] / gain_total[c, i]
                        )

    compiled: Callable[..., None] = kernel
    return compiled
