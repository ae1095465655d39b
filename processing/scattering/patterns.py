"""Interpolation over a band between Chebyshev's nodes (Lagrange's form), for patterns that change with frequency."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def chebyshev_nodes(count: int, half: float) -> Floats:
    """(count,) zeros of Chebyshev's polynomial over ``1 - half`` to ``1 + half``."""
    return np.asarray(1 + half * np.cos((np.arange(count) + 0.5) * np.pi / count), dtype=np.float64)


def lagrange(nodes: Floats, at: Floats) -> Floats:
    """(nodes, n) weights of values at the nodes in the polynomial through them, at (n,) places."""
    weights = np.ones((len(nodes), len(at)))
    for one, node in enumerate(nodes):
        for other, apart in enumerate(nodes):
            if one != other:
                weights[one] *= (at - apart) / (node - apart)
    return weights
