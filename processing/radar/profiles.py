"""Range-compressed data, the common currency between ranging, focusing and display."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.radar.antenna import AntennaPair

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
    """(positions, 3) antenna phase centre in rig coordinates, m, at the middle of the ramps; with ``pairs``, the point
    on the platform that they are measured from. Any track: a rail, a circle, a flight."""
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
    start_m: NDArray[np.float64] | None = None
    """(positions,) what is added to ``range_m`` at each position, for tracks whose distance changes by more than the
    scene is deep. Phases stay those of the absolute range. None: nothing."""
    pairs: tuple[AntennaPair, ...] | None = None
    """Phase centres of transmission and reception of each channel. Range is then half the path from the one over the
    target to the other. None: both at ``antenna_m``."""
    velocity_m_s: NDArray[np.float64] | None = None
    """(positions, 3) velocity of the platform while it recorded. None: it stood still."""
    ramp_s: float | None = None
    """Length of the ramp, needed with ``velocity_m_s`` alone. None: not known (or no ramps: pulses)."""

    def at_positions(
        self, chosen: NDArray[np.integer] | NDArray[np.bool_], values: NDArray[np.complexfloating] | None = None
    ) -> RangeProfiles:
        """The same of some positions, or in another order.

        Args:
            chosen: indices of positions, or (positions,) which.
            values: (channels, chosen positions, bins) instead of those held here.
        """
        return replace(
            self,
            values=self.values[:, chosen] if values is None else values,
            antenna_m=self.antenna_m[chosen],
            noise=None if self.noise is None else self.noise[:, chosen],
            start_m=None if self.start_m is None else self.start_m[chosen],
            velocity_m_s=None if self.velocity_m_s is None else self.velocity_m_s[chosen],
        )

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
