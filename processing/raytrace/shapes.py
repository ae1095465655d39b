"""The thesis's bodies as triangles: plates, strips, corner reflectors, spheres; and a rough ground to measure speed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.raytrace.triangles import Triangles, joined

Floats = NDArray[np.float64]


def plate(width_m: float, depth_m: float | None = None, *, cells: int = 1, material: int = 0) -> Triangles:
    """A rectangle in the plane z = 0, centred, of ``cells`` by ``cells`` pairs of triangles."""
    return patch(
        (-width_m / 2, -(depth_m or width_m) / 2, 0.0),
        (width_m, 0.0, 0.0),
        (0.0, depth_m or width_m, 0.0),
        cells=cells,
        material=material,
    )


def patch(
    corner_m: ArrayLike, edge_u_m: ArrayLike, edge_v_m: ArrayLike, *, cells: int = 1, material: int = 0
) -> Triangles:
    """A parallelogram of ``cells`` by ``cells`` pairs of triangles.

    Raises:
        DataError: no cells, or edges that span no area.
    """
    corner, u, v = (np.asarray(vector, dtype=np.float64) for vector in (corner_m, edge_u_m, edge_v_m))
    if cells < 1 or not np.linalg.norm(np.cross(u, v)) > 0:
        raise DataError(
            f"a patch has {cells} cells and edges {u} and {v}", "give 1 or more and edges across each other"
        )
    steps = np.linspace(0.0, 1.0, cells + 1)
    points = corner + steps[:, None, None] * v + steps[None, :, None] * u
    return Triangles(points.reshape(-1, 3), _grid_faces(cells + 1, cells + 1), np.array([material]))


def strips(width_m: float, depth_m: float, count: int) -> Triangles:
    """A plate in z = 0 of ``count`` equal strips side by side along x, with materials 0, 1, 2 … (thesis Fig. 6.4)."""
    if count < 1:
        raise DataError(f"a plate of {count} strips was asked for", "give 1 or more")
    wide = width_m / count
    return joined(
        [
            patch((i * wide - width_m / 2, -depth_m / 2, 0.0), (wide, 0.0, 0.0), (0.0, depth_m, 0.0), material=i)
            for i in range(count)
        ]
    )


def dihedral(edge_m: float, *, material: int = 0) -> Triangles:
    """Two squares that meet at right angles along x: one on the ground (+y), one upright (+z)."""
    left = (-edge_m / 2, 0.0, 0.0)
    return joined(
        [
            patch(left, (edge_m, 0.0, 0.0), (0.0, edge_m, 0.0), material=material),
            patch(left, (0.0, 0.0, edge_m), (edge_m, 0.0, 0.0), material=material),
        ]
    )


def trihedral(edge_m: float, *, material: int = 0) -> Triangles:
    """Three squares that meet at the origin, open towards (+x, +y, +z)."""
    axes = edge_m * np.eye(3)
    apex = (0.0, 0.0, 0.0)
    return joined([patch(apex, axes[i], axes[(i + 1) % 3], material=material) for i in range(3)])


def sphere(radius_m: float, *, divisions: int = 4, material: int = 0) -> Triangles:
    """An icosahedron whose triangles are divided ``divisions`` times: 20 * 4^divisions triangles."""
    golden = (1 + math.sqrt(5)) / 2
    points = [(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)]
    vertices = np.array([np.roll(point, turn) for turn in range(3) for point in points], dtype=np.float64)
    vertices /= np.linalg.norm(vertices[0])
    # Its faces are the triples of points at the edge's distance from each other.
    near = np.linalg.norm(vertices[:, None] - vertices[None], axis=2) < 1.06
    faces = np.array(
        [
            (i, j, k)
            for i in range(12)
            for j in range(i + 1, 12)
            for k in range(j + 1, 12)
            if near[i, j] and near[j, k] and near[i, k]
        ]
    )
    for _ in range(divisions):
        vertices, faces = _divided(vertices, faces)
    outward = np.einsum(
        "ij,ij->i",
        np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]),
        vertices[faces[:, 0]],
    )
    faces = np.where((outward < 0)[:, None], faces[:, ::-1], faces)
    return Triangles(radius_m * vertices, faces, np.array([material]))


def rough_ground(width_m: float, cells: int, height_sd_m: float, *, seed: int = 0, material: int = 0) -> Triangles:
    """A square of ground, z about 0, of 2 ``cells``^2 triangles, its points' heights random (hills of many sizes)."""
    random = np.random.default_rng(seed)
    count = cells + 1
    spectrum = np.fft.rfft2(random.standard_normal((count, count)))
    frequency = np.hypot(np.fft.fftfreq(count)[:, None], np.fft.rfftfreq(count)[None])
    spectrum *= np.where(frequency > 0, np.maximum(frequency, 1 / count) ** -1.8, 0.0)
    heights = np.fft.irfft2(spectrum, s=(count, count))
    heights *= height_sd_m / heights.std()
    flat = plate(width_m, cells=cells, material=material)
    points = flat.vertices_m.copy()
    points[:, 2] = heights.ravel()
    return Triangles(points, flat.faces, flat.material)


def turn_about(axis: ArrayLike, angle_rad: float) -> Floats:
    """Rotation (3, 3) about an axis, right-handed (Rodrigues)."""
    a = np.asarray(axis, dtype=np.float64)
    x, y, z = a / np.linalg.norm(a)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * cross @ cross)


def _grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    return np.stack([lower, upper], axis=1).reshape(-1, 3)


def _divided(vertices: Floats, faces: NDArray[np.int64]) -> tuple[Floats, NDArray[np.int64]]:
    """Each triangle as four, the new points on the unit sphere and shared by neighbours."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    middle = vertices[unique].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    a, b, c = (len(vertices) + inverse.reshape(-1, 3)).T
    i, j, k = faces.T
    parts = [(i, a, c), (a, j, b), (c, b, k), (a, b, c)]
    return np.concatenate([vertices, middle]), np.concatenate([np.stack(part, axis=1) for part in parts])
