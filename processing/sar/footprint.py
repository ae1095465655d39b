"""Which pixels of a focused image can be trusted: those that the antennas light up."""

from __future__ import annotations

import enum
import math

import numpy as np
from numpy.typing import NDArray

from processing.radar.antenna import boresight, one_way_gain
from processing.sar.grid import Grid

ROWS = 64
"""Rows of a grid that are worked on at a time: what they need besides the flags stays small."""


class ImageFlag(enum.IntFlag):
    """Why a pixel of a focused image is to be mistrusted. Bits of the flag plane (uint8)."""

    OUTSIDE_BEAM = 1
    """Beyond the antennas' half-power beam: compensating the pattern would raise noise and ambiguities only; NaN."""
    GRATING_LOBES = 2
    """Beyond the angle within which the step along the rail is free of grating lobes: may show a bright target's."""
    UNDEFINED = 4
    """The processor could not form it (no data at its range): NaN."""


def footprint_flags(
    grid: Grid,
    *,
    beamwidth_rad: float | None,
    depression_rad: float,
    alias_free_rad: float,
    undefined: NDArray[np.bool_],
) -> NDArray[np.uint8]:
    """Flag plane (ny, nx) of an image, as seen from the aperture's centre. A pixel's flags depend on no other pixel.

    Args:
        grid: the image's grid.
        beamwidth_rad: half-power beamwidth of one antenna; None where the pattern is not compensated.
        depression_rad: antennas' axes below horizontal.
        alias_free_rad: widest angle from broadside without grating lobes (pi/2: none anywhere).
        undefined: (ny, nx) pixels that are NaN.
    """
    flags = np.where(undefined, int(ImageFlag.UNDEFINED), 0).astype(np.uint8)
    axis = boresight(depression_rad)
    for first in range(0, grid.shape[0], ROWS):
        # Written out, for products of matrices round differently for different numbers of rows.
        some = flags[first : first + ROWS]
        x, y, z = grid.places_m(slice(first, first + ROWS))
        distance = np.sqrt(x**2 + y**2 + z**2)
        with np.errstate(invalid="ignore", divide="ignore"):
            cosine = (axis[0] * x + axis[1] * y + axis[2] * z) / distance
            sine = np.abs(x) / distance
        if beamwidth_rad is not None:
            some[~(one_way_gain(cosine, beamwidth_rad) >= 0.5)] |= int(ImageFlag.OUTSIDE_BEAM)
        if alias_free_rad < math.pi / 2:
            some[sine > math.sin(alias_free_rad)] |= int(ImageFlag.GRATING_LOBES)
    return flags
