"""A scene's geometry: triangles, each of a material, and the frames that belong to them (thesis 4.4 to 4.9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Triangles:
    """A mesh. Both sides of a triangle are surfaces; the order of its vertices does not matter to light.

    Args:
        vertices_m: (V, 3) points, m.
        faces: (T, 3) indices of vertices.
        material: (T,) index of each triangle's material; one number is for all.

    Raises:
        DataError: shapes that do not fit, indices out of range, points that are not finite.
    """

    vertices_m: Floats
    faces: NDArray[np.int64]
    material: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, dtype=np.int64))

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices_m, dtype=np.float64)
        faces = np.ascontiguousarray(self.faces, dtype=np.int64)
        if vertices.ndim != 2 or vertices.shape[1:] != (3,) or faces.ndim != 2 or faces.shape[1:] != (3,):
            raise DataError(f"vertices have shape {vertices.shape} and faces {faces.shape}", "give both three columns")
        if not len(faces):
            raise DataError("a mesh has no triangle", "give at least one")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise DataError(
                f"faces name vertices {faces.min()} to {faces.max()}", f"there are {len(vertices)}, counted from 0"
            )
        if not np.all(np.isfinite(vertices)) or np.abs(vertices).max() > 1e12:
            raise DataError("a vertex is not finite or beyond 1e12 m", "look at the mesh's coordinates")
        material = np.asarray(self.material, dtype=np.int64)
        if material.size != 1 and material.shape != (len(faces),):
            raise DataError(f"{material.size} materials are given for {len(faces)} triangles", "give one for each")
        object.__setattr__(self, "vertices_m", vertices)
        object.__setattr__(self, "faces", faces)
        # A copy always: read-only arrays are another type to the compiler, and everything would be compiled twice.
        object.__setattr__(self, "material", np.array(np.broadcast_to(material, (len(faces),))))

    def __len__(self) -> int:
        return len(self.faces)

    @property
    def corners_m(self) -> Floats:
        """(T, 3, 3): the three points of each triangle."""
        return np.ascontiguousarray(self.vertices_m[self.faces])

    @property
    def normals(self) -> Floats:
        """(T, 3) unit normals (4.4); NaN for triangles without area."""
        corners = self.corners_m
        edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        # Each edge by its own length, so that tiny and huge triangles neither vanish nor overflow.
        sizes = [np.linalg.norm(edge, axis=1, keepdims=True) for edge in edges]
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.cross(edges[0] / sizes[0], edges[1] / sizes[1])
            size = np.linalg.norm(across, axis=1, keepdims=True)
            return np.asarray(np.where(size > 0, across / size, np.nan))

    @property
    def sphere(self) -> tuple[Floats, float]:
        """Centre and radius, m, of a sphere that holds all vertices in use."""
        points = self.vertices_m[np.unique(self.faces)]
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        return centre, float(np.linalg.norm(points - centre, axis=1).max())

    def turned(self, matrix: ArrayLike) -> Triangles:
        """Every point multiplied by a (3, 3) matrix."""
        return Triangles(self.vertices_m @ np.asarray(matrix, dtype=np.float64).T, self.faces, self.material)

    def moved(self, offset_m: ArrayLike) -> Triangles:
        """Every point moved by (3,), m."""
        return Triangles(self.vertices_m + np.asarray(offset_m, dtype=np.float64), self.faces, self.material)

    def of_material(self, index: int) -> Triangles:
        """All triangles of one material."""
        return Triangles(self.vertices_m, self.faces, np.array([index]))


def joined(meshes: Sequence[Triangles]) -> Triangles:
    """Several meshes as one. Raises :class:`DataError` without any."""
    if not meshes:
        raise DataError("no mesh is there to join", "give at least one")
    first = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes[:-1])])
    return Triangles(
        np.concatenate([mesh.vertices_m for mesh in meshes]),
        np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, first, strict=True)]),
        np.concatenate([mesh.material for mesh in meshes]),
    )


def local_frame(normal: ArrayLike) -> Floats:
    """The rotation T2 T1 (..., 3, 3) that turns a normal into +z (thesis 4.6 and 4.7)."""
    n = np.asarray(normal, dtype=np.float64)
    beta, alpha = np.arctan2(np.hypot(n[..., 0], n[..., 1]), n[..., 2]), np.arctan2(n[..., 1], n[..., 0])
    ca, sa, cb, sb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
    zero, one = np.zeros_like(ca), np.ones_like(ca)
    first = np.stack([ca, sa, zero, -sa, ca, zero, zero, zero, one], axis=-1).reshape(*ca.shape, 3, 3)
    second = np.stack([cb, zero, -sb, zero, one, zero, sb, zero, cb], axis=-1).reshape(*ca.shape, 3, 3)
    return np.asarray(second @ first)


def local_angles(vector: ArrayLike, normal: ArrayLike) -> tuple[Floats, Floats]:
    """Zenith and azimuth (...) of unit vectors in their facets' frames, radians (thesis 4.8 and 4.9)."""
    local = np.einsum("...ij,...j->...i", local_frame(normal), np.asarray(vector, dtype=np.float64))
    zenith = np.arctan2(np.hypot(local[..., 0], local[..., 1]), local[..., 2])
    return zenith, np.arctan2(local[..., 1], local[..., 0])
