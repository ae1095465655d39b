"""Polar format's geometry: straight wavefronts in place of curved ones, what that costs, and how far it will do.

A pulse from ``a_n`` has wavefronts that are nearly straight at the scene's centre: ``R_n(p) - R_n(0)`` is nearly
``d_n . q`` with the direction's projection d_n on the image plane and q the place relative to the centre. With q moved
a little, by least squares over the pulses, all of the curvature is taken up that is the same for all pulses or that is
linear along the aperture; only what is left, a defocus that grows with the square of the distance from the centre, is
an error (Carrara, Goodman, Majewski 1995, section 3.5; Gorham, Moore 2010).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.grid import ImageGrid
from processing.sar.gridding import chebyshev_nodes

LARGEST_TURN_RAD = math.radians(60)
"""How far directions may turn to either side of their mean."""

STEEPEST_GROUND = 0.05
"""Least part of a direction that lies in the image plane: from straight above there is no resolution on the ground."""

NODES = 13
"""Along each axis of the image, at which displacements are computed; they are smooth, and interpolated between."""

REFUSED_DB = -20.0
"""Error of a point from which an image is refused."""

KERNELS_DB = -86.0
"""Error that interpolation and the roll-off at the ends of the ranges leave."""


@dataclass(frozen=True)
class Spotlight:
    """A scene's centre and how pulses look at it."""

    centre_m: NDArray[np.float64]
    """(3,) on the image plane."""
    axes: NDArray[np.float64]
    """(2, 2) unit vectors of the plane: along the mean direction of sight, and across it."""
    direction: NDArray[np.float64]
    """(pulses, 2) projection of each direction of sight, along and across."""
    centre_range_m: NDArray[np.float64]
    """(pulses,) range of the centre."""
    antenna_m: NDArray[np.float64]
    """(pulses, 3)."""
    weights: NDArray[np.float64]
    """(pulses,) by which least squares count."""

    def straightened(self, places_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where straight wavefronts see places.

        Args:
            places_m: (places, 3).

        Returns:
            (places, 2) coordinates along and across, and (places, pulses) what is left of the range, m.
        """
        further = np.linalg.norm(places_m[:, None] - self.antenna_m, axis=2) - self.centre_range_m
        root = np.sqrt(self.weights)
        solve = np.linalg.pinv(self.direction * root[:, None], rcond=1e-13)
        at = (further * root) @ solve.T
        return at, further - at @ self.direction.T

    def error_power(self, left_m: NDArray[np.float64], k_rad_m: float) -> NDArray[np.float64]:
        """(places,) power of the error relative to the point's own, from what is left of the range."""
        share = self.weights / self.weights.sum()
        return np.asarray((2 - 2 * np.cos(k_rad_m * left_m)) @ share)


def spotlight(antenna_m: NDArray[np.float64], grid: ImageGrid, weights: NDArray[np.float64] | None = None) -> Spotlight:
    """The middle of an image as pulses see it.

    Args:
        antenna_m: (pulses, 3).
        grid: of the image.
        weights: (pulses,) along the aperture.

    Raises:
        DataError: directions turn too far, or come from straight above.
    """
    middle = [0.5 * (float(axis.min()) + float(axis.max())) for axis in (grid.x_m, grid.y_m)]
    centre = np.array([*middle, grid.z_m])
    sight = centre - antenna_m
    away = np.linalg.norm(sight, axis=1)
    advice = "focus by back-projection or factorized back-projection, which take any track"
    if not (away > 0).all():
        raise DataError("an antenna stands in the middle of the image", advice)
    ground = sight[:, :2] / away[:, None]
    mean = ground.mean(axis=0)
    if np.linalg.norm(ground, axis=1).min() < STEEPEST_GROUND:
        raise DataError("pulses come from straight above the image, where ranges tell no places on it", advice)
    axes = np.array([[0.0, 1.0], [-1.0, 0.0]])
    if np.linalg.norm(mean) > 1e-3:
        along = mean / np.linalg.norm(mean)
        axes = np.array([along, [-along[1], along[0]]])
    direction = ground @ axes.T
    turn = np.abs(np.arctan2(direction[:, 1], direction[:, 0])).max()
    if turn > LARGEST_TURN_RAD:
        raise DataError(
            f"directions of sight turn by {math.degrees(turn):.0f} degrees from their mean "
            f"(polar format allows {math.degrees(LARGEST_TURN_RAD):.0f})",
            advice,
        )
    squares = np.ones(len(antenna_m)) if weights is None else np.asarray(weights, dtype=np.float64) ** 2
    return Spotlight(centre, axes, direction, away, antenna_m, squares)


@dataclass(frozen=True)
class Straightening:
    """Coordinates along and across, and errors, over an image."""

    nodes: NDArray[np.float64]
    """(2, ny, nx) at nodes."""
    to_rows: NDArray[np.float64]
    to_columns: NDArray[np.float64]
    error_power: NDArray[np.float64]
    """(ny, nx) at nodes."""

    @property
    def error_db(self) -> float:
        """Expected error of the image, root mean square, dB, with points anywhere in it but at its very edge."""
        rows, columns = (_middle(to).mean(axis=0) for to in (self.to_rows, self.to_columns))
        mean = float(rows @ self.error_power @ columns)
        return float(10 * np.log10(max(mean, 0.0) + 10 ** (KERNELS_DB / 10)))

    @property
    def worst_db(self) -> float:
        """Expected error of a point where it is largest, dB."""
        return float(10 * np.log10(self.error_power.max() + 10 ** (KERNELS_DB / 10)))


def _middle(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """All but a twentieth at either end: of points there part of the response is beyond the image."""
    edge = len(lines) // 20
    return lines[edge : len(lines) - edge]


def straighten(scene: Spotlight, grid: ImageGrid, k_rad_m: float) -> Straightening:
    """Where straight wavefronts see an image's pixels, and with what error.

    Args:
        scene: see :func:`spotlight`.
        grid: of the image.
        k_rad_m: 4 pi f / c of the carrier.
    """
    x, to_columns = chebyshev_nodes(np.asarray(grid.x_m, dtype=np.float64), NODES)
    y, to_rows = chebyshev_nodes(np.asarray(grid.y_m, dtype=np.float64), NODES)
    places = np.stack(np.broadcast_arrays(x, y[:, None], grid.z_m), axis=-1).reshape(-1, 3)
    at, left = scene.straightened(places)
    shape = len(y), len(x)
    return Straightening(
        np.moveaxis(at.reshape(*shape, 2), 2, 0), to_rows, to_columns, scene.error_power(left, k_rad_m).reshape(shape)
    )


def usable_radius_m(scene: Spotlight, k_rad_m: float, tolerance_db: float) -> float:
    """Distance from the centre within which points are formed with an error below a tolerance.

    Args:
        scene: see :func:`spotlight`.
        k_rad_m: 4 pi f / c of the carrier.
        tolerance_db: error of a point, dB.

    Returns:
        The radius, m; at most the range of the nearest pulse.
    """
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(16)], axis=1)

    def good(radius: float) -> bool:
        _, left = scene.straightened(scene.centre_m + radius * circle)
        return bool(scene.error_power(left, k_rad_m).max() <= 10 ** (tolerance_db / 10))

    low, high = 0.0, float(scene.centre_range_m.min())
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if good(middle) else (low, middle)
    return low


@dataclass(frozen=True)
class PolarForecast:
    """What polar format would make of an image."""

    error_db: float
    """Root mean square over the image relative to back-projection, with points anywhere in it."""
    worst_db: float
    """Error of a point where it is largest."""
    along: float
    """Wavenumbers along the mean line of sight, about."""
    across: float
    """Wavenumbers across it, about."""


def polar_forecast(
    antenna_m: NDArray[np.float64],
    grid: ImageGrid,
    wavelength_m: float,
    bandwidth_hz: float,
    weights: NDArray[np.float64] | None = None,
) -> PolarForecast | None:
    """What polar format would make of an image; None where it is refused.

    Args:
        antenna_m: (pulses, 3).
        grid: of the image.
        wavelength_m: of the centre frequency.
        bandwidth_hz: of the ramp.
        weights: (pulses,) along the aperture.
    """
    k = 4 * math.pi / wavelength_m
    try:
        scene = spotlight(antenna_m, grid, weights)
    except DataError:
        return None
    straight = straighten(scene, grid, k)
    if straight.worst_db > REFUSED_DB:
        return None
    width = 4 * math.pi * bandwidth_hz / SPEED_OF_LIGHT_M_S
    deep, broad = (float(np.abs(part).max()) for part in straight.nodes)
    margin = 12 * SPEED_OF_LIGHT_M_S / (2 * bandwidth_hz)
    slope = scene.direction[:, 1] / scene.direction[:, 0]
    highest = (k + 0.7 * width) * float(scene.direction[:, 0].max())
    spread = highest - (k - 0.7 * width) * float(scene.direction[:, 0].min())
    return PolarForecast(
        straight.error_db,
        straight.worst_db,
        spread * (2 * deep + margin) / (2 * math.pi),
        1.5 * highest * float(np.ptp(slope)) * 2 * broad / (2 * math.pi) + 8,
    )
