"""How a polarizer sits in its mount: the angle ``offset_deg`` of the rig file, from measurements.

Home of a mount is where its maker put the sensor; the film sits in it as somebody glued it. Two ways to find out, both
with ``offset_deg = 0`` in the rig file, so that the driver reports the mount's own angle:

- *by angles*: for some mount angles, measure the direction of the transmission axis (with a protractor at its mark, or
  by crossing it with a polarizer whose axis is known and adding 90 degrees): :func:`offset_from_axes`;
- *by intensities*: look at light of known linear polarization (a known polarizer before a lamp) at some mount angles
  and fit the law of Malus: :func:`offset_from_intensities`.

A transmission axis repeats after half a turn, and so does the offset: it is given between -90 and 90 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_LEAST_CONTRAST = 1e-3


@dataclass(frozen=True)
class Offset:
    """Angle of the transmission axis from horizontal with the mount at home, and its standard deviation, radians."""

    angle_rad: float
    sd_rad: float

    @property
    def option(self) -> str:
        """The line for ``[polarizer.options]``."""
        return f"offset_deg = {math.degrees(self.angle_rad):.3f}  # +- {math.degrees(self.sd_rad):.3f}"


def offset_from_axes(mount_rad: Sequence[float], axis_rad: Sequence[float]) -> Offset:
    """The offset from measured directions of the transmission axis: their mean on the circle of doubled angles.

    Args:
        mount_rad: angles of the mount as its driver reports them with ``offset_deg = 0``, shape (n,), n at least 2.
        axis_rad: measured directions of the axis from horizontal (any half turn), shape (n,).

    Returns:
        The offset; its standard deviation is that of the mean (scatter of the directions over sqrt(n)).

    Raises:
        ValueError: fewer than two angles, lengths that differ, angles that are not finite, or directions that scatter
            so much that they have no mean.
    """
    mount, axis = _columns(mount_rad, axis_rad, at_least=2)
    mean = np.mean(np.exp(2j * (axis - mount)))
    if abs(mean) < 0.5:
        raise ValueError(
            f"the measured axes do not follow the mount (they agree to {abs(mean):.2f} of 1): is its sense right?"
        )
    offset_rad = float(np.angle(mean)) / 2
    off_rad = np.angle(np.exp(2j * (axis - mount - offset_rad))) / 2
    sd_rad = math.sqrt(float(np.sum(off_rad**2)) / (len(off_rad) - 1) / len(off_rad))
    return Offset(offset_rad, sd_rad)


def offset_from_intensities(mount_rad: Sequence[float], intensity: Sequence[float], source_rad: float) -> Offset:
    """The offset from intensities behind the polarizer in linearly polarized light: I = a + b cos 2(mount - peak).

    Args:
        mount_rad: angles of the mount as its driver reports them with ``offset_deg = 0``, shape (n,), n at least 4,
            spread over at least a quarter turn.
        intensity: intensities (any unit, dark level subtracted), shape (n,).
        source_rad: polarization of the light from horizontal, radians.

    Returns:
        The offset, ``source_rad`` less the mount's angle of greatest intensity; its standard deviation follows from the
        residuals of the fit.

    Raises:
        ValueError: too few or unusable values, or intensities that do not change with the angle.
    """
    mount, seen = _columns(mount_rad, intensity, at_least=4)
    design = np.column_stack([np.ones_like(mount), np.cos(2 * mount), np.sin(2 * mount)])
    if np.linalg.cond(design) > 50:
        raise ValueError("the mount's angles lie too close together: spread them over at least a quarter turn")
    (mean, cosine, sine), *_ = np.linalg.lstsq(design, seen, rcond=None)
    amplitude = math.hypot(cosine, sine)
    if not amplitude > _LEAST_CONTRAST * abs(mean):
        raise ValueError("the intensity does not change with the angle: is the light polarized?")
    residual = seen - design @ np.array([mean, cosine, sine])
    covariance = np.linalg.inv(design.T @ design) * float(residual @ residual) / (len(seen) - 3)
    # peak = atan2(sine, cosine) / 2
    gradient = np.array([0.0, -sine, cosine]) / (2 * amplitude**2)
    offset_rad = source_rad - math.atan2(sine, cosine) / 2
    half_turns = round(offset_rad / math.pi)
    return Offset(offset_rad - math.pi * half_turns, math.sqrt(float(gradient @ covariance @ gradient)))


def _columns(
    first: Sequence[float], second: Sequence[float], *, at_least: int
) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], np.ndarray[tuple[int], np.dtype[np.float64]]]:
    one, two = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if one.ndim != 1 or one.shape != two.shape or len(one) < at_least:
        raise ValueError(
            f"found {one.shape} and {two.shape} values, allowed: two lists of the same length, at least {at_least}"
        )
    if not (np.all(np.isfinite(one)) and np.all(np.isfinite(two))):
        raise ValueError("found values that are no numbers")
    return one, two
