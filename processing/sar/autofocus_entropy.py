"""Errors along the aperture from the image itself: the phases, or the places, with which its entropy is least."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from processing.sar.autofocus_chips import Chips
from processing.sar.autofocus_gradient import without_shift

ITERATIONS = 80


def minimum_entropy_phase(chips: Chips, start_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Phase to turn each position by, (positions,) rad, for the least entropy (Kragh 2006, by L-BFGS).

    The gradient is exact (:func:`entropy_and_slopes`). Without its mean and its linear part along the track.
    """

    def cost(phase: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        entropy, slope = entropy_and_slopes(chips, chips.spread(phase[:, None, None]))
        return entropy, slope.sum(axis=(1, 2))

    return without_shift(_descend(cost, start_rad), chips.antenna_m)


def minimum_entropy_track(
    chips: Chips, basis: NDArray[np.float64], axis: NDArray[np.float64], start_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Coefficients (m,) of the positions' shift along ``axis`` for the least entropy; ``basis`` is (positions, m)."""
    wavelength = 4 * np.pi / chips.k_rad_m

    def cost(scaled: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        shift = basis @ scaled * wavelength
        entropy, slope = entropy_and_slopes(chips, chips.turn_of_shift(shift, axis))
        by_shift = np.sum(slope * chips.slope_of_shift(shift, axis), axis=(1, 2))
        return entropy, wavelength * (basis.T @ by_shift)

    return _descend(cost, start_m / wavelength) * wavelength


def entropy_and_slopes(chips: Chips, turn_rad: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Entropy of the span, nats, and its derivative by the turn of every term, (positions, points, pixels).

    With powers I, their sum E and H the entropy: ``dH/dI = -(ln(I/E) + H) / E`` and, z the image and b a turned term,
    ``dI/dturn = -2 Im(conj(z) b)``.
    """
    turned = chips.terms * np.exp(1j * turn_rad)
    image = turned.sum(axis=1)
    power = np.sum(np.abs(image) ** 2, axis=0)
    total = float(power.sum())
    if not total > 0:
        return 0.0, np.zeros(turn_rad.shape)
    share = np.maximum(power / total, 1e-300)
    entropy = float(-np.sum(share * np.log(share)))
    by_power = -(np.log(share) + entropy) / total
    slope = ((np.conj(image) * by_power)[:, None] * turned).imag.sum(axis=0)
    return entropy, -2 * slope


def _descend(
    cost: Callable[[NDArray[np.float64]], tuple[float, NDArray[np.float64]]], start: NDArray[np.float64]
) -> NDArray[np.float64]:
    found = minimize(cost, start, jac=True, method="L-BFGS-B", options={"maxiter": ITERATIONS, "ftol": 1e-10})
    better = found.fun < cost(start)[0] and np.isfinite(found.x).all()
    return np.asarray(found.x if better else start, dtype=np.float64)
