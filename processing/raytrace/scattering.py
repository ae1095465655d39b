"""How a surface scatters polarized light: the definition, in plain float64 NumPy.

Light comes along ``-w_in`` and leaves along ``w_out``; both point away from the surface, on the side of ``normal``. The
reflectance is written in the frame that both rays share, s = normal of the plane that holds them: there it is

    diffuse * diag(1, 0, 0, 0) + [[a, b, 0, 0], [b, a, 0, 0], [0, 0, c, d], [0, 0, -d, c]]

because the facet that mirrors one ray into the other stands upright in that plane. :func:`shared_axis` gives s; turning
into other frames is :func:`turn`. Numba's versions are in :mod:`processing.raytrace.scattering_kernel`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from processing.optics.fresnel import film_amplitudes
from processing.raytrace.materials import (
    CHOICE,
    DIFFUSE,
    FILM_K,
    FILM_N,
    FILM_THICKNESS,
    LOBE,
    ROUGHNESS,
    SAMPLED,
    SHADOWING,
    SPECULAR,
    K,
    Lobe,
    N,
    Shadowing,
)

Floats = NDArray[np.float64]

GRAZING = 1e-12
"""Rays whose cosine is no larger run along the surface and are not scattered by it."""


class Parts(NamedTuple):
    """Parts of a reflectance in the shared frame, each (...)."""

    diffuse: Floats
    a: Floats
    b: Floats
    c: Floats
    d: Floats

    def matrix(self) -> Floats:
        """The Mueller matrices (..., 4, 4)."""
        m = np.zeros((*self.a.shape, 4, 4))
        m[..., 0, 0] = self.diffuse + self.a
        m[..., 1, 1] = self.a
        m[..., 0, 1] = m[..., 1, 0] = self.b
        m[..., 2, 2] = m[..., 3, 3] = self.c
        m[..., 2, 3], m[..., 3, 2] = self.d, -self.d
        return m


def shared_axis(w_in: Floats, w_out: Floats) -> Floats:
    """Unit vectors s (..., 3) across the plane of both rays; any one across them where they coincide."""
    s = np.cross(w_out, w_in)
    size = np.linalg.norm(s, axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(size > 1e-10, s / size, any_axis(w_out))


def any_axis(direction: Floats) -> Floats:
    """A unit vector (..., 3) across each direction (Duff et al. 2017, JCGT 6(1))."""
    x, y, z = np.moveaxis(direction, -1, 0)
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    return np.stack([1.0 + sign * x * x * a, sign * x * y * a, -sign * x], axis=-1)


def turn(direction: Floats, axis_from: Floats, axis_to: Floats) -> tuple[Floats, Floats]:
    """Cosine and sine (...) of twice the angle from one Stokes axis to another about the direction of propagation."""
    cosine = np.sum(axis_from * axis_to, axis=-1)
    sine = np.sum(np.cross(direction, axis_from) * axis_to, axis=-1)
    size = cosine * cosine + sine * sine
    return (cosine * cosine - sine * sine) / size, 2 * cosine * sine / size


def turned_stokes(stokes: Floats, cosine: Floats, sine: Floats) -> Floats:
    """Stokes vectors (..., 4) described in axes turned as :func:`turn` tells."""
    return np.stack(
        [
            stokes[..., 0],
            cosine * stokes[..., 1] + sine * stokes[..., 2],
            cosine * stokes[..., 2] - sine * stokes[..., 1],
            stokes[..., 3],
        ],
        axis=-1,
    )


def evaluate(rows: Floats, normal: Floats, w_in: Floats, w_out: Floats) -> tuple[Parts, Floats]:
    """Reflectance (1/sr) and the density (1/sr) with which :func:`sample` draws ``w_in``; smooth lobes are left out.

    Args:
        rows: (..., 12) of the materials' table.
        normal: (..., 3) unit normals on the side of ``w_out``.
        w_in: (..., 3) unit vectors towards where light comes from.
        w_out: (..., 3) unit vectors towards where it goes.
    """
    cos_in, cos_out = np.sum(normal * w_in, axis=-1), np.sum(normal * w_out, axis=-1)
    lit = (cos_in > GRAZING) & (cos_out > GRAZING)
    cos_in, cos_out = np.where(lit, cos_in, 1.0), np.where(lit, cos_out, 1.0)
    w_in, w_out = np.where(lit[..., None], w_in, normal), np.where(lit[..., None], w_out, normal)
    lobe = rows[..., LOBE]
    diffuse = rows[..., DIFFUSE] / math.pi
    summed = w_in + w_out
    length = np.linalg.norm(summed, axis=-1)
    cos_half = np.minimum(np.sum(normal * summed, axis=-1) / length, 1.0)
    cos_facet = np.minimum(length / 2, 1.0)  # of the angle between each ray and the half vector
    tan2 = np.maximum(1 - cos_half * cos_half, 0.0) / (cos_half * cos_half)

    ward = np.isin(lobe, (Lobe.WARD_HALF_VECTOR, Lobe.WARD_THESIS, Lobe.WARD_BOUNDED))
    alpha = np.where(ward, rows[..., ROUGHNESS], 1.0)
    off = 2 * cos_in * cos_out - np.sum(w_in * w_out, axis=-1)  # cosine from the mirror direction of w_in to w_out
    with np.errstate(divide="ignore", over="ignore"):
        off_tan2 = np.where(off > 0, (1 - off * off) / (off * off), np.inf)
    exponent = np.where(lobe == Lobe.WARD_THESIS, np.maximum(off_tan2, 0.0), tan2)
    peak = np.exp(-exponent / alpha**2) * rows[..., SPECULAR] / (math.pi * alpha**2)
    plain = peak / (4 * np.sqrt(cos_in * cos_out))
    # |h|^2 / (h.n)^4 of the unnormalized half vector.
    bounded = peak / (length**2 * cos_half**4)
    diffuse = diffuse + np.where(ward, np.where(lobe == Lobe.WARD_BOUNDED, bounded, plain), 0.0)

    facets = lobe == Lobe.MICROFACETS
    sd = np.where(facets, rows[..., ROUGHNESS], 1.0)
    slopes = np.exp(-tan2 / (2 * sd * sd)) / (2 * math.pi * sd * sd * cos_half**4)
    shadow = shadowing(rows[..., SHADOWING], sd, cos_in) * shadowing(rows[..., SHADOWING], sd, cos_out)
    strength = np.where(facets, rows[..., SPECULAR] * slopes * shadow / (4 * cos_in * cos_out), 0.0)
    parts = fresnel_parts(rows, cos_facet)

    has_lobe = (lobe != Lobe.NONE) & (lobe != Lobe.SMOOTH)
    alpha = np.where(has_lobe, rows[..., SAMPLED], 1.0)
    drawn = np.exp(-tan2 / alpha**2) / (math.pi * alpha**2 * cos_half**3) / (4 * cos_facet)
    density = (1 - rows[..., CHOICE]) * cos_in / math.pi + np.where(has_lobe, rows[..., CHOICE] * drawn, 0.0)
    keep = lit.astype(np.float64)
    return Parts(keep * diffuse, *(keep * strength * part for part in parts)), keep * density


def fresnel_parts(rows: Floats, cosine: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """a, b, c and d (...) of the facets' own reflection at a cosine of incidence."""
    usable = rows[..., N] + rows[..., K] > 0
    index = np.where(usable, rows[..., N] + 1j * rows[..., K], 1.0)
    film = rows[..., FILM_N] + 1j * rows[..., FILM_K]
    ss, pp = film_amplitudes(index, cosine, film, rows[..., FILM_THICKNESS])
    rs, rp, both = np.abs(ss) ** 2, np.abs(pp) ** 2, ss * pp.conj()
    return (rs + rp) / 2, (rs - rp) / 2, both.real, both.imag


def shadowing(kind: Floats, slope_sd: Floats, cosine: Floats) -> Floats:
    """Share (...) of the facets that face a direction which that direction sees, for Gaussian slopes.

    Exact: Smith 1967, IEEE Trans. AP 15, 668; fit: Walter et al. 2007, EGSR, with a = cot(angle) / (sqrt 2 slope_sd).
    """
    sine = np.sqrt(np.maximum(1 - cosine * cosine, 0.0))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        a = np.where(sine > 0, cosine / (math.sqrt(2) * slope_sd * sine), np.inf)
        hidden = np.where(np.isinf(a), 0.0, np.exp(-a * a) / (2 * a * math.sqrt(math.pi)) - erfc(a) / 2)
        exact = 1 / (1 + hidden)
        fit = np.where(a >= 1.6, 1.0, (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a))
    return np.where(kind == Shadowing.SMITH, exact, np.where(kind == Shadowing.SMITH_RATIONAL, fit, 1.0))


def sample(
    rows: Floats, normal: Floats, w_out: Floats, choice: Floats, u: Floats, v: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Draw where light comes from, given where it goes.

    Args:
        rows: (..., 12) of the materials' table.
        normal, w_out: as in :func:`evaluate`.
        choice, u, v: (...) random numbers in [0, 1).

    Returns:
        Unit vectors ``w_in`` (..., 3), possibly below the surface (then no light comes), and whether the smooth lobe
        was taken, which has no density: its reflectance times cosine over probability is
        ``specular * fresnel_parts(cosine) / choice``.
    """
    lobe = rows[..., LOBE]
    specular = choice < rows[..., CHOICE]
    along, across = any_axis(normal), np.cross(normal, any_axis(normal))
    angle = 2 * math.pi * v
    tan2 = -np.log1p(-u) * rows[..., SAMPLED] ** 2
    cosine = np.where(specular, 1 / np.sqrt(1 + tan2), np.sqrt(1 - u))
    sine = np.sqrt(np.maximum(1 - cosine * cosine, 0.0))
    drawn = (
        (sine * np.cos(angle))[..., None] * along
        + (sine * np.sin(angle))[..., None] * across
        + cosine[..., None] * normal
    )
    smooth = specular & (lobe == Lobe.SMOOTH)
    half = np.where(smooth[..., None], normal, drawn)
    mirrored = 2 * np.sum(half * w_out, axis=-1)[..., None] * half - w_out
    return np.where(specular[..., None], mirrored, drawn), smooth
