"""Weighted sums over small patches of complex samples, in the vectors of the processor.

Interpolation between samples is a sum over a few neighbours. Compilers do not turn such short sums into vector
instructions by themselves, so :func:`patches_sum` writes them out: each row of eight complex samples is one vector of
sixteen numbers, whatever the processor makes of it (one AVX-512 register, two of AVX, four of SSE or NEON). It reads
one patch of each of several arrays, turns each by its phase, and adds them; lanes are added up once, at the end.
:func:`patch_sum_reference` defines what one patch gives.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types as numba_types
from numba.core import cgutils as numba_cgutils
from numba.core.errors import RequireLiteralValue
from numba.extending import intrinsic
from numpy.typing import NDArray

from processing.sar.filter_design import least_squares_weights

ROWS = 8
"""Rows of a patch from which factorized back-projection interpolates along the angle."""

COLUMNS = 8
"""Complex samples of a row that a sum reads."""

TABLE_STEPS = 256
"""Intervals of the weight tables between two samples; interpolated linearly, their error is below -94 dB."""

types: Any = numba_types
cgutils: Any = numba_cgutils
PLACES = types.Array(types.float64, 2, "A", readonly=True)
"""Type of the places of pixels: of any layout, such as a row repeated."""

_FLOAT, _INT, _INDEX = ir.FloatType(), ir.IntType(32), ir.IntType(64)
_WIDE = ir.VectorType(_FLOAT, 2 * COLUMNS)


def column_table(oversampling: float) -> NDArray[np.float32]:
    """Weights of eight samples of a row, each twice (real and imaginary part): (TABLE_STEPS + 2, 16) float32.

    Args:
        oversampling: how many times finer than its band the row is sampled.
    """
    return np.repeat(_table(COLUMNS, oversampling), 2, axis=1)


def row_table(rows: int, oversampling: float) -> NDArray[np.float32]:
    """Weights of ``rows`` (2, 4, ... 16) rows, padded with zeros to sixteen: (TABLE_STEPS + 2, 16) float32."""
    table = np.zeros((TABLE_STEPS + 2, 16), dtype=np.float32)
    table[:, :rows] = _table(rows, oversampling)
    return table


def _table(taps: int, oversampling: float) -> NDArray[np.float32]:
    # One entry beyond the last, so that a fraction that rounds to one still has a right neighbour.
    fractions = np.minimum(np.arange(TABLE_STEPS + 2) / TABLE_STEPS, 1.0)
    return least_squares_weights(fractions, taps, oversampling).astype(np.float32)


def patch_sum_reference(
    samples: NDArray[np.complexfloating], row_fraction: float, column_fraction: float, oversampling: tuple[float, float]
) -> complex:
    """Value between the middle samples of a patch, (rows, columns) complex, in float64.

    Args:
        samples: the patch; rows and columns even.
        row_fraction: place between the two middle rows, 0 to 1.
        column_fraction: the same between the two middle columns.
        oversampling: of rows and of columns.
    """
    rows, columns = samples.shape
    along = least_squares_weights(row_fraction, rows, oversampling[0])
    across = least_squares_weights(column_fraction, columns, oversampling[1])
    return complex(along @ samples.astype(np.complex128) @ across)


class _Code:
    """Shorthand for the instructions of one call."""

    def __init__(self, context: Any, builder: Any) -> None:
        self.context, self.builder = context, builder

    def pointer(self, kind: Any, array: Any, element: Any) -> Any:
        """First element of a contiguous array."""
        data = self.context.make_array(kind)(self.context, self.builder, array).data
        return self.builder.bitcast(data, element.as_pointer())

    def scalar(self, pointer: Any, index: Any) -> Any:
        return self.builder.load(self.builder.gep(pointer, [index]))

    def wide(self, pointer: Any, index: Any) -> Any:
        """Sixteen float32 from an index on, aligned to nothing more than a float."""
        place = self.builder.gep(pointer, [index])
        return self.builder.load(self.builder.bitcast(place, _WIDE.as_pointer()), align=4)

    def fused(self, a: Any, b: Any, c: Any) -> Any:
        """``a b + c``."""
        kind = ir.FunctionType(_WIDE, [_WIDE] * 3)
        function = cgutils.get_or_insert_function(self.builder.module, kind, "llvm.fmuladd.v16f32")
        return self.builder.call(function, [a, b, c])

    def spread(self, vector: Any, lane: int) -> Any:
        """One lane of a vector in all lanes."""
        mask = ir.Constant(ir.VectorType(_INT, 16), [lane] * 16)
        return self.builder.shuffle_vector(vector, ir.Constant(_WIDE, ir.Undefined), mask)

    def broadcast(self, value: Any) -> Any:
        lane = self.builder.insert_element(ir.Constant(_WIDE, ir.Undefined), value, ir.Constant(_INT, 0))
        return self.spread(lane, 0)

    def weights(self, table: Any, entry: Any, part: Any) -> Any:
        """Row ``entry`` of a flat table, interpolated by ``part`` toward the next."""
        index = self.builder.mul(self.builder.sext(entry, _INDEX), ir.Constant(_INDEX, 16))
        here = self.wide(table, index)
        there = self.wide(table, self.builder.add(index, ir.Constant(_INDEX, 16)))
        return self.fused(self.broadcast(part), self.builder.fsub(there, here), here)

    def lanes(self, total: Any) -> list[Any]:
        """Sums of the even and of the odd lanes."""
        width = 16
        while width > 2:
            half = width // 2
            kind = ir.VectorType(_INT, half)
            undefined = ir.Constant(total.type, ir.Undefined)
            low = self.builder.shuffle_vector(total, undefined, ir.Constant(kind, list(range(half))))
            high = self.builder.shuffle_vector(total, undefined, ir.Constant(kind, list(range(half, width))))
            total, width = self.builder.fadd(low, high), half
        return [self.builder.extract_element(total, ir.Constant(_INT, lane)) for lane in (0, 1)]


def _patches_sum(
    typing: Any, samples: Any, begin: Any, pitch: Any, rows: Any, along: Any, across: Any, place: Any, entries: Any,
    parts: Any, phase: Any, depth: Any, stride: Any, at: Any, count: Any
) -> Any:  # fmt: skip
    """Sum of one patch of each of ``count`` arrays, each turned by its phase; returns (real, imaginary) as float32.

    Args:
        typing: given by the compiler.
        samples: flat float32, real and imaginary parts alternate.
        begin: (count,) int64, first complex sample of each array.
        pitch: (count,) int64, complex samples from row to row of each.
        rows: constant number of rows of a patch; of one row alone no row weights are read.
        along: flat row table.
        across: flat column table.
        place: (depth, stride) int32, complex samples from ``begin`` to the patch's first one.
        entries: (2, depth, stride) int32 rows in the two tables.
        parts: (2, depth, stride) float32 places between there and the next row.
        phase: (2, depth, stride) float32 cosine and sine, or other factors.
        depth: arrays that the four above have room for.
        stride: places that they have room for.
        at: the place that is meant.
        count: how many arrays there are, at most ``depth``.
    """
    if not isinstance(rows, types.IntegerLiteral):
        raise RequireLiteralValue("the number of rows must be a constant")
    lines = rows.literal_value
    number = types.int64
    signature = types.UniTuple(types.float32, 2)(
        samples, begin, pitch, rows, along, across, place, entries, parts, phase, number, number, number, number
    )

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        write = _Code(context, builder)
        kinds = (_FLOAT, _INDEX, _INDEX, None, _FLOAT, _FLOAT, _INT, _INT, _FLOAT, _FLOAT)
        data, first, step, _, row_table_, column_table_, where, entry, part, turned = (
            None if kind is None else write.pointer(signature.args[i], arguments[i], kind)
            for i, kind in enumerate(kinds)
        )
        depth_, wide, index, number = arguments[10:]
        second = builder.mul(wide, depth_)
        zero = ir.Constant(_WIDE, [0.0] * 16)
        by_cosine = cgutils.alloca_once_value(builder, zero)
        by_sine = cgutils.alloca_once_value(builder, zero)
        with cgutils.for_range(builder, number) as loop:
            here = builder.add(builder.mul(loop.index, wide), index)
            there = builder.add(here, second)
            begun = builder.add(write.scalar(first, loop.index), builder.sext(write.scalar(where, here), _INDEX))
            begun = builder.shl(begun, ir.Constant(_INDEX, 1))
            column = write.weights(column_table_, write.scalar(entry, there), write.scalar(part, there))
            total = write.wide(data, begun)
            if lines > 1:
                row = write.weights(row_table_, write.scalar(entry, here), write.scalar(part, here))
                total = builder.fmul(write.spread(row, 0), total)
                pitch_ = builder.shl(write.scalar(step, loop.index), ir.Constant(_INDEX, 1))
                for k in range(1, lines):
                    begun = builder.add(begun, pitch_)
                    total = write.fused(write.spread(row, k), write.wide(data, begun), total)
            total = builder.fmul(total, column)
            for held, value in ((by_cosine, here), (by_sine, there)):
                factor = write.broadcast(write.scalar(turned, value))
                builder.store(write.fused(total, factor, builder.load(held)), held)
        (a, b), (c, d) = write.lanes(builder.load(by_cosine)), write.lanes(builder.load(by_sine))
        lanes = [builder.fsub(a, d), builder.fadd(b, c)]
        return context.make_tuple(builder, signature.return_type, lanes)

    return signature, code


patches_sum: Any = intrinsic(_patches_sum)
"""As :func:`_patches_sum` tells, for kernels to call."""
