"""The antennas' pattern, one model for simulation and for compensation.

One antenna's power pattern is ``cos^n`` of the angle off its axis, with n chosen for the half-power beamwidth; nothing
is received from behind. With two equal antennas, one transmitting and one receiving, the two-way *amplitude* pattern
equals the one-way *power* pattern.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError


@dataclass(frozen=True)
class AntennaPair:
    """Phase centres of a channel's transmitting and receiving antenna, m, from a common point on the platform.

    The platform is taken not to turn: offsets are in rig coordinates at every position.
    """

    transmit_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    receive_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


def pattern_exponent(beamwidth_rad: float) -> float:
    """Exponent n for which ``cos^n(beamwidth / 2) = 1/2``.

    Raises:
        DataError: the beamwidth is not between 0 and pi (exclusive).
    """
    if not 0 < beamwidth_rad < math.pi:
        raise DataError(
            f"a half-power beamwidth of {math.degrees(beamwidth_rad):g} degrees has no cosine pattern",
            "give one above 0 and below 180 degrees",
        )
    return math.log(0.5) / math.log(math.cos(beamwidth_rad / 2))


def one_way_gain(cos_angle: ArrayLike, beamwidth_rad: float) -> NDArray[np.float64]:
    """One antenna's power pattern relative to its axis, which is also the two-way amplitude pattern of two.

    Args:
        cos_angle: cosine of the angle off the axis, any shape.
        beamwidth_rad: half-power beamwidth (full angle), rad.

    Returns:
        Same shape, 1 on the axis, 1/2 at half the beamwidth, 0 at and beyond 90 degrees; NaN stays NaN.

    Raises:
        DataError: the beamwidth is not between 0 and pi (exclusive).
    """
    exponent = pattern_exponent(beamwidth_rad)
    ahead = np.clip(np.asarray(cos_angle, dtype=np.float64), 0.0, 1.0)
    gain: NDArray[np.float64] = ahead**exponent
    return gain


def boresight(depression_rad: float) -> NDArray[np.float64]:
    """Unit vector (3,) of the antennas' axes: along +y, tilted below horizontal by ``depression_rad``."""
    return np.array([0.0, math.cos(depression_rad), -math.sin(depression_rad)])
