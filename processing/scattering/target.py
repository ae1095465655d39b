"""Triangles as the rays of a radar meet them: geometry, planes and what each is made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.raytrace.materials import Lambert
from processing.raytrace.sources import Sun
from processing.raytrace.triangles import Triangles
from processing.raytrace.world import World, world
from processing.scattering import surfaces as materials
from processing.scattering.surfaces import RadarSurface

Floats = NDArray[np.float64]

FLAT = 1e-9
"""Planes nearer than this part of the scene's size, and normals nearer than this, are one."""


class Target(NamedTuple):
    """Arrays for the kernels."""

    world: World
    """Geometry, as the ray tracer has it."""
    plane: NDArray[np.int64]
    """(T,) number of the plane (of one material) that a triangle lies in."""
    surfaces: Floats
    """(materials, :data:`processing.scattering.surfaces.COLUMNS`)."""
    wavenumber: float
    """2 pi / wavelength, 1/m."""
    velocity: Floats
    """(T, 3) m/s of each triangle; (0, 3) where nothing moves."""

    @property
    def corners_m(self) -> Floats:
        """(T, 3, 3)."""
        return self.world.corners.reshape(-1, 3, 3)


def radar_target(
    mesh: Triangles, surfaces: Sequence[RadarSurface], wavelength_m: float, velocity_m_s: Floats | None = None
) -> Target:
    """Prepare a mesh.

    Args:
        mesh: triangles; their materials are indices of ``surfaces``.
        surfaces: what they are made of.
        wavelength_m: wavelength at the centre frequency, m: roughness is told by it.
        velocity_m_s: (T, 3) of each triangle; nothing moves where it is left out.

    Raises:
        DataError: a triangle of a material that is not there, or a wavelength that is not positive.
    """
    if not (np.isfinite(wavelength_m) and wavelength_m > 0):
        raise DataError(f"a wavelength is {wavelength_m} m", "give a positive one")
    # The tracer wants light and optical surfaces, which radar does not ask for.
    seen = world(mesh, [Lambert(0.0)] * len(surfaces), [Sun((0.0, 0.0, 1.0))])
    velocity = np.zeros((0, 3)) if velocity_m_s is None else np.ascontiguousarray(velocity_m_s, dtype=np.float64)
    planes = _planes(mesh, velocity if len(velocity) else np.zeros((len(mesh), 3)))
    return Target(seen, planes, materials.table(surfaces, wavelength_m), 2 * np.pi / wavelength_m, velocity)


def _planes(mesh: Triangles, velocity: Floats) -> NDArray[np.int64]:
    """Numbers of the planes; triangles without area have one of their own each and are never met.

    What moves otherwise is another plane."""
    normals = mesh.normals
    # Either side is the same plane: the first component that is not zero is positive.
    lead = np.take_along_axis(normals, np.argmax(np.abs(normals) > FLAT, axis=1)[:, None], axis=1)
    normals = normals * np.where(lead < 0, -1.0, 1.0)
    centre, radius = mesh.sphere
    height = np.sum((mesh.corners_m.mean(axis=1) - centre) * normals, axis=1) / max(radius, 1e-300)
    keys = np.column_stack([np.round(normals / FLAT), np.round(height / FLAT), mesh.material, velocity])
    flat = ~np.isfinite(keys).all(axis=1)
    keys[flat] = np.column_stack([np.full((flat.sum(), 7), np.inf), np.flatnonzero(flat)])
    return np.asarray(np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1), dtype=np.int64)
