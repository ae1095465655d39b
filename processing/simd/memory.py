"""Vectors from memory and to it, and lookups in tables, in registers where the processor can."""

from __future__ import annotations

from typing import Any

import numba.core.codegen
from llvmlite import ir  # type: ignore[import-untyped]

from processing.simd.vectors import (
    BITS,
    F32,
    I32,
    LANES,
    call,
    constant,
    float32x16,
    float64x16,
    intrinsic,
    spread,
    types,
)

config: Any = numba.core.config
codegen: Any = numba.core.codegen

_I1, _I64 = ir.IntType(1), ir.IntType(64)


def _has_permutes() -> bool:
    """Whether the processor that Numba compiles for can permute sixteen numbers by an index vector (AVX-512)."""
    if config.CPU_FEATURES is not None:
        features = str(config.CPU_FEATURES)
    elif config.CPU_NAME == "generic":
        features = ""
    else:
        features = codegen.get_host_cpu_features()
    return "+avx512f" in str(features).split(",")


PERMUTES = _has_permutes()
"""Whether :func:`lookup16` and :func:`lookup32` exist; without them :func:`gather` does their work."""


def _address(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Address of ``array[index]`` of a contiguous one-dimensional array."""
    start = context.make_array(kind)(context, builder, array).data
    return builder.gep(start, [index if index.type == _I64 else builder.sext(index, _I64)])


def _contiguous(array: Any) -> bool:
    return isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"


def _of(array: Any) -> Any:
    return {types.float32: float32x16, types.float64: float64x16}.get(array.dtype) if _contiguous(array) else None


STREAM_BYTES = 64
"""What addresses given to :func:`stream` are multiples of: a vector of float32, and a line of caches."""


@intrinsic
def load(typing: Any, array: Any, index: Any) -> Any:
    """Sixteen numbers from ``array[index]`` on; the array is contiguous and one-dimensional. Not checked."""
    kind = _of(array)
    if kind is None or not isinstance(index, types.Integer):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _address(context, builder, array, arguments[0], arguments[1])
        value = builder.load(builder.bitcast(place, kind.llvm.as_pointer()))
        value.align = array.dtype.bitwidth // 8
        return value

    return kind(array, index), generate


@intrinsic
def store(typing: Any, array: Any, index: Any, vector: Any) -> Any:
    """Put a vector at ``array[index]`` and after. Not checked."""
    if vector is not _of(array) or not isinstance(index, types.Integer):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _address(context, builder, array, arguments[0], arguments[1])
        made = builder.store(arguments[2], builder.bitcast(place, vector.llvm.as_pointer()))
        made.align = array.dtype.bitwidth // 8
        return context.get_dummy_value()

    return types.void(array, index, vector), generate


@intrinsic
def stream(typing: Any, array: Any, index: Any, vector: Any) -> Any:
    """:func:`store` past the caches, for what is not read soon: the place is a multiple of 64 bytes. Not checked.

    End with :func:`fence` before another thread reads.
    """
    if vector is not _of(array) or not isinstance(index, types.Integer):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _address(context, builder, array, arguments[0], arguments[1])
        made = builder.store(arguments[2], builder.bitcast(place, vector.llvm.as_pointer()))
        made.align = STREAM_BYTES
        made.set_metadata("nontemporal", builder.module.add_metadata([I32(1)]))
        return context.get_dummy_value()

    return types.void(array, index, vector), generate


@intrinsic
def fence(typing: Any) -> Any:
    """All that was stored before is seen by other threads before anything that is stored after."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.fence("seq_cst")
        return context.get_dummy_value()

    return types.void(), generate


@intrinsic
def store_whole(typing: Any, array: Any, index: Any, vector: Any) -> Any:
    """Put sixteen whole numbers, given as float64, into an int64 array at ``array[index]`` and after. Not checked."""
    if not (_contiguous(array) and array.dtype == types.int64 and vector is float64x16):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        wide = ir.VectorType(_I64, LANES)
        place = _address(context, builder, array, arguments[0], arguments[1])
        made = builder.store(builder.fptosi(arguments[2], wide), builder.bitcast(place, wide.as_pointer()))
        made.align = 8
        return context.get_dummy_value()

    return types.void(array, index, vector), generate


@intrinsic
def add_pairs(typing: Any, array: Any, index: Any, even: Any, odd: Any) -> Any:
    """Add to sixteen pairs of float32 from ``array[index]`` on, such as complex numbers. Not checked."""
    if _of(array) is not float32x16 or even is not float32x16 or odd is not even:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pairs = ir.VectorType(F32, 2 * LANES)
        order = [lane // 2 + LANES * (lane % 2) for lane in range(2 * LANES)]
        mask = ir.Constant(ir.VectorType(I32, 2 * LANES), order)
        start = _address(context, builder, array, arguments[0], arguments[1])
        place = builder.bitcast(start, pairs.as_pointer())
        before = builder.load(place)
        before.align = 4
        added = builder.fadd(before, builder.shuffle_vector(arguments[2], arguments[3], mask))
        builder.store(added, place).align = 4
        return context.get_dummy_value()

    return types.void(array, index, even, odd), generate


@intrinsic
def lookup16(typing: Any, table: Any, first: Any, places: Any) -> Any:
    """``table[first + p]`` for whole places p of 0 to 15, given as :func:`index_bits`; needs :data:`PERMUTES`."""
    if not (_contiguous(table) and table.dtype == types.float32 and places is float32x16):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        (low,) = _windows(context, builder, table, arguments[0], arguments[1], 1)
        index = builder.bitcast(arguments[2], ir.VectorType(I32, LANES))
        return call(builder, "llvm.x86.avx512.permvar.sf.512", float32x16.llvm, [low, index])

    return float32x16(table, first, places), generate


@intrinsic
def lookup32(typing: Any, table: Any, first: Any, places: Any) -> Any:
    """``table[first + p]`` for whole places p of 0 to 31, given as :func:`index_bits`; needs :data:`PERMUTES`."""
    if not (_contiguous(table) and table.dtype == types.float32 and places is float32x16):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        low, high = _windows(context, builder, table, arguments[0], arguments[1], 2)
        index = builder.bitcast(arguments[2], ir.VectorType(I32, LANES))
        return call(builder, "llvm.x86.avx512.vpermi2var.ps.512", float32x16.llvm, [low, index, high])

    return float32x16(table, first, places), generate


def _windows(context: Any, builder: Any, kind: Any, array: Any, index: Any, count: int) -> list[Any]:
    place = builder.bitcast(_address(context, builder, kind, array, index), float32x16.llvm.as_pointer())
    found = []
    for k in range(count):
        value = builder.load(builder.gep(place, [ir.Constant(_I64, k)]))
        value.align = 4
        found.append(value)
    return found


@intrinsic
def gather(typing: Any, table: Any, first: Any, places: Any) -> Any:
    """``table[first + p]`` for any whole places p below 2^22 in size, given as :func:`index_bits`. Not checked."""
    if not (_contiguous(table) and table.dtype == types.float32 and places is float32x16):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = ir.VectorType(I32, LANES)
        wide = ir.VectorType(_I64, LANES)
        start = _address(context, builder, table, arguments[0], arguments[1])
        offset = builder.sub(builder.bitcast(arguments[2], whole), constant(int(BITS), whole))
        # llvmlite has no address arithmetic on vectors.
        bytes_away = builder.shl(builder.sext(offset, wide), constant(2, wide))
        addresses = builder.add(spread(builder, builder.ptrtoint(start, _I64), wide), bytes_away)
        places = builder.inttoptr(addresses, ir.VectorType(start.type, LANES))
        all_of_them = ir.Constant(ir.VectorType(_I1, LANES), [1] * LANES)
        return call(
            builder,
            f"llvm.masked.gather.v{LANES}f32.v{LANES}p0",
            float32x16.llvm,
            [places, ir.Constant(I32, 4), all_of_them, ir.Constant(float32x16.llvm, ir.Undefined)],
        )

    return float32x16(table, first, places), generate
