"""Vectors of sixteen numbers for kernels that the compiler does not turn into vectors by itself.

A loop over pixels that looks values up in tables, or a sum that must keep its order, is compiled number by number. In a
kernel written with these types it is not: :data:`float32x16` and :data:`float64x16` are single values to Numba, held in
registers, with ``+ - * /`` and the functions below, each one instruction (or a few, on processors with narrower
registers; the compiler splits them). Nothing here may be called from plain Python.

Arithmetic is strict: nothing is reordered, and products and sums are fused only by :func:`fma`. So one processor gives
the same bits every time; another kind may round once where the first rounds twice.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numba.core.cgutils
import numba.core.codegen
import numba.extending
import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]

# Numba's inner parts have no usable types.
types: Any = numba.types
cgutils: Any = numba.core.cgutils
config: Any = numba.core.config
codegen: Any = numba.core.codegen
models: Any = numba.extending.models
intrinsic: Any = numba.extending.intrinsic
overload: Any = numba.extending.overload
register_model: Any = numba.extending.register_model

LANES = 16
"""Numbers in a vector."""

_I1, _I32, _I64 = ir.IntType(1), ir.IntType(32), ir.IntType(64)
_F32, _F64 = ir.FloatType(), ir.DoubleType()


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


class Vector(types.Type):  # type: ignore[misc]
    """Numba's type of a vector."""

    def __init__(self, name: str, element: ir.Type) -> None:
        super().__init__(name=name)
        self.llvm = ir.VectorType(element, LANES)
        self.suffix = f"v{LANES}f{32 if element is _F32 else 64}"


class _Float32x16(Vector):
    pass


class _Float64x16(Vector):
    pass


float32x16 = _Float32x16("float32x16", _F32)
"""Sixteen float32."""
float64x16 = _Float64x16("float64x16", _F64)
"""Sixteen float64."""


@register_model(_Float32x16)
class _Float32Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.llvm)


@register_model(_Float64x16)
class _Float64Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.llvm)


def _splat(builder: Any, value: Any, vector: Any) -> Any:
    undefined = ir.Constant(vector, ir.Undefined)
    one = builder.insert_element(undefined, value, ir.Constant(_I32, 0))
    return builder.shuffle_vector(one, undefined, ir.Constant(ir.VectorType(_I32, LANES), [0] * LANES))


def _constant(number: float, vector: Any) -> Any:
    return ir.Constant(vector, [number] * LANES)


def _call(builder: Any, name: str, result: Any, arguments: list[Any]) -> Any:
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


def _address(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Address of ``array[index]`` of a contiguous one-dimensional array."""
    start = context.make_array(kind)(context, builder, array).data
    return builder.gep(start, [index if index.type == _I64 else builder.sext(index, _I64)])


def _contiguous(array: Any) -> bool:
    return isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"


def _of(array: Any) -> Any:
    return {types.float32: float32x16, types.float64: float64x16}.get(array.dtype) if _contiguous(array) else None


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
def splat(typing: Any, number: Any) -> Any:
    """A vector of one float32 or float64, sixteen times."""
    kind: Any = {types.float32: float32x16, types.float64: float64x16}.get(number)
    if kind is None:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _splat(builder, arguments[0], kind.llvm)

    return kind(number), generate


@intrinsic
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """``a * b + c``, rounded once where the processor can do that as fast."""
    if not (isinstance(a, Vector) and a is b and a is c):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _call(builder, f"llvm.fmuladd.{a.suffix}", a.llvm, list(arguments))

    return a(a, a, a), generate


def _unary(name: str, sentence: str) -> Any:
    def typed(typing: Any, a: Any) -> Any:
        if not isinstance(a, Vector):
            return None

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return _call(builder, f"llvm.{name}.{a.suffix}", a.llvm, list(arguments))

        return a(a), generate

    typed.__doc__ = sentence
    return intrinsic(typed)


sqrt = _unary("sqrt", "Square roots.")
rint = _unary("rint", "Nearest whole numbers, halves to the even one.")


def _binary(name: str, sentence: str) -> Any:
    def typed(typing: Any, a: Any, b: Any) -> Any:
        if not (isinstance(a, Vector) and a is b):
            return None

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return _call(builder, f"llvm.{name}.{a.suffix}", a.llvm, list(arguments))

        return a(a, a), generate

    typed.__doc__ = sentence
    return intrinsic(typed)


minimum = _binary("minnum", "The smaller of two numbers, or the one that is not NaN.")
maximum = _binary("maxnum", "The larger of two numbers, or the one that is not NaN.")


@intrinsic
def to_float32(typing: Any, a: Any) -> Any:
    """Rounded to float32."""
    if a is not float64x16:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fptrunc(arguments[0], float32x16.llvm)

    return float32x16(a), generate


@intrinsic
def to_float64(typing: Any, a: Any) -> Any:
    """The same numbers as float64."""
    if a is not float32x16:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fpext(arguments[0], float64x16.llvm)

    return float64x16(a), generate


@intrinsic
def where_positive(typing: Any, condition: Any, a: Any, b: Any) -> Any:
    """``a`` where the condition is above 0, else (also where it is NaN) ``b``."""
    if not (isinstance(a, Vector) and a is b and condition is a):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        positive = builder.fcmp_ordered(">", arguments[0], _constant(0.0, a.llvm))
        return builder.select(positive, arguments[1], arguments[2])

    return a(a, a, a), generate


@intrinsic
def log2_parts(typing: Any, a: Any) -> Any:
    """Exponent and mantissa of normal positive float32: ``a = 2^e m`` with m from sqrt(1/2) to sqrt(2)."""
    if a is not float32x16:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = ir.VectorType(_I32, LANES)
        bits = builder.bitcast(arguments[0], whole)
        # Counted from sqrt(1/2): what is above it in the same octave carries into the exponent.
        raised = builder.sub(bits, _constant(0x3F3504F3, whole))
        exponent = builder.ashr(raised, _constant(23, whole))
        mantissa = builder.sub(bits, builder.shl(exponent, _constant(23, whole)))
        parts = (builder.sitofp(exponent, a.llvm), builder.bitcast(mantissa, a.llvm))
        return context.make_tuple(builder, signature.return_type, parts)

    return types.UniTuple(a, 2)(a), generate


@intrinsic
def times_power_of_two(typing: Any, a: Any, exponent: Any) -> Any:
    """``a * 2^exponent`` for whole exponents; 0 below 2^-126."""
    if a is not float32x16 or exponent is not a:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = ir.VectorType(_I32, LANES)
        small = builder.fcmp_ordered("<", arguments[1], _constant(-126.0, a.llvm))
        held = builder.select(small, _constant(-126.0, a.llvm), arguments[1])
        biased = builder.add(builder.fptosi(held, whole), _constant(127, whole))
        power = builder.bitcast(builder.shl(biased, _constant(23, whole)), a.llvm)
        return builder.select(small, _constant(0.0, a.llvm), builder.fmul(arguments[0], power))

    return a(a, a), generate


@intrinsic
def flip_odd(typing: Any, a: Any, bits: Any) -> Any:
    """``a`` with its sign turned where the whole number in ``bits`` (see :data:`INDEX_BITS`) is odd."""
    if a is not float32x16 or bits is not a:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = ir.VectorType(_I32, LANES)
        sign = builder.shl(builder.bitcast(arguments[1], whole), _constant(31, whole))
        return builder.bitcast(builder.xor(builder.bitcast(arguments[0], whole), sign), a.llvm)

    return a(a, a), generate


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
        pairs = ir.VectorType(_F32, 2 * LANES)
        order = [lane // 2 + LANES * (lane % 2) for lane in range(2 * LANES)]
        mask = ir.Constant(ir.VectorType(_I32, 2 * LANES), order)
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
        index = builder.bitcast(arguments[2], ir.VectorType(_I32, LANES))
        return _call(builder, "llvm.x86.avx512.permvar.sf.512", float32x16.llvm, [low, index])

    return float32x16(table, first, places), generate


@intrinsic
def lookup32(typing: Any, table: Any, first: Any, places: Any) -> Any:
    """``table[first + p]`` for whole places p of 0 to 31, given as :func:`index_bits`; needs :data:`PERMUTES`."""
    if not (_contiguous(table) and table.dtype == types.float32 and places is float32x16):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        low, high = _windows(context, builder, table, arguments[0], arguments[1], 2)
        index = builder.bitcast(arguments[2], ir.VectorType(_I32, LANES))
        return _call(builder, "llvm.x86.avx512.vpermi2var.ps.512", float32x16.llvm, [low, index, high])

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
        whole = ir.VectorType(_I32, LANES)
        wide = ir.VectorType(_I64, LANES)
        start = _address(context, builder, table, arguments[0], arguments[1])
        offset = builder.sub(builder.bitcast(arguments[2], whole), _constant(int(_BITS), whole))
        # llvmlite has no address arithmetic on vectors.
        bytes_away = builder.shl(builder.sext(offset, wide), _constant(2, wide))
        addresses = builder.add(_splat(builder, builder.ptrtoint(start, _I64), wide), bytes_away)
        places = builder.inttoptr(addresses, ir.VectorType(start.type, LANES))
        all_of_them = ir.Constant(ir.VectorType(_I1, LANES), [1] * LANES)
        return _call(
            builder,
            f"llvm.masked.gather.v{LANES}f32.v{LANES}p0",
            float32x16.llvm,
            [places, ir.Constant(_I32, 4), all_of_them, ir.Constant(float32x16.llvm, ir.Undefined)],
        )

    return float32x16(table, first, places), generate


INDEX_BITS = np.float32(1.5 * 2**23)
"""Added to a number below 2^22 in size it rounds it to a whole one, which the sum holds in its lowest bits: that is
what the lookups take. Taking it off again gives the whole number."""
_BITS = INDEX_BITS.view(np.int32)


def _operator(symbol: Callable[..., Any], name: str) -> None:
    @intrinsic
    def made(typing: Any, a: Any, b: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return getattr(builder, name)(*arguments)

        return a(a, a), generate

    @overload(symbol, strict=False)
    def both(a: Any, b: Any) -> Any:
        if isinstance(a, Vector) and a is b:
            return lambda a, b: made(a, b)
        return None


for _symbol, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _operator(_symbol, _name)


@intrinsic
def _negative(typing: Any, a: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fneg(arguments[0])

    return a(a), generate


@overload(operator.neg, strict=False)
def _negated(a: Any) -> Any:
    return (lambda a: _negative(a)) if isinstance(a, Vector) else None
