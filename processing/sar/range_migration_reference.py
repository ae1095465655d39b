"""Range migration in plain NumPy and float64: exact sums where the fast one interpolates."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from processing.radar.antenna import pattern_exponent
from processing.radar.profiles import RangeProfiles
from processing.sar.grid import ImageGrid
from processing.sar.range_migration import second_term
from processing.sar.range_migration_plan import plan_migration
from processing.sar.range_migration_task import prepare
from processing.sar.stolt import FILTERS, smooth_step
from processing.sar.straight_track import ahead_cosine, pattern_sum


def range_migration_reference(
    profiles: RangeProfiles,
    grid: ImageGrid,
    *,
    weights: NDArray[np.floating] | None = None,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
) -> NDArray[np.complex128]:
    """:func:`processing.sar.range_migration.range_migration`, its definition: the same wavenumbers, summed directly.

    Every k_y of a line is a direct sum over ranges at its own k, so that there is no Stolt interpolation; rows and
    columns are direct sums over wavenumbers. Cost: lines x (bins x k_y + k_y x rows + rows x columns).

    Args:
        profiles: as there.
        grid: as there.
        weights: as there.
        beamwidth_rad: as there.
        depression_rad: as there.

    Returns:
        (channels, ny, nx) complex128.

    Raises:
        DataError: as there.
    """
    task = prepare(profiles, grid, weights)
    exponent = 0.0 if beamwidth_rad is None else pattern_exponent(beamwidth_rad)
    plan = plan_migration(task.profiles, task.track, grid, next(iter(FILTERS.values())), exponent)
    m = plan.mapping
    r, x = task.profiles.range_m, task.track.x_m - task.track.middle_m
    columns = grid.x_m - task.track.middle_m
    half = next(iter(FILTERS.values())).taps // 2
    low, high = m.k_first + (half - 1) * m.k_step, m.k_first + (2 * plan.half_band + 1 - half) * m.k_step
    scale = plan.along_step * m.across_step / (2 * math.pi) ** 2 * task.profiles.range_step_m
    second = second_term(m.along, m.centre, exponent)
    tilt = ahead_cosine(task.track, grid, depression_rad) ** exponent
    tapers = np.stack([plan.edges.taper(row, m.along) for row in range(len(plan.slant))])
    image = np.zeros((len(task.pulses.values), *grid.shape), dtype=np.complex128)
    for line, along in enumerate(m.along):
        across = m.across_step * (m.across_first[line] + np.arange(m.across_count))
        k = np.hypot(across, along)
        kept = (k >= low) & (k <= high) & (across > m.outer_cosine * k)
        across, k = across[kept], k[kept]
        edge = np.clip((across / k - m.outer_cosine) / (m.inner_cosine - m.outer_cosine), 0, 1)
        factor = np.sqrt(2 * np.pi / across) * (across / k) ** exponent * smooth_step(edge)
        at_k = np.exp(-1j * np.outer(k - m.centre, r)) * task.roll
        to_rows = np.exp(1j * np.outer(plan.slant, across)) * factor
        to_rows *= (tapers[:, line] * np.sqrt(plan.slant) * tilt)[:, None]
        to_rows *= np.exp(1j * (math.pi / 4 + second[line] / plan.slant))[:, None]
        to_columns = np.exp(1j * along * columns)
        for channel, values in enumerate(task.pulses.values):
            at_line = (task.pulses.weights[channel] * np.exp(-1j * along * x)) @ values
            image[channel] += np.outer(to_rows @ (at_k @ at_line), to_columns)
    for channel, weight in enumerate(task.pulses.weights):
        image[channel] *= scale / weight.sum()
        if beamwidth_rad is not None:
            gain = pattern_sum(task.track, weight, grid, beamwidth_rad, depression_rad) / weight.sum()
            with np.errstate(invalid="ignore", divide="ignore"):
                image[channel] = np.where(gain > 0, image[channel] / gain, np.nan)
        if task.outside is not None:
            image[channel][task.outside] = np.nan
    return image
