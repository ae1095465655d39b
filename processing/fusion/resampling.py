"""Pictures between their pixels: by straight lines or by splines, and what either does to each spatial frequency.

A spline of degree n takes the component ``exp(2 pi j nu x)`` of a scene to itself times
``m(nu) = sinc(nu)^(n+1) / B_n(nu)``, the mean over all places between pixels, beside ghosts; all of it has the power
``q(nu) = B_(2n+1)(nu) / B_n(nu)^2``, where ``B_n(nu) = sum_k beta_n(k) cos(2 pi k nu)`` are the B-spline's samples
(Unser, Aldroubi and Eden, IEEE Trans. Signal Processing 41, 821, 1993; Blu and Unser, ibid. 47, 2783, 1999). Degree 1
is interpolation by straight lines.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline
from scipy.ndimage import distance_transform_edt, map_coordinates

from processing.errors import DataError
from processing.fusion.registration import sample_bilinear

Floats = NDArray[np.float64]

DEGREES = (1, 3, 5)
"""Of splines that pictures are interpolated by."""


def sample_spline(image: ArrayLike, u: ArrayLike, v: ArrayLike, degree: int = 3) -> Floats:
    """Values of a picture between its pixels, by a spline of that degree.

    Args:
        image: (rows, columns) with NaN where it is undefined.
        u, v: column and row, any one shape; whole numbers are pixel centres. The outermost half pixel takes the
            border's value, beyond the border the picture is mirrored.
        degree: of :data:`DEGREES`; 1 is :func:`processing.fusion.registration.sample_bilinear`.

    Returns:
        Shape of ``u``; NaN outside the picture and wherever one of the ``degree + 1`` pixels around the place, in rows
        and columns, is NaN.

    Raises:
        DataError: no picture, or another degree.
    """
    if degree not in DEGREES:
        raise DataError(f"a spline of degree {degree}", f"take one of {', '.join(map(str, DEGREES))}")
    if degree == 1:
        return sample_bilinear(image, u, v)
    values = np.asarray(image, dtype=np.float64)
    if values.ndim != 2 or not values.size:
        raise DataError(f"the picture has shape {values.shape}", "give rows and columns")
    rows, columns = values.shape
    column, row = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
    inside = (column >= -0.5) & (column <= columns - 0.5) & (row >= -0.5) & (row <= rows - 0.5)
    column = np.clip(np.where(inside, column, 0.0), 0, columns - 1)
    row = np.clip(np.where(inside, row, 0.0), 0, rows - 1)
    lost = ~np.isfinite(values)
    if lost.any():
        if lost.all():
            return np.full(column.shape, np.nan)
        inside = inside & ~_near(lost, column, row, degree)
        # A spline reaches far, if weakly: what it meets where nothing is known is the nearest known value.
        nearest = distance_transform_edt(lost, return_distances=False, return_indices=True)
        values = values[tuple(nearest)]
    found = map_coordinates(values, [row.ravel(), column.ravel()], order=degree, mode="mirror").reshape(column.shape)
    return np.asarray(np.where(inside, found, np.nan))


def _near(lost: NDArray[np.bool_], column: Floats, row: Floats, degree: int) -> NDArray[np.bool_]:
    """Whether one of the pixels around these places is lost."""
    rows, columns = lost.shape
    top, left = np.floor(row).astype(np.intp), np.floor(column).astype(np.intp)
    found = np.zeros(row.shape, dtype=bool)
    reach = degree // 2
    for down in range(-reach, reach + 2):
        for right in range(-reach, reach + 2):
            found |= lost[np.clip(top + down, 0, rows - 1), np.clip(left + right, 0, columns - 1)]
    return found


@functools.cache
def _spline_samples(degree: int) -> tuple[float, ...]:
    """beta_n(0), beta_n(1), ... as far as they are not zero; ``degree`` odd."""
    spline = BSpline.basis_element(np.arange(degree + 2) - (degree + 1) / 2)
    return tuple(float(spline(k)) for k in range((degree + 1) // 2))


def spline_spectrum(degree: int, frequency: ArrayLike) -> Floats:
    """``B_n``: the Fourier series of a centred B-spline's samples, for odd ``degree``; frequencies in 1 / pixel."""
    nu = np.asarray(frequency, dtype=np.float64)
    first, *rest = _spline_samples(degree)
    total = np.full(nu.shape, first)
    for k, sample in enumerate(rest, start=1):
        total += 2 * sample * np.cos(2 * np.pi * k * nu)
    return total


def passed(degree: int, frequency: ArrayLike) -> Floats:
    """``m``: what of a component of the scene stays itself; also beyond half the sampling frequency."""
    nu = np.asarray(frequency, dtype=np.float64)
    return np.asarray(np.sinc(nu) ** (degree + 1) / spline_spectrum(degree, nu))


def power_between(degree: int, frequency: ArrayLike) -> Floats:
    """``q``: power that a component of power 1 has between the pixels, its ghosts included."""
    return np.asarray(spline_spectrum(2 * degree + 1, frequency) / spline_spectrum(degree, frequency) ** 2)


def passed_at(degree: int, frequency: ArrayLike, place: float) -> NDArray[np.complex128]:
    """What a spline makes of the samples of ``exp(2 pi i nu k)`` at ``k + place``, over the sample at k.

    ``sum_j beta_n(place - j) exp(2 pi i nu j) / B_n(nu)``; without error it would be ``exp(2 pi i nu place)``.

    Args:
        degree: of :data:`DEGREES`.
        frequency: nu, 1 / pixel.
        place: pixels.
    """
    nu = np.asarray(frequency, dtype=np.float64)
    spline = BSpline.basis_element(np.arange(degree + 2) - (degree + 1) / 2, extrapolate=False)
    first = math.floor(place) - degree // 2
    total = np.zeros(nu.shape, dtype=np.complex128)
    for j in range(first, first + degree + 1):
        total += np.nan_to_num(spline(place - j)) * np.exp(2j * np.pi * nu * j)
    return np.asarray(total / spline_spectrum(degree, nu))


def noise_between(degree: int) -> float:
    """Variance of white noise between the pixels over its variance in them; by straight lines 4/9."""
    middle = (np.arange(4096) + 0.5) / 4096
    return float(np.mean(power_between(degree, middle))) ** 2
