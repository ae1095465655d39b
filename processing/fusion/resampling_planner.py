"""How a picture is to be interpolated: the error of each degree of splines, foretold from the picture's own spectrum.

A component of the scene at (nu, mu) errs by ``1 - 2 m(nu) m(mu) + q(nu) q(mu)`` of its power, mean over all places
between pixels (:mod:`processing.fusion.resampling`). What is recorded at a frequency is the sum of all components that
sampling folds there; a spectrum that falls as ``nu^-a exp(-b nu^2)`` (texture and edges, seen by a blurred lens) is
fitted to it and tells how much of it each of them is. Noise is no part of the scene: its variance is taken off the
spectrum, and what it leaves between the pixels is added to the error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt
from scipy.signal.windows import tukey

from processing.errors import DataError
from processing.fusion.resampling import DEGREES, noise_between, passed, power_between
from processing.optics.pieces import spread_pieces

Floats = NDArray[np.float64]

NAMES = {1: "straight lines", 3: "cubic splines", 5: "splines of degree 5"}
SAFETY_DB = 0.5
"""How far below the tolerance the expected error must be."""
EQUAL_DB = 0.5
"""Where nothing keeps the tolerance: what is gained by less than that is not worth its time."""

PIXEL_NS = {1: 0.0, 3: 60.0, 5: 90.0}
SAMPLE_NS = {1: 150.0, 3: 170.0, 5: 330.0}
"""Core time of a pixel of the picture and of a place looked for, ns; only their order decides."""

PIECE_PX, PIECES = 256, 6
"""Side of the pieces that are looked at, and how many of them at most."""
LEAST_PX = 16
"""Smallest side of a picture whose errors can be foretold."""
TAPER = 0.5
"""Share of a piece's sides over which it fades out: less would leak, more would not see what is there."""
SHARPER = 2.0
"""Power beyond half the sampling frequency over what the fall of the mean spectrum tells: some edges are sharper."""
_FOLDS = (-1, 0, 1)
_EDGES = np.linspace(0.06, 0.5, 12)
"""Rings of frequencies that the fall of the spectrum is fitted to, 1 / pixel."""


@dataclass(frozen=True)
class ResamplingChoice:
    """A degree of splines, and why."""

    degree: int
    """Of :data:`processing.fusion.resampling.DEGREES`."""
    predicted_error_db: float
    """Root mean square between the pixels, relative to the planes together, noise included, dB."""
    tolerance_db: float
    kept: bool
    """Whether the tolerance is expected to be kept."""
    considered: dict[int, float] = field(default_factory=dict)
    """Expected error of each degree, dB, cheapest first."""

    @property
    def reason(self) -> str:
        """In a few words."""
        if self.kept:
            return f"the fastest within {self.tolerance_db:g} dB"
        if self.predicted_error_db > min(self.considered.values()):
            return f"nothing on offer keeps {self.tolerance_db:g} dB; none is better by {EQUAL_DB:g} dB"
        return f"nothing on offer keeps {self.tolerance_db:g} dB: the most exact"

    def explain(self) -> list[str]:
        """The choice in words."""
        lines = [
            f"between the camera's pixels by {NAMES[self.degree]}: {self.reason}; expected error "
            f"{self.predicted_error_db:.1f} dB (that of the registration itself is told in pixels)"
        ]
        for degree, error in self.considered.items():
            if degree < self.degree:
                lines.append(f"not by {NAMES[degree]}: {error:.1f} dB")
            elif degree > self.degree:
                lines.append(f"not by {NAMES[degree]}: takes longer ({error:.1f} dB)")
        return lines


def resampling_errors_db(planes: ArrayLike, variance: ArrayLike = 0.0) -> dict[int, float]:
    """Expected error of splines of each degree anywhere between the pixels, dB.

    Args:
        planes: (rows, columns), or several of them that are interpolated alike; NaN where undefined.
        variance: of the noise in each plane, mean over its pixels; white.

    Returns:
        Keys of :data:`processing.fusion.resampling.DEGREES`.

    Raises:
        DataError: planes that are smaller than :data:`LEAST_PX`, or without power.
    """
    values = np.asarray(planes, dtype=np.float64)
    values = values[None] if values.ndim == 2 else values
    if values.ndim != 3 or min(values.shape[1:], default=0) < LEAST_PX:
        raise DataError(f"pictures of shape {values.shape}", f"give rows and columns, at least {LEAST_PX} each")
    values = values[:, : values.shape[1] // 2 * 2, : values.shape[2] // 2 * 2]
    noise = float(np.sum(np.broadcast_to(np.asarray(variance, dtype=np.float64), len(values))))
    errors = dict.fromkeys(DEGREES, 0.0)
    power = 0.0
    for window in spread_pieces(values.shape[1:], PIECE_PX, PIECES):
        piece = values[:, *window]
        lost = ~np.isfinite(piece).all(axis=0)
        if lost.mean() > 0.5:
            continue
        if lost.any():
            nearest = distance_transform_edt(lost, return_distances=False, return_indices=True)
            piece = piece[:, *nearest]
        mean, spectrum = _spectrum(piece, noise)
        weight = piece[0].size
        power += weight * (mean + float(spectrum.sum()))
        for degree, left in _left(spectrum, noise).items():
            errors[degree] += weight * (max(left, 0.0) + noise * noise_between(degree))
    if not power > 0:
        raise DataError("no error can be foretold of a picture without light", "check the frames")
    return {degree: 10 * math.log10(max(error / power, 1e-32)) for degree, error in errors.items()}


def choose_resampling(planes: ArrayLike, tolerance_db: float, *, variance: ArrayLike = 0.0) -> ResamplingChoice:
    """The cheapest degree whose expected error is within the tolerance; where there is none, the best of them.

    Args:
        planes, variance: as for :func:`resampling_errors_db`.
        tolerance_db: largest error, dB (negative).

    Raises:
        DataError: a tolerance that is no negative number, and as :func:`resampling_errors_db`.
    """
    if not (tolerance_db < 0 and math.isfinite(tolerance_db)):
        raise DataError(f"a tolerance of {tolerance_db:g} dB is no error below the picture", "give a negative number")
    considered = resampling_errors_db(planes, variance)
    within = [degree for degree, error in considered.items() if error <= tolerance_db - SAFETY_DB]
    best = min(considered.values())
    degree = within[0] if within else next(n for n, error in considered.items() if error <= best + EQUAL_DB)
    error = considered[degree]
    return ResamplingChoice(degree, error, tolerance_db, error <= tolerance_db, considered)


def _spectrum(planes: Floats, noise: float) -> tuple[float, Floats]:
    """Squares of the planes' means, and (rows, columns // 2 + 1) the power about them at each frequency, noise taken
    off: both halves of the plane of frequencies are in it, and it sums to the variance."""
    rows, columns = planes.shape[1:]
    window = tukey(rows, TAPER)[:, None] * tukey(columns, TAPER)
    mean = (planes * window).sum(axis=(1, 2)) / window.sum()
    power = np.abs(np.fft.rfft2((planes - mean[:, None, None]) * window)) ** 2
    spectrum = power.sum(axis=0) / ((window**2).sum() * rows * columns) - noise / (rows * columns)
    return float((mean**2).sum()), np.asarray(spectrum * _both_halves(spectrum.shape[1]))


def _both_halves(half: int) -> Floats:
    """How often each column of half a plane of frequencies stands in all of it; the picture has even columns."""
    twice = np.full(half, 2.0)
    twice[[0, -1]] = 1.0
    return twice


def _left(spectrum: Floats, noise: float) -> dict[int, float]:
    """Power of the error without noise, of each degree."""
    rows, half = spectrum.shape
    columns = 2 * (half - 1)
    nu, mu = np.fft.fftfreq(rows)[:, None], np.arange(half) / max(columns, 1)
    fall = _fitted_fall(spectrum, np.hypot(nu, mu), noise)
    folded = {
        (i, k): (SHARPER if i or k else 1.0) * _falling(np.hypot(nu + i, mu + k), fall) for i in _FOLDS for k in _FOLDS
    }
    whole = sum(folded.values(), np.zeros_like(spectrum))
    left = {}
    for degree in DEGREES:
        down = {i: passed(degree, nu + i) for i in _FOLDS}
        right = {k: passed(degree, mu + k) for k in _FOLDS}
        stays = sum((share * down[i] * right[k] for (i, k), share in folded.items()), np.zeros_like(spectrum)) / whole
        between = power_between(degree, nu) * power_between(degree, mu)
        left[degree] = float((spectrum * (1 - 2 * stays + between)).sum())
    return left


def _falling(frequency: Floats, fall: tuple[float, float]) -> Floats:
    at = np.maximum(frequency, 1e-3)
    return np.asarray(np.exp(-fall[0] * np.log(at) - fall[1] * at**2))


def _fitted_fall(spectrum: Floats, frequency: Floats, noise: float) -> tuple[float, float]:
    """Exponents a and b of ``nu^-a exp(-b nu^2)``, from the means over rings in which the scene stands above noise."""
    rows, half = spectrum.shape
    single = spectrum / _both_halves(half)
    ring = np.digitize(frequency, _EDGES)
    at, level = [], []
    for number in range(1, len(_EDGES)):
        own = single[ring == number]
        if len(own) < 3:
            continue
        doubt = own.std() / math.sqrt(len(own) / 4) + 0.1 * noise / (rows * 2 * (half - 1))
        if own.mean() > 2 * doubt:
            at.append(float(frequency[ring == number].mean()))
            level.append(math.log(own.mean()))
    if len(at) < 3:
        return 3.0, 0.0  # edges
    nu, known = np.array(at), np.array(level)
    fall = (2.0, 0.0)
    folds: Floats = np.zeros_like(nu)
    for _ in range(3):
        fall = _least_squares(nu, known - folds)
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


def _folded_over_own(nu: Floats, fall: tuple[float, float]) -> Floats:
    """What is recorded at a frequency over what belongs there, mean over directions."""
    turn = np.linspace(0, np.pi / 2, 7)[:, None]
    x, y = nu * np.cos(turn), nu * np.sin(turn)
    whole = sum((_falling(np.hypot(x + i, y + k), fall) for i in _FOLDS for k in _FOLDS), np.zeros_like(x))
    return np.asarray(np.mean(whole / _falling(nu, fall), axis=0))
