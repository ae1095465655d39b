"""The compiled kernel for a few pulses: a live image to which one position after another is added.

What :mod:`processing.sar.backprojection_kernel` works out for every patch of pixels pays when many pulses share it. For
few of them every pixel's range is worked out in float64 and what it reads is added to the image at once: no expansion
about a middle, no sums on the side.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange

from processing import simd
from processing.sar.patch_ranges import STRICT, seen_exactly
from processing.sar.patch_sums import sampler
from processing.sar.phasors import INSIDE, power, turned_exactly
from processing.sar.segments import MARGIN
from processing.simd import (
    INDEX_BITS,
    add_pairs,
    fma,
    largest,
    load,
    maximum,
    minimum,
    rint,
    smallest,
    splat,
    store,
    to_float32,
)

FEW = 6
"""Pulses up to which this kernel is the faster one."""

RUN = 64
"""Patches in a row whose sums are held until they are added to the image, in the core's caches."""

PERMUTES = simd.PERMUTES

_narrow, _wide, _anywhere = sampler(16, 0), sampler(32, 0), sampler(0, 0)


@njit(**INSIDE)
def _places(pixel: Any, ground: Any, row: int, column: int, pixels: Any) -> None:
    """x, y and z of a patch's pixels, sixteen each; those beyond the grid repeat its edge."""
    x, y, z = pixel
    across = ground.across
    if across == 16 and column + 16 <= ground.columns:
        _row(x, row * ground.x_row + column * ground.x_column, ground.x_column, pixels, 0)
        _row(y, row * ground.y_row + column * ground.y_column, ground.y_column, pixels, 16)
        _row(z, row * ground.z_row + column * ground.z_column, ground.z_column, pixels, 32)
        return
    for lane in range(16):
        i, j = min(row + lane // across, ground.rows - 1), min(column + lane % across, ground.columns - 1)
        pixels[lane] = x[i * ground.x_row + j * ground.x_column]
        pixels[16 + lane] = y[i * ground.y_row + j * ground.y_column]
        pixels[32 + lane] = z[i * ground.z_row + j * ground.z_column]


@njit(**INSIDE)
def _row(places: Any, first: int, step: int, pixels: Any, to: int) -> None:
    # Steps are 0 or 1: a value for all columns, or one for each.
    if step:
        store(pixels, to, load(places, first))
    else:
        store(pixels, to, splat(places[first]))


@njit(**STRICT)
def _put(ground: Any, width: int, row: int, column: int, re: Any, im: Any, parts: Any, first: int, spare: Any) -> None:
    """Add complex numbers to those pixels of a patch that are in the image; ``first`` is the channel's first pixel."""
    across = ground.across
    store(spare, 0, re)
    store(spare, 16, im)
    for lane in range(16):
        i, j = row + lane // across, column + lane % across
        if i < ground.rows and j < width:
            to = 2 * (first + (ground.first_row + i) * width + j)
            parts[to] += spare[lane]
            parts[to + 1] += spare[16 + lane]


@njit(**STRICT)
def _put_gain(ground: Any, width: int, row: int, column: int, gain: Any, gains: Any, first: int, spare: Any) -> None:
    """As :func:`_put` for squared gains, of which there is one number for each pixel."""
    across = ground.across
    store(spare, 0, gain)
    for lane in range(16):
        i, j = row + lane // across, column + lane % across
        if i < ground.rows and j < width:
            gains[first + (ground.first_row + i) * width + j] += spare[lane]


@njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def add_few(
    table: Any, layout: Any, signal: Any, pulses: int, track: Any, weights: Any, pixel: Any, ground: Any, total: Any,
    gains: Any,
) -> None:  # fmt: skip
    """Add a few pulses to some rows of an image; arguments as for
    :func:`processing.sar.backprojection_kernel.add_pulses`."""
    down = 16 // ground.across
    step = track.shape[0] // 10
    height, width = total.shape[1], ground.columns
    parts, flat_gains = total.reshape(-1).view(np.float32), gains.reshape(-1)
    powers, degree, stride = 2 * (layout.degree + 1), layout.degree, layout.stride
    channels, sets = layout.channels, weights.shape[0] if signal.exponent > 0 else 0
    lowest, highest = splat(np.float32(-MARGIN)), splat(np.float32(layout.bins + MARGIN - 2))
    none = splat(np.float32(0))
    for band in prange((ground.rows + down - 1) // down):
        row = band * down
        pixels, spare = np.empty(48), np.empty(32, np.float32)
        patches = min(RUN, (width + ground.across - 1) // ground.across)
        sums, squares = np.empty(channels * patches * 32, np.float32), np.empty(sets * patches * 16, np.float32)
        for begin in range(0, width, patches * ground.across):
            count = min(patches, (width - begin + ground.across - 1) // ground.across)
            for patch in range(count):
                _places(pixel, ground, row, begin + patch * ground.across, pixels)
                x, y, z = load(pixels, 0), load(pixels, 16), load(pixels, 32)
                for p in range(pulses):
                    seen, turns, cosine = seen_exactly(x, y, z, p, step, track, signal)
                    place = (seen - splat(track[9 * step + p])) * splat(signal.bins_per_m) - splat(0.5)
                    nearest = rint(place)
                    beyond = to_float32(place - nearest)
                    n = minimum(maximum(to_float32(nearest), lowest), highest)
                    c, s = turned_exactly(to_float32(turns - rint(turns)))
                    if signal.exponent > 0:
                        gain = power(cosine, np.float32(signal.exponent))
                        c, s = c * gain, s * gain
                        for k in range(sets):
                            to = (k * patches + patch) * 16
                            before = load(squares, to) if p else none
                            store(squares, to, fma(gain * gain, splat(weights[k, p]), before))
                    first = smallest(n)
                    apart = largest(n) - first
                    # Windows end within the table.
                    room = np.float32(16) if apart < np.float32(16) else np.float32(32)
                    first = min(first, np.float32(layout.bins + MARGIN - 1) - room)
                    bits = n - splat(first) + splat(INDEX_BITS)
                    at = p * channels * powers * stride + MARGIN + int(first)
                    for channel in range(channels):
                        if PERMUTES and apart < np.float32(16):
                            vr, vi = _narrow(table, at, stride, degree, bits, beyond)
                        elif PERMUTES and apart < np.float32(32):
                            vr, vi = _wide(table, at, stride, degree, bits, beyond)
                        else:
                            vr, vi = _anywhere(table, at, stride, degree, bits, beyond)
                        to = (channel * patches + patch) * 32
                        re, im = (load(sums, to), load(sums, to + 16)) if p else (none, none)
                        store(sums, to, fma(vr, c, fma(-vi, s, re)))
                        store(sums, to + 16, fma(vr, s, fma(vi, c, im)))
                        at += powers * stride
            # One channel after another: planes that lie a multiple of 4 KiB apart slow each other's stores down.
            for channel in range(channels):
                for patch in range(count):
                    column, at = begin + patch * ground.across, (channel * patches + patch) * 32
                    whole = ground.across == 16 and column + 16 <= width
                    re, im = load(sums, at), load(sums, at + 16)
                    # Here and not in a function: handing arrays over would take longer than adding.
                    if whole:
                        to = (channel * height + ground.first_row + row) * width + column
                        add_pairs(parts, 2 * to, re, im)
                    else:
                        _put(ground, width, row, column, re, im, parts, channel * height * width, spare)
            for k in range(sets):
                for patch in range(count):
                    column = begin + patch * ground.across
                    whole = ground.across == 16 and column + 16 <= width
                    added = load(squares, (k * patches + patch) * 16)
                    if whole:
                        to = (k * height + ground.first_row + row) * width + column
                        store(flat_gains, to, load(flat_gains, to) + added)
                    else:
                        _put_gain(ground, width, row, column, added, flat_gains, k * height * width, spare)
