"""Yamaguchi's four components: surface, double bounce, volume and helix.

Sources: Yamaguchi et al. 2005, IEEE TGRS 43(8) 1699 (``"original"``); Yamaguchi et al. 2011, TGRS 49(6) 2251
(``"rotated"``: T is first turned about the line of sight until its cross-polarized power is least); Sato et al. 2012,
IEEE GRSL 9(2) 166 (``"extended"``: rotated, and a volume of its own for double bounces). The cross term is T12 + T13 as
in the flow chart of 2011 and in PolSARpro, in every variant.

Two choices where programs differ from the papers: the angle is that of the *least* T33 (an arctangent of one argument
finds the greatest at half of the pixels); and where helix would leave a negative volume, helix is set to zero and the
volume is that of the paper for no helix, so that the powers still sum to the span.

Limits, of the kernel and the reference alike: no power is negative and their sum is the span. A pixel without power has
four zeros; one with an undefined element or a negative span has four NaN.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from processing.errors import DataError
from processing.polarimetry.matrices import Planes, as_planes
from processing.polarimetry.pauli import Floats

COMPONENTS = ("surface", "double_bounce", "volume", "helix")
"""What :func:`yamaguchi` returns, in order."""

Model = Literal["original", "rotated", "extended"]
MODELS: tuple[Model, ...] = ("original", "rotated", "extended")

_TWO_DB = 10**0.2
_SOME_VOLUME = 1 - 1e-6
"""A pure helix has no volume; rounding must not make it a negative one."""


def yamaguchi(planes: Planes, model: Model = "rotated") -> Planes:
    """Powers of :data:`COMPONENTS`, (4, rows, columns), m^2, of coherency planes (9, rows, columns); compiled.

    Float32 planes give float32 powers (computed in float64 within), all others float64.

    Raises:
        DataError: no such model, or planes of another shape.
    """
    given = as_planes(planes)
    made = np.empty((4, *given.shape[1:]), dtype=given.dtype)
    _image(given, _number(model), made)
    return made


def yamaguchi_reference(planes: Planes, model: Model = "rotated") -> Floats:
    """The definition of :func:`yamaguchi` in NumPy and float64. Raises as it."""
    number = _number(model)
    t = as_planes(planes).astype(np.float64)
    t = np.where(np.isfinite(t), t, np.nan)
    t11, t12, t13, t22, t23, t33 = t[0], t[1] + 1j * t[2], t[3] + 1j * t[4], t[5], t[6] + 1j * t[7], t[8]
    span = t11 + t22 + t33
    if number:
        angle = 0.5 * np.arctan2(2 * t23.real, t22 - t33)
        c, s = np.cos(angle), np.sin(angle)
        t12, t13 = t12 * c + t13 * s, t13 * c - t12 * s
        t22, t33 = (
            t22 * c**2 + 2 * t23.real * c * s + t33 * s**2, t22 * s**2 - 2 * t23.real * c * s + t33 * c**2
        )  # fmt: skip
    helix = 2 * np.abs(t23.imag)
    helix = np.where(2 * t33 < _SOME_VOLUME * helix, 0.0, np.minimum(helix, span))
    double = (
        t11 - t22 + 7 / 8 * t33 + helix / 16 <= 0 if number == 2 else np.zeros_like(span, dtype=bool)
    )  # fmt: skip
    vertical, horizontal = t11 + t22 - 2 * t12.real, t11 + t22 + 2 * t12.real
    tilt = np.where(vertical > _TWO_DB * horizontal, 1, np.where(vertical * _TWO_DB <= horizontal, -1, 0))
    tilt = np.where(double, 0, tilt)
    volume = np.where(double, 15 / 16, np.where(tilt == 0, 2.0, 15 / 8)) * np.maximum(2 * t33 - helix, 0.0)
    full = volume + helix > span
    cross = np.abs(t12 + t13 + tilt * volume / 6) ** 2
    surface = t11 - np.where(double, 0.0, volume / 2)
    bounce = span - volume - helix - surface
    odd = ~double & (2 * t11 + helix - span > 0)
    base = np.where(odd, surface, bounce)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        coupled = np.where(base > 0, cross / base, 0.0)
    shift = np.where(odd, coupled, -coupled)
    rest = np.maximum(span - volume - helix, 0.0)
    powers = np.stack([np.clip(surface + shift, 0, rest), np.zeros_like(span), volume, helix])
    powers[1] = rest - powers[0]
    powers = np.where(full, np.stack([0 * span, 0 * span, span - helix, helix]), powers)
    return np.where(np.isfinite(t).all(axis=0) & (span >= 0), powers, np.nan)


def _number(model: str) -> int:
    if model not in MODELS:
        raise DataError(f"there is no Yamaguchi model {model!r}", f"choose from {', '.join(MODELS)}")
    return MODELS.index(model)


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def _image(t: NDArray[Any], model: int, made: NDArray[Any]) -> None:
    for row in prange(t.shape[1]):
        # prange counts unsigned; without the cast the row would be compiled for both kinds of numbers.
        _row(t, model, made, np.int64(row))


@njit(cache=True, nogil=True, error_model="numpy")
def _row(t: NDArray[Any], model: int, made: NDArray[Any], row: Any) -> None:
    pixel = np.empty(9)
    for column in range(t.shape[2]):
        sound = 0.0
        for plane in range(9):
            pixel[plane] = t[plane, row, column]
            sound += pixel[plane] * 0.0
        powers = _pixel(pixel, model)
        for k in range(4):
            # Zero, or NaN where any element is not finite.
            made[k, row, column] = powers[k] + sound


@njit(cache=True, nogil=True, error_model="numpy")
def _pixel(t: NDArray[np.float64], model: int) -> tuple[float, float, float, float]:
    t11, t12, t13, t22, t33 = t[0], complex(t[1], t[2]), complex(t[3], t[4]), t[5], t[8]
    span = t11 + t22 + t33
    if span < 0.0:
        return np.nan, np.nan, np.nan, np.nan
    if model > 0:
        angle = 0.5 * math.atan2(2.0 * t[6], t22 - t33)
        c, s = math.cos(angle), math.sin(angle)
        t12, t13 = t12 * c + t13 * s, t13 * c - t12 * s
        mixed = 2.0 * t[6] * c * s
        t22, t33 = t22 * c * c + mixed + t33 * s * s, t22 * s * s - mixed + t33 * c * c
    helix = min(2.0 * abs(t[7]), span)
    if 2.0 * t33 < _SOME_VOLUME * helix:
        helix = 0.0
    double = model == 2 and t11 - t22 + 0.875 * t33 + helix / 16.0 <= 0.0
    share, tilt = 2.0, 0.0
    if double:
        share = 15.0 / 16.0
    else:
        vertical, horizontal = t11 + t22 - 2.0 * t12.real, t11 + t22 + 2.0 * t12.real
        if vertical > _TWO_DB * horizontal:
            share, tilt = 1.875, 1.0
        elif vertical * _TWO_DB <= horizontal:
            share, tilt = 1.875, -1.0
    volume = share * max(2.0 * t33 - helix, 0.0)
    if volume + helix > span:
        return 0.0, 0.0, span - helix, helix
    cross = t12 + t13 + tilt * volume / 6.0
    surface = t11 if double else t11 - 0.5 * volume
    rest = max(span - volume - helix, 0.0)
    odd = not double and 2.0 * t11 + helix - span > 0.0
    base = surface if odd else span - volume - helix - surface
    if base > 0.0:
        coupled = (cross.real * cross.real + cross.imag * cross.imag) / base
        surface = surface + coupled if odd else surface - coupled
    surface = min(max(surface, 0.0), rest)
    return surface, rest - surface, volume, helix
