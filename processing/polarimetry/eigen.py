"""Eigenvalues and eigenvectors of 3 x 3 Hermitian matrices, compiled, as accurate as LAPACK's.

The trigonometric formula alone loses half of the digits where two eigenvalues are close, as at every single-look pixel.
So it only finds the eigenvalue that stands apart, with its vector; what is orthogonal to that is a 2 x 2 problem, which
is solved without cancellation (Eberly 2014, "A robust eigensolver for 3 x 3 symmetric matrices", taken to complex
numbers). All errors are of the order of the rounding of the largest eigenvalue.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True, error_model="numpy")
def hermitian_eigen(
    t11: float, t12: complex, t13: complex, t22: float, t23: complex, t33: float, values: NDArray[Any],
    vectors: NDArray[Any],
) -> None:  # fmt: skip
    """Eigenvalues (3,), the largest first, and unit eigenvectors as columns (3, 3) of one matrix.

    Args:
        t11, t12, t13, t22, t23, t33: diagonal and upper elements; all must be finite.
        values: (3,) float64, filled.
        vectors: (3, 3) complex128, filled; the phase of each column is arbitrary.
    """
    scale = max(abs(t11), abs(t22), abs(t33), abs(t12), abs(t13), abs(t23))
    vectors[:] = 0.0
    if scale == 0.0:
        values[:] = 0.0
        vectors[0, 0] = vectors[1, 1] = vectors[2, 2] = 1.0
        return
    mean = (t11 / scale + t22 / scale + t33 / scale) / 3.0
    a, b, c = t11 / scale - mean, t22 / scale - mean, t33 / scale - mean
    d, e, f = t12 / scale, t13 / scale, t23 / scale
    d2, e2, f2 = _square(d), _square(e), _square(f)
    size = math.sqrt((a * a + b * b + c * c + 2.0 * (d2 + e2 + f2)) / 6.0)
    if size < 1e-300:
        values[:] = mean * scale
        vectors[0, 0] = vectors[1, 1] = vectors[2, 2] = 1.0
        return
    determinant = a * b * c + 2.0 * (d * f * e.conjugate()).real - a * f2 - b * e2 - c * d2
    half = min(max(determinant / (2.0 * size * size * size), -1.0), 1.0)
    # The root of the determinant's sign is the one that stands apart.
    apart = 2.0 * size * math.cos(math.acos(abs(half)) / 3.0)
    if half < 0.0:
        apart = -apart
    v1, v2, v3 = _null_vector(a - apart, d, e, b - apart, f, c - apart)
    apart = (
        a * _square(v1) + b * _square(v2) + c * _square(v3)
        + 2.0 * (v1.conjugate() * (d * v2 + e * v3) + v2.conjugate() * f * v3).real
    )  # fmt: skip
    # Two unit vectors orthogonal to v and to each other.
    if _square(v1) <= _square(v2) or _square(v1) <= _square(v3):
        length = math.sqrt(_square(v2) + _square(v3))
        u1, u2, u3 = 0j, v3.conjugate() / length, -v2.conjugate() / length
    else:
        length = math.sqrt(_square(v1) + _square(v3))
        u1, u2, u3 = v3.conjugate() / length, 0j, -v1.conjugate() / length
    w1 = (v2 * u3 - v3 * u2).conjugate()
    w2 = (v3 * u1 - v1 * u3).conjugate()
    w3 = (v1 * u2 - v2 * u1).conjugate()
    g1, g2 = a * u1 + d * u2 + e * u3, d.conjugate() * u1 + b * u2 + f * u3
    g3 = e.conjugate() * u1 + f.conjugate() * u2 + c * u3
    h1, h2 = a * w1 + d * w2 + e * w3, d.conjugate() * w1 + b * w2 + f * w3
    h3 = e.conjugate() * w1 + f.conjugate() * w2 + c * w3
    uu = (u1.conjugate() * g1 + u2.conjugate() * g2 + u3.conjugate() * g3).real
    ww = (w1.conjugate() * h1 + w2.conjugate() * h2 + w3.conjugate() * h3).real
    uw = u1.conjugate() * h1 + u2.conjugate() * h2 + u3.conjugate() * h3
    middle, difference, coupling = 0.5 * (uu + ww), 0.5 * (uu - ww), abs(uw)
    radius = math.hypot(difference, coupling)
    # cos and sin of half the angle whose cosine is difference / radius, without cancellation.
    if radius > 0.0:
        cosine = math.sqrt(0.5 * (1.0 + abs(difference) / radius))
        sine = 0.5 * coupling / (radius * cosine)
        if difference < 0.0:
            cosine, sine = sine, cosine
    else:
        cosine, sine = 1.0, 0.0
    phase = uw.conjugate() / coupling if coupling > 0.0 else 1.0 + 0j
    turned = sine * phase
    high1, high2, high3 = cosine * u1 + turned * w1, cosine * u2 + turned * w2, cosine * u3 + turned * w3
    back = sine * phase.conjugate()
    low1, low2, low3 = cosine * w1 - back * u1, cosine * w2 - back * u2, cosine * w3 - back * u3
    first, second, third = (0, 1, 2) if half >= 0.0 else (2, 0, 1)
    values[first] = (apart + mean) * scale
    values[second] = (middle + radius + mean) * scale
    values[third] = (middle - radius + mean) * scale
    vectors[0, first], vectors[1, first], vectors[2, first] = v1, v2, v3
    vectors[0, second], vectors[1, second], vectors[2, second] = high1, high2, high3
    vectors[0, third], vectors[1, third], vectors[2, third] = low1, low2, low3


@njit(cache=True, nogil=True)
def _square(z: complex) -> float:
    return z.real * z.real + z.imag * z.imag


@njit(cache=True, nogil=True)
def _null_vector(a: float, d: complex, e: complex, b: float, f: complex, c: float) -> tuple[complex, complex, complex]:
    """Unit vector that a singular Hermitian matrix takes to zero: the largest column of its adjugate."""
    m11, m22, m33 = b * c - _square(f), a * c - _square(e), a * b - _square(d)
    m12, m13, m23 = e * f.conjugate() - c * d, d * f - b * e, d.conjugate() * e - a * f
    if abs(m11) >= abs(m22) and abs(m11) >= abs(m33):
        x, y, z = m11 + 0j, m12.conjugate(), m13.conjugate()
    elif abs(m22) >= abs(m33):
        x, y, z = m12, m22 + 0j, m23.conjugate()
    else:
        x, y, z = m13, m23, m33 + 0j
    length = math.sqrt(_square(x) + _square(y) + _square(z))
    if length == 0.0:
        return 1.0 + 0j, 0j, 0j
    return x / length, y / length, z / length


@njit(cache=True, nogil=True)
def hermitian_eigen_of(matrices: NDArray[np.complex128]) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """:func:`hermitian_eigen` of matrices (n, 3, 3): eigenvalues (n, 3), the largest first, and vectors (n, 3, 3)."""
    count = matrices.shape[0]
    values = np.empty((count, 3))
    vectors = np.empty((count, 3, 3), dtype=np.complex128)
    for n in range(count):
        m = matrices[n]
        hermitian_eigen(
            m[0, 0].real, m[0, 1], m[0, 2], m[1, 1].real, m[1, 2], m[2, 2].real, values[n], vectors[n]
        )  # fmt: skip
    return values, vectors
