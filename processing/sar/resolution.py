"""Theoretical widths of a point target in a focused image, from the exact support in wavenumbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.radar.ranging import window_weights

FREQUENCIES = 129
"""Samples of the ramp in the sums below; the widths change by less than 1e-4 beyond."""


@dataclass(frozen=True)
class Resolution:
    """-3 dB widths of a point target."""

    slant_m: float
    """Along range, of one profile."""
    x_m: float
    """On the ground along the rail."""
    y_m: float
    """On the ground across the rail."""


def point_resolution(
    antenna_m: NDArray[np.float64],
    place_m: tuple[float, float, float],
    *,
    centre_hz: float,
    bandwidth_hz: float,
    window: str = "rectangular",
    aperture_weights: NDArray[np.float64] | None = None,
) -> Resolution:
    """-3 dB widths of the focused response of a point, for the track as it is.

    Every position n and frequency f contributes one wave to the response, with the wavenumber vector
    ``k_n = (4 pi f / c) (place - antenna_n) / R_n``; the response along a direction e is
    ``|sum w_n W(f) exp(j k_n . e d)|``. Unlike ``wavelength R / (2 L)`` (thesis 2.35) this holds for wide apertures
    and any direction, and it includes the windows and the slant of range to the ground.

    Args:
        antenna_m: (positions, 3).
        place_m: the point.
        centre_hz: centre frequency.
        bandwidth_hz: bandwidth of the ramp.
        window: over the ramp, as in :func:`processing.radar.ranging.window_weights`.
        aperture_weights: (positions,) total weights of the pulses (window, times squared pattern where compensated).

    Returns:
        Widths in m; infinite where the response has none (a single position has no width across its line of sight).

    Raises:
        DataError: unknown window, or the point is at an antenna.
    """
    sight = np.asarray(place_m, dtype=np.float64) - antenna_m
    distance = np.linalg.norm(sight, axis=1)
    if not (distance > 0).all():
        raise DataError("the point is at the antenna", "ask for a point in front of the rail")
    weights = np.ones(len(sight)) if aperture_weights is None else np.asarray(aperture_weights, dtype=np.float64)
    part = (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES - 0.5
    ramp = window_weights(window, part, 1e9)
    k = 4 * np.pi / SPEED_OF_LIGHT_M_S * (centre_hz + bandwidth_hz * part)
    direction = sight / distance[:, None]
    both = (weights[:, None] * ramp).ravel()
    return Resolution(
        slant_m=_width(k, ramp),
        x_m=_width(np.outer(direction[:, 0], k).ravel(), both),
        y_m=_width(np.outer(direction[:, 1], k).ravel(), both),
    )


def _width(k: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """-3 dB width of ``|sum weights exp(j k d)|`` over d; infinite where all k are equal."""
    total = weights.sum()
    spread = float(np.sqrt(np.sum(weights * (k - np.sum(weights * k) / total) ** 2) / total))
    if spread <= 1e-9 * float(np.abs(k).max()):
        return float("inf")

    def drop(d: float) -> float:
        return float(np.abs(np.sum(weights * np.exp(1j * k * d))) / total - np.sqrt(0.5))

    # The half width is near 1.18 / (2 spread) for any smooth lobe; walk outward until it is enclosed.
    inner, outer = 0.0, 0.3 / spread
    while drop(outer) > 0:
        inner, outer = outer, outer + 0.3 / spread
    return 2 * float(brentq(drop, inner, outer, xtol=1e-12, rtol=1e-10))
