"""Division of focal plane: a mosaic of polarizers on the sensor's pixels, two by two.

A mosaic is named by its angles in degrees, row by row from the first pixel on: ``"90-45-135-0"`` is 90 and 45 over 135
and 0, as on Sony's polarization sensors. A region that begins one column or row later has another phase, and so another
name.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.optics.analyser import measurement_matrix

Floats = NDArray[np.float64]

ANGLES_DEG = (0, 45, 90, 135)
"""Order of the planes that :func:`split` and :func:`processing.optics.demosaic.demosaic` return."""


@dataclass(frozen=True)
class Mosaic:
    """Angles of the 2 x 2 pixels from the first pixel on, degrees."""

    angles_deg: tuple[tuple[int, int], tuple[int, int]]

    def __post_init__(self) -> None:
        found = sorted(angle for row in self.angles_deg for angle in row)
        if found != list(ANGLES_DEG):
            raise DataError(f"a mosaic has the angles {found}", "give 0, 45, 90 and 135, each once")

    @property
    def name(self) -> str:
        """The mosaic's name."""
        return "-".join(str(angle) for row in self.angles_deg for angle in row)

    def place(self, angle_deg: int) -> tuple[int, int]:
        """Row and column, 0 or 1, of the pixels behind that angle."""
        for row, angles in enumerate(self.angles_deg):
            if angle_deg in angles:
                return row, angles.index(angle_deg)
        raise DataError(f"no pixel of the mosaic is behind {angle_deg} degrees", f"give one of {ANGLES_DEG}")

    def shifted(self, rows: int, columns: int) -> Mosaic:
        """The mosaic of a region that begins so many rows and columns later."""
        a = self.angles_deg
        r, c = rows % 2, columns % 2
        return Mosaic(((a[r][c], a[r][1 - c]), (a[1 - r][c], a[1 - r][1 - c])))


def parse_mosaic(name: str) -> Mosaic:
    """The mosaic of that name.

    Raises:
        DataError: not the angles 0, 45, 90 and 135, each once, joined by hyphens.
    """
    parts = name.split("-")
    if len(parts) != 4 or not all(part.isascii() and part.isdigit() and len(part) <= 3 for part in parts):
        raise DataError(f"a mosaic is called {name!r}", "name its angles row by row, such as 90-45-135-0")
    a, b, c, d = map(int, parts)
    return Mosaic(((a, b), (c, d)))


def through_mosaic(stokes: Floats, mosaic: Mosaic, extinction_ratio: float = math.inf) -> Floats:
    """Intensity that each pixel sees: the forward model of a division of focal plane sensor.

    Args:
        stokes: (3, rows, columns) S0, S1, S2 of the light on each pixel.
        mosaic: polarizers on the pixels.
        extinction_ratio: of these polarizers.

    Returns:
        (rows, columns), unit of ``stokes``.
    """
    light = np.empty(stokes.shape[1:])
    for angle in ANGLES_DEG:
        i, k = mosaic.place(angle)
        row = measurement_matrix([math.radians(angle)], extinction_ratio)[0]
        light[i::2, k::2] = np.tensordot(row, stokes[:, i::2, k::2], axes=1)
    return light


def through_planes(planes: Floats, mosaic: Mosaic) -> Floats:
    """What each pixel sees of images behind all four angles.

    Args:
        planes: (4, rows, columns) in the order of :data:`ANGLES_DEG`.
        mosaic: polarizers on the pixels.

    Returns:
        (rows, columns), unit of ``planes``.
    """
    light = np.empty(planes.shape[1:])
    for plane, angle in zip(planes, ANGLES_DEG, strict=True):
        i, k = mosaic.place(angle)
        light[i::2, k::2] = plane[i::2, k::2]
    return light


def split(image: NDArray[np.generic], mosaic: Mosaic) -> NDArray[np.generic]:
    """The four images that a mosaic holds, at half the resolution; nothing is interpolated.

    The planes see the scene from places up to one pixel apart: what polarization shows at edges may be that.

    Args:
        image: (rows, columns), any type; both even.
        mosaic: its polarizers.

    Returns:
        (4, rows / 2, columns / 2) in the order of :data:`ANGLES_DEG`, type of ``image``.

    Raises:
        DataError: not an image of even size.
    """
    check_mosaic_image(image)
    return np.stack([image[i::2, k::2] for i, k in map(mosaic.place, ANGLES_DEG)])


def spread(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels whose demosaiced values use a pixel of ``mask``: (rows, columns), itself and its eight neighbours."""
    check_mosaic_image(mask)
    rows, columns = mask.shape
    padded = np.pad(mask, 1)
    touched = np.zeros_like(mask)
    for down in range(3):
        for right in range(3):
            touched |= padded[down : down + rows, right : right + columns]
    return touched


def check_mosaic_image(image: NDArray[np.generic], least: int = 2) -> None:
    """Raise :class:`DataError` for what is no image of even size, or smaller than ``least``."""
    if image.ndim != 2 or image.shape[0] % 2 or image.shape[1] % 2 or min(image.shape) < least:
        raise DataError(
            f"a mosaic image has shape {image.shape}", f"give rows and columns, both even and at least {least}"
        )
