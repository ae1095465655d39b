"""Which wavenumbers range migration needs for a track, an image and its profiles, and how long its transforms are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.grid import ImageGrid
from processing.sar.gridding import Kernel
from processing.sar.stolt import Filter, Mapping, smooth_step
from processing.sar.straight_track import Track

BAND_MARGIN = 1.4
"""Width of the band that is kept, as a multiple of the ramp's: cropping spreads it a little."""

FRESNEL_ZONES = 7.0
"""Width of the taper beyond the angles that the image needs, in Fresnel zones of the edge."""

TRACK_KERNEL = Kernel(6, 1.5)
"""From positions to k_x."""

ROW_KERNEL = Kernel(6, 1.5)
"""From k_y to rows."""

COLUMN_KERNEL = Kernel(6, 1.5)
"""From k_x to columns, where the grid is not read directly."""


@dataclass(frozen=True)
class Edges:
    """(rows,) k_x between which a row of the image is formed: whole between the inner, rolled off to the outer ones."""

    outer_low: NDArray[np.float64]
    inner_low: NDArray[np.float64]
    inner_high: NDArray[np.float64]
    outer_high: NDArray[np.float64]

    @property
    def limits(self) -> NDArray[np.float64]:
        """(4, rows) from the lowest to the highest."""
        return np.stack([self.outer_low, self.inner_low, self.inner_high, self.outer_high])

    def taper(self, row: int, along: NDArray[np.float64]) -> NDArray[np.float64]:
        """(lines,) the roll-off of one row."""
        low, high = (
            np.clip((along - outer) / (inner - outer), 0, 1)
            for outer, inner in (
                (self.outer_low[row], self.inner_low[row]),
                (self.outer_high[row], self.inner_high[row]),
            )
        )
        return np.asarray(smooth_step(low) * smooth_step(high))


@dataclass(frozen=True)
class MigrationPlan:
    """Sizes and places of everything between profiles and image; lengths in m, wavenumbers in rad/m."""

    mapping: Mapping
    edges: Edges
    slant: NDArray[np.float64]
    """(rows,) distance of each row from the rail's line."""
    range_length: int
    """Of the transform along range."""
    middle_bin: int
    """Bin of the range that spectra are referred to."""
    half_band: int
    """Samples of k kept on either side of the carrier."""
    track_length: int
    """Of the transform along the track."""
    first_line: int
    """k_x of the first line, in steps."""
    along_step: float
    row_length: int
    """Of the transform across the rail."""
    direct: int
    """Of the transform along x that meets the grid's columns; 0 where they are not equidistant."""

    @property
    def lines(self) -> int:
        """Number of k_x."""
        return len(self.mapping.along)

    @property
    def middle_line(self) -> int:
        """Line that the transforms along x are centred on."""
        return self.lines // 2

    @property
    def period_m(self) -> float:
        """After which the image repeats along x."""
        return 2 * math.pi / self.along_step

    @property
    def across_middle(self) -> NDArray[np.float64]:
        """(lines,) k_y that the transforms across the rail are centred on."""
        index = self.mapping.across_first + self.mapping.across_count // 2
        return np.asarray(self.mapping.across_step * index, dtype=np.float64)


def plan_migration(
    profiles: RangeProfiles, track: Track, grid: ImageGrid, taps: Filter, exponent: float = 0.0
) -> MigrationPlan:
    """Lay the transforms out; ``profiles`` are those that are left after cropping.

    Args:
        profiles: range profiles on one axis.
        track: the positions.
        grid: in front of them.
        taps: filter of the Stolt interpolation.
        exponent: of the antennas' amplitude pattern, ``cos^n``.
    """
    slant = np.hypot(grid.y_m - track.y_m, grid.z_m - track.z_m)
    bins = len(profiles.range_m)
    range_length = scipy.fft.next_fast_len(math.ceil(taps.oversampling * bins))
    k_step = 2 * math.pi / (range_length * profiles.range_step_m)
    width = 4 * math.pi * profiles.bandwidth_hz / SPEED_OF_LIGHT_M_S
    centre = 4 * math.pi * profiles.centre_hz / SPEED_OF_LIGHT_M_S
    half = math.ceil(0.5 * min(BAND_MARGIN * width, 1.8 * centre) / k_step) + taps.taps // 2
    half = min(half, (range_length - 1) // 2, int(0.95 * centre / k_step))
    lowest, highest = centre - k_step * half, centre + k_step * half

    edges, (inner, outer), sideways = _edges(track, grid, slant, (lowest, highest), centre)
    direct = _uniform_step(grid.x_m)
    length = 0
    period = sideways
    if direct:
        length = scipy.fft.next_fast_len(math.ceil(period / abs(direct)))
        period = length * abs(direct)
    along_step = 2 * math.pi / period
    first_line = math.floor(float(edges.outer_low.min()) / along_step)
    last_line = math.ceil(float(edges.outer_high.max()) / along_step)
    along = along_step * np.arange(first_line, last_line + 1, dtype=np.float64)

    depth = max(
        float(slant.max()) - math.cos(outer) * float(profiles.range_m[0]), float(profiles.range_m[-1] - slant.min())
    )
    across_step = 2 * math.pi / (1.02 * depth + 2 * profiles.resolution_m)
    low = np.maximum(np.sqrt(np.clip(lowest**2 - along**2, 0, None)), np.abs(along) / math.tan(outer))
    high = np.sqrt(np.clip(highest**2 - along**2, 0, None))
    across_first = np.floor(low / across_step).astype(np.int64)
    count = int((np.ceil(high / across_step).astype(np.int64) - across_first).max()) + 1
    middle_bin = bins // 2
    mapping = Mapping(
        along, lowest, k_step, centre, float(profiles.range_m[middle_bin]), across_first, across_step, count,
        0.5 * float(slant.min() + slant.max()), math.cos(inner), math.cos(outer), exponent,
    )  # fmt: skip
    return MigrationPlan(
        mapping=mapping,
        edges=edges,
        slant=slant,
        range_length=range_length,
        middle_bin=middle_bin,
        half_band=half,
        track_length=scipy.fft.next_fast_len(math.ceil(TRACK_KERNEL.oversampling * len(along)) + TRACK_KERNEL.taps),
        first_line=first_line,
        along_step=along_step,
        row_length=scipy.fft.next_fast_len(math.ceil(ROW_KERNEL.oversampling * count) + ROW_KERNEL.taps),
        direct=length,
    )


def _edges(
    track: Track, grid: ImageGrid, slant: NDArray[np.float64], band: tuple[float, float], centre: float
) -> tuple[Edges, tuple[float, float], float]:
    """The rows' limits of k_x; the widest angle and where it is rolled off to; the period along x that suits them.

    What the limits let through must not fold into the grid, which is all that the period is for.
    """
    x_low, x_high = float(grid.x_m.min()), float(grid.x_m.max())
    first, last = float(track.x_m.min()), float(track.x_m.max())

    def angles(aside: float, outward: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        # At most halfway from what is needed to the direction of the rail.
        away = np.hypot(aside, slant)
        zones = FRESNEL_ZONES * np.sqrt(2 * np.pi * away / centre) * away / slant
        inner = np.arctan2(outward * aside, slant)
        outer = np.minimum(np.arctan2(outward * aside + zones, slant), 0.5 * (inner + math.pi / 2))
        return outward * inner, outward * outer

    def limit(angle: NDArray[np.float64], outward: int) -> NDArray[np.float64]:
        # Every k of the band is to be inside.
        return np.asarray(np.where(angle * outward > 0, band[1], band[0]) * np.sin(angle))

    inner_low, outer_low = angles(x_low - last, -1)
    inner_high, outer_high = angles(x_high - first, 1)
    edges = Edges(limit(outer_low, -1), limit(inner_low, -1), limit(inner_high, 1), limit(outer_high, 1))
    inner = max(float(np.abs(inner_low).max()), float(np.abs(inner_high).max()))
    outer = max(float(np.abs(outer_low).max()), float(np.abs(outer_high).max()))

    def furthest(k_along: NDArray[np.float64]) -> NDArray[np.float64]:
        # The lowest k of the band is seen under the widest angle.
        seen = np.minimum(np.arcsin(np.clip(np.abs(k_along) / band[0], 0, 1)), outer)
        return np.asarray(slant * np.tan(seen))

    aside = max(float(furthest(edges.outer_low).max()), float(furthest(edges.outer_high).max()))
    period = max(last + aside - x_low, x_high - (first - aside), last - first)
    return edges, (inner, outer), 1.01 * period


def _uniform_step(x_m: NDArray[np.float64]) -> float:
    """Step of equidistant columns, m; 0 where they are not or there is only one."""
    if len(x_m) == 1:
        return 0.0
    step = float(x_m[-1] - x_m[0]) / (len(x_m) - 1)
    off = np.abs(x_m - np.linspace(x_m[0], x_m[-1], len(x_m))).max()
    return step if step != 0 and off <= 1e-5 * abs(step) else 0.0
