"""Tubes of rays through a target, split where their corners part, for Numba.

A tube is a cell of a window that faces the antenna. Its middle ray is followed from bounce to bounce; where its four
corner rays meet the same planes and are seen from the antenna alike, the tube is whole and lights a parallelogram of
each plane. Elsewhere it is split in four, down to the finest cells, of which the middle ray decides.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from processing.raytrace.bvh_kernel import STACK, nearest
from processing.raytrace.world import World
from processing.scattering.surfaces import reflection_kernel
from processing.scattering.target import Target

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Indices = NDArray[np.int64]

WIDEST = 60.0
"""A footprint's edge that is this many times its tube's width belongs to a ray along the surface, and is left out."""
ROUNDING = 1e-6
"""Part of a tube by which its corner rays stay inside, so that edges that coincide with cells' do not split them."""

ORIGIN, ACROSS, UP = 0, 1, 2
"""Rows of a window: its corner, and its edges (of one whole cell)."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _seen(
    world: World, stack: NDArray[np.int32], entry: Floats, antenna: Floats, point: Floats, normal: Floats, skip: int
) -> bool:
    """Whether the way from a surface back to the antenna is free, on the side of ``normal``."""
    x = point[0] + world.margin * normal[0]
    y = point[1] + world.margin * normal[1]
    z = point[2] + world.margin * normal[2]
    dx, dy, dz = antenna[0] - x, antenna[1] - y, antenna[2] - z
    if dx * normal[0] + dy * normal[1] + dz * normal[2] <= 0.0:
        return False
    _, met, _, _ = nearest(
        world.boxes, world.children, world.sorted_corners, world.order, stack, entry, x, y, z, dx, dy, dz, skip, 1.0,
        True,
    )  # fmt: skip
    return met < 0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def follow(
    target: Target, stack: NDArray[np.int32], entry: Floats, antenna: Floats, direction: Floats, most: int,
    triangles: Indices, points: Floats, ways: Floats, normals: Floats, seen: NDArray[np.bool_],
) -> int:  # fmt: skip
    """Follow one ray; fills what it met and returns how many bounces there were.

    Args:
        target: the bodies.
        stack, entry: scratch.
        antenna: (3,) where it begins.
        direction: (3,) unit vector.
        most: bounces.
        triangles: (most,) filled.
        points, ways, normals: (most, 3) where, from which direction, and the normal towards it; filled.
        seen: (most,) whether the antenna sees the point on that side; filled.
    """
    world = target.world
    x, y, z = antenna[0], antenna[1], antenna[2]
    dx, dy, dz = direction[0], direction[1], direction[2]
    skip = -1
    for bounce in range(most):
        distance, met, _, _ = nearest(
            world.boxes, world.children, world.sorted_corners, world.order, stack, entry, x, y, z, dx, dy, dz, skip,
            math.inf, False,
        )  # fmt: skip
        if met < 0:
            return bounce
        n = world.normals[met]
        cosine = n[0] * dx + n[1] * dy + n[2] * dz
        side = -1.0 if cosine > 0.0 else 1.0
        x, y, z = x + distance * dx, y + distance * dy, z + distance * dz
        triangles[bounce] = met
        points[bounce, 0], points[bounce, 1], points[bounce, 2] = x, y, z
        ways[bounce, 0], ways[bounce, 1], ways[bounce, 2] = dx, dy, dz
        for axis in range(3):
            normals[bounce, axis] = side * n[axis]
        # What the ray left from is what the antenna sees: only later points can be hidden from it.
        seen[bounce] = bounce == 0 or _seen(world, stack, entry, antenna, points[bounce], normals[bounce], met)
        dx, dy, dz = dx - 2 * cosine * n[0], dy - 2 * cosine * n[1], dz - 2 * cosine * n[2]
        x, y, z = (
            x + world.margin * normals[bounce, 0],
            y + world.margin * normals[bounce, 1],
            z + world.margin * normals[bounce, 2],
        )
        skip = met
    return most


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _unit_fields(way: Floats, fields: Floats) -> None:
    """Unit vectors h = way x z and v = h x way of a line of sight (x to the right when it is upright)."""
    hx, hy = way[1], -way[0]
    size = math.hypot(hx, hy)
    if size < 1e-12:
        hx, hy, size = 1.0, 0.0, 1.0
    hx, hy = hx / size, hy / size
    fields[0, 0], fields[0, 1], fields[0, 2] = hx, hy, 0.0
    fields[1, 0], fields[1, 1], fields[1, 2] = hy * way[2], -hx * way[2], hx * way[1] - hy * way[0]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _dot(a: Floats, b: Floats) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def bounce_field(row: Floats, way: Floats, normal: Floats, field: Complexes, onward: Complexes) -> None:
    """Reflect a field (3,) at a surface, in place; ``onward`` becomes the field that an endless conductor's current
    would need for the same reflection: ``-R_s E_s s + R_p E_p p``."""
    cosine = -_dot(way, normal)
    sx = way[1] * normal[2] - way[2] * normal[1]
    sy = way[2] * normal[0] - way[0] * normal[2]
    sz = way[0] * normal[1] - way[1] * normal[0]
    size = math.sqrt(sx * sx + sy * sy + sz * sz)
    if size < 1e-9:
        # Upright incidence: any axis across the ray will do.
        sx, sy, sz = (0.0, way[2], -way[1]) if abs(way[0]) < 0.9 else (-way[2], 0.0, way[0])
        size = math.sqrt(sx * sx + sy * sy + sz * sz)
    sx, sy, sz = sx / size, sy / size, sz / size
    px, py, pz = way[1] * sz - way[2] * sy, way[2] * sx - way[0] * sz, way[0] * sy - way[1] * sx
    dx, dy, dz = way[0] + 2 * cosine * normal[0], way[1] + 2 * cosine * normal[1], way[2] + 2 * cosine * normal[2]
    qx, qy, qz = dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx
    r_s, r_p = reflection_kernel(row, min(max(cosine, 0.0), 1.0))
    e_s = r_s * (field[0] * sx + field[1] * sy + field[2] * sz)
    e_p = r_p * (field[0] * px + field[1] * py + field[2] * pz)
    onward[0], onward[1], onward[2] = e_p * px - e_s * sx, e_p * py - e_s * sy, e_p * pz - e_s * sz
    field[0], field[1], field[2] = e_s * sx + e_p * qx, e_s * sy + e_p * qy, e_s * sz + e_p * qz


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _footprint(
    antenna: Floats, window: Floats, x: float, y: float, cell: float, bounce: int, points: Floats, normals: Floats,
    corners: Floats, images: Floats,
) -> bool:  # fmt: skip
    """Where a tube's corner rays meet the planes of its middle ray: (4, 3) corners and their images; False if not."""
    for corner in range(4):
        cx = x + (cell if corner & 1 else 0.0)
        cy = y + (cell if corner & 2 else 0.0)
        ox, oy, oz = antenna[0], antenna[1], antenna[2]
        dx = window[0, 0] + cx * window[1, 0] + cy * window[2, 0] - ox
        dy = window[0, 1] + cx * window[1, 1] + cy * window[2, 1] - oy
        dz = window[0, 2] + cx * window[1, 2] + cy * window[2, 2] - oz
        size = math.sqrt(dx * dx + dy * dy + dz * dz)
        ux, uy, uz = dx / size, dy / size, dz / size
        dx, dy, dz = ux, uy, uz
        length = 0.0
        for b in range(bounce + 1):
            nx, ny, nz = normals[b, 0], normals[b, 1], normals[b, 2]
            against = dx * nx + dy * ny + dz * nz
            if against >= -1e-9:
                return False
            step = ((points[b, 0] - ox) * nx + (points[b, 1] - oy) * ny + (points[b, 2] - oz) * nz) / against
            ox, oy, oz = ox + step * dx, oy + step * dy, oz + step * dz
            length += step
            dx, dy, dz = dx - 2 * against * nx, dy - 2 * against * ny, dz - 2 * against * nz
        corners[corner, 0], corners[corner, 1], corners[corner, 2] = ox, oy, oz
        images[corner, 0] = antenna[0] + length * ux
        images[corner, 1] = antenna[1] + length * uy
        images[corner, 2] = antenna[2] + length * uz
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _direction(antenna: Floats, window: Floats, x: float, y: float, direction: Floats) -> None:
    size = 0.0
    for axis in range(3):
        direction[axis] = window[0, axis] + x * window[1, axis] + y * window[2, axis] - antenna[axis]
        size += direction[axis] * direction[axis]
    size = math.sqrt(size)
    for axis in range(3):
        direction[axis] /= size


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sight(antenna: Floats, point: Floats, sight: Floats) -> None:
    """Unit vector from the antenna to a point."""
    x, y, z = point[0] - antenna[0], point[1] - antenna[1], point[2] - antenna[2]
    size = math.sqrt(x * x + y * y + z * z)
    sight[0], sight[1], sight[2] = x / size, y / size, z / size


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _edges(corners: Floats, images: Floats, longest: float, edges: Floats) -> float:
    """Mean edges (4, 3) of a footprint and of its image; its area, 0 where an edge is longer than ``longest``."""
    for axis in range(3):
        edges[0, axis] = 0.5 * (corners[1, axis] - corners[0, axis] + corners[3, axis] - corners[2, axis])
        edges[1, axis] = 0.5 * (corners[2, axis] - corners[0, axis] + corners[3, axis] - corners[1, axis])
        edges[2, axis] = 0.5 * (images[1, axis] - images[0, axis] + images[3, axis] - images[2, axis])
        edges[3, axis] = 0.5 * (images[2, axis] - images[0, axis] + images[3, axis] - images[1, axis])
    if max(_dot(edges[0], edges[0]), _dot(edges[1], edges[1])) > longest * longest:
        return 0.0
    x = edges[0, 1] * edges[1, 2] - edges[0, 2] * edges[1, 1]
    y = edges[0, 2] * edges[1, 0] - edges[0, 0] * edges[1, 2]
    z = edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0]
    return math.sqrt(x * x + y * y + z * z)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _write_place(antenna: Floats, direction: Floats, bounce: int, points: Floats, edges: Floats, place: Floats) -> None:
    """Middle, edges, and image of a footprint: the image is as far along the first direction as the way was long."""
    length = 0.0
    x, y, z = antenna[0], antenna[1], antenna[2]
    for b in range(bounce + 1):
        length += math.sqrt((points[b, 0] - x) ** 2 + (points[b, 1] - y) ** 2 + (points[b, 2] - z) ** 2)
        x, y, z = points[b, 0], points[b, 1], points[b, 2]
    for axis in range(3):
        place[0, axis] = points[bounce, axis]
        place[1, axis], place[2, axis] = edges[0, axis], edges[1, axis]
        place[3, axis] = antenna[axis] + length * direction[axis]
        place[4, axis], place[5, axis] = edges[2, axis], edges[3, axis]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _write_motion(velocity: Floats, bounce: int, triangles: Indices, normals: Floats, motion: Floats) -> None:
    """Velocities (2, 3) of a footprint and of its image.

    A footprint on a body moves with it; one on what stands follows, in its plane, the last moving body that sends the
    waves there. Mirrored in a plane of normal n and velocity w, a velocity u becomes ``u - 2 n n.(u - w)``.
    """
    last = bounce
    while last > 0 and not (velocity[triangles[last]] != 0.0).any():
        last -= 1
    v = velocity[triangles[last]]
    normal = normals[bounce]
    off = 0.0 if last == bounce else _dot(normal, v)
    for axis in range(3):
        motion[0, axis] = motion[1, axis] = v[axis] - off * normal[axis]
    for b in range(bounce - 1, -1, -1):
        n, w = normals[b], velocity[triangles[b]]
        off = _dot(n, motion[1]) - _dot(n, w)
        for axis in range(3):
            motion[1, axis] -= 2 * off * n[axis]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def shoot_tubes(
    target: Target, antenna: Floats, window: Floats, first_row: int, last_row: int, columns: int, levels: int,
    most: int, places: Floats, amplitudes: Complexes, kinds: Indices, motions: Floats,
) -> tuple[int, int]:  # fmt: skip
    """Follow the tubes of some rows of a window, and write what lights up.

    Args:
        target: the bodies.
        antenna: (3,) m.
        window: (3, 3) corner and one cell's edges, m; see :data:`ORIGIN`.
        first_row, last_row, columns: cells.
        levels: how often a cell may be split in four.
        most: bounces.
        places: (capacity, 6, 3) filled with: middle of the footprint, its two edges; the same of its image, to which
            the way from the antenna is straight, m.
        amplitudes: (capacity, 2, 2) filled with S[rx, tx] over wavenumber of an evenly lit footprint, m^2.
        kinds: (capacity, 3) filled with: bounces, plane, 1 where the tube was whole.
        motions: (capacity, 2, 3) filled with the velocities of footprint and image, m/s; (0, 2, 3) where nothing
            moves.

    Returns:
        How many there are (places beyond the capacity are counted, not written), and rays followed.
    """
    stack, entry = np.empty(STACK, dtype=np.int32), np.empty(STACK, dtype=np.float64)
    triangles, other = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    points, ways, normals = np.empty((most, 3)), np.empty((most, 3)), np.empty((most, 3))
    points2, ways2, normals2 = np.empty((most, 3)), np.empty((most, 3)), np.empty((most, 3))
    seen, seen2 = np.empty(most, dtype=np.bool_), np.empty(most, dtype=np.bool_)
    direction, corners, images, edges = np.empty(3), np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    sent, back, sight = np.empty((2, 3)), np.empty((2, 3)), np.empty(3)
    fields, current = np.empty((2, 3), dtype=np.complex128), np.empty(3, dtype=np.complex128)
    waiting = np.empty((4 * levels + 4, 3))
    count, rays = 0, 0
    width = max(
        math.sqrt(_dot(window[1], window[1])),
        math.sqrt(_dot(window[2], window[2])),
    )
    for row in range(first_row, last_row):
        for column in range(columns):
            waiting[0, 0], waiting[0, 1], waiting[0, 2] = column, row, 0
            left = 1
            while left:
                left -= 1
                x, y, level = waiting[left, 0], waiting[left, 1], int(waiting[left, 2])
                cell = 0.5**level
                _direction(antenna, window, x + 0.5 * cell, y + 0.5 * cell, direction)
                bounces = follow(target, stack, entry, antenna, direction, most, triangles, points, ways, normals, seen)
                rays += 1
                whole = True
                if levels > 0:
                    for corner in range(4):
                        cx = x + cell * (1.0 - ROUNDING if corner & 1 else ROUNDING)
                        cy = y + cell * (1.0 - ROUNDING if corner & 2 else ROUNDING)
                        _direction(antenna, window, cx, cy, sight)
                        met = follow(target, stack, entry, antenna, sight, most, other, points2, ways2, normals2, seen2)
                        rays += 1
                        whole = met == bounces
                        for b in range(bounces):
                            if not whole:
                                break
                            whole = target.plane[other[b]] == target.plane[triangles[b]] and seen2[b] == seen[b]
                        if not whole:
                            break
                    if not whole and level < levels:
                        half = 0.5 * cell
                        for part in range(4):
                            waiting[left, 0] = x + (half if part & 1 else 0.0)
                            waiting[left, 1] = y + (half if part & 2 else 0.0)
                            waiting[left, 2] = level + 1
                            left += 1
                        continue
                _unit_fields(direction, sent)
                for tx in range(2):
                    for axis in range(3):
                        fields[tx, axis] = sent[tx, axis]
                for b in range(bounces):
                    surface = target.surfaces[target.world.material[triangles[b]]]
                    area = 0.0
                    if seen[b] and _footprint(antenna, window, x, y, cell, b, points, normals, corners, images):
                        area = _edges(corners, images, WIDEST * width * cell * (1 + b), edges)
                    write = area > 0.0
                    inside = write and count < len(places)
                    if inside:
                        _write_place(antenna, direction, b, points, edges, places[count])
                        _sight(antenna, points[b], sight)
                        _unit_fields(sight, back)
                    normal, way = normals[b], ways[b]
                    cosine = _dot(way, normal)
                    for tx in range(2):
                        bounce_field(surface, way, normal, fields[tx], current)
                        if inside:
                            # n x (k x e) = k (n . e) - e (n . k), over sqrt(pi)
                            share = current[0] * normal[0] + current[1] * normal[1] + current[2] * normal[2]
                            for rx in range(2):
                                e = back[rx]
                                along = way[0] * e[0] + way[1] * e[1] + way[2] * e[2]
                                across = current[0] * e[0] + current[1] * e[1] + current[2] * e[2]
                                amplitudes[count, rx, tx] = (
                                    area / math.sqrt(math.pi) * (share * along - cosine * across)
                                )
                    if inside:
                        # Mirrors on all bounces but the last favour one way round: the mean of both is reciprocal.
                        cross = 0.5 * (amplitudes[count, 0, 1] + amplitudes[count, 1, 0])
                        amplitudes[count, 0, 1], amplitudes[count, 1, 0] = cross, cross
                        kinds[count, 0] = b + 1
                        kinds[count, 1] = target.plane[triangles[b]]
                        kinds[count, 2] = 1 if whole else 0
                        if len(motions):
                            _write_motion(target.velocity, b, triangles, normals, motions[count])
                    if write:
                        count += 1
    return count, rays
