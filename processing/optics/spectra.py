"""The spectrum of a picture, noise taken off, and what of it is the scene beyond half the sampling frequency.

What is recorded at a frequency is the sum of all components that sampling folds there; a spectrum that falls as
``nu^-a exp(-b nu^2)`` (texture and edges, seen by a blurred lens) is fitted to it and tells how much of it each of them
is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.signal.windows import tukey

Floats = NDArray[np.float64]

TAPER = 0.5
"""Share of a piece's sides over which it fades out: less would leak, more would not see what is there."""
FOLDS = (-1, 0, 1)
"""Multiples of the sampling frequency that are told apart."""
_EDGES = np.linspace(0.06, 0.5, 12)
"""Rings of frequencies that the fall of the spectrum is fitted to, 1 / pixel."""


def filled(planes: Floats) -> Floats:
    """Planes (planes, rows, columns) in which the nearest known pixel stands for those that are undefined in any."""
    lost = ~np.isfinite(planes).all(axis=0)
    if not lost.any():
        return planes
    nearest = distance_transform_edt(lost, return_distances=False, return_indices=True)
    return planes[:, *nearest]


def power_spectrum(planes: Floats, noise: float) -> tuple[float, Floats]:
    """Power of the planes together, by frequency.

    Args:
        planes: (planes, rows, columns), rows and columns even.
        noise: variance of white noise, summed over the planes.

    Returns:
        Squares of the planes' means; (rows, columns // 2 + 1) the power about them at each frequency, noise taken off:
        both halves of the plane of frequencies are in it, and it sums to the variance.
    """
    rows, columns = planes.shape[1:]
    window = tukey(rows, TAPER)[:, None] * tukey(columns, TAPER)
    mean = (planes * window).sum(axis=(1, 2)) / window.sum()
    power = np.abs(np.fft.rfft2((planes - mean[:, None, None]) * window)) ** 2
    spectrum = power.sum(axis=0) / ((window**2).sum() * rows * columns) - noise / (rows * columns)
    return float((mean**2).sum()), np.asarray(spectrum * _twice(spectrum))


def frequencies(spectrum: Floats) -> tuple[Floats, Floats]:
    """Frequencies down, (rows, 1), and right, (columns // 2 + 1), that :func:`power_spectrum` is at, 1 / pixel."""
    rows, half = spectrum.shape
    return np.asarray(np.fft.fftfreq(rows)[:, None], dtype=np.float64), np.arange(half) / max(2 * (half - 1), 1)


def folded_shares(spectrum: Floats, noise: float) -> dict[tuple[int, int], Floats]:
    """What share of each frequency is the scene at that frequency plus (i, k) sampling frequencies, down and right.

    Args:
        spectrum: of :func:`power_spectrum`.
        noise: as there; it tells where the scene stands above it.

    Returns:
        Arrays of the spectrum's shape, for i and k of :data:`FOLDS`; they sum to 1.
    """
    nu, mu = frequencies(spectrum)
    fall = _fitted(_rings(spectrum, noise))
    folded = {(i, k): fall.at(np.hypot(nu + i, mu + k)) for i in FOLDS for k in FOLDS}
    whole = sum(folded.values(), np.zeros_like(spectrum))
    return {place: share / whole for place, share in folded.items()}


def above_noise(spectrum: Floats, noise: float) -> Floats:
    """The spectrum, and the fitted fall in its place at frequencies where noise hides the scene.

    Args:
        spectrum: of :func:`power_spectrum`; what is left of noise that was taken off is as often below zero as above.
        noise: as there.

    Returns:
        Its shape; 0 where the scene stands above noise nowhere.
    """
    rings = _rings(spectrum, noise)
    if not rings.hidden.any():
        return spectrum
    fall = _fitted(rings)
    shape = fall.at(np.hypot(*frequencies(spectrum))) * _twice(spectrum)
    # The scene's largest parts stand above noise first: without rings all that is known is between them and the mean.
    inner = ~rings.hidden
    inner[0, 0] = False
    if rings.frequency:
        own = [level - math.log(fall.at(np.array(at))) for at, level in zip(rings.frequency, rings.level, strict=True)]
        scale = math.exp(sum(own) / len(own))
    else:
        scale = max(float(spectrum[inner].sum()), 0.0) / max(float(shape[inner].sum()), 1e-300)
    return np.where(rings.hidden, scale * shape, spectrum)


def _twice(spectrum: Floats) -> Floats:
    """How often each column of half a plane of frequencies stands in all of it; the picture has even columns."""
    twice = np.full(spectrum.shape[1], 2.0)
    twice[[0, -1]] = 1.0
    return twice


@dataclass(frozen=True)
class _Fall:
    """``nu^-a exp(-b nu^2)``, and beyond what was seen the power of nu that continues it: some edges are sharper."""

    a: float
    b: float
    seen: float

    def at(self, frequency: Floats) -> Floats:
        nu = np.maximum(frequency, 1e-3)
        inner = np.minimum(nu, self.seen)
        beyond = (self.a + 2 * self.b * self.seen**2) * np.log(nu / inner)
        return np.asarray(np.exp(-self.a * np.log(inner) - self.b * inner**2 - beyond))


@dataclass(frozen=True)
class _Rings:
    """Rings of frequencies in which the scene stands above noise, and the places where it does not."""

    frequency: list[float]
    level: list[float]
    """Logarithm of the mean power."""
    hidden: NDArray[np.bool_]


def _rings(spectrum: Floats, noise: float) -> _Rings:
    frequency = np.hypot(*frequencies(spectrum))
    single = spectrum / _twice(spectrum)
    ring = np.digitize(frequency, _EDGES)
    white = noise / (spectrum.shape[0] * 2 * (spectrum.shape[1] - 1))
    at, level = [], []
    hidden = np.zeros(spectrum.shape, dtype=np.bool_)
    for number in range(1, len(_EDGES) + 1):
        place = ring == number
        own = single[place]
        if len(own) < 3:
            continue
        # The taper makes neighbours alike; noise is not known better than to a tenth.
        few = math.sqrt(len(own) / 4)
        if not own.mean() > 2 * white * (1 / few + 0.1):
            hidden |= place & (noise > 0)
        elif number < len(_EDGES) and own.mean() > 2 * (own.std() / few + 0.1 * white):
            at.append(float(frequency[place].mean()))
            level.append(math.log(own.mean()))
    return _Rings(at, level, hidden)


def _fitted(rings: _Rings) -> _Fall:
    if len(rings.frequency) < 3:
        return _Fall(3.0, 0.0, 0.5)  # edges
    nu, known = np.array(rings.frequency), np.array(rings.level)
    fall = _Fall(2.0, 0.0, 0.5)
    folds: Floats = np.zeros_like(nu)
    for _ in range(3):
        fall = _Fall(*_least_squares(nu, known - folds), float(nu[-1]))
        folds = np.log(_folded_over_own(nu, fall))
    return fall


def _least_squares(nu: Floats, level: Floats) -> tuple[float, float]:
    """Neither exponent is negative."""
    columns = np.stack([np.ones_like(nu), -np.log(nu), -(nu**2)], axis=1)
    a, b = (float(value) for value in np.linalg.lstsq(columns, level, rcond=None)[0][1:])
    if b < 0:
        a, b = float(np.linalg.lstsq(columns[:, :2], level, rcond=None)[0][1]), 0.0
    elif a < 0:
        a, b = 0.0, float(np.linalg.lstsq(columns[:, ::2], level, rcond=None)[0][1])
    return max(a, 0.0), max(b, 0.0)


def _folded_over_own(nu: Floats, fall: _Fall) -> Floats:
    """What is recorded at a frequency over what belongs there, mean over directions."""
    turn = np.linspace(0, np.pi / 2, 7)[:, None]
    x, y = nu * np.cos(turn), nu * np.sin(turn)
    whole = sum((fall.at(np.hypot(x + i, y + k)) for i in FOLDS for k in FOLDS), np.zeros_like(x))
    return np.asarray(np.mean(whole / fall.at(nu), axis=0))
