"""All that rays may meet, as arrays for the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.raytrace import bvh, materials, sources
from processing.raytrace.materials import Material
from processing.raytrace.sources import Source
from processing.raytrace.triangles import Triangles

Floats = NDArray[np.float64]

MARGIN = 2.0**-45
"""Rays leave a surface from this part of the scene's largest coordinate above it: past the rounding of where they
met it, and far below what a picture shows."""


class World(NamedTuple):
    """Geometry, materials and sources as arrays (a NamedTuple, which Numba takes as it is)."""

    boxes: NDArray[np.float32]
    children: NDArray[np.int32]
    sorted_corners: Floats
    order: NDArray[np.int32]
    corners: Floats
    """(T, 9)"""
    normals: Floats
    """(T, 3)"""
    material: NDArray[np.int64]
    """(T,)"""
    materials: Floats
    sources: Floats
    margin: float
    centre: Floats
    radius: float

    @property
    def tree(self) -> bvh.Tree:
        """The tree of boxes, with its methods."""
        return bvh.Tree(self.boxes, self.children, self.sorted_corners, self.order)


def world(mesh: Triangles, surfaces: Sequence[Material], lights: Sequence[Source]) -> World:
    """Prepare a scene.

    Raises:
        DataError: a triangle of a material that is not there, no source at all, or a source that cannot be.
    """
    if mesh.material.min() < 0 or mesh.material.max() >= len(surfaces):
        raise DataError(
            f"triangles are of materials {mesh.material.min()} to {mesh.material.max()}",
            f"there are {len(surfaces)}, counted from 0",
        )
    if not lights:
        raise DataError("the scene is dark", "give at least one source")
    tree = bvh.build(mesh)
    centre, radius = mesh.sphere
    return World(
        boxes=tree.boxes,
        children=tree.children,
        sorted_corners=tree.corners,
        order=tree.order,
        corners=np.ascontiguousarray(mesh.corners_m.reshape(len(mesh), 9)),
        normals=np.ascontiguousarray(mesh.normals),
        material=mesh.material,
        materials=materials.table(surfaces),
        sources=sources.table(lights),
        margin=MARGIN * float(np.abs(mesh.vertices_m[np.unique(mesh.faces)]).max()),
        centre=centre,
        radius=radius * (1 + 1e-9),
    )
