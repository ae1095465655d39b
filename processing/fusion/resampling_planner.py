"""How a picture is to be interpolated: the error of each degree of splines, foretold from the picture's own spectrum.

A component of the scene at (nu, mu) errs by ``1 - 2 m(nu) m(mu) + q(nu) q(mu)`` of its power, mean over all places
between pixels (:mod:`processing.fusion.resampling`); :mod:`processing.optics.spectra` tells how much of each there is.
Noise is no part of the scene: its variance is taken off the spectrum, and what it leaves between the pixels is added to
the error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.fusion.resampling import DEGREES, noise_between, passed, power_between
from processing.optics.pieces import spread_pieces
from processing.optics.spectra import FOLDS, filled, folded_shares, frequencies, power_spectrum
from processing.tolerances import cheapest_within, check_tolerance, reason

Floats = NDArray[np.float64]

NAMES = {1: "straight lines", 3: "cubic splines", 5: "splines of degree 5"}
SAFETY_DB = 0.4
"""How far below the tolerance the expected error must be."""

PIXEL_NS = {1: 0.0, 3: 60.0, 5: 90.0}
SAMPLE_NS = {1: 150.0, 3: 170.0, 5: 330.0}
"""Core time of a pixel of the picture and of a place looked for, ns; only their order decides."""

PIECE_PX, PIECES = 256, 6
"""Side of the pieces that are looked at, and how many of them at most."""
LEAST_PX = 16
"""Smallest side of a picture whose errors can be foretold."""


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
        errors = list(self.considered.values())
        return reason(self.predicted_error_db, errors, self.tolerance_db, kept=self.kept)

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
        if np.isfinite(piece).all(axis=0).mean() < 0.5:
            continue
        mean, spectrum = power_spectrum(filled(piece), noise)
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
    check_tolerance(tolerance_db, "picture")
    considered = resampling_errors_db(planes, variance)
    degree, error = list(considered.items())[cheapest_within(list(considered.values()), tolerance_db, SAFETY_DB)]
    return ResamplingChoice(degree, error, tolerance_db, error <= tolerance_db, considered)


def _left(spectrum: Floats, noise: float) -> dict[int, float]:
    """Power of the error without noise, of each degree."""
    nu, mu = frequencies(spectrum)
    folded = folded_shares(spectrum, noise)
    left = {}
    for degree in DEGREES:
        down = {i: passed(degree, nu + i) for i in FOLDS}
        right = {k: passed(degree, mu + k) for k in FOLDS}
        stays = sum((share * down[i] * right[k] for (i, k), share in folded.items()), np.zeros_like(spectrum))
        between = power_between(degree, nu) * power_between(degree, mu)
        left[degree] = float((spectrum * (1 - 2 * stays + between)).sum())
    return left
