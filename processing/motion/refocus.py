"""Pictures focused for what moves with a given velocity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.radar.profiles import RangeProfiles
from processing.sar.backprojection import backproject
from processing.sar.grid import Grid


def seen_from(profiles: RangeProfiles, velocity_m_s: ArrayLike, time_s: ArrayLike) -> RangeProfiles:
    """The same profiles as a target sees them that moves with ``velocity_m_s``: it stands still, the platform passes.

    Exact for constant velocities, whatever the track. Places are then those at time 0.

    Args:
        profiles: range profiles along the track.
        velocity_m_s: (3,) velocity of the target.
        time_s: (positions,) times of the positions.

    Raises:
        DataError: shapes that do not fit.
    """
    velocity, time = np.asarray(velocity_m_s, dtype=np.float64), np.asarray(time_s, dtype=np.float64)
    if velocity.shape != (3,) or time.shape != (len(profiles.antenna_m),):
        raise DataError(
            f"a velocity of shape {velocity.shape} and times of shape {time.shape} do not fit "
            f"{len(profiles.antenna_m)} positions",
            "give vx, vy, vz and one time for each position",
        )
    moved = profiles.antenna_m - velocity * time[:, None]
    own = None if profiles.velocity_m_s is None else profiles.velocity_m_s - velocity
    return replace(profiles, antenna_m=moved, velocity_m_s=own)


def refocus(
    profiles: RangeProfiles,
    grid: Grid,
    velocity_m_s: ArrayLike,
    time_s: ArrayLike,
    *,
    weights: NDArray[np.floating] | None = None,
    beamwidth_rad: float | None = None,
) -> NDArray[np.complex64]:
    """Focus what moves with ``velocity_m_s`` at its place at time 0; what stands still blurs and shifts instead.

    Arguments and errors as :func:`seen_from` and :func:`processing.sar.backprojection.backproject`.
    """
    return backproject(seen_from(profiles, velocity_m_s, time_s), grid, weights=weights, beamwidth_rad=beamwidth_rad)
