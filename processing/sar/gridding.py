"""Kaiser-Bessel gridding: between equal steps and any places, by a short kernel and one division.

A sum of exponentials at equal steps is wanted at any places (or is given at any places and wanted at equal steps). A
transform that is ``oversampling`` times as long as there are terms, and a kernel of a few taps over its samples, give
it; what the kernel does to the terms is known and divided off beforehand. Errors fall by a factor of
``exp(pi sqrt(1 - 1 / oversampling))`` with each tap, far faster than those of a windowed sinc, which has to be flat.
Kernel: Jackson, Meyer, Nishimura, Macovski 1991; shape: Beatty, Nishimura, Pauly 2005, equation 5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError


@dataclass(frozen=True)
class Kernel:
    """A Kaiser-Bessel kernel over ``taps`` samples for a transform of ``oversampling`` times the terms."""

    taps: int = 6
    """Even number of samples."""
    oversampling: float = 1.5

    def __post_init__(self) -> None:
        if self.taps < 2 or self.taps % 2 or not (1 < self.oversampling <= 8):
            raise DataError(
                f"a kernel of {self.taps} taps at {self.oversampling:g} times the terms cannot be made",
                "give an even number of taps and an oversampling above 1 and up to 8",
            )

    @property
    def shape(self) -> float:
        """Kaiser's beta that leaves the least error."""
        width, over = self.taps, self.oversampling
        return math.pi * math.sqrt(max((width / over) ** 2 * (over - 0.5) ** 2 - 0.8, 0.1))

    @property
    def error_db(self) -> float:
        """Expected error of one term, dB: exponential in the taps (Fessler, Sutton 2003)."""
        return -20 * math.pi * self.taps * math.sqrt(1 - 1 / self.oversampling) / math.log(10)

    def weights(self, fraction: ArrayLike) -> NDArray[np.float64]:
        """Weights of the samples around a place.

        Args:
            fraction: place between the two middle samples, 0 to 1, any shape.

        Returns:
            (..., taps) for samples ``floor(t) - taps/2 + 1`` to ``floor(t) + taps/2``.
        """
        half = self.taps // 2
        away = np.asarray(fraction, dtype=np.float64)[..., None] - np.arange(1 - half, half + 1)
        inside = np.sqrt(np.clip(1 - (away / half) ** 2, 0, None))
        # The window is open at its ends, where it is 1 / I0(beta): samples beyond them count nothing.
        weights: NDArray[np.float64] = np.where(np.abs(away) <= half, np.i0(self.shape * inside), 0) / np.i0(self.shape)
        return weights

    def response(self, cycles: ArrayLike) -> NDArray[np.float64]:
        """What the kernel makes of a term of ``cycles`` per sample: its Fourier transform, to be divided off."""
        under = np.sqrt(np.asarray(self.shape**2 - (math.pi * self.taps * np.asarray(cycles)) ** 2, dtype=complex))
        small = np.abs(under) < 1e-6
        value = np.where(small, 1.0, np.sinh(under) / np.where(small, 1.0, under))
        return np.asarray(self.taps * value.real / np.i0(self.shape))


def places(at: NDArray[np.float64], kernel: Kernel, length: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """First sample and weights for reading (or spreading) at places of a periodic array.

    Args:
        at: (places,) in samples, any real numbers.
        kernel: the kernel.
        length: samples of the array's period.

    Returns:
        (places,) first sample, 0 to length - 1, and (places, taps) weights.
    """
    whole = np.floor(at)
    first = (whole.astype(np.int64) - kernel.taps // 2 + 1) % length
    return first, kernel.weights(at - whole)


def chebyshev_nodes(axis: NDArray[np.float64], most: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes for a smooth function over an axis and the matrix (axis, nodes) that interpolates from its values there.

    Chebyshev points of the second kind, barycentric formula (Berrut, Trefethen 2004); the axis itself if it is no
    longer than ``most``.
    """
    if len(axis) <= most or np.ptp(axis) == 0:
        return axis, np.eye(len(axis))
    low, high = float(axis.min()), float(axis.max())
    nodes = 0.5 * (low + high) + 0.5 * (high - low) * chebyshev.chebpts2(most)
    weights = (-1.0) ** np.arange(most)
    weights[[0, -1]] *= 0.5
    away = axis[:, None] - nodes
    met = away == 0
    terms = weights / np.where(met, 1.0, away)
    matrix = terms / terms.sum(axis=1, keepdims=True)
    rows = met.any(axis=1)
    matrix[rows] = met[rows]
    return nodes, matrix
