"""A tree of boxes over triangles, so that a ray meets few of them: built by the surface area heuristic in bins.

Wald 2007, "On fast construction of SAH-based bounding volume hierarchies".
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.raytrace.bvh_kernel import STACK, nearest_of_many
from processing.raytrace.moller_trumbore import Hits
from processing.raytrace.triangles import Triangles

Floats = NDArray[np.float64]
Indices = NDArray[np.int32]

BINS = 16
LEAF = 4
"""Most triangles of a leaf (fewer where splitting pays)."""
_TRIANGLE_COST = 1.2
"""Of one triangle, in boxes' tests."""


@dataclass(frozen=True)
class Tree:
    """Boxes of pairs of children, and the triangles in the order of the leaves."""

    boxes: NDArray[np.float32]
    """(inner nodes, 12): x from, x to, y from … z to of the first child, then of the second; rounded outwards."""
    children: Indices
    """(inner nodes, 2): an inner node, or ``-1 - (first << 4 | count)`` of a leaf."""
    corners: Floats
    """(T, 9) points of the triangles, leaf by leaf."""
    order: Indices
    """(T,) which triangle each of them is."""

    def closest(self, origin: ArrayLike, direction: ArrayLike, skip: ArrayLike | None = None) -> Hits:
        """The nearest triangle that each ray meets, edges and corners included.

        Args:
            origin, direction: (N, 3).
            skip: (N,) index of a triangle that does not count, -1 for none.
        """
        o = np.ascontiguousarray(origin, dtype=np.float64)
        return self._many(o, direction, skip, np.full(len(o), np.inf), first_only=False)

    def occluded(
        self, origin: ArrayLike, direction: ArrayLike, distance: ArrayLike, skip: ArrayLike | None = None
    ) -> NDArray[np.bool_]:
        """Whether rays meet any triangle before ``distance`` (N,), in lengths of their directions."""
        o = np.ascontiguousarray(origin, dtype=np.float64)
        return self._many(o, direction, skip, np.array(distance, dtype=np.float64), first_only=True).triangle >= 0

    def _many(self, o: Floats, direction: ArrayLike, skip: ArrayLike | None, far: Floats, *, first_only: bool) -> Hits:
        skipped = np.full(len(o), -1) if skip is None else np.ascontiguousarray(skip, dtype=np.int64)
        hits = Hits(far, np.empty(len(o), dtype=np.int64), np.empty(len(o)), np.empty(len(o)))
        nearest_of_many(
            self.boxes,
            self.children,
            self.corners,
            self.order,
            o,
            np.ascontiguousarray(direction, dtype=np.float64),
            skipped,
            *hits,
            first_only,
        )
        return hits


def build(mesh: Triangles) -> Tree:
    """The tree of a mesh. Triangles without area are left out: no ray meets them."""
    corners = mesh.corners_m
    usable = np.flatnonzero(np.isfinite(mesh.normals[:, 0]))
    points = corners[usable]
    low, high = points.min(axis=1), points.max(axis=1)
    count = len(usable)
    order = np.arange(count, dtype=np.int32)
    boxes = np.zeros((max(count, 1), 2, 6))
    children = np.full((max(count, 1), 2), -1, dtype=np.int32)
    inner = _split(low, high, (low + high) / 2, order, boxes, children) if count else 1
    rounded = _outwards(boxes[:inner])
    if not count:
        rounded[:] = np.tile(np.array([np.inf, -np.inf], dtype=np.float32), 6)
    chosen = usable[order]
    return Tree(
        boxes=rounded,
        children=np.ascontiguousarray(children[:inner]),
        corners=np.ascontiguousarray(corners[chosen].reshape(count, 9)),
        order=chosen.astype(np.int32),
    )


def _outwards(boxes: Floats) -> NDArray[np.float32]:
    """Boxes (n, 2, low xyz and high xyz) as float32 that hold them, in the order of the kernel."""
    low, high = boxes[..., :3], boxes[..., 3:]
    lower, upper = low.astype(np.float32), high.astype(np.float32)
    lower = np.where(lower > low, np.nextafter(lower, np.float32(-np.inf)), lower)
    upper = np.where(upper < high, np.nextafter(upper, np.float32(np.inf)), upper)
    return np.ascontiguousarray(np.stack([lower, upper], axis=-1).reshape(len(boxes), 12))


@numba.njit(cache=True, nogil=True)
def _half_area(box: Floats) -> float:
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return float(x * y + y * z + z * x)


@numba.njit(cache=True, nogil=True)
def _bounds(low: Floats, high: Floats, order: Indices, begin: int, end: int, box: Floats) -> None:
    for axis in range(3):
        box[axis], box[3 + axis] = np.inf, -np.inf
    for i in range(begin, end):
        for axis in range(3):
            box[axis] = min(box[axis], low[order[i], axis])
            box[3 + axis] = max(box[3 + axis], high[order[i], axis])


@numba.njit(cache=True, nogil=True)
def _best_split(
    low: Floats, high: Floats, centre: Floats, order: Indices, begin: int, end: int
) -> tuple[float, int, float, float]:
    """Cost (times area), axis, and the two numbers that tell a centre's bin; infinite where all centres coincide."""
    best, best_axis, best_from, best_scale, best_bin = np.inf, -1, 0.0, 0.0, 0
    for axis in range(3):
        least, most = np.inf, -np.inf
        for i in range(begin, end):
            value = centre[order[i], axis]
            least, most = min(least, value), max(most, value)
        if not most > least:
            continue
        scale = BINS * (1.0 - 1e-12) / (most - least)
        if not np.isfinite(scale):
            continue
        counts = np.zeros(BINS, dtype=np.int64)
        bins = np.empty((BINS, 6))
        bins[:, :3], bins[:, 3:] = np.inf, -np.inf
        for i in range(begin, end):
            t = order[i]
            b = min(int((centre[t, axis] - least) * scale), BINS - 1)
            counts[b] += 1
            for k in range(3):
                bins[b, k] = min(bins[b, k], low[t, k])
                bins[b, 3 + k] = max(bins[b, 3 + k], high[t, k])
        costs = np.zeros(BINS)
        for backwards in range(2):
            box = np.empty(6)
            box[:3], box[3:] = np.inf, -np.inf
            number = 0
            for step in range(BINS - 1):
                b = BINS - 1 - step if backwards else step
                number += counts[b]
                for k in range(3):
                    box[k] = min(box[k], bins[b, k])
                    box[3 + k] = max(box[3 + k], bins[b, 3 + k])
                costs[b - 1 if backwards else b] += _half_area(box) * number if number else np.inf
        for b in range(BINS - 1):
            if costs[b] < best:
                best, best_axis, best_from, best_scale, best_bin = costs[b], axis, least, scale, b
    return best, best_axis, best_from, (best_bin + 1) / best_scale if best_axis >= 0 else 0.0


@numba.njit(cache=True, nogil=True)
def _parted(centre: Floats, order: Indices, begin: int, end: int, axis: int, start: float, width: float) -> int:
    """Sort a range of ``order`` in two: centres below ``start + width`` first. Returns where the second begins."""
    left, right = begin, end - 1
    while left <= right:
        if centre[order[left], axis] - start < width:
            left += 1
        else:
            order[left], order[right] = order[right], order[left]
            right -= 1
    return left


@numba.njit(cache=True, nogil=True)
def _split(low: Floats, high: Floats, centre: Floats, order: Indices, boxes: Floats, children: Indices) -> int:
    """Fill the tree's nodes; returns how many there are."""
    tasks = np.empty((len(order) + 64, 4), dtype=np.int64)  # first, end, node, depth
    tasks[0, 0], tasks[0, 1], tasks[0, 2], tasks[0, 3] = 0, len(order), 0, 0
    waiting, made = 1, 1
    box = np.empty(6)
    while waiting:
        waiting -= 1
        begin, end, node, depth = tasks[waiting, 0], tasks[waiting, 1], tasks[waiting, 2], tasks[waiting, 3]
        middle = begin + (end - begin + 1) // 2
        # Deep in a badly shaped tree halves are cut, so that the walker's stack holds.
        if depth < STACK // 2:
            _, axis, start, width = _best_split(low, high, centre, order, begin, end)
            if axis >= 0:
                cut = _parted(centre, order, begin, end, axis, start, width)
                if begin < cut < end:
                    middle = cut
        for side in range(2):
            first, last = (begin, middle) if side == 0 else (middle, end)
            if first == last:
                boxes[node, side, :3], boxes[node, side, 3:] = np.inf, -np.inf
                children[node, side] = -1
                continue
            _bounds(low, high, order, first, last, box)
            boxes[node, side] = box
            number = last - first
            leaf = number == 1
            if number <= LEAF and number > 1:
                cost, axis, _, _ = _best_split(low, high, centre, order, first, last)
                area = _half_area(box)
                leaf = axis < 0 or area * number * _TRIANGLE_COST <= 2.0 * area + cost * _TRIANGLE_COST
            if leaf:
                children[node, side] = -1 - (first << 4 | number)
            else:
                children[node, side] = made
                tasks[waiting, 0], tasks[waiting, 1], tasks[waiting, 2], tasks[waiting, 3] = (
                    first,
                    last,
                    made,
                    depth + 1,
                )
                waiting += 1
                made += 1
    return made
