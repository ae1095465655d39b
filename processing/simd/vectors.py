"""Sixteen float32 or float64 as one value of Numba's, and arithmetic with them."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numba.core.cgutils
import numba.extending
import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]

# Numba's inner parts have no usable types.
types: Any = numba.types
cgutils: Any = numba.core.cgutils
models: Any = numba.extending.models
intrinsic: Any = numba.extending.intrinsic
overload: Any = numba.extending.overload
register_model: Any = numba.extending.register_model

LANES = 16
"""Numbers in a vector."""

I32, F32, F64 = ir.IntType(32), ir.FloatType(), ir.DoubleType()


class Vector(types.Type):  # type: ignore[misc]
    """Numba's type of a vector."""

    def __init__(self, name: str, element: ir.Type) -> None:
        super().__init__(name=name)
        self.llvm = ir.VectorType(element, LANES)
        self.number = types.float32 if element is F32 else types.float64
        self.suffix = f"v{LANES}f{32 if element is F32 else 64}"


class _Float32x16(Vector):
    pass


class _Float64x16(Vector):
    pass


float32x16 = _Float32x16("float32x16", F32)
"""Sixteen float32."""
float64x16 = _Float64x16("float64x16", F64)
"""Sixteen float64."""


@register_model(_Float32x16)
class _Float32Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.llvm)


@register_model(_Float64x16)
class _Float64Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, kind.llvm)


def spread(builder: Any, value: Any, vector: Any) -> Any:
    """Instructions for a vector of one number."""
    undefined = ir.Constant(vector, ir.Undefined)
    one = builder.insert_element(undefined, value, ir.Constant(I32, 0))
    return builder.shuffle_vector(one, undefined, ir.Constant(ir.VectorType(I32, LANES), [0] * LANES))


def constant(number: float, vector: Any) -> Any:
    """A vector of one constant."""
    return ir.Constant(vector, [number] * LANES)


def call(builder: Any, name: str, result: Any, arguments: list[Any]) -> Any:
    """Instructions for a call of one of LLVM's own functions."""
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


@intrinsic
def splat(typing: Any, number: Any) -> Any:
    """A vector of one float32 or float64, sixteen times."""
    kind: Any = {types.float32: float32x16, types.float64: float64x16}.get(number)
    if kind is None:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return spread(builder, arguments[0], kind.llvm)

    return kind(number), generate


@intrinsic
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """``a * b + c``, rounded once where the processor can do that as fast."""
    if not (isinstance(a, Vector) and a is b and a is c):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return call(builder, f"llvm.fmuladd.{a.suffix}", a.llvm, list(arguments))

    return a(a, a, a), generate


def _unary(name: str, sentence: str) -> Any:
    def typed(typing: Any, a: Any) -> Any:
        if not isinstance(a, Vector):
            return None

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return call(builder, f"llvm.{name}.{a.suffix}", a.llvm, list(arguments))

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
            return call(builder, f"llvm.{name}.{a.suffix}", a.llvm, list(arguments))

        return a(a, a), generate

    typed.__doc__ = sentence
    return intrinsic(typed)


minimum = _binary("minnum", "The smaller of two numbers, or the one that is not NaN.")
maximum = _binary("maxnum", "The larger of two numbers, or the one that is not NaN.")


def _reduced(name: str, sentence: str) -> Any:
    def typed(typing: Any, a: Any) -> Any:
        if not isinstance(a, Vector):
            return None

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            element = a.llvm.element
            kind = ir.FunctionType(element, [a.llvm])
            function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.vector.reduce.{name}.{a.suffix}")
            return builder.call(function, arguments, fastmath=("nnan",))

        return a.number(a), generate

    typed.__doc__ = sentence
    return intrinsic(typed)


smallest = _reduced("fmin", "The smallest of a vector's numbers, none of which is NaN.")
largest = _reduced("fmax", "The largest of a vector's numbers, none of which is NaN.")


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
        positive = builder.fcmp_ordered(">", arguments[0], constant(0.0, a.llvm))
        return builder.select(positive, arguments[1], arguments[2])

    return a(a, a, a), generate


@intrinsic
def log2_parts(typing: Any, a: Any) -> Any:
    """Exponent and mantissa of normal positive float32: ``a = 2^e m`` with m from sqrt(1/2) to sqrt(2)."""
    if a is not float32x16:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = ir.VectorType(I32, LANES)
        bits = builder.bitcast(arguments[0], whole)
        # Counted from sqrt(1/2): what is above it in the same octave carries into the exponent.
        raised = builder.sub(bits, constant(0x3F3504F3, whole))
        exponent = builder.ashr(raised, constant(23, whole))
        mantissa = builder.sub(bits, builder.shl(exponent, constant(23, whole)))
        parts = (builder.sitofp(exponent, a.llvm), builder.bitcast(mantissa, a.llvm))
        return context.make_tuple(builder, signature.return_type, parts)

    return types.UniTuple(a, 2)(a), generate


@intrinsic
def times_power_of_two(typing: Any, a: Any, exponent: Any) -> Any:
    """``a * 2^exponent`` for whole exponents; 0 below 2^-126."""
    if a is not float32x16 or exponent is not a:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = ir.VectorType(I32, LANES)
        small = builder.fcmp_ordered("<", arguments[1], constant(-126.0, a.llvm))
        held = builder.select(small, constant(-126.0, a.llvm), arguments[1])
        biased = builder.add(builder.fptosi(held, whole), constant(127, whole))
        power = builder.bitcast(builder.shl(biased, constant(23, whole)), a.llvm)
        return builder.select(small, constant(0.0, a.llvm), builder.fmul(arguments[0], power))

    return a(a, a), generate


@intrinsic
def flip_odd(typing: Any, a: Any, bits: Any) -> Any:
    """``a`` with its sign turned where the whole number in ``bits`` (see :data:`INDEX_BITS`) is odd."""
    if a is not float32x16 or bits is not a:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = ir.VectorType(I32, LANES)
        sign = builder.shl(builder.bitcast(arguments[1], whole), constant(31, whole))
        return builder.bitcast(builder.xor(builder.bitcast(arguments[0], whole), sign), a.llvm)

    return a(a, a), generate


INDEX_BITS = np.float32(1.5 * 2**23)
"""Added to a number below 2^22 in size it rounds it to a whole one, which the sum holds in its lowest bits: that is
what the lookups take. Taking it off again gives the whole number."""
BITS = INDEX_BITS.view(np.int32)


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
