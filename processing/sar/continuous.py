"""Platforms that move while they sweep: what a linear ramp makes of it, and whether it matters.

With the radial velocity v at the middle of the ramp, R(t) = R + v t, an echo's beat (residual video phase included) is

    exp j (2 pi tau(t) (f_c + K t) - pi K tau(t)^2),    tau(t) = 2 (R(t) - v R / c) / c,

the last term for the flight from transmission to reception. Its part linear in t puts the target at the apparent range

    R_a = R' + v (f_c / K - 2 R' / c),    R' = R (1 - v / c)    (range walk and range-Doppler coupling),

and since range compression takes the residual video phase off at R_a, the profile there has the phase
``-2 pi (2 f_c R' / c + 2 K (R_a^2 - R'^2) / c^2)``. What is left out is the part quadratic in t, 4 pi v K t^2 / c,
which widens the profile. Meta, Hoogeboom, Ligthart 2007 (IEEE Trans. Geosci. Remote Sens. 45) treat the same signal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles

Motion = Literal["auto", "still", "moving"]
MOTIONS: tuple[Motion, ...] = ("auto", "still", "moving")

TOLERANCE_DB = -60.0
"""Error that leaving motion out may make where the choice is automatic."""


@dataclass(frozen=True)
class SweepMotion:
    """Whether motion within the ramps is modelled, and what it would cost to leave it out."""

    modelled: bool
    slope_hz_s: float
    """K = B / T; infinite where no ramp is known."""
    walk_m: float
    """Bound of the apparent shift in range, |v| f_c / K."""
    phase_rad: float
    """Bound of the phase that moving adds: flight and residual video phase."""
    still_error_db: float
    """Bound of the image's relative error where motion is left out; -inf where nothing moves."""
    left_out_db: float
    """What the whole model still leaves of a target at the target's own place, where it is the phase quadratic within
    a ramp; beside it a passing radar's response has another shape, which the matched filter has as well. -inf where
    nothing moves."""
    reason: str
    """One sentence for the user."""


def sweep_motion(
    profiles: RangeProfiles, motion: Motion = "auto", *, tolerance_db: float = TOLERANCE_DB
) -> SweepMotion:
    """Decide whether motion within the ramps matters.

    The bounds hold for targets in any direction: radial speeds are taken as the platform's own. A shift s of the
    profile changes an image by ``pi s / (sqrt(3) cell)`` of its size (root mean square over a flat band).

    Args:
        profiles: range profiles with ``velocity_m_s`` and ``ramp_s``; both missing means that it stood still.
        motion: ``"auto"`` models it where leaving it out may cost more than the tolerance; the others by order.
        tolerance_db: that tolerance.

    Raises:
        DataError: unknown choice, or motion is to be modelled and the ramp's length is not known.
    """
    if motion not in MOTIONS:
        raise DataError(f"there is no motion model {motion!r}", f"choose one of {', '.join(MOTIONS)}")
    speed = 0.0
    if profiles.velocity_m_s is not None:
        speed = float(np.linalg.norm(np.asarray(profiles.velocity_m_s, dtype=np.float64), axis=1).max(initial=0.0))
    if speed == 0.0:
        return SweepMotion(False, math.inf, 0.0, 0.0, -math.inf, -math.inf, "the platform stood still while it swept")
    if profiles.ramp_s is None or not (math.isfinite(profiles.ramp_s) and profiles.ramp_s > 0):
        raise DataError("velocities are given without the length of the ramp", "give ramp_s, or leave velocities out")
    slope = profiles.bandwidth_hz / profiles.ramp_s
    furthest = float(np.max(np.abs(profiles.range_m)))
    if profiles.start_m is not None:
        furthest += float(np.max(np.abs(profiles.start_m)))
    walk = speed * profiles.centre_hz / slope
    flight = 4 * math.pi * profiles.centre_hz / SPEED_OF_LIGHT_M_S * furthest * speed / SPEED_OF_LIGHT_M_S
    video = 4 * math.pi * slope / SPEED_OF_LIGHT_M_S**2 * (2 * furthest * walk + walk**2)
    error = math.pi / math.sqrt(3) * walk / profiles.resolution_m + flight + video
    quadratic = math.pi * speed * profiles.bandwidth_hz * profiles.ramp_s / SPEED_OF_LIGHT_M_S / math.sqrt(5)
    error_db, quadratic_db = 20 * math.log10(error), 20 * math.log10(quadratic)
    modelled = motion == "moving" or (motion == "auto" and error_db > tolerance_db)
    did = "modelled" if modelled else "left out"
    reason = (
        f"motion within the sweeps is {did}: at {speed:.3g} m/s it moves echoes by up to {1000 * walk:.3g} mm of range "
        f"and {math.degrees(flight + video):.3g} degrees, an error of {error_db:.0f} dB at most if left out"
    )
    return SweepMotion(modelled, slope, walk, flight + video, error_db, quadratic_db, reason)


def apparent_range(
    range_m: NDArray[np.float64], radial_m_s: NDArray[np.float64], centre_hz: float, slope_hz_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where a target appears in a moving platform's profile, and the phase that it has there.

    Args:
        range_m: true range at the middle of the ramp, any shape.
        radial_m_s: velocity at which it grows, same shape.
        centre_hz: frequency at the ramp's centre.
        slope_hz_s: K = B / T.

    Returns:
        Apparent range, m, and the phase there in turns, to be turned back by ``exp(+2j pi turns)``.
    """
    flown = range_m * (1 - radial_m_s / SPEED_OF_LIGHT_M_S)
    seen = flown + radial_m_s * (centre_hz / slope_hz_s - 2 * flown / SPEED_OF_LIGHT_M_S)
    turns = 2 * centre_hz / SPEED_OF_LIGHT_M_S * flown
    turns = turns + 2 * slope_hz_s / SPEED_OF_LIGHT_M_S**2 * (seen - flown) * (seen + flown)
    return seen, turns
