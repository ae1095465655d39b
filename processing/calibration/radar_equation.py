"""The radar equation (thesis 5.8) and what follows from it: compensation for range, noise-equivalent RCS.

Powers are W, or any unit as long as it is the same; losses are ratios of at least 1.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]

BOLTZMANN_J_K = 1.380649e-23
STANDARD_TEMPERATURE_K = 290.0

RANGE_POWER = {"point": 4, "clutter": 3}
"""Power of the range with which echoes fall: a point R^4; ground R^3, for its resolution cell widens as R."""


def received_power(
    rcs_m2: ArrayLike,
    range_m: ArrayLike,
    *,
    transmit_w: float,
    aperture_m2: float,
    wavelength_m: float,
    loss: float = 1.0,
) -> Floats:
    """Power received from a target, W: ``P_t A^2 sigma / (4 pi lambda^2 L R^4)`` (thesis 5.8).

    Raises:
        DataError: a range that is not positive, or one of the radar's figures.
    """
    return np.asarray(
        np.asarray(rcs_m2, dtype=np.float64) / _per_watt(range_m, transmit_w, aperture_m2, wavelength_m, loss)
    )


def rcs_from_power(
    power_w: ArrayLike,
    range_m: ArrayLike,
    *,
    transmit_w: float,
    aperture_m2: float,
    wavelength_m: float,
    loss: float = 1.0,
) -> Floats:
    """RCS that explains a received power, m^2: the inverse of :func:`received_power`. Raises likewise."""
    return np.asarray(
        np.asarray(power_w, dtype=np.float64) * _per_watt(range_m, transmit_w, aperture_m2, wavelength_m, loss)
    )


def range_compensation(range_m: ArrayLike, law: Literal["point", "clutter"] = "point", at_m: float = 1.0) -> Floats:
    """Factor on *power* that makes echoes of equal strength equally bright at all ranges, 1 at ``at_m``.

    ``"point"`` multiplies by (R / at)^4, right for reflectors; ``"clutter"`` by (R / at)^3, right for ground whose
    resolution cell grows with range (images of a rail, whose cross-range resolution is lambda R / 2L).

    Raises:
        DataError: an unknown law, a negative or undefined range, or ``at_m`` that is not positive.
    """
    if law not in RANGE_POWER:
        raise DataError(f"there is no compensation for {law!r}", f"use one of {', '.join(RANGE_POWER)}")
    distance = np.asarray(range_m, dtype=np.float64)
    if np.any(distance < 0):
        raise DataError("a range is negative", "give distances from the antennas in metres")
    _positive("at_m", at_m)
    return np.asarray((distance / at_m) ** RANGE_POWER[law])


def noise_power(
    bandwidth_hz: float, noise_figure_db: float = 0.0, temperature_k: float = STANDARD_TEMPERATURE_K
) -> float:
    """Thermal noise power ``k T B F``, W. Raises :class:`DataError` for figures that are not positive."""
    _positive("bandwidth_hz", bandwidth_hz)
    _positive("temperature_k", temperature_k)
    return float(BOLTZMANN_J_K * temperature_k * bandwidth_hz * 10 ** (noise_figure_db / 10))


def noise_equivalent_sigma0_db(
    noise_equivalent_rcs_m2: ArrayLike,
    range_m: ArrayLike,
    height_m: float,
    resolution_m: float,
    cross_range_m: ArrayLike,
) -> Floats:
    """Noise-equivalent backscatter coefficient of level ground, dB: RCS over the area of a resolution cell.

    The cell is ``cross_range_m`` by ``resolution_m / cos(depression)`` on the ground, ``height_m`` below the antennas.

    Args:
        noise_equivalent_rcs_m2: m^2, against range.
        range_m: slant range, m; NaN results where it is not beyond the height.
        height_m: of the antennas above the ground, m.
        resolution_m: slant-range resolution, m.
        cross_range_m: cross-range resolution, m.

    Raises:
        DataError: a resolution that is not positive.
    """
    _positive("resolution_m", resolution_m)
    slant = np.asarray(range_m, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.sqrt(1 - (height_m / slant) ** 2)
        area = np.asarray(cross_range_m, dtype=np.float64) * resolution_m / cosine
        return np.asarray(10 * np.log10(np.where(area > 0, np.asarray(noise_equivalent_rcs_m2) / area, np.nan)))


def _per_watt(range_m: ArrayLike, transmit_w: float, aperture_m2: float, wavelength_m: float, loss: float) -> Floats:
    """RCS in m^2 for each watt received."""
    figures = {"transmit_w": transmit_w, "aperture_m2": aperture_m2, "wavelength_m": wavelength_m, "loss": loss}
    for name, value in figures.items():
        _positive(name, value)
    distance = np.asarray(range_m, dtype=np.float64)
    if not (np.isfinite(distance) & (distance > 0)).all():
        raise DataError("a range is zero, negative or undefined", "give distances from the antennas in metres")
    return np.asarray(4 * np.pi * wavelength_m**2 * loss * distance**4 / (transmit_w * aperture_m2**2))


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise DataError(f"{name} is {value}", f"give a positive, finite {name}")
