"""Which pixels of a focused image can be trusted: those that the antennas light up."""

from __future__ import annotations

import enum
import math

import numpy as np
from numpy.typing import NDArray

from processing.radar.antenna import boresight, one_way_gain
from processing.sar.grid import ImageGrid


class ImageFlag(enum.IntFlag):
    """Why a pixel of a focused image is to be mistrusted. Bits of the flag plane (uint8)."""

    OUTSIDE_BEAM = 1
    """Beyond the antennas' half-power beam: compensating the pattern would raise noise and ambiguities only; NaN."""
    GRATING_LOBES = 2
    """Beyond the angle within which the step along the rail is free of grating lobes: may show a bright target's."""
    UNDEFINED = 4
    """The processor could not form it (no data at its range): NaN."""


def footprint_flags(
    grid: ImageGrid,
    *,
    beamwidth_rad: float | None,
    depression_rad: float,
    alias_free_rad: float,
    undefined: NDArray[np.bool_],
) -> NDArray[np.uint8]:
    """Flag plane (ny, nx) of an image, as seen from the aperture's centre.

    Args:
        grid: the image's grid.
        beamwidth_rad: half-power beamwidth of one antenna; None where the pattern is not compensated.
        depression_rad: antennas' axes below horizontal.
        alias_free_rad: widest angle from broadside without grating lobes (pi/2: none anywhere).
        undefined: (ny, nx) pixels that are NaN.
    """
    sight = np.stack(
        [
            np.broadcast_to(grid.x_m, grid.shape),
            np.broadcast_to(grid.y_m[:, None], grid.shape),
            np.full(grid.shape, grid.z_m),
        ],
        axis=-1,
    )
    distance = np.linalg.norm(sight, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = sight @ boresight(depression_rad) / distance
        sine = np.abs(sight[..., 0]) / distance
    flags = np.where(undefined, int(ImageFlag.UNDEFINED), 0).astype(np.uint8)
    if beamwidth_rad is not None:
        flags[~(one_way_gain(cosine, beamwidth_rad) >= 0.5)] |= int(ImageFlag.OUTSIDE_BEAM)
    if alias_free_rad < math.pi / 2:
        flags[sine > math.sin(alias_free_rad)] |= int(ImageFlag.GRATING_LOBES)
    return flags
