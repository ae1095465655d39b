"""Vectors of sixteen numbers for kernels that the compiler does not turn into vectors by itself.

A loop over pixels that looks values up in tables, or a sum that must keep its order, is compiled number by number. In a
kernel written with these types it is not: :data:`float32x16` and :data:`float64x16` are single values to Numba, held in
registers, with ``+ - * /`` and the functions below, each one instruction (or a few, on processors with narrower
registers; the compiler splits them). Nothing here may be called from plain Python.

Arithmetic is strict: nothing is reordered, and products and sums are fused only by :func:`fma`. So one processor gives
the same bits every time; another kind may round once where the first rounds twice.
"""

from __future__ import annotations

from processing.simd.memory import (
    PERMUTES,
    STREAM_BYTES,
    add_pairs,
    fence,
    gather,
    load,
    lookup16,
    lookup32,
    store,
    store_whole,
    stream,
)
from processing.simd.vectors import (
    INDEX_BITS,
    LANES,
    flip_odd,
    float32x16,
    float64x16,
    fma,
    largest,
    log2_parts,
    maximum,
    minimum,
    rint,
    smallest,
    splat,
    sqrt,
    times_power_of_two,
    to_float32,
    to_float64,
    where_positive,
)

__all__ = [
    "INDEX_BITS",
    "LANES",
    "PERMUTES",
    "STREAM_BYTES",
    "add_pairs",
    "fence",
    "flip_odd",
    "float32x16",
    "float64x16",
    "fma",
    "gather",
    "largest",
    "load",
    "log2_parts",
    "lookup16",
    "lookup32",
    "maximum",
    "minimum",
    "rint",
    "smallest",
    "splat",
    "sqrt",
    "store",
    "store_whole",
    "stream",
    "times_power_of_two",
    "to_float32",
    "to_float64",
    "where_positive",
]
