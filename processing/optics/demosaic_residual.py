"""Demosaicing by residual interpolation, guided by the total intensity.

After M. Morimatsu, Y. Monno, M. Tanaka and M. Okutomi, "Monochrome and color polarization demosaicking using edge-aware
residual interpolation", ICIP 2020. The mean of all four angles is known well at every pixel, without polarization: it
guides. In a small window each angle's image is a straight line of the guide; what that leaves (the residual at the
pixels that have the angle) is smooth, is interpolated bilinearly and added.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from processing.optics.demosaic_newton import shifted
from processing.optics.mosaic import ANGLES_DEG, Mosaic, check_mosaic_image, spread

Floats = NDArray[np.float64]

WINDOW_PX = 7
"""Side of the window in which an angle's image is fitted by the guide."""

_STIFFNESS = 1e-3
"""Variance of the guide, relative to its mean square, below which the fit turns to a constant."""
_TINY = 1e-12


def demosaic_residual(image: NDArray[np.generic], mosaic: Mosaic) -> Floats:
    """Full-size image behind each angle.

    Args:
        image: (rows, columns) any real type; both even and at least 8. Beyond the border it is mirrored.
        mosaic: its polarizers, in any phase.

    Returns:
        (4, rows, columns) float64 in the order of :data:`processing.optics.mosaic.ANGLES_DEG`. Pixels keep their own
        value; NaN makes NaN of what is interpolated from it.

    Raises:
        DataError: not an image of even size, or a smaller one.
    """
    check_mosaic_image(image, least=8)
    own = image.astype(np.float64)
    lost = ~np.isfinite(own)
    filled = np.where(lost, 0.0, own)
    guide = guide_image(filled, mosaic)
    planes = np.empty((len(ANGLES_DEG), *own.shape))
    for plane, angle in zip(planes, ANGLES_DEG, strict=True):
        i, k = mosaic.place(angle)
        has = np.zeros(own.shape)
        has[i::2, k::2] = 1.0
        fitted = _fitted(filled, guide, has * ~lost)
        residual = has * (filled - fitted)
        plane[:] = fitted + _bilinear(residual) / _bilinear(has)
    planes[:, spread(lost)] = np.nan
    return planes


def guide_image(own: Floats, mosaic: Mosaic) -> Floats:
    """Mean of all four angles at each pixel, (rows, columns): of the windows of 2 x 3 pixels above, below, left and
    right (each angle counts a quarter in each), mixed by how little the light changes there."""
    total, weights = np.zeros_like(own), np.zeros_like(own)
    for transposed in (False, True):
        image = own.T if transposed else own
        partner = _orthogonal(mosaic, transposed)
        beside = 0.5 * (shifted(image, 0, -1) + shifted(image, 0, 1))
        for up in (-1, 1):
            above, across = shifted(image, up, 0), shifted(beside, up, 0)
            window = 0.25 * (image + beside + above + across)
            # Two sums over orthogonal angles: both are S0 where the light is uniform, whatever its polarization.
            pairs = {
                "beside": (image + beside) - (above + across),
                "above": (image + above) - (beside + across),
                "across": (image + across) - (beside + above),
            }
            change = shifted(uniform_filter(np.abs(pairs[partner]), (3, 5), mode="mirror"), up, 0)
            weight = 1 / (change + _TINY)
            total += (weight * window).T if transposed else weight * window
            weights += weight.T if transposed else weight
    return total / weights


def _orthogonal(mosaic: Mosaic, transposed: bool) -> str:
    """Where a pixel's orthogonal angle is: beside it in the row, above it in the column, or across."""
    (row, column), (other_row, other_column) = mosaic.place(0), mosaic.place(90)
    if row != other_row and column != other_column:
        return "across"
    return "beside" if (row == other_row) != transposed else "above"


def _fitted(values: Floats, guide: Floats, has: Floats) -> Floats:
    """At each pixel the mean over the windows that hold it of the straight lines fitted there: a guided filter."""
    mean = _over_window(has)
    safe = np.maximum(mean, _TINY)
    g, v = _over_window(has * guide) / safe, _over_window(has * values) / safe
    variance = _over_window(has * guide * guide) / safe - g * g
    covariance = _over_window(has * guide * values) / safe - g * v
    slope = covariance / (np.maximum(variance, 0.0) + _STIFFNESS * (g * g + _TINY))
    constant = v - slope * g
    return _over_window(slope) * guide + _over_window(constant)


def _over_window(values: Floats) -> Floats:
    found: Floats = uniform_filter(values, WINDOW_PX, mode="mirror")
    return found


def _bilinear(values: Floats) -> Floats:
    rows = values + 0.5 * (shifted(values, -1, 0) + shifted(values, 1, 0))
    return rows + 0.5 * (shifted(rows, 0, -1) + shifted(rows, 0, 1))
