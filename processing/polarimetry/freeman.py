"""Freeman and Durden's three components: surface, double bounce and volume.

Source: Freeman and Durden 1998, IEEE TGRS 36(3) 963; limits as in PolSARpro's program. The volume is a cloud of thin
dipoles in all directions; a target that is turned about the line of sight counts as volume by its cross-polarization
(:mod:`processing.polarimetry.yamaguchi` turns it back first).

Limits, of the kernel and the reference alike: where the volume would be more than a co-polarized power, all is volume;
a correlation of HH and VV that no two waves can have after the volume is taken away is brought down to the largest that
they can; so the three powers are never negative and their sum is the span. A pixel without power has three zeros; one
with an undefined element or a negative span has three NaN.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from processing.polarimetry.matrices import Planes, as_planes
from processing.polarimetry.pauli import Floats

COMPONENTS = ("surface", "double_bounce", "volume")
"""What :func:`freeman_durden` returns, in order."""


def freeman_durden(planes: Planes) -> Planes:
    """Powers of :data:`COMPONENTS`, (3, rows, columns), m^2, of coherency planes (9, rows, columns); compiled.

    Float32 planes give float32 powers (computed in float64 within), all others float64.
    """
    given = as_planes(planes)
    made = np.empty((3, *given.shape[1:]), dtype=given.dtype)
    _image(given, made)
    return made


def freeman_durden_reference(planes: Planes) -> Floats:
    """The definition of :func:`freeman_durden` in NumPy and float64."""
    t = as_planes(planes).astype(np.float64)
    span = t[0] + t[5] + t[8]
    fv = 1.5 * t[8]
    hh, vv = (t[0] + t[5]) / 2 + t[1] - fv, (t[0] + t[5]) / 2 - t[1] - fv
    cross = (t[0] - t[5]) / 2 - fv / 3 - 1j * t[2]
    mixed = (hh > 0) & (vv > 0)
    limit = np.sqrt(np.where(mixed, hh * vv, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = cross * np.where(np.abs(cross) > limit, limit / np.abs(cross), 1.0)
        # Of the two mechanisms the one that does not dominate is taken with a known ratio of VV to HH: +1 or -1.
        other = (hh * vv - np.abs(cross) ** 2) / (hh + vv + 2 * np.abs(cross.real))
    lesser = 2 * np.maximum(other, 0.0)
    greater = np.maximum(hh + vv - lesser, 0.0)
    odd = cross.real >= 0
    powers = np.stack([np.where(odd, greater, lesser), np.where(odd, lesser, greater), 8 * fv / 3])
    powers = np.where(mixed, powers, np.stack([np.zeros_like(span), np.zeros_like(span), span]))
    return np.where(np.isfinite(t).all(axis=0) & (span >= 0), powers, np.nan)


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def _image(t: NDArray[Any], made: NDArray[Any]) -> None:
    for row in prange(t.shape[1]):
        # prange counts unsigned; without the cast the row would be compiled for both kinds of numbers.
        _row(t, made, np.int64(row))


@njit(cache=True, nogil=True, error_model="numpy")
def _row(t: NDArray[Any], made: NDArray[Any], row: Any) -> None:
    for column in range(t.shape[2]):
        sound = 0.0
        for plane in range(9):
            sound += t[plane, row, column] * 0.0
        surface, double, volume = three_components(
            np.float64(t[0, row, column]), np.float64(t[5, row, column]), np.float64(t[8, row, column]),
            np.float64(t[1, row, column]), np.float64(t[2, row, column]),
        )  # fmt: skip
        # Zero, or NaN where any element is not finite.
        made[0, row, column] = surface + sound
        made[1, row, column] = double + sound
        made[2, row, column] = volume + sound


@njit(cache=True, nogil=True, error_model="numpy")
def three_components(
    t11: float, t22: float, t33: float, t12_real: float, t12_imag: float
) -> tuple[float, float, float]:
    """Surface, double bounce and volume power of one pixel."""
    span = t11 + t22 + t33
    if span < 0.0:
        return np.nan, np.nan, np.nan
    fv = 1.5 * t33
    hh, vv = 0.5 * (t11 + t22) + t12_real - fv, 0.5 * (t11 + t22) - t12_real - fv
    if not (hh > 0.0 and vv > 0.0):
        return 0.0, 0.0, span
    real, imag = 0.5 * (t11 - t22) - fv / 3.0, -t12_imag
    size, limit = real * real + imag * imag, hh * vv
    if size > limit:
        real *= np.sqrt(limit / size)
        size = limit
    lesser = 2.0 * (limit - size) / (hh + vv + 2.0 * abs(real))
    greater = max(hh + vv - lesser, 0.0)
    if real >= 0.0:
        return greater, lesser, 8.0 * fv / 3.0
    return lesser, greater, 8.0 * fv / 3.0
