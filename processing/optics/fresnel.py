"""Reflection at a smooth surface: Fresnel's amplitudes for any complex index, Brewster's angle, and one thin film.

Amplitudes belong to fields that vary as ``exp(i (k z - w t))``, so an absorbing medium has ``n + i k`` with k > 0. The
p axes of both rays are ``propagation x s`` (or both its negative): at normal incidence ``a_pp = -a_ss`` (thesis 4.15).
The ``*_kernel`` functions are the same in scalars, for Numba.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

TINY = 1e-150
"""A cosine whose square cannot be told from nothing counts as grazing."""
NO_FILM = 1e-290
"""A film that is thinner, in wavelengths, is none."""


def amplitudes(index: ArrayLike, cosine: ArrayLike) -> tuple[Complexes, Complexes]:
    """Amplitudes ``a_ss`` and ``a_pp`` (...) of reflection from vacuum off a medium (thesis 4.15).

    Args:
        index: complex refractive index n + i k.
        cosine: of the angle of incidence, 0 to 1.

    Raises:
        DataError: a cosine outside 0 to 1, or an index with a negative part.
    """
    n, c = _checked(index, cosine)
    root = _inside(n, c)
    with np.errstate(divide="ignore", invalid="ignore"):
        ss = (c - root) / (c + root)
        pp = (n * n * c - root) / (n * n * c + root)
    # An index of 1 at grazing incidence leaves 0 / 0: nothing reflects.
    nothing = n == 1
    return np.where(nothing, 0.0, ss), np.where(nothing, 0.0, pp)


def film_amplitudes(
    index: ArrayLike, cosine: ArrayLike, film_index: ArrayLike, film_thickness: ArrayLike
) -> tuple[Complexes, Complexes]:
    """Amplitudes ``a_ss`` and ``a_pp`` (...) off a medium that carries one film (Airy's sum of all passes).

    Args:
        index: complex index of the medium.
        cosine: of the angle of incidence in vacuum, 0 to 1.
        film_index: complex index of the film.
        film_thickness: thickness in vacuum wavelengths.

    Raises:
        DataError: as :func:`amplitudes`; a thickness that is negative.
    """
    n, c = _checked(index, cosine)
    film, _ = _checked(film_index, cosine)
    thickness = np.asarray(film_thickness, dtype=np.float64)
    if not np.all(thickness >= 0):
        raise DataError(f"a film is {thickness.min()} wavelengths thick", "give zero or more")
    in_film, in_medium = _inside(film, c), _inside(n, c)
    with np.errstate(divide="ignore", invalid="ignore"):
        top = ((c - in_film) / (c + in_film), (film * film * c - in_film) / (film * film * c + in_film))
        bottom = (
            (in_film - in_medium) / (in_film + in_medium),
            (n * n * in_film - film * film * in_medium) / (n * n * in_film + film * film * in_medium),
        )
    turn = np.exp(4j * np.pi * thickness * in_film)
    ss, pp = ((np.nan_to_num(a) + np.nan_to_num(b) * turn) for a, b in zip(top, bottom, strict=True))
    for_s, for_p = (1 + np.nan_to_num(a) * np.nan_to_num(b) * turn for a, b in zip(top, bottom, strict=True))
    bare = amplitudes(n, c)
    # Airy's sum is 0 / 0 where a film without thickness lies on nothing at grazing incidence, and next to it denormal
    # numbers stand over denormal ones.
    none = thickness < NO_FILM
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found_s, found_p = (np.where(none, a, b) for a, b in zip(bare, (ss / for_s, pp / for_p), strict=True))
    return found_s, found_p


def _inside(index: Complexes, cosine: Floats) -> Complexes:
    """``sqrt(n^2 - sin^2)``, written so that it is the cosine itself for an index of 1, however small that is."""
    inside: Complexes = np.sqrt((index * index - 1) + cosine * cosine)
    return inside


def reflectances(index: ArrayLike, cosine: ArrayLike) -> tuple[Floats, Floats]:
    """Reflectances ``R_s`` and ``R_p`` (...) of a bare surface; arguments as :func:`amplitudes`."""
    ss, pp = amplitudes(index, cosine)
    return np.abs(ss) ** 2, np.abs(pp) ** 2


def brewster(index: float) -> float:
    """Angle of incidence at which a dielectric does not reflect p, radians: ``atan n``.

    Raises:
        DataError: an index that is not positive.
    """
    if not (math.isfinite(index) and index > 0):
        raise DataError(f"the index of a dielectric is {index}", "give a positive number")
    return math.atan(index)


def reflection_mueller(a_ss: ArrayLike, a_pp: ArrayLike) -> Floats:
    """Mueller matrices (..., 4, 4) of ``diag(a_ss, a_pp)`` in the frame of s (thesis 2.32)."""
    ss, pp = np.broadcast_arrays(np.asarray(a_ss, dtype=np.complex128), np.asarray(a_pp, dtype=np.complex128))
    rs, rp, both = np.abs(ss) ** 2, np.abs(pp) ** 2, ss * pp.conj()
    matrix = np.zeros((*ss.shape, 4, 4))
    matrix[..., 0, 0] = matrix[..., 1, 1] = (rs + rp) / 2
    matrix[..., 0, 1] = matrix[..., 1, 0] = (rs - rp) / 2
    matrix[..., 2, 2] = matrix[..., 3, 3] = both.real
    matrix[..., 2, 3] = both.imag
    matrix[..., 3, 2] = -both.imag
    return matrix


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _root(re: float, im: float) -> tuple[float, float]:
    """Principal square root of a number whose imaginary part is not negative."""
    size = math.hypot(re, im)
    real = math.sqrt(max(0.5 * (size + re), 0.0))
    imaginary = math.sqrt(max(0.5 * (size - re), 0.0))
    # The smaller part from the larger: the difference above loses it.
    if re > 0.0 and real > 0.0:
        imaginary = 0.5 * im / real
    elif re < 0.0 and imaginary > 0.0:
        real = 0.5 * im / imaginary
    return real, imaginary


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _ratio(x: complex, y: complex) -> complex:
    """(x - y) / (x + y), 0 where both are."""
    re, im = x.real + y.real, x.imag + y.imag
    size = re * re + im * im
    if size == 0.0:
        return 0j
    up_re, up_im = x.real - y.real, x.imag - y.imag
    return complex((up_re * re + up_im * im) / size, (up_im * re - up_re * im) / size)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def amplitudes_kernel(n: complex, cosine: float, film: complex, thickness: float) -> tuple[complex, complex]:
    """Both amplitudes as :func:`film_amplitudes` (as :func:`amplitudes` for a thickness of 0), in scalars."""
    if cosine < TINY:
        cosine = 0.0
    cosine2 = cosine * cosine
    n2 = complex(n.real * n.real - n.imag * n.imag, 2.0 * n.real * n.imag)
    re, im = _root((n2.real - 1.0) + cosine2, n2.imag)
    medium = complex(re, im)
    outside = complex(cosine, 0.0)
    if thickness < NO_FILM:
        return _ratio(outside, medium), _ratio(n2 * outside, medium)
    f2 = complex(film.real * film.real - film.imag * film.imag, 2.0 * film.real * film.imag)
    re, im = _root((f2.real - 1.0) + cosine2, f2.imag)
    inside = complex(re, im)
    angle = 4.0 * math.pi * thickness
    size = math.exp(-angle * im)
    turn = complex(size * math.cos(angle * re), size * math.sin(angle * re))
    top_s, top_p = _ratio(outside, inside), _ratio(f2 * outside, inside)
    bottom_s, bottom_p = _ratio(inside, medium) * turn, _ratio(n2 * inside, f2 * medium) * turn
    return (top_s + bottom_s) / (1.0 + top_s * bottom_s), (top_p + bottom_p) / (1.0 + top_p * bottom_p)


def _checked(index: ArrayLike, cosine: ArrayLike) -> tuple[Complexes, Floats]:
    n, c = np.asarray(index, dtype=np.complex128), np.asarray(cosine, dtype=np.float64)
    if not np.all((c >= 0) & (c <= 1)):
        raise DataError("a cosine of incidence lies outside 0 to 1", "give angles from 0 to 90 degrees")
    if not (np.all(np.isfinite(n)) and np.all(n.real >= 0) and np.all(n.imag >= 0) and np.all(n != 0)):
        raise DataError("a refractive index has a negative part or is zero", "give n + i k with n and k not negative")
    return n, np.where(c < TINY, 0.0, c)
