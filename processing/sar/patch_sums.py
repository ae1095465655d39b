"""Sums over a block of pulses for a patch of sixteen pixels: profiles between bins, turned and added.

Bins are looked up in a window of the pulse's table that is held in registers where they lie close enough together, and
in memory otherwise: the same numbers either way. A few pulses are summed in float32, their sums in float64.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from processing import simd
from processing.sar.patch_ranges import (
    BEYOND,
    BIN,
    COS,
    GAIN,
    KEPT,
    LOWEST,
    PHASE,
    PLACE,
    SIN,
    STRICT,
    offset_in_patch,
    offset_on_line,
    segment_of,
)
from processing.sar.phasors import INSIDE, turned
from processing.simd import fma, gather, load, splat, store, to_float64

RUN = 16
"""Pulses that are summed in float32."""

_LOOKUPS = {
    16: simd.lookup16 if simd.PERMUTES else gather,
    32: simd.lookup32 if simd.PERMUTES else gather,
    0: gather,
}


def sampler(window: int, fixed: int) -> Callable[..., Any]:
    """A function for profiles between bins, by Horner's rule; polynomials of the degree ``fixed``, 0 for any."""
    look = _LOOKUPS[window]

    @njit(**INSIDE)
    def sample(table: Any, first: int, stride: int, degree: int, places: Any, beyond: Any) -> Any:
        re = look(table, first, places)
        im = look(table, first + stride, places)
        for _ in range(fixed if fixed > 0 else degree):
            first += 2 * stride
            re = fma(re, beyond, look(table, first, places))
            im = fma(im, beyond, look(table, first + stride, places))
        return re, im

    return sample  # type: ignore[no-any-return]


def _single(fixed: int, line: bool) -> Callable[..., Any]:
    """A function that adds a block of pulses of the only channel to a patch within windows of 16.

    Its arguments: pulses, offsets of the pixels, numbers and rows of :mod:`processing.sar.patch_ranges`, turns of phase
    per bin, layout of the table, the table, and sums (float64) with the place there.
    """
    sample = sampler(16, fixed)

    @njit(**STRICT)
    def add(
        count: int, offsets: Any, numbers: Any, rows: Any, turns: Any, layout: Any, table: Any, sums: Any, at: int
    ) -> None:
        halves = splat(np.float32(2) * turns)
        a, b, c, d = load(offsets, 0), load(offsets, 16), load(offsets, 32), load(offsets, 48)
        stride, degree = layout.stride, layout.degree
        for first in range(0, count, RUN):
            re = im = splat(np.float32(0))
            for q in range(first, min(first + RUN, count)):
                offset = offset_on_line(a, b, c, d, numbers, q) if line else offset_in_patch(a, b, c, d, numbers, q)
                bits, beyond = segment_of(16, offset + splat(numbers[PLACE + q]), numbers[LOWEST + q], halves)
                cosine, sine = turned(fma(halves, offset, splat(numbers[PHASE + q])))
                vr, vi = sample(table, rows[q], stride, degree, bits, beyond)
                re = fma(vr, cosine, fma(-vi, sine, re))
                im = fma(vr, sine, fma(vi, cosine, im))
            store(sums, at, load(sums, at) + to_float64(re))
            store(sums, at + 16, load(sums, at + 16) + to_float64(im))

    return add  # type: ignore[no-any-return]


def _shared(window: int) -> Callable[..., Any]:
    """A function that adds a block of pulses of one channel to a patch, by what was kept for all channels."""
    sample = sampler(window, 0)

    @njit(**STRICT)
    def add(count: int, kept: Any, rows: Any, shift: int, layout: Any, table: Any, sums: Any, at: int) -> None:
        stride, degree = layout.stride, layout.degree
        for first in range(0, count, RUN):
            re = im = splat(np.float32(0))
            for q in range(first, min(first + RUN, count)):
                k = KEPT * q
                n, beyond = load(kept, k + BIN), load(kept, k + BEYOND)
                c, s = load(kept, k + COS), load(kept, k + SIN)
                vr, vi = sample(table, rows[q] + shift, stride, degree, n, beyond)
                re = fma(vr, c, fma(-vi, s, re))
                im = fma(vr, s, fma(vi, c, im))
            store(sums, at, load(sums, at) + to_float64(re))
            store(sums, at + 16, load(sums, at + 16) + to_float64(im))

    return add  # type: ignore[no-any-return]


# Filters of two and of four taps have loops of their own, whose degree the compiler knows.
_line1, _line3, _line, _patch = _single(1, True), _single(3, True), _single(0, True), _single(0, False)
_shared16, _shared32, _shared0 = _shared(16), _shared(32), _shared(0)


@njit(**STRICT)
def add_single(
    line: bool, count: int, offsets: Any, numbers: Any, rows: Any, turns: Any, layout: Any, table: Any, sums: Any,
    at: int,
) -> None:  # fmt: skip
    """Add a block of pulses of the only channel to a patch whose bins lie within windows of 16, offsets in float32.

    Args:
        line: whether the pixels lie on a line.
        count: pulses.
        offsets: (64,) float32 of the pixels, as for :func:`processing.sar.patch_ranges.keep_small`.
        numbers: of the pulses.
        rows: where the pulses' windows begin in the table.
        turns: of phase per bin, float32.
        layout: of the table.
        table: the profiles.
        sums: float64, 16 real and 16 imaginary parts from ``at`` on.
        at: the patch's place there.
    """
    if not line:
        _patch(count, offsets, numbers, rows, turns, layout, table, sums, at)
    elif layout.degree == 1:
        _line1(count, offsets, numbers, rows, turns, layout, table, sums, at)
    elif layout.degree == 3:
        _line3(count, offsets, numbers, rows, turns, layout, table, sums, at)
    else:
        _line(count, offsets, numbers, rows, turns, layout, table, sums, at)


@njit(**STRICT)
def add_kept(
    wide: int, count: int, kept: Any, rows: Any, shift: int, layout: Any, table: Any, sums: Any, at: int
) -> None:
    """Add a block of pulses of one channel to a patch. Other arguments as for :func:`add_single`.

    Args:
        wide: how far apart its bins lie (0, 1 or 2), see :func:`processing.sar.patch_ranges.centre_on_line`.
        kept: of :func:`processing.sar.patch_ranges.keep_small` or :func:`processing.sar.patch_ranges.keep_exact`.
        shift: from a pulse's place in the table to the channel's.
    """
    if wide == 0:
        _shared16(count, kept, rows, shift, layout, table, sums, at)
    elif wide == 1:
        _shared32(count, kept, rows, shift, layout, table, sums, at)
    else:
        _shared0(count, kept, rows, shift, layout, table, sums, at)


@njit(**STRICT)
def add_gains(count: int, kept: Any, weights: Any, p0: int, gains: Any, at: int) -> None:
    """Add the squared gains of a block of pulses to a patch; weights (pulses,) float32."""
    total = load(gains, at)
    for q in range(count):
        gain = load(kept, KEPT * q + GAIN)
        total = fma(gain * splat(weights[p0 + q]), gain, total)
    store(gains, at, total)
