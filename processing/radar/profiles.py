"""Range-compressed data, the common currency between ranging, focusing and display."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SPEED_OF_LIGHT_M_S = 299_792_458.0


@dataclass(frozen=True)
class RangeProfiles:
    """Complex range profiles of one or more channels along a track.

    Convention: an isotropic point of RCS sigma at range R from the antenna appears as
    ``A sqrt(sigma) w(r - R) exp(-j 4 pi centre_hz R / c)`` with a real, even envelope ``w``, ``w(0) = 1``: phase is
    that of the ramp's centre, so the envelope is at base band and may be interpolated along range.
    """

    values: NDArray[np.complexfloating]
    """(channels, positions, bins) complex."""
    range_m: NDArray[np.float64]
    """(bins,) uniform range axis, m."""
    antenna_m: NDArray[np.float64]
    """(positions, 3) antenna phase centre in rig coordinates, m."""
    channels: tuple[str, ...]
    """Channel names, transmit-then-receive, in the order of the first axis of ``values``."""
    centre_hz: float
    bandwidth_hz: float
    window: str = "hann"
    """Window over the ramp, which sets the envelope's width and side lobes."""
    range_compensated: bool = False
    """Whether amplitudes were multiplied by R^2 (so that they do not fall with range)."""
    noise: NDArray[np.float64] | None = None
    """(channels, positions) noise power of one bin before range compensation, from the scatter of the sweeps averaged;
    NaN where there was one sweep only. None where nothing is known of it."""

    @property
    def range_step_m(self) -> float:
        """Spacing of the range axis, m."""
        return float(self.range_m[1] - self.range_m[0])

    @property
    def resolution_m(self) -> float:
        """c / 2B, m: the unweighted resolution."""
        return SPEED_OF_LIGHT_M_S / (2 * self.bandwidth_hz)

    @property
    def wavelength_m(self) -> float:
        """Wavelength at the centre frequency, m."""
        return SPEED_OF_LIGHT_M_S / self.centre_hz
