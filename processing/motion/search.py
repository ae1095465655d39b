"""From range profiles to moving targets: picture of what stands, streaks in it, their motion, and which of them are
real."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.motion.estimate import EstimateSettings, MovingTarget, estimate_motion
from processing.motion.radon import RadonSettings, Streak, find_streaks, tiles_in
from processing.radar.profiles import RangeProfiles
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid

Floats = NDArray[np.float64]

LEAST_SNR_DB = 15.0
"""Coherent sum over clutter and noise below which a streak is no single target."""
LARGEST_PHASE_RMS_RAD = 0.6
"""Of the sub-apertures about a steady motion; a row of standing scatterers has no common phase."""
SIGNIFICANT_SDS = 4.0
"""Speed along the track over its standard deviation: what stands is no streak."""


@dataclass(frozen=True)
class Rejected:
    """A streak that is no target in steady motion."""

    streak: Streak
    reason: str


@dataclass(frozen=True)
class Found:
    """Outcome of a search."""

    power: Floats
    """(rows, columns) power of the picture of what stands."""
    targets: tuple[MovingTarget, ...]
    """The most evident first."""
    streaks: tuple[Streak, ...]
    """Of each target."""
    rejected: tuple[Rejected, ...]
    tiles: int
    """Tiles searched: times the rate of false alarms is how many streaks speckle alone would show."""


def find_moving(
    profiles: RangeProfiles,
    time_s: Floats,
    grid: ImageGrid,
    *,
    beamwidth_rad: float | None,
    channel: int = 0,
    radon: RadonSettings | None = None,
    estimate: EstimateSettings | None = None,
) -> Found:
    """Find what moves along the track by its streak in the picture of what stands, and measure its velocity.

    What moves in range only is a displaced point, and is not found by one picture (see docs).

    Args:
        profiles: range profiles along a straight track in x, evenly spaced in time.
        time_s: (positions,) times of the pulses.
        grid: where to look; its pixels should not exceed the resolution.
        beamwidth_rad: half-power beam width of one antenna; None where ``estimate`` knows the place.
        channel: index into the profiles.
        radon: tiles and rate of false alarms.
        estimate: how velocities are looked for.

    Raises:
        DataError: unusable profiles, grid or settings.
    """
    radon, estimate = radon or RadonSettings(), estimate or EstimateSettings()
    one = _channel(profiles, channel)
    power = np.abs(backproject(one, grid)[0].astype(np.complex128)) ** 2
    streaks = find_streaks(power, radon, cell_px=cell_px(one, grid, beamwidth_rad))
    found: list[tuple[Streak, MovingTarget]] = []
    rejected: list[Rejected] = []
    for streak in streaks:
        at = (
            float(np.interp(streak.column, np.arange(len(grid.x_m)), grid.x_m)),
            float(np.interp(streak.row, np.arange(len(grid.y_m)), grid.y_m)),
            grid.z_m,
        )
        try:
            target = estimate_motion(one, time_s, at, beamwidth_rad=beamwidth_rad, settings=estimate)
        except DataError as error:
            rejected.append(Rejected(streak, str(error).split(";")[0]))
            continue
        reason = _doubt(target)
        if reason:
            rejected.append(Rejected(streak, reason))
        elif any(_same(target, other, one.resolution_m) for _, other in found):
            rejected.append(Rejected(streak, "another part of a target that is already known"))
        else:
            found.append((streak, target))
    return Found(
        power,
        tuple(target for _, target in found),
        tuple(streak for streak, _ in found),
        tuple(rejected),
        tiles_in(grid.shape, radon),
    )


def _doubt(target: MovingTarget) -> str:
    if target.snr_db < LEAST_SNR_DB:
        return f"its coherent sum stands {target.snr_db:.1f} dB above clutter and noise only"
    if target.phase_rms_rad > LARGEST_PHASE_RMS_RAD:
        return f"its phases scatter by {target.phase_rms_rad:.2f} rad about any steady motion"
    # Standing points are sharp already: no speed makes them sharper.
    if abs(target.path.speed_m_s) < SIGNIFICANT_SDS * target.azimuth_sd_m_s:
        return "it stands still along the track"
    return ""


def _same(one: MovingTarget, other: MovingTarget, cell_m: float) -> bool:
    slow = abs(one.path.speed_m_s - other.path.speed_m_s) < 1.0
    return slow and abs(one.path.y_m - other.path.y_m) < 2 * cell_m and abs(one.path.x_m - other.path.x_m) < 10 * cell_m


def cell_px(profiles: RangeProfiles, grid: ImageGrid, beamwidth_rad: float | None) -> tuple[float, float]:
    """Resolution (down, along) in pixels of a grid, rounded to tenths: thresholds are kept for each."""
    y = float(np.median(grid.y_m))
    slant = float(np.hypot(y, grid.z_m - profiles.antenna_m[:, 2].mean()))
    half = float(np.ptp(profiles.antenna_m[:, 0])) / 2 / slant
    if beamwidth_rad is not None:
        half = min(half, beamwidth_rad / 2)
    steps = [float(np.median(np.diff(axis))) if len(axis) > 1 else 1.0 for axis in (grid.y_m, grid.x_m)]
    down = profiles.resolution_m * slant / y / steps[0]
    return round(down, 1), round(profiles.wavelength_m / (4 * half) / steps[1], 1)


def _channel(profiles: RangeProfiles, channel: int) -> RangeProfiles:
    if not 0 <= channel < len(profiles.values):
        raise DataError(f"there is no channel {channel} among {len(profiles.values)}", "count from 0")
    return replace(
        profiles,
        values=profiles.values[channel : channel + 1],
        channels=profiles.channels[channel : channel + 1],
        noise=None if profiles.noise is None else profiles.noise[channel : channel + 1],
        pairs=None if profiles.pairs is None else profiles.pairs[channel : channel + 1],
    )
