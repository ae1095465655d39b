"""Point targets all over a scene: side lobes, widths, phase and amplitude of what back-projection makes of them.

A narrow aperture far away has the textbook's response: sinc along range and across, first side lobe -13.26 dB, width
0.886 c / 2B. A rail that sees its scene under 70 degrees has not: its waves come from so many directions that their
band along y has no sharp ends, which lowers side lobes and widens the lobe by what the exact integral tells. There
every place is held against that integral, in float64: ``1/P sum sinc((R_n - R_n0) / cell) exp(j k (R_n - R_n0))``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid
from processing.sar.quality import Cut, PointResponse, carrier_of, point_response
from processing.sar.resolution import point_resolution

PSLR_DB, WIDTH_CELLS = -13.26, 0.8859
"""Of a sinc: its first side lobe, and its -3 dB width in cells."""

REACH_CELLS = 3.0


@dataclass(frozen=True)
class Geometry:
    """A track, and what it transmits; unweighted."""

    antenna_m: NDArray[np.float64]
    """(positions, 3)."""
    centre_hz: float
    bandwidth_hz: float

    @property
    def cell_m(self) -> float:
        """c / 2B."""
        return SPEED_OF_LIGHT_M_S / (2 * self.bandwidth_hz)

    @property
    def k_rad_m(self) -> float:
        """4 pi centre / c."""
        return 4 * math.pi * self.centre_hz / SPEED_OF_LIGHT_M_S


@dataclass(frozen=True)
class Point:
    """One place: what the kernel's image shows, what the exact integral has."""

    place_m: tuple[float, float, float]
    seen: PointResponse
    exact: PointResponse
    phase_rad: float
    """At the target's place, where it should be 0."""
    amplitude: float
    """There, where it should be 1."""
    off: float
    """Largest difference between image and exact integral anywhere around, over the peak."""
    across_m: float
    """Textbook's width across range, for a far target: 0.886 wavelength R / (2 L)."""


FLIGHT = Geometry(np.column_stack([np.linspace(-44, 44, 111), np.zeros((111, 2))]), 10e9, 150e6)
"""Half a degree of aperture at 10 km."""

RAIL = Geometry(np.column_stack([(np.arange(61) - 30) * 0.0508, np.zeros((61, 2))]), 2.4e9, 80e6)
"""The thesis's."""


def flight_places(side: int) -> list[tuple[float, float, float]]:
    """``side`` x ``side`` places over 120 m x 200 m, 10 km away."""
    return [(x, y, 0.0) for x in np.linspace(-60, 60, side) for y in np.linspace(9900, 10100, side)]


def rail_places(side: int) -> list[tuple[float, float, float]]:
    """``side`` x ``side`` places over the rail's scene, on the ground."""
    return [(x, y, -1.069) for x in np.linspace(-5.5, 5.5, side) for y in np.linspace(5, 19, side)]


def measure(geometry: Geometry, place_m: tuple[float, float, float]) -> Point:
    """Focus one point target and measure it, and its exact image."""
    waves = {"centre_hz": geometry.centre_hz, "bandwidth_hz": geometry.bandwidth_hz}
    cell = point_resolution(geometry.antenna_m, place_m, **waves)
    sizes = cell.x_m / WIDTH_CELLS, cell.y_m / WIDTH_CELLS
    axes = []
    for at, size in zip(place_m, sizes, strict=False):
        step = size / 5
        count = math.ceil(REACH_CELLS * size / step) + 8
        axes.append(at + step * np.arange(-count, count + 1))
    grid = ImageGrid(axes[0], axes[1], place_m[2])
    true_m = np.linalg.norm(np.asarray(place_m) - geometry.antenna_m, axis=1)
    profiles = _profiles(geometry, true_m, grid)
    image = backproject(profiles, grid)[0]
    exact = _exact(geometry, true_m, grid)
    reach = REACH_CELLS * sizes[0], REACH_CELLS * sizes[1]
    seen, ideal = (
        point_response(
            made,
            grid,
            place_m[0],
            place_m[1],
            reach_m=reach,
            carrier=carrier_of(geometry.antenna_m, geometry.centre_hz),
        )
        for made in (image, exact)
    )
    here = ImageGrid(np.array(place_m[:1]), np.array(place_m[1:2]), place_m[2])
    value = complex(backproject(profiles, here)[0, 0, 0])
    count = len(geometry.antenna_m)
    length = float(np.ptp(geometry.antenna_m[:, 0])) * count / (count - 1)
    across = WIDTH_CELLS * SPEED_OF_LIGHT_M_S / geometry.centre_hz * float(true_m.mean()) / (2 * length)
    off = float(np.abs(image - exact).max() / np.abs(exact).max())
    return Point(place_m, seen, ideal, float(np.angle(value)), abs(value), off, across)


def _profiles(geometry: Geometry, true_m: NDArray[np.float64], grid: ImageGrid) -> RangeProfiles:
    corners = np.array([[x, y, grid.z_m] for x in grid.x_m[[0, -1]] for y in grid.y_m[[0, -1]]])
    away = np.linalg.norm(corners[:, None] - geometry.antenna_m, axis=2)
    step = geometry.cell_m / 4
    nearest = max(float(grid.y_m[0]), 0.0)
    axis = np.arange(min(away.min(), nearest) - 4 * geometry.cell_m, away.max() + 4 * geometry.cell_m, step)
    echo = np.sinc((axis - true_m[:, None]) / geometry.cell_m) * np.exp(-1j * geometry.k_rad_m * true_m)[:, None]
    return RangeProfiles(
        echo[None], axis, geometry.antenna_m, ("HH",), geometry.centre_hz, geometry.bandwidth_hz, "rectangular", True
    )


def _exact(geometry: Geometry, true_m: NDArray[np.float64], grid: ImageGrid) -> NDArray[np.complex128]:
    x, y, z = grid.places_m()
    total = np.zeros(grid.shape, dtype=np.complex128)
    for place, true in zip(geometry.antenna_m, true_m, strict=True):
        further = np.sqrt((x - place[0]) ** 2 + (y - place[1]) ** 2 + (z - place[2]) ** 2) - true
        total += np.sinc(further / geometry.cell_m) * np.exp(1j * geometry.k_rad_m * further)
    return total / len(true_m)


def run(quick: bool) -> list[Row]:
    """Worst figures over the places of a flight, against the textbook, and of a rail, against the exact integral."""
    side = 3 if quick else 7
    flight = [measure(FLIGHT, place) for place in flight_places(side)]
    rail = [measure(RAIL, place) for place in rail_places(side)]
    lobes = max(abs(cut.peak_sidelobe_db - PSLR_DB) for point in flight for cut in (point.seen.x, point.seen.y))
    widths = max(
        max(
            abs(point.seen.x.width_m / point.across_m - 1),
            abs(point.seen.y.width_m / (WIDTH_CELLS * FLIGHT.cell_m) - 1),
        )
        for point in flight
    )
    told = f"{side * side} places"
    rows = [
        Row("focus.points_flight.sidelobes", "", None, lobes < 0.1, f"within 0.1 dB of -13.26 dB, {told}", error=lobes),
        Row("focus.points_flight.widths", "", None, widths < 0.01, f"within 1 % of theory, {told}", error=widths),
        _phases("flight", flight),
    ]
    # What that could do to a side lobe of the textbook's size: lobes that are shoulders have no level of their own.
    lobes = max(20 * math.log10(1 + point.off / 10 ** (PSLR_DB / 20)) for point in rail)
    widths = max(abs(a.width_m / b.width_m - 1) for point in rail for a, b in _cuts(point))
    own = [cut.peak_sidelobe_db for point in rail for cut in (point.exact.x, point.exact.y)]
    told = f"the exact integral's, which has side lobes of {min(own):.1f} to {max(own):.1f} dB, {told}"
    return [
        *rows,
        Row("focus.points_rail.sidelobes", "", None, lobes < 0.1, f"within 0.1 dB of {told}", error=lobes),
        Row("focus.points_rail.widths", "", None, widths < 0.01, f"within 1 % of {told}", error=widths),
        _phases("rail", rail),
    ]


def _cuts(point: Point) -> list[tuple[Cut, Cut]]:
    return [(point.seen.x, point.exact.x), (point.seen.y, point.exact.y)]


def _phases(name: str, points: list[Point]) -> Row:
    worst = max(abs(math.degrees(point.phase_rad)) for point in points)
    level = max(abs(point.amplitude - 1) for point in points)
    target = f"phase within 1 degree, amplitude off by {level:.1e} at most, {len(points)} places"
    return Row(f"focus.points_{name}.phase", "", None, worst < 1.0, target, error=worst)
