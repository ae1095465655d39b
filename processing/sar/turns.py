"""The phasor of one float64 number of turns, for kernels that the compiler turns into vectors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

# Reordering and contraction only: nothing here may assume that numbers are finite.
MATH = {"contract", "reassoc", "nsz", "arcp"}


@njit(inline="always", fastmath=MATH, error_model="numpy")
def phasor(turns: float) -> Any:
    """Cosine and sine of a float64 number of turns, as float32.

    Folded to a quarter turn, where these Taylor series are good to 6e-8, float32's own rounding.
    """
    angle = np.float32(turns - math.floor(turns + 0.5))
    size = abs(angle)
    far = size > np.float32(0.25)
    v = (np.float32(0.5) - size if far else size) * np.float32(2 * math.pi)
    u = v * v
    c = np.float32(-1 / 3628800) + u * np.float32(1 / 479001600)
    c = np.float32(-1 / 720) + u * (np.float32(1 / 40320) + u * c)
    c = np.float32(1) + u * (np.float32(-1 / 2) + u * (np.float32(1 / 24) + u * c))
    s = np.float32(-1 / 5040) + u * (np.float32(1 / 362880) + u * np.float32(-1 / 39916800))
    s = v * (np.float32(1) + u * (np.float32(-1 / 6) + u * (np.float32(1 / 120) + u * s)))
    return (-c if far else c), (-s if angle < np.float32(0) else s)
