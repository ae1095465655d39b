"""From a mosaic of polarizers to a full-size image behind each of its angles.

:func:`demosaic` is the fast way (numba); :func:`demosaic_reference` is its definition in plain float64 NumPy. Both are
bilinear; :func:`demosaic_by` takes one of :data:`METHODS`.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.optics.demosaic_newton import demosaic_newton
from processing.optics.demosaic_residual import demosaic_residual
from processing.optics.mosaic import ANGLES_DEG, Mosaic, check_mosaic_image

Floats = NDArray[np.float64]

SAMPLES_PER_PIXEL = 0.25
"""Independent samples of each angle that a full-size plane holds per pixel: the rest is interpolated from them."""


def demosaic_reference(image: NDArray[np.generic], mosaic: Mosaic) -> Floats:
    """Plain float64 definition of :func:`demosaic`; same arguments and result, in float64.

    Each plane's samples are spread with the weights (1/2, 1, 1/2) along rows and columns (bilinear interpolation) and
    divided by the weights that found a sample, which matters at the border only.
    """
    check_mosaic_image(image)
    rows, columns = image.shape
    planes = np.empty((len(ANGLES_DEG), rows, columns))
    for plane, angle in zip(planes, ANGLES_DEG, strict=True):
        i, k = mosaic.place(angle)
        samples, weights = np.zeros((rows + 2, columns + 2)), np.zeros((rows + 2, columns + 2))
        samples[1 + i : rows + 1 : 2, 1 + k : columns + 1 : 2] = image[i::2, k::2]
        weights[1 + i : rows + 1 : 2, 1 + k : columns + 1 : 2] = 1.0
        total, weight = np.zeros((rows, columns)), np.zeros((rows, columns))
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                share = 0.5 ** (abs(down) + abs(right))
                window = np.s_[1 + down : rows + 1 + down, 1 + right : columns + 1 + right]
                # A sample counts only where it is: 0 x NaN must not spread a lost pixel beyond its neighbours.
                total += np.where(weights[window] > 0, share * samples[window], 0.0)
                weight += share * weights[window]
        plane[:] = total / weight
    return planes


def demosaic(image: NDArray[np.generic], mosaic: Mosaic) -> NDArray[np.float32]:
    """Full-size image behind each angle, bilinear between the pixels that have it.

    Args:
        image: (rows, columns) any real type; both even. NaN pixels make NaN of what is interpolated from them.
        mosaic: its polarizers.

    Returns:
        (4, rows, columns) float32 in the order of :data:`ANGLES_DEG`; the pixels that have an angle keep their value.

    Raises:
        DataError: not an image of even size.
    """
    check_mosaic_image(image)
    planes = np.empty((len(ANGLES_DEG), *image.shape), dtype=np.float32)
    places = np.array([mosaic.place(angle) for angle in ANGLES_DEG], dtype=np.int64)
    _kernel(np.ascontiguousarray(image, dtype=np.float32), places, planes)
    return planes


def _bilinear(image: NDArray[np.generic], mosaic: Mosaic) -> Floats:
    return demosaic(image, mosaic).astype(np.float64)


METHODS: dict[str, Callable[[NDArray[np.generic], Mosaic], Floats]] = {
    "bilinear": _bilinear,
    "newton": demosaic_newton,
    "residual": demosaic_residual,
}
"""Ways to demosaic: the fastest, Newton's polynomials, and residual interpolation, which has the least error."""

_SHARES = {
    # of a pixel's own angle, its row's other, its column's other, the one across; and what all have in common
    "bilinear": (1.0, 1 / 2, 1 / 2, 1 / 4, 0.0),
    "newton": (0.21, 0.21, 0.21, 0.21, 0.375),
    "residual": (1.0, 1 / 2, 1 / 2, 1 / 4, 0.0),
}
"""Variance of interpolated planes over that of one sample, in uniform light. Bilinear: means of 2, 2 and 4 samples.
Newton's polynomials pass differences between angles through a narrow filter, so that noise is mostly common to all;
residuals in uniform light are the light itself, interpolated bilinearly. Checked by Monte Carlo in the tests."""


def demosaic_by(method: str, image: NDArray[np.generic], mosaic: Mosaic) -> NDArray[np.float32]:
    """Full-size image behind each angle, (4, rows, columns) float32, by one of :data:`METHODS`.

    Raises:
        DataError: an unknown method, or an image that it cannot take.
    """
    if method not in METHODS:
        raise DataError(f"no demosaicing is called {method!r}", f"take one of {', '.join(METHODS)}")
    return METHODS[method](image, mosaic).astype(np.float32)


def variance_share(method: str, mosaic: Mosaic) -> tuple[Floats, float]:
    """Variance of each plane over that of a pixel's own sample, (4, even or odd row, even or odd column), and variance
    that all planes have in common beside it.

    For :func:`processing.optics.stokes.stokes_planes`: interpolated samples are means of several and so better.
    """
    if method not in METHODS:
        raise DataError(f"no demosaicing is called {method!r}", f"take one of {', '.join(METHODS)}")
    own, beside, over, across, common = _SHARES[method]
    shares = np.empty((len(ANGLES_DEG), 2, 2))
    for share, angle in zip(shares, ANGLES_DEG, strict=True):
        i, k = mosaic.place(angle)
        share[i, k], share[i, 1 - k], share[1 - i, k], share[1 - i, 1 - k] = own, beside, over, across
    return shares, common


@numba.njit(cache=True, nogil=True)
def _kernel(image: NDArray[np.float32], places: NDArray[np.int64], planes: NDArray[np.float32]) -> None:
    rows, columns = image.shape
    for plane in range(4):
        first_row, first_column = places[plane, 0], places[plane, 1]
        for row in range(rows):
            # Rows above and below that have this angle; beyond the border the other one stands for both.
            up, down = row, row
            if row % 2 != first_row:
                up, down = row - 1, row + 1
                if up < 0:
                    up = down
                if down >= rows:
                    down = up
            for column in range(columns):
                left, right = column, column
                if column % 2 != first_column:
                    left, right = column - 1, column + 1
                    if left < 0:
                        left = right
                    if right >= columns:
                        right = left
                total = image[up, left] + image[up, right]
                total += image[down, left] + image[down, right]
                planes[plane, row, column] = total * np.float32(0.25)
