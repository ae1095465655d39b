"""Stolt interpolation: from wavenumber to wavenumber across the rail, referred from one range to another on the way.

Before it the spectrum is referred to the middle of the profiles' ranges, after it to the middle of the image, so that
it turns slowly on either side and a short filter will do. Three filters are there, measured beside one another by
``python -m benchmarks speed.range_migration``: a Kaiser-Bessel kernel (the one in use), the cubic spline, and a
Kaiser-windowed sinc. The first two ask for a correction of the profiles in range, which costs nothing.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray

from processing.sar.gridding import Kernel
from processing.sar.interpolation import sinc_weights
from processing.sar.turns import phasor

_MATH = {"contract", "reassoc", "nsz", "arcp"}
TABLE_STEPS = 8192
"""Intervals per sample of the table of weights, of which the nearest entry is taken: within -90 dB."""

CHUNK = 64
"""Lines that a thread takes at a time."""


class Filter(Protocol):
    """An interpolation filter over a padded transform."""

    def __hash__(self) -> int: ...

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


@functools.lru_cache(maxsize=8)
def weight_table(taps: Filter, steps: int) -> NDArray[np.float32]:
    """Weights on ``steps + 1`` equidistant fractions, (steps + 1, taps) float32, not to be written to."""
    table = taps.weights(np.arange(steps + 1) / steps).astype(np.float32)
    table.setflags(write=False)
    return table


def smooth_step(part: NDArray[np.float64]) -> NDArray[np.float64]:
    """From 0 to 1 over ``part`` from 0 to 1, with two steady derivatives: 10 t^3 - 15 t^4 + 6 t^5."""
    return np.asarray(part**3 * (10 - 15 * part + 6 * part**2))


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
    table = weight_table(taps, TABLE_STEPS)
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
        amplitude = np.sqrt(2 * np.pi / across) * (across / k) ** mapping.exponent * smooth_step(edge)
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
    steep = 1 / (inner - outer)
    for chunk in prange((lines + CHUNK - 1) // CHUNK):
        begin = chunk * CHUNK
        here = min(CHUNK, lines - begin)
        whole = np.empty(here, dtype=np.int64)
        entry = np.empty(here, dtype=np.int64)
        size = np.empty(here, dtype=np.float64)
        turns = np.empty(here, dtype=np.float64)
        cosine = np.empty(here, dtype=np.float32)
        sine = np.empty(here, dtype=np.float32)
        beside, starts = along[begin : begin + here], across_first[begin : begin + here]
        for j in range(count):
            for i in range(here):
                across = across_step * (starts[i] + j)
                k = math.sqrt(across * across + beside[i] * beside[i])
                place = (k - k_first) * per_step
                kept = (place >= half - 1.0) & (place <= columns - half) & (across > outer * k)
                place = place if kept else half - 1.0
                low = min(math.floor(place), columns - half - 1.0)
                whole[i] = int(low) - half + 1
                entry[i] = int((place - low) * TABLE_STEPS + 0.5)
                edge = min(max((across / k - outer) * steep, 0.0), 1.0)
                edge *= edge * edge * (10.0 - 15.0 * edge + 6.0 * edge * edge)
                size[i] = edge * math.sqrt(2 * math.pi / across) if kept else 0.0
                turns[i] = (middle * across - bulk * (k - centre)) * turn
            if exponent > 0.0:
                for i in range(here):
                    across = across_step * (starts[i] + j)
                    size[i] *= (across / math.sqrt(across * across + beside[i] * beside[i])) ** exponent
            for i in range(here):
                c, s = phasor(turns[i])
                amplitude = np.float32(size[i])
                cosine[i] = amplitude * c
                sine[i] = amplitude * s
            for i in range(here):
                re = np.float32(0)
                im = np.float32(0)
                if size[i] > 0.0:
                    weights = table[entry[i]]
                    for tap in range(taps):
                        value = spectrum[whole[i] + tap, begin + i]
                        re += weights[tap] * value.real
                        im += weights[tap] * value.imag
                out[j, begin + i] = complex(re * cosine[i] - im * sine[i], re * sine[i] + im * cosine[i])
