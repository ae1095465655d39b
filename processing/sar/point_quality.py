"""A focused point against theory: place, widths, side lobes, phase and amplitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.radar.ranging import window_weights
from processing.sar.grid import ImageGrid
from processing.sar.quality import Cut, PointResponse, carrier_of, measure_cut, point_response

FREQUENCIES = 129
"""Samples of the ramp in the sums below."""

FINENESS = 32
"""Samples of a theoretical cut in the unweighted resolution cell, at least."""


@dataclass(frozen=True)
class PointQuality:
    """What was measured, what theory has, and how far one is from the other."""

    measured: PointResponse
    x: Cut
    """Theoretical cut along x."""
    y: Cut
    """Theoretical cut along y."""
    place_error_cells: tuple[float, float]
    """Measured place less true place along x and y, in theoretical widths."""
    width_ratio: tuple[float, float]
    """Measured widths over theoretical ones."""
    amplitude_error_db: float
    """Level less that of ``amplitude``."""
    phase_error_rad: float
    """Phase less that of ``amplitude`` at the true place; the turn that comes from the offset of the measured place is
    taken off."""


def theoretical_cut(
    antenna_m: NDArray[np.float64],
    place_m: tuple[float, float, float],
    direction: tuple[float, float, float],
    reach_m: float,
    *,
    centre_hz: float,
    bandwidth_hz: float,
    window: str = "rectangular",
    aperture_weights: NDArray[np.float64] | None = None,
) -> Cut:
    """Cut through the response of a point, as far as theory knows it: plane waves from each position and frequency.

    The sum is that of :func:`processing.sar.resolution.point_resolution`, with its side lobes.

    Args:
        antenna_m: (positions, 3).
        place_m: the point.
        direction: unit vector of the cut.
        reach_m: how far the cut goes to either side.
        centre_hz: centre frequency.
        bandwidth_hz: bandwidth of the ramp.
        window: over the ramp.
        aperture_weights: (positions,) total weights of the pulses.

    Raises:
        DataError: unknown window, the point is at an antenna, or a reach that is not positive.
    """
    if not (reach_m > 0 and np.isfinite(reach_m)):
        raise DataError(f"a cut of {reach_m:g} m shows nothing", "give a positive reach")
    sight = np.asarray(place_m, dtype=np.float64) - antenna_m
    distance = np.linalg.norm(sight, axis=1)
    if not (distance > 0).all():
        raise DataError("the point is at the antenna", "ask for a point in front of the rail")
    weights = np.ones(len(sight)) if aperture_weights is None else np.asarray(aperture_weights, dtype=np.float64)
    part = (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES - 0.5
    ramp = window_weights(window, part, 1e9)
    k = 4 * np.pi / SPEED_OF_LIGHT_M_S * (centre_hz + bandwidth_hz * part)
    along = (sight / distance[:, None]) @ np.asarray(direction, dtype=np.float64)
    support = np.outer(along, k)
    spread = float(np.ptp(support))
    step = 2 * np.pi / max(spread, 2 * np.pi / reach_m) / FINENESS
    d = np.arange(-int(reach_m / step), int(reach_m / step) + 1) * step
    # One position after another, so that no (positions, frequencies, places) array is made.
    cut = np.zeros(len(d), dtype=np.complex128)
    for weight, row in zip(weights, support - support.mean(), strict=True):
        cut += weight * (ramp @ np.exp(1j * np.outer(row, d)))
    return measure_cut(np.abs(cut), step)


def point_quality(
    image: NDArray[np.complexfloating],
    grid: ImageGrid,
    place_m: tuple[float, float, float],
    antenna_m: NDArray[np.float64],
    *,
    centre_hz: float,
    bandwidth_hz: float,
    window: str = "rectangular",
    aperture_weights: NDArray[np.float64] | None = None,
    amplitude: complex = 1.0,
    reach_m: tuple[float, float],
    range_compensated: bool = False,
) -> PointQuality:
    """Measure a point whose place and amplitude are known.

    Args:
        image: (ny, nx) complex, one channel.
        grid: where it stands.
        place_m: true place.
        antenna_m: (positions, 3).
        centre_hz: centre frequency.
        bandwidth_hz: bandwidth of the ramp.
        window: over the ramp.
        aperture_weights: (positions,) total weights of the pulses.
        amplitude: true value of the image at the place.
        reach_m: how far the cuts go to either side, x and y.
        range_compensated: as in :func:`processing.sar.quality.point_response`.

    Raises:
        DataError: nothing is defined around that place, no amplitude, or as :func:`theoretical_cut`.
    """
    if not (np.isfinite(amplitude) and abs(amplitude) > 0):
        raise DataError("the point has no amplitude to compare with", "give the true one")
    measured = point_response(
        image, grid, place_m[0], place_m[1], reach_m=reach_m, range_compensated=range_compensated,
        carrier=carrier_of(antenna_m, centre_hz),
    )  # fmt: skip
    x, y = (
        theoretical_cut(
            antenna_m, place_m, direction, reach, centre_hz=centre_hz, bandwidth_hz=bandwidth_hz, window=window,
            aperture_weights=aperture_weights,
        )
        for direction, reach in zip(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), reach_m, strict=True)
    )  # fmt: skip
    peak = measured.peak
    off = np.array([peak.x_m - place_m[0], peak.y_m - place_m[1], 0.0])
    sight = np.asarray(place_m, dtype=np.float64) - antenna_m
    weights = np.ones(len(sight)) if aperture_weights is None else np.asarray(aperture_weights, dtype=np.float64)
    mean = np.average(sight / np.linalg.norm(sight, axis=1)[:, None], axis=0, weights=weights)
    turned = 4 * np.pi * centre_hz / SPEED_OF_LIGHT_M_S * float(mean @ off)
    return PointQuality(
        measured,
        x,
        y,
        (float(off[0]) / x.width_m, float(off[1]) / y.width_m),
        (measured.x.width_m / x.width_m, measured.y.width_m / y.width_m),
        float(20 * np.log10(abs(peak.value) / abs(amplitude))),
        float(np.angle(np.exp(1j * (peak.phase_rad - turned)) / amplitude)),
    )
