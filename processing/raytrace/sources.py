"""Where light comes from: lamps, the sun, and a sky polarized by Rayleigh scattering (thesis 4.3).

What a lamp emits has a state of polarization whose x axis is horizontal: across the ray and the source's ``up``.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.optics.stokes_vectors import is_physical

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]
State = tuple[float, float, float, float]

UNPOLARIZED: State = (1.0, 0.0, 0.0, 0.0)
UP: Vector = (0.0, 0.0, 1.0)

SUN_RADIUS_RAD = math.radians(0.2665)
"""Half the sun's angular diameter, mean over the year."""


class Kind(enum.IntEnum):
    """Kinds of source, as the kernels know them."""

    POINT = 0
    PLANE = 1
    GAUSSIAN = 2
    SUN = 3
    SKY = 4


@dataclass(frozen=True)
class PointSource:
    """A lamp that radiates alike in all directions."""

    position_m: Vector
    intensity: float
    """W/sr (or any unit of flux per sr)."""
    stokes: State = UNPOLARIZED
    up: Vector = UP


@dataclass(frozen=True)
class PlaneSource:
    """The thesis's plane source: a lamp at a point that lights a square of a plane across its axis evenly."""

    position_m: Vector
    target_m: Vector
    power: float
    """Flux of all rays, W."""
    half_slope: float
    """Half the lit square's width over its distance."""
    stokes: State = UNPOLARIZED
    up: Vector = UP


@dataclass(frozen=True)
class GaussianSource:
    """The thesis's Gaussian source: a lamp at a point whose rays have Gaussian slopes from its axis."""

    position_m: Vector
    target_m: Vector
    power: float
    slope_sd: float
    """Standard deviation of each slope; of the lit spot over its distance."""
    stokes: State = UNPOLARIZED
    up: Vector = UP


@dataclass(frozen=True)
class Sun:
    """Light from a small disc at infinity; with ``radius_rad = 0`` a plane wave."""

    direction: Vector
    """Towards the sun, any length."""
    irradiance: float = 1.0
    """On a surface that faces it, W/m^2."""
    radius_rad: float = SUN_RADIUS_RAD
    stokes: State = UNPOLARIZED
    up: Vector = UP


@dataclass(frozen=True)
class RayleighSky:
    """Light scattered once by clear air, from above the horizon (z > 0).

    Radiance ``radiance * 3/4 (1 + cos^2 g)`` and DOLP ``dolp * sin^2 g / (1 + cos^2 g)`` across the plane of
    scattering, g the angle from the sun (Chandrasekhar 1950, Radiative Transfer, section 16; ``dolp`` stands for all
    that depolarizes).
    """

    sun_direction: Vector
    radiance: float = 1.0
    """Mean over the sphere, W/(m^2 sr)."""
    dolp: float = 0.8
    """At 90 degrees from the sun."""


Source = PointSource | PlaneSource | GaussianSource | Sun | RayleighSky

COLUMNS = 16
KIND, PLACE, STRENGTH, S1, AXIS, UPRIGHT, SIZE = 0, 1, 4, 5, 8, 11, 14
"""Columns of the table; places, states, axes and uprights take three."""


def table(sources: Sequence[Source]) -> Floats:
    """Sources as the kernels read them, (count, :data:`COLUMNS`).

    Raises:
        DataError: a strength that is negative, a state that light cannot have, a direction that is none.
    """
    rows = np.zeros((len(sources), COLUMNS))
    for number, (row, source) in enumerate(zip(rows, sources, strict=True), start=1):
        if isinstance(source, RayleighSky):
            row[KIND], row[STRENGTH], row[SIZE] = Kind.SKY, source.radiance, source.dolp
            row[PLACE : PLACE + 3] = _unit(source.sun_direction, f"source {number}")
            _check(0 <= source.dolp <= 1, number, f"a sky's DOLP is {source.dolp}", "give a number from 0 to 1")
        else:
            _check(
                bool(is_physical(source.stokes)) and source.stokes[0] > 0,
                number,
                f"a state of polarization is {source.stokes}",
                "give S0 > 0 and the others no larger together",
            )
            row[S1 : S1 + 3] = np.asarray(source.stokes[1:]) / source.stokes[0]
            row[UPRIGHT : UPRIGHT + 3] = _unit(source.up, f"source {number}")
            _place(row, source, number)
        _check(
            math.isfinite(row[STRENGTH]) and row[STRENGTH] >= 0,
            number,
            f"its strength is {row[STRENGTH]}",
            "give a finite number, zero or more",
        )
    return rows


def _place(row: Floats, source: PointSource | PlaneSource | GaussianSource | Sun, number: int) -> None:
    if isinstance(source, Sun):
        row[KIND], row[STRENGTH], row[SIZE] = Kind.SUN, source.irradiance, source.radius_rad
        row[PLACE : PLACE + 3] = _unit(source.direction, f"source {number}")
        _check(
            0 <= source.radius_rad < 0.5, number, f"the sun's radius is {source.radius_rad} rad", "give 0 to 0.5 rad"
        )
        return
    _check(bool(np.all(np.isfinite(source.position_m))), number, "its place is not finite", "give three numbers")
    row[PLACE : PLACE + 3] = source.position_m
    if isinstance(source, PointSource):
        row[KIND], row[STRENGTH] = Kind.POINT, source.intensity
        return
    axis = _unit(np.subtract(source.target_m, source.position_m), f"source {number}")
    row[AXIS : AXIS + 3] = axis
    row[STRENGTH] = source.power
    width = source.half_slope if isinstance(source, PlaneSource) else source.slope_sd
    row[KIND] = Kind.PLANE if isinstance(source, PlaneSource) else Kind.GAUSSIAN
    row[SIZE] = width
    _check(0 < width < 1e6, number, f"its beam's slope is {width}", "give a number above 0")
    _check(
        float(np.linalg.norm(np.cross(axis, row[UPRIGHT : UPRIGHT + 3]))) > 1e-9,
        number,
        "its upright direction lies along its beam",
        "give another 'up'",
    )


def _unit(vector: Vector | Floats, what: str) -> Floats:
    v = np.asarray(vector, dtype=np.float64)
    size = float(np.linalg.norm(v)) if v.shape == (3,) else 0.0
    if not (math.isfinite(size) and size > 0):
        raise DataError(f"{what}: a direction is {vector}", "give three finite numbers, not all zero")
    return np.asarray(v / size)


def _check(good: bool, number: int, what: str, advice: str) -> None:
    if not good:
        raise DataError(f"source {number}: {what}", advice)
