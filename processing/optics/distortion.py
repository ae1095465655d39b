"""Lens distortion after Brown and Conrady: two radial and two tangential terms.

With a point's ideal image coordinates over the focal length (a to the right, b down) and ``q = a^2 + b^2``,

    a' = a (1 + k1 q + k2 q^2) + 2 p1 a b + p2 (q + 2 a^2)
    b' = b (1 + k1 q + k2 q^2) + p1 (q + 2 b^2) + 2 p2 a b

(Brown 1971, Photogrammetric Engineering 37(8) 855; coefficients in the order k1, k2, p1, p2 that is common in computer
vision).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Coefficients = tuple[float, float, float, float]
"""k1, k2, p1, p2."""

NONE: Coefficients = (0.0, 0.0, 0.0, 0.0)
_STEPS = 20


def distorted(a: ArrayLike, b: ArrayLike, coefficients: Coefficients) -> tuple[Floats, Floats]:
    """Where the lens shows points, from where a pinhole would; each of any one shape, over the focal length."""
    right, down = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    k1, k2, p1, p2 = coefficients
    q = right**2 + down**2
    radial = 1 + q * (k1 + k2 * q)
    return (
        right * radial + 2 * p1 * right * down + p2 * (q + 2 * right**2),
        down * radial + p1 * (q + 2 * down**2) + 2 * p2 * right * down,
    )


def undistorted(a: ArrayLike, b: ArrayLike, coefficients: Coefficients) -> tuple[Floats, Floats]:
    """Inverse of :func:`distorted`, by Newton's method; NaN where the lens folds and there is none.

    Args:
        a, b: as the lens shows them.
        coefficients: k1, k2, p1, p2.
    """
    seen = np.stack(np.broadcast_arrays(np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)))
    if not any(coefficients):
        return seen[0], seen[1]
    k1, k2, p1, p2 = coefficients
    x, y = seen.copy()
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            at = distorted(x, y, coefficients)
            off, offset = seen[0] - at[0], seen[1] - at[1]
            q = x**2 + y**2
            radial, slope = 1 + q * (k1 + k2 * q), 2 * (k1 + 2 * k2 * q)
            xx = radial + slope * x**2 + 2 * p1 * y + 6 * p2 * x
            yy = radial + slope * y**2 + 6 * p1 * y + 2 * p2 * x
            xy = slope * x * y + 2 * p1 * x + 2 * p2 * y
            determinant = xx * yy - xy**2
            x = x + (yy * off - xy * offset) / determinant
            y = y + (xx * offset - xy * off) / determinant
        at = distorted(x, y, coefficients)
        # Where Newton's method leaves a part of a pixel, the point is beyond what the lens can show.
        good = (np.abs(at[0] - seen[0]) + np.abs(at[1] - seen[1]) < 1e-9) & (determinant > 0)
    return np.where(good, x, np.nan), np.where(good, y, np.nan)
