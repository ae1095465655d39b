"""Phasors and powers of sixteen numbers at a time, for the kernels of back-projection."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from processing.simd import (
    INDEX_BITS,
    flip_odd,
    fma,
    log2_parts,
    maximum,
    rint,
    splat,
    times_power_of_two,
    where_positive,
)

INSIDE: dict[str, Any] = {"nogil": True, "error_model": "numpy", "forceinline": True}
"""How functions are compiled that become part of a loop."""

# cos(pi x) = sum c x^2k and sin(pi x) = x sum s x^2k for |x| <= 1/2, Chebyshev series: within 5e-8 and 1.2e-6.
_C0, _C1, _C2, _C3, _C4 = (np.float32(c) for c in (0.999999953, -4.93479283, 4.05841137, -1.33187662, 0.219689615))
_S0, _S1, _S2, _S3 = (np.float32(s) for s in (3.14159027, -5.16740677, 2.54401068, -0.559462469))


@njit(**INSIDE)
def turned(halves: Any) -> Any:
    """Cosine and sine of float32 angles in half turns, up to 2^21 of them, within 1.2e-6.

    Whole half turns only turn the sign, so short series in what is left will do.
    """
    bits = halves + splat(INDEX_BITS)
    x = halves - (bits - splat(INDEX_BITS))
    z = x * x
    c = fma(z, fma(z, fma(z, fma(z, splat(_C4), splat(_C3)), splat(_C2)), splat(_C1)), splat(_C0))
    s = fma(z, fma(z, fma(z, splat(_S3), splat(_S2)), splat(_S1)), splat(_S0))
    return flip_odd(c, bits), flip_odd(x, bits) * s


@njit(**INSIDE)
def turned_exactly(x: Any) -> Any:
    """Cosine and sine of float32 angles in turns, -1/2 to 1/2, to float32's own rounding, 6e-8, by Taylor series."""
    size = maximum(x, -x)
    far = size - splat(np.float32(0.25))
    v = where_positive(far, splat(np.float32(0.5)) - size, size) * splat(np.float32(2 * math.pi))
    u = v * v
    c = fma(u, splat(np.float32(1 / 479001600)), splat(np.float32(-1 / 3628800)))
    c = fma(u, fma(u, c, splat(np.float32(1 / 40320))), splat(np.float32(-1 / 720)))
    c = fma(u, fma(u, c, splat(np.float32(1 / 24))), splat(np.float32(-1 / 2)))
    c = fma(u, c, splat(np.float32(1)))
    s = fma(u, splat(np.float32(-1 / 39916800)), splat(np.float32(1 / 362880)))
    s = fma(u, fma(u, s, splat(np.float32(-1 / 5040))), splat(np.float32(1 / 120)))
    s = v * fma(u, fma(u, s, splat(np.float32(-1 / 6))), splat(np.float32(1)))
    return where_positive(far, -c, c), where_positive(x, s, -s)


@njit(**INSIDE)
def power(x: Any, exponent: np.float32) -> Any:
    """``x^exponent`` of float32, 0 where x is not positive; exponents are not negative."""
    one = splat(np.float32(1))
    e, m = log2_parts(maximum(x, splat(np.float32(1e-30))))
    s = (m - one) / (m + one)
    z = s * s
    # log2 m = 2 / ln 2 (s + s^3 / 3 + s^5 / 5 + ...), |s| < 0.172: what is left out is below 1e-9.
    series = fma(z, fma(z, splat(np.float32(2 / 9)), splat(np.float32(2 / 7))), splat(np.float32(2 / 5)))
    series = fma(z, fma(z, series, splat(np.float32(2 / 3))), splat(np.float32(2)))
    y = fma(s * series, splat(np.float32(1 / math.log(2))), e) * splat(exponent)
    n = rint(y)
    f = (y - n) * splat(np.float32(math.log(2)))
    p = fma(f, fma(f, splat(np.float32(1 / 720)), splat(np.float32(1 / 120))), splat(np.float32(1 / 24)))
    p = fma(f, fma(f, fma(f, p, splat(np.float32(1 / 6))), splat(np.float32(1 / 2))), one)
    return where_positive(x, times_power_of_two(fma(f, p, one), n), splat(np.float32(0)))
