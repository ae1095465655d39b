"""Detection at a constant rate of false alarms: cell averaging (CA) and ordered statistic (OS).

A pixel is compared with the mean, or with one of the ordered values, of a ring around it. In even clutter of
L looks (gamma distributed intensity) the ratio of both does not depend on the clutter's power, so the factor that a
given rate of false alarms asks for follows exactly:

- CA: pixel over mean of N pixels has Fisher's F distribution with 2L and 2NL degrees of freedom.
- OS: the k-th of N ordered values u has the probability u's rank has, Beta(k, N - k + 1); the rate is the mean over it
  (single look: ``prod (N - i) / (N - i + factor)``, Rohling 1983, IEEE TAES 19(4) 608, eq. 17).

CA is better in even clutter; OS next to edges and other targets. At borders and beside undefined pixels there are fewer
training pixels, and the factor grows accordingly.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray
from scipy import optimize, special

from processing.errors import DataError
from processing.polarimetry.matrices import Planes, as_planes
from processing.polarimetry.pauli import Floats

Kind = Literal["ca", "os"]
RANK = 0.75
"""Which of the ordered training pixels OS takes, as a part of their number (Rohling 1983)."""
FEWEST = 16
"""Training pixels below which nothing is said."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(150)


@dataclass(frozen=True)
class Ring:
    """Where clutter is looked at, around each pixel."""

    outer: int = 21
    """Odd width of the window, pixels."""
    guard: int = 9
    """Odd width of its middle that is left out, for the target itself and its side lobes, pixels."""

    def __post_init__(self) -> None:
        sound = self.outer % 2 == 1 and self.guard % 2 == 1 and 1 <= self.guard < self.outer
        if not sound or self.outer**2 - self.guard**2 < FEWEST:
            raise DataError(
                f"a window of {self.outer} pixels with a middle of {self.guard} is no ring of {FEWEST} pixels or more",
                "take odd widths, such as 21 and 9",
            )


def cfar(
    intensity: ArrayLike, *, false_alarm: float, looks: float, ring: Ring | None = None, kind: Kind = "ca"
) -> Floats:
    """Pixel over its threshold, (rows, columns): more than 1 is a detection; compiled.

    NaN where the pixel is undefined, where fewer than :data:`FEWEST` training pixels are defined, or where these have
    no power. Negative intensities count as they are.

    Args:
        intensity: (rows, columns), such as the span, or a power behind a whitening or matched filter.
        false_alarm: probability that a pixel of clutter is detected.
        looks: equivalent looks of the intensity; 3 per look behind a whitening filter.
        ring: where clutter is looked at; 21 x 21 without the inner 9 x 9 if left out.
        kind: ``"ca"`` or ``"os"``.

    Raises:
        DataError: no image, or a rate, number of looks or kind that cannot be.
    """
    values, around = _prepared(intensity, false_alarm, looks, ring, kind)
    if kind == "os":
        level, counts = np.empty_like(values), np.empty(values.shape, dtype=np.int64)
        _ordered_values(values, around.outer // 2, around.guard // 2, RANK, level, counts)
    else:
        defined = ~np.isnan(values)
        counts = _ring_counts(defined, around)
        level = _means(values if defined.all() else np.where(defined, values, 0.0), around, counts)
    return _over_threshold(values, level, counts, false_alarm, looks, kind)


def cfar_reference(
    intensity: ArrayLike, *, false_alarm: float, looks: float, ring: Ring | None = None, kind: Kind = "ca"
) -> Floats:
    """The definition of :func:`cfar` in NumPy."""
    values, around = _prepared(intensity, false_alarm, looks, ring, kind)
    reach = around.outer // 2
    offset = np.abs(np.arange(-reach, reach + 1))
    mask = np.maximum(offset[:, None], offset) > around.guard // 2
    padded = np.pad(values, reach, constant_values=np.nan)
    training = np.lib.stride_tricks.sliding_window_view(padded, mask.shape)[..., mask]
    counts = np.isfinite(training).sum(axis=-1)
    ordered = np.sort(training, axis=-1)  # NaN last
    if kind == "os":
        at = np.maximum(np.ceil(RANK * counts).astype(int), 1) - 1
        level = np.take_along_axis(ordered, at[..., None], axis=-1)[..., 0]
    else:
        level = np.where(np.isnan(training), 0.0, training).sum(axis=-1) / np.maximum(counts, 1)
    return _over_threshold(values, np.where(counts > 0, level, np.nan), counts, false_alarm, looks, kind)


def ring_average(planes: Planes, ring: Ring) -> Floats:
    """Mean matrices of the rings, (9, rows, columns): clutter in which the pixel's own target has no part; compiled.

    Pixels outside the image and with a NaN in any plane are left out; NaN where fewer than :data:`FEWEST` are left.

    Raises:
        DataError: planes of another shape.
    """
    given = as_planes(planes).astype(np.float64)
    defined = np.asarray(np.isfinite(given).all(axis=0))
    given[:, ~defined] = 0.0
    counts = _ring_counts(defined, ring)
    return np.where(counts >= FEWEST, [_means(plane, ring, counts) for plane in given], np.nan)


@functools.lru_cache(maxsize=8192)
def factor(training: int, *, false_alarm: float, looks: float, kind: Kind = "ca") -> float:
    """Threshold over the mean (CA) or the ordered value (OS) of ``training`` pixels.

    Raises:
        DataError: a rate, number of looks or pixels, or kind that cannot be.
    """
    _check(false_alarm, looks, kind)
    if training < 1:
        raise DataError("no threshold follows from no training pixels", "take a larger ring")
    if kind == "ca":
        # F > f has the probability I_x(NL, L), x = N / (N + f).
        x = special.betaincinv(looks * training, looks, false_alarm)
        return float(training * (1 - x) / x)
    rank = max(int(np.ceil(RANK * training)), 1)
    above = training - rank + 1
    low, high = special.betaincinv(rank, above, [1e-24, 1 - 1e-16])
    u = low + (high - low) * (_NODES + 1) / 2
    density = np.exp((rank - 1) * np.log(u) + (above - 1) * np.log1p(-u) - special.betaln(rank, above))
    density *= _WEIGHTS * (high - low) / 2
    value = special.gammaincinv(looks, u)

    def excess(logarithm: float) -> float:
        rate = float(density @ special.gammaincc(looks, np.exp(logarithm) * value))
        return math.log(max(rate, 1e-300)) - math.log(false_alarm)

    return float(np.exp(optimize.brentq(excess, -10.0, 30.0, xtol=1e-10)))


def _prepared(
    intensity: ArrayLike, false_alarm: float, looks: float, ring: Ring | None, kind: str
) -> tuple[Floats, Ring]:
    _check(false_alarm, looks, kind)
    values = np.asarray(intensity, dtype=np.float64)
    if values.ndim != 2:
        raise DataError(f"an array of shape {values.shape} is no image", "give (rows, columns)")
    return np.where(np.isfinite(values), values, np.nan), Ring() if ring is None else ring


def _check(false_alarm: float, looks: float, kind: str) -> None:
    if not 1e-15 <= false_alarm <= 0.5:
        raise DataError(f"a false-alarm rate of {false_alarm:g}", "take a number from 1e-15 to 0.5 such as 1e-6")
    if not (np.isfinite(looks) and looks > 0):
        raise DataError(f"{looks:g} looks are no speckle", "give a positive number, 1 for single-look images")
    if kind not in ("ca", "os"):
        raise DataError(f"there is no CFAR of kind {kind!r}", "choose ca (cell averaging) or os (ordered statistic)")


def _ring_counts(defined: NDArray[np.bool_], ring: Ring) -> NDArray[np.int64]:
    """Defined pixels in the ring around each pixel."""
    if not defined.all():
        sums = np.empty(defined.shape)
        _ring_sums(defined.astype(np.float64), ring.outer // 2, ring.guard // 2, sums)
        return sums.astype(np.int64)
    within = [[_within(size, width // 2) for size in defined.shape] for width in (ring.outer, ring.guard)]
    return np.asarray(np.multiply.outer(*within[0]) - np.multiply.outer(*within[1]))


def _within(size: int, reach: int) -> NDArray[np.int64]:
    """Places no farther than ``reach`` from each place of a line."""
    at = np.arange(size)
    return np.asarray(np.minimum(at + reach, size - 1) - np.maximum(at - reach, 0) + 1)


def _means(values: Floats, ring: Ring, counts: NDArray[np.int64]) -> Floats:
    """Means of the rings; undefined pixels are given as 0. NaN where nothing is counted."""
    means = np.empty_like(values)
    _ring_sums(values, ring.outer // 2, ring.guard // 2, means)
    with np.errstate(invalid="ignore"):
        means /= counts
    return means


def _over_threshold(
    values: Floats, level: Floats, counts: NDArray[np.int64], false_alarm: float, looks: float, kind: Kind
) -> Floats:
    factors = np.full(int(counts.max(initial=0)) + 1, np.nan)
    for count in np.flatnonzero(np.bincount(counts.ravel())):
        if count >= FEWEST:
            factors[count] = factor(int(count), false_alarm=false_alarm, looks=looks, kind=kind)
    threshold: Floats = factors[counts]
    threshold *= level
    threshold[~(threshold > 0)] = np.nan
    return np.divide(values, threshold, out=threshold)


@njit(cache=True, nogil=True, parallel=True)
def _ring_sums(values: NDArray[np.float64], outer: int, guard: int, sums: NDArray[np.float64]) -> None:
    for row in prange(values.shape[0]):
        # prange counts unsigned; without the cast the row would be compiled for both kinds of numbers.
        _ring_row(values, outer, guard, sums, np.int64(row))


@njit(cache=True, nogil=True)
def _ring_row(values: NDArray[np.float64], outer: int, guard: int, sums: NDArray[np.float64], row: Any) -> None:
    """Sums of columns, whole and without the guarded rows, so that nothing strong is added and taken away again."""
    rows, columns = values.shape
    ring, whole = np.zeros(columns + 2 * outer), np.zeros(columns + 2 * outer)
    for r in range(max(row - outer, 0), min(row + outer + 1, rows)):
        line = ring if abs(r - row) > guard else whole
        for c in range(columns):
            line[c + outer] += values[r, c]
    for c in range(columns):
        whole[c + outer] += ring[c + outer]
        sums[row, c] = 0.0
    # Pixels of the row in the inner loop: independent sums, which the compiler makes several of at a time.
    for k in range(2 * outer + 1):
        line = whole if abs(k - outer) > guard else ring
        for c in range(columns):
            sums[row, c] += line[c + k]


@njit(cache=True, nogil=True, parallel=True)
def _ordered_values(
    values: NDArray[np.float64], outer: int, guard: int, rank: float, level: NDArray[np.float64],
    counts: NDArray[np.int64],
) -> None:  # fmt: skip
    for row in prange(values.shape[0]):
        # prange counts unsigned; without the cast the row would be compiled for both kinds of numbers.
        _ordered_row(values, outer, guard, rank, level, counts, np.int64(row))


@njit(cache=True, nogil=True)
def _ordered_row(
    values: NDArray[Any], outer: int, guard: int, rank: float, level: NDArray[Any], counts: NDArray[np.int64],
    row: Any,
) -> None:  # fmt: skip
    rows, columns = values.shape
    training = np.empty((2 * outer + 1) ** 2)
    for column in range(columns):
        count = 0
        for r in range(max(row - outer, 0), min(row + outer + 1, rows)):
            for c in range(max(column - outer, 0), min(column + outer + 1, columns)):
                value = values[r, c]
                if not np.isnan(value) and (abs(r - row) > guard or abs(c - column) > guard):
                    training[count] = value
                    count += 1
        counts[row, column] = count
        if count:
            at = max(int(np.ceil(rank * count)), 1) - 1
            level[row, column] = np.partition(training[:count], at)[at]
        else:
            level[row, column] = np.nan
