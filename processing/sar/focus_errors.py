"""Error of back-projection, predicted for a track, a grid, a window, an interpolator and an oversampling.

A filter that reads profiles between bins errs in two ways (Parker, Kenyon, Troxel 1983 separate them so). It changes
what is in the band, which stays at its target's place and so in the image. And it leaves *images* of the band around
multiples of the sampling frequency; they turn with the absolute range, ``exp(j 2 pi m R / step)``, and are summed by
back-projection to ghosts at other angles: where the track changes its distance by many bins, they leave a small image.
How much stays is told by a sample of pixels (:func:`ghost_share`).
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.radar.ranging import window_weights
from processing.sar.grid import ImageGrid
from processing.sar.interpolation import tap_weights, taps_of

ARITHMETIC_DB = -139.0
"""What complex64 images and the compiled kernel's float32 sums leave."""

OFFSETS_DB = -125.0
"""What the compiled kernel's float32 offsets within patches of pixels leave with filters of up to eight taps."""

FREQUENCIES, PLACES = 129, 256
"""Samples of the band and of the place between two bins in the means below."""

MARGIN = 0.15
"""Share of an image's width and depth at either side in which no target is taken to be."""

FINER = 4
"""Distances in a resolution cell, which the edges of the band make necessary."""

TARGETS, PIXELS, PULSES = 4, 300, 192
"""Of the sample that tells how many ghosts stay in an image: targets, pixels near and pixels anywhere, positions."""

NEAR_CELLS = 3.0


@functools.lru_cache(maxsize=512)
def filter_error(
    interpolator: str, oversampling: float, window: str, depth_cells: float = math.inf
) -> tuple[float, float]:
    """Relative error powers of a filter over profiles of one window: what stays in the band, and what leaves it.

    Errors of frequencies near the band's edges are spread over many resolution cells of range; those that end up beyond
    an image of ``depth_cells`` are not in it (mean over targets within that depth, but for its :data:`MARGIN`).

    Raises:
        DataError: unknown interpolator or window, or less than one bin per cell.
    """
    taps_of(interpolator)
    if not (oversampling >= 1 - 1e-9 and math.isfinite(oversampling)):
        raise DataError(f"{oversampling:g} range bins per cell lose information", "range with an oversampling of 2 up")
    part = (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES - 0.5
    spectrum = window_weights(window, part, 1e9)
    cycles = part / max(oversampling, 1.0)
    w = (np.arange(PLACES) + 0.5) / PLACES
    taps = tap_weights(interpolator, w, oversampling)
    bins = np.arange(1 - taps.shape[1] // 2, taps.shape[1] // 2 + 1)
    # What the filter makes of each frequency, over what it should be; in range, whole cells around the target.
    error = taps @ np.exp(2j * np.pi * np.outer(bins, cycles)) * np.exp(-2j * np.pi * np.outer(w, cycles)) - 1
    own = error.mean(axis=0)
    away = np.abs(np.fft.fftfreq(FINER * FREQUENCIES, 1 / FREQUENCIES)) / depth_cells
    seen = np.clip((1 - MARGIN - away) / (1 - 2 * MARGIN), 0.0, 1.0)
    powers = [
        float(np.mean(np.abs(np.fft.ifft(part_of * spectrum, FINER * FREQUENCIES, axis=-1)) ** 2 @ seen))
        for part_of in (np.ones((1, FREQUENCIES)), own[None], error - own)
    ]
    return powers[1] / powers[0], powers[2] / powers[0]


def ghost_share(
    antenna_m: NDArray[np.float64], grid: ImageGrid, *, centre_hz: float, bandwidth_hz: float, oversampling: float
) -> float:
    """Share of the energy outside the band that back-projection sums to places within the grid, about 0 to 1.

    Args:
        antenna_m: (positions, 3).
        grid: of the image.
        centre_hz: centre frequency.
        bandwidth_hz: of the ramp.
        oversampling: bins per resolution cell.
    """
    rng = np.random.default_rng(0)
    cell = SPEED_OF_LIGHT_M_S / (2 * bandwidth_hz)
    k = 4 * math.pi * centre_hz / SPEED_OF_LIGHT_M_S
    fine = 2 * math.pi * oversampling / cell
    whole = len(antenna_m) <= PULSES
    antenna = antenna_m if whole else antenna_m[np.sort(rng.choice(len(antenna_m), PULSES, replace=False))]
    span = math.dist((grid.x_m.min(), grid.y_m.min()), (grid.x_m.max(), grid.y_m.max()))
    aperture = float(np.linalg.norm(np.ptp(antenna_m, axis=0)))
    target_energy, ghost_energy = 0.0, 0.0
    for _ in range(TARGETS):
        target = np.array([*(_within(axis, rng, MARGIN) for axis in (grid.x_m, grid.y_m)), grid.z_m])
        away = float(np.linalg.norm(target - antenna.mean(axis=0)))
        wide = NEAR_CELLS * min(max(away * math.pi / max(k * aperture, 1e-12), cell / 8), span), NEAR_CELLS * cell
        near = [
            (max(axis.min(), at - reach), min(axis.max(), at + reach))
            for axis, at, reach in zip((grid.x_m, grid.y_m), target, wide, strict=False)
        ]
        all_of = [(axis.min(), axis.max()) for axis in (grid.x_m, grid.y_m)]
        places = np.concatenate(
            [
                np.column_stack([rng.uniform(*limits, PIXELS) for limits in box] + [np.full(PIXELS, grid.z_m)])
                for box in (near, all_of)
            ]
        )
        areas = [max(math.prod(b - a for a, b in box), 1e-300) for box in (near, all_of)]
        inside = np.all([(places[:, i] >= near[i][0]) & (places[:, i] <= near[i][1]) for i in (0, 1)], axis=0)
        weight = 1 / (0.5 * inside / areas[0] + 0.5 / areas[1])
        distance = np.linalg.norm(places[:, None] - antenna, axis=2)
        further = distance - np.linalg.norm(target - antenna, axis=1)
        seen = np.sinc(further / cell) * np.exp(1j * k * further)
        target_energy += float(weight @ _coherent(seen, whole))
        for side in (-1, 1):
            ghost_energy += 0.5 * float(weight @ _coherent(seen * np.exp(1j * side * fine * distance), whole))
    return float(np.clip(ghost_energy / max(target_energy, 1e-300), 0.0, 4.0))


def _within(axis: NDArray[np.float64], rng: np.random.Generator, margin: float) -> float:
    return float(axis.min() + np.ptp(axis) * rng.uniform(margin, 1 - margin))


def _coherent(seen: NDArray[np.complex128], whole: bool) -> NDArray[np.float64]:
    """Power of the mean over positions; from a sample of them without what the sampling itself adds."""
    power = np.abs(seen.mean(axis=1)) ** 2
    if not whole:
        count = seen.shape[1]
        power = (count * power - np.mean(np.abs(seen) ** 2, axis=1)) / (count - 1)
    return np.asarray(power)


def predicted_error_db(
    interpolator: str,
    oversampling: float,
    window: str = "rectangular",
    share: float = 1.0,
    *,
    floor_db: float | None = None,
    depth_cells: float = math.inf,
) -> float:
    """Expected error of back-projection, dB: root mean square over the image, relative to the exact matched filter.

    Args:
        interpolator: see :mod:`processing.sar.interpolation`.
        oversampling: range bins per resolution cell.
        window: over the ramp.
        share: of the ghosts that stay in the image, see :func:`ghost_share`; 1 is the worst.
        floor_db: error of the arithmetic; that of the compiled kernel where left out.
        depth_cells: ranges within the image, resolution cells.

    Raises:
        DataError: unknown interpolator or window, or less than one bin per cell.
    """
    own, ghosts = filter_error(interpolator, round(float(oversampling), 6), window, depth_cells)
    if floor_db is None:
        floor_db = OFFSETS_DB if taps_of(interpolator) <= 8 else ARITHMETIC_DB
    return 10 * math.log10(own + share * ghosts + 10 ** (floor_db / 10))
