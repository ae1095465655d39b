"""Corners of a chessboard in a picture, to a small part of a pixel.

Where four fields meet, brightness has a saddle: the determinant of its second derivatives is negative, most so at the
corner (Beaudet 1978). Its place is that of the saddle of a parabola fitted around it (Lucchese and Mitra 2002). Corners
are put in order by going from neighbour to neighbour.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from processing.errors import DataError

Floats = NDArray[np.float64]

_SMOOTHING_PX = 1.5
_REACH_PX = 3
_STEPS = 4
_LEAST = 0.08
"""Saddles weaker than this part of the strongest ones are none of the board's."""
_NEAR = 0.35
"""Part of a field's side by which a corner may lie off where its neighbours foretell it."""


def find_chessboard(image: ArrayLike, rows: int, columns: int) -> Floats:
    """Inner corners of a chessboard.

    Args:
        image: (height, width) picture; one board, wholly inside, fields of ten pixels or more.
        rows, columns: inner corners down and along, each 2 or more.

    Returns:
        (rows, columns, 2) u (column) and v (row) of each corner, in an order that a board in front of the camera has
        (right, then down); which of its ends is the first is not told by a chessboard.

    Raises:
        DataError: no such board.
    """
    picture = np.asarray(image, dtype=np.float64)
    if picture.ndim != 2 or min(picture.shape) < 16 or rows < 2 or columns < 2 or not np.isfinite(picture).all():
        raise DataError(
            f"a picture of shape {picture.shape} for {rows} x {columns} corners",
            "give a whole picture and 2 x 2 or more",
        )
    corners = _saddles(picture)
    found = _lattice(corners, rows, columns)
    if found is None:
        raise DataError(
            f"no chessboard with {rows} x {columns} inner corners was found among {len(corners)} corners",
            "show the whole board, sharp and evenly lit, and count the corners where four fields meet",
        )
    return found


def _saddles(picture: Floats) -> Floats:
    """(count, 2) u and v of saddles."""
    smooth = ndimage.gaussian_filter(picture, _SMOOTHING_PX)
    along, down, mixed = (ndimage.gaussian_filter(picture, _SMOOTHING_PX, order=o) for o in ((0, 2), (2, 0), (1, 1)))
    response = mixed**2 - along * down
    peaks = (response == ndimage.maximum_filter(response, size=2 * _REACH_PX + 1)) & (response > 0)
    margin = _REACH_PX + 1
    peaks[:margin] = peaks[-margin:] = False
    peaks[:, :margin] = peaks[:, -margin:] = False
    places = np.argwhere(peaks)
    if not len(places):
        return np.zeros((0, 2))
    strength = response[tuple(places.T)]
    places = places[strength > _LEAST * np.sort(strength)[-min(len(strength), 10)]]
    y, x = np.mgrid[-_REACH_PX : _REACH_PX + 1, -_REACH_PX : _REACH_PX + 1].reshape(2, -1).astype(np.float64)
    fit = np.linalg.pinv(np.stack([x**2, x * y, y**2, x, y, np.ones_like(x)], axis=1))
    spline = ndimage.spline_filter(smooth, order=3, mode="mirror")
    v, u = places.T.astype(np.float64)
    sound = np.ones(len(u), dtype=np.bool_)
    for _ in range(_STEPS):
        # Read around the present place: only about its own middle does a saddle look like a parabola without bias.
        around = ndimage.map_coordinates(
            spline, [v[:, None] + y, u[:, None] + x], order=3, mode="mirror", prefilter=False
        )
        xx, xy, yy, dx, dy, _ = fit @ around.T
        determinant = 4 * xx * yy - xy**2
        sound &= determinant < 0
        safe = np.where(determinant < 0, determinant, -1.0)
        u = u + np.clip((xy * dy - 2 * yy * dx) / safe, -1, 1)
        v = v + np.clip((xy * dx - 2 * xx * dy) / safe, -1, 1)
    near = np.hypot(u - places[:, 1], v - places[:, 0]) < 2
    return np.asarray(np.stack([u, v], axis=1)[sound & near], dtype=np.float64)


def _lattice(corners: Floats, rows: int, columns: int) -> Floats | None:
    """The board that grows from one of the corners nearest to the middle."""
    if len(corners) < rows * columns:
        return None
    middle = np.median(corners, axis=0)
    for start in np.argsort(np.linalg.norm(corners - middle, axis=1))[:12]:
        order = np.argsort(np.linalg.norm(corners - corners[start], axis=1))[1:7]
        for one, other in itertools.combinations(order, 2):
            a, b = corners[one] - corners[start], corners[other] - corners[start]
            sine = (a[0] * b[1] - a[1] * b[0]) / (np.linalg.norm(a) * np.linalg.norm(b))
            if abs(sine) < 0.5 or not 0.4 < np.linalg.norm(a) / np.linalg.norm(b) < 2.5:
                continue
            board = _board(_grown(corners, int(start), a, b), corners, rows, columns)
            if board is not None:
                return board
    return None


def _grown(corners: Floats, start: int, a: Floats, b: Floats) -> dict[tuple[int, int], int]:
    """Lattice places of corners, reached from neighbour to neighbour; steps follow the board's perspective."""
    at: dict[tuple[int, int], int] = {(0, 0): start}
    steps: dict[tuple[int, int], tuple[Floats, Floats]] = {(0, 0): (a, b)}
    waiting = [(0, 0)]
    taken = {start}
    while waiting:
        here = waiting.pop(0)
        for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
            there = (here[0] + sign * (axis == 0), here[1] + sign * (axis == 1))
            if there in at:
                continue
            step = steps[here][axis] * sign
            wanted = corners[at[here]] + step
            distance = np.linalg.norm(corners - wanted, axis=1)
            nearest = int(np.argmin(distance))
            if nearest in taken or distance[nearest] > _NEAR * np.linalg.norm(step):
                continue
            at[there] = nearest
            taken.add(nearest)
            new = list(steps[here])
            new[axis] = sign * (corners[nearest] - corners[at[here]])
            steps[there] = (new[0], new[1])
            waiting.append(there)
    return at


def _board(at: dict[tuple[int, int], int], corners: Floats, rows: int, columns: int) -> Floats | None:
    """A full rectangle of the asked size, right then down."""
    if len(at) < rows * columns:
        return None
    places = np.array(list(at))
    first, last = places.min(axis=0), places.max(axis=0)
    size = tuple(last - first + 1)
    if size not in ((rows, columns), (columns, rows)) or len(at) != rows * columns:
        return None
    grid = np.empty((*size, 2))
    for place, index in at.items():
        grid[place[0] - first[0], place[1] - first[1]] = corners[index]
    if size != (rows, columns) or (
        rows == columns and abs(grid[0, -1, 0] - grid[0, 0, 0]) < abs(grid[-1, 0, 0] - grid[0, 0, 0])
    ):
        grid = grid.transpose(1, 0, 2)
    if grid[0, -1, 0] < grid[0, 0, 0]:
        grid = grid[:, ::-1]
    right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    # Seen from the front, columns turn clockwise into rows (v counts downwards).
    if right[0] * down[1] - right[1] * down[0] < 0:
        grid = grid[::-1]
    return np.ascontiguousarray(grid)
