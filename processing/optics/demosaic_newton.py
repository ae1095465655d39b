"""Demosaicing by Newton's polynomials and the polarization difference model.

After N. Li, Y. Zhao, Q. Pan and S. G. Kong, "Demosaicking DoFP images using Newton's polynomial interpolation and
polarization difference model", Opt. Express 27, 1376-1391 (2019). The difference between the images behind two angles
is smoother than either; along a line on which two angles alternate, the missing one is its neighbours' polynomial plus
the own angle's second difference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.errors import undefined_is_nan
from processing.optics.mosaic import ANGLES_DEG, Mosaic, check_mosaic_image

Floats = NDArray[np.float64]

TAPS = (1 / 16, -1 / 4, 7 / 16, 1 / 2, 7 / 16, -1 / 4, 1 / 16)
"""Weights along a line: odd places belong to the angle looked for, even ones to the pixel's own. Sums are 1 and 0."""

CLEAR_EDGE = 5.8
"""Ratio of the residuals of two directions at which an edge decides between them (as published)."""

_REACH = 3
_TINY = 1e-12


@undefined_is_nan
def demosaic_newton(image: NDArray[np.generic], mosaic: Mosaic) -> Floats:
    """Full-size image behind each angle.

    Args:
        image: (rows, columns) any real type; both even and at least 4. Beyond the border it is mirrored.
        mosaic: its polarizers, in any phase.

    Returns:
        (4, rows, columns) float64 in the order of :data:`processing.optics.mosaic.ANGLES_DEG`. Pixels keep their own
        value; NaN makes NaN of what is interpolated from it.

    Raises:
        DataError: not an image of even size, or a smaller one.
    """
    check_mosaic_image(image, least=4)
    own = image.astype(np.float64)
    # The angles missing at a pixel are those of its neighbours beside, above and across.
    falling = _line(own, own, (1, 1))
    rising = _line(own, own, (1, -1))
    across = _fused(own, falling, rising, _roughness(own, (1, 1)), _roughness(own, (1, -1)))
    along_row, along_column = _line(own, own, (0, 1)), _line(own, own, (1, 0))
    # In the next row the angle across a pixel is the one beside it here, and so for columns.
    beside_again, over_again = _line(own, across, (1, 0)), _line(own, across, (0, 1))
    level, upright = _roughness(own, (0, 1)), _roughness(own, (1, 0))
    beside = _fused(own, along_row, beside_again, level, upright)
    over = _fused(own, over_again, along_column, level, upright)
    return by_angle(own, beside, over, across, mosaic)


def by_angle(own: Floats, beside: Floats, over: Floats, across: Floats, mosaic: Mosaic) -> Floats:
    """Planes by angle from planes by place: of a pixel's own angle, its row neighbours', its column neighbours', and
    that of the pixels across. All (rows, columns)."""
    planes = np.empty((len(ANGLES_DEG), *own.shape))
    for plane, angle in zip(planes, ANGLES_DEG, strict=True):
        i, k = mosaic.place(angle)
        plane[i::2, k::2] = own[i::2, k::2]
        plane[i::2, 1 - k :: 2] = beside[i::2, 1 - k :: 2]
        plane[1 - i :: 2, k::2] = over[1 - i :: 2, k::2]
        plane[1 - i :: 2, 1 - k :: 2] = across[1 - i :: 2, 1 - k :: 2]
    return planes


def shifted(image: Floats, down: int, right: int, reach: int = _REACH) -> Floats:
    """``image[row + down, column + right]``, mirrored at its borders (which keeps the mosaic's phase)."""
    padded = np.pad(image, reach, mode="reflect")
    rows, columns = image.shape
    return padded[reach + down : reach + down + rows, reach + right : reach + right + columns]


def _line(own: Floats, other: Floats, step: tuple[int, int]) -> Floats:
    """The missing angle along a line: odd places are taken from ``other``, even ones from ``own``."""
    total = np.zeros_like(own)
    for place, weight in enumerate(TAPS, start=-_REACH):
        total += weight * shifted(other if place % 2 else own, place * step[0], place * step[1])
    return total


def _roughness(own: Floats, step: tuple[int, int]) -> Floats:
    """How much the image changes along a line, counts."""
    i, k = step
    first = np.abs(shifted(own, -i, -k) - shifted(own, i, k))
    return first + np.abs(2 * own - shifted(own, -2 * i, -2 * k) - shifted(own, 2 * i, 2 * k))


def _fused(own: Floats, one: Floats, other: Floats, rough_one: Floats, rough_other: Floats) -> Floats:
    """Of two directions the one along an edge, else their mean with weights by smoothness."""
    misfit_one, misfit_other = _around(np.abs(one - own)), _around(np.abs(other - own))
    w_one, w_other = 1 / (rough_one + _TINY), 1 / (rough_other + _TINY)
    mixed = (w_one * one + w_other * other) / (w_one + w_other)
    mixed = np.where(misfit_one > CLEAR_EDGE * misfit_other, other, mixed)
    return np.where(misfit_other > CLEAR_EDGE * misfit_one, one, mixed)


def _around(values: Floats) -> Floats:
    """Sum over the nine nearest pixels of the same angle."""
    rows = shifted(values, -2, 0) + values + shifted(values, 2, 0)
    return shifted(rows, 0, -2) + rows + shifted(rows, 0, 2)
