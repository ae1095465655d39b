"""Stolt interpolation: from wavenumber to wavenumber across the rail, referred from one range to another on the way.

Before it the spectrum is referred to the middle of the profiles' ranges, after it to the middle of the image, so that
it turns slowly on either side and a short filter will do. Three filters are there, measured beside one another by
``python -m benchmarks speed.range_migration``: a Kaiser-Bessel kernel (the one in use), the cubic spline, and a
Kaiser-windowed sinc. The first two ask for a correction of the profiles in range, which costs nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray

from processing.sar.factorized_kernel import _phasor
from processing.sar.gridding import TABLE_STEPS, Kernel
from processing.sar.interpolation import sinc_weights

_MATH = {"contract", "reassoc", "nsz", "arcp"}
CHUNK = 32
"""Lines that a thread takes at a time."""


class Filter(Protocol):
    """An interpolation filter over a padded transform."""

    @property
    def taps(self) -> int:
        """Even number of samples read."""

    @property
    def oversampling(self) -> float:
        """Samples per sample of the unpadded transform."""

    def weights(self, fraction: ArrayLike) -> NDArray[np.float64]:
        """(..., taps) weights around a place between the two middle samples."""

    def response(self, cycles: ArrayLike) -> NDArray[np.float64]:
        """What is to be divided off each term, by its cycles per sample."""


@dataclass(frozen=True)
class CubicSpline:
    """The interpolating cubic spline: B-splines, whose prefilter is a division of the terms (Unser 1999)."""

    oversampling: float = 4.0
    taps: int = 4

    def weights(self, fraction: ArrayLike) -> NDArray[np.float64]:
        """Cubic B-spline at four samples."""
        w = np.asarray(fraction, dtype=np.float64)
        return np.stack([(1 - w) ** 3, 4 - 6 * w**2 + 3 * w**3, 1 + 3 * w + 3 * w**2 - 3 * w**3, w**3], axis=-1) / 6

    def response(self, cycles: ArrayLike) -> NDArray[np.float64]:
        """Transform of the B-spline's samples."""
        return np.asarray((2 + np.cos(2 * np.pi * np.asarray(cycles))) / 3)


@dataclass(frozen=True)
class WindowedSinc:
    """A Kaiser-windowed sinc, which is flat in the band and asks for no correction."""

    oversampling: float = 4.0
    taps: int = 8

    def weights(self, fraction: ArrayLike) -> NDArray[np.float64]:
        """See :func:`processing.sar.interpolation.sinc_weights`."""
        return sinc_weights(fraction, self.taps, self.oversampling)

    def response(self, cycles: ArrayLike) -> NDArray[np.float64]:
        """1."""
        return np.ones(np.shape(cycles))


FILTERS: dict[str, Filter] = {
    "kaiser-bessel": Kernel(6, 1.5),
    "cubic-spline": CubicSpline(),
    "sinc8": WindowedSinc(),
}
"""By name; the first is the one in use."""


@dataclass(frozen=True)
class Mapping:
    """Where a spectrum's lines lie before and after the change from k to k_y; wavenumbers in rad/m."""

    along: NDArray[np.float64]
    """(lines,) k_x."""
    k_first: float
    """k of the first sample."""
    k_step: float
    centre: float
    """k that the carrier has."""
    bulk_m: float
    """Range that the spectrum is referred to before."""
    across_first: NDArray[np.int64]
    """(lines,) first k_y of each line, in steps."""
    across_step: float
    across_count: int
    middle_m: float
    """Distance across the rail that it is referred to after."""
    inner_cosine: float = 0.0
    """Of the widest angle from broadside that is kept whole."""
    outer_cosine: float = -1.0
    """Of the angle that it is rolled off to."""
    exponent: float = 0.0
    """Of the antennas' amplitude pattern, ``cos^n``."""


def stolt(spectrum: NDArray[np.complex64], mapping: Mapping, taps: Filter) -> NDArray[np.complex64]:
    """Resample each line of a spectrum from k to ``sqrt(k^2 - k_x^2)``; compiled, lines shared among threads.

    The result is multiplied by ``sqrt(2 pi / k_y) cos^n exp(j (middle k_y - bulk (k - centre)))``, back-projection's
    amplitude (see :mod:`processing.sar.range_migration`) and the change of reference, and rolled off at wide angles.

    Args:
        spectrum: (columns, lines) samples at ``k_first + column * k_step``, of terms that the filter's response was
            divided off.
        mapping: where the lines lie.
        taps: the filter.

    Returns:
        (across_count, lines) complex64; 0 where k lies outside the spectrum.
    """
    out = np.empty((mapping.across_count, spectrum.shape[1]), dtype=np.complex64)
    table = taps.weights(np.arange(TABLE_STEPS + 1) / TABLE_STEPS).astype(np.float32)
    _stolt(
        spectrum, mapping.along, mapping.k_first, 1 / mapping.k_step, mapping.centre, mapping.bulk_m,
        mapping.across_first, mapping.across_step, mapping.middle_m, mapping.inner_cosine, mapping.outer_cosine,
        mapping.exponent, table, out,
    )  # fmt: skip
    return out


def stolt_reference(spectrum: NDArray[np.complexfloating], mapping: Mapping, taps: Filter) -> NDArray[np.complex128]:
    """:func:`stolt` in plain NumPy, float64: its definition."""
    columns, lines = spectrum.shape
    out = np.zeros((mapping.across_count, lines), dtype=np.complex128)
    half = taps.taps // 2
    for line, k_along in enumerate(mapping.along):
        across = mapping.across_step * (mapping.across_first[line] + np.arange(mapping.across_count))
        k = np.hypot(across, k_along)
        place = (k - mapping.k_first) / mapping.k_step
        inside = (place >= half - 1) & (place <= columns - half) & (across > 0)
        place, across, k = place[inside], across[inside], k[inside]
        whole = np.floor(place).astype(np.int64)
        bins = np.clip(whole[:, None] + np.arange(1 - half, half + 1), 0, columns - 1)
        value = (spectrum[:, line][bins] * taps.weights(place - whole)).sum(axis=1)
        phase = mapping.middle_m * across - mapping.bulk_m * (k - mapping.centre)
        edge = np.clip((across / k - mapping.outer_cosine) / (mapping.inner_cosine - mapping.outer_cosine), 0, 1)
        amplitude = np.sqrt(2 * np.pi / across) * (across / k) ** mapping.exponent * (0.5 - 0.5 * np.cos(np.pi * edge))
        out[inside, line] = value * amplitude * np.exp(1j * phase)
    return out


@njit(parallel=True, cache=True, nogil=True, fastmath=_MATH, error_model="numpy")
def _stolt(
    spectrum: Any, along: Any, k_first: float, per_step: float, centre: float, bulk: float, across_first: Any,
    across_step: float, middle: float, inner: float, outer: float, exponent: float, table: Any, out: Any,
) -> None:  # fmt: skip
    columns, lines = spectrum.shape
    count = out.shape[0]
    taps = table.shape[1]
    half = taps // 2
    turn = 1 / (2 * math.pi)
    for chunk in prange((lines + CHUNK - 1) // CHUNK):
        for line in range(chunk * CHUNK, min(lines, (chunk + 1) * CHUNK)):
            along_squared = along[line] * along[line]
            for j in range(count):
                across = across_step * (across_first[line] + j)
                k = math.sqrt(across * across + along_squared)
                place = (k - k_first) * per_step
                if place < half - 1.0 or place > columns - half or across <= outer * k:
                    out[j, line] = 0.0
                    continue
                whole = min(int(place), columns - half - 1)
                entry = (place - whole) * TABLE_STEPS
                q = min(int(entry), TABLE_STEPS - 1)
                part = np.float32(entry - q)
                re = np.float32(0)
                im = np.float32(0)
                for tap in range(taps):
                    weight = table[q, tap] + part * (table[q + 1, tap] - table[q, tap])
                    value = spectrum[whole - half + 1 + tap, line]
                    re += weight * value.real
                    im += weight * value.imag
                size = math.sqrt(2 * math.pi / across)
                if across < inner * k:
                    size *= 0.5 - 0.5 * math.cos(math.pi * (across / k - outer) / (inner - outer))
                if exponent > 0.0:
                    size *= (across / k) ** exponent
                amplitude = np.float32(size)
                c, s = _phasor((middle * across - bulk * (k - centre)) * turn)
                out[j, line] = complex(amplitude * (re * c - im * s), amplitude * (re * s + im * c))
