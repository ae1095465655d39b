"""Where on a corner reflector's faces a wave arrives after each sequence of bounces, in exact polygons.

Every bounce but the last is a mirror (geometrical optics): the wave that arrives on the last face comes from the mirror
image of the antenna, through windows that are the faces passed on the way, each mirrored likewise. A footprint is the
last face, clipped by the pyramids from the image through those windows; what other faces hide from the transmitter or
the receiver is cut out of it. Valid for faces that meet at right angles and look at each other.
Source: method of images and projection as in Griesser and Balanis, Backscatter analysis of dihedral corner reflectors
using physical optics and the physical theory of diffraction (IEEE TAP 1987).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.calibration.facets import Face, FacetTarget
from processing.calibration.quadrature import cross_products

Floats = NDArray[np.float64]

FLAT = 1e-9
"""Length over which points count as one, relative to the face's size."""


@dataclass(frozen=True, eq=False)
class Footprint:
    """A part of a face that one sequence of bounces lights up."""

    faces: tuple[int, ...]
    """Indices of the faces in the order of the bounces."""
    corners_m: Floats
    """(n, 3) convex polygon on the last face, m."""
    normal: Floats
    """(3,) of the last face."""
    unfold: Floats
    """(3, 3) and (3,): ``unfold @ r + shift`` is where a point of the footprint would be without the mirrors, so that
    the path from the antenna to there is straight."""
    shift_m: Floats

    @property
    def bounces(self) -> int:
        """Number of bounces, the last one included."""
        return len(self.faces)


def footprints(
    target: FacetTarget, transmitter_m: Floats, receiver_m: Floats, *, bounces: Iterable[int] = (1, 2, 3)
) -> list[Footprint]:
    """All lit polygons of a target, for a transmitter and a receiver at the places given (each (3,), m)."""
    found: list[Footprint] = []
    for count in sorted(set(bounces)):
        for order in itertools.permutations(range(len(target.faces)), count):
            found.extend(_along(target, order, transmitter_m, receiver_m))
    return found


def _along(target: FacetTarget, order: tuple[int, ...], transmitter_m: Floats, receiver_m: Floats) -> list[Footprint]:
    faces = [target.faces[index] for index in order]
    last = faces[-1]
    if _side(last, receiver_m) <= 0:
        return []
    # The antenna's image after each mirror; every face must be lit from its front.
    matrix, shift = np.eye(3), np.zeros(3)
    for face in faces[:-1]:
        if _side(face, matrix @ transmitter_m + shift) <= 0:
            return []
        mirror, offset = _mirror(face)
        matrix, shift = mirror @ matrix, mirror @ shift + offset
    image = matrix @ transmitter_m + shift
    if _side(last, image) <= 0:
        return []
    pieces = [last.corners_m]
    onward, move = np.eye(3), np.zeros(3)
    for face in reversed(faces[:-1]):
        # ``onward`` holds the mirrors that come after this face.
        window = face.corners_m @ onward.T + move
        pieces = [clipped for piece in pieces if len(clipped := _clip_all(piece, _beyond(image, window)))]
        mirror, offset = _mirror(face)
        onward, move = onward @ mirror, onward @ offset + move
    for index, face in enumerate(target.faces):
        # A face that an antenna stands behind hides others from it.
        if index != order[0] and _side(face, transmitter_m) < 0:
            pieces = _without(pieces, _beyond(image, face.corners_m @ onward.T + move))
        if index != order[-1] and _side(face, receiver_m) < 0:
            pieces = _without(pieces, _beyond(receiver_m, face.corners_m))
    inverse = matrix.T
    return [Footprint(order, piece, last.normal, inverse, -inverse @ shift) for piece in pieces]


def _side(face: Face, point_m: Floats) -> float:
    """Positive in front of a face, negative behind it, zero in its plane (to rounding)."""
    height = face.height_m(point_m)
    return 0.0 if abs(height) <= FLAT * float(np.linalg.norm(point_m - face.corners_m[0])) else height


def _mirror(face: Face) -> tuple[Floats, Floats]:
    """Matrix and shift of the reflection in a face's plane."""
    n = face.normal
    return np.eye(3) - 2 * np.outer(n, n), 2 * n * float(n @ face.corners_m[0])


def _beyond(eye: Floats, window: Floats) -> list[tuple[Floats, float]] | None:
    """Half-spaces ``n . r >= c`` of what ``eye`` sees through a window and beyond it; None where it is edge-on."""
    centre = window.mean(axis=0)
    normal = cross_products(window[1] - window[0], window[2] - window[0])
    normal /= np.linalg.norm(normal)
    height = float(normal @ (eye - centre))
    size = float(np.linalg.norm(window - centre, axis=1).max())
    if abs(height) <= FLAT * size:
        return None
    behind = -np.sign(height) * normal
    found = [(behind, float(behind @ centre))]
    towards = window - eye
    sides = cross_products(towards, np.concatenate([towards[1:], towards[:1]]))
    lengths = np.sqrt((sides * sides).sum(axis=1))
    if not lengths.all():
        return None
    sides *= (np.sign(sides @ (centre - eye)) / lengths)[:, None]
    found.extend((side, float(side @ eye)) for side in sides)
    return found


def _clip_all(polygon: Floats, spaces: Sequence[tuple[Floats, float]] | None) -> Floats:
    if spaces is None:
        return np.empty((0, 3))
    for normal, offset in spaces:
        polygon = _clip(polygon, normal, offset)
    return polygon


def _without(pieces: list[Floats], spaces: Sequence[tuple[Floats, float]] | None) -> list[Floats]:
    """The pieces with what lies in all half-spaces cut out, again as convex pieces."""
    if spaces is None:
        return pieces
    kept: list[Floats] = []
    for piece in pieces:
        rest = piece
        for normal, offset in spaces:
            outside = _clip(rest, -normal, -offset)
            if len(outside):
                kept.append(outside)
            rest = _clip(rest, normal, offset)
            if not len(rest):
                break
    return kept


def _clip(polygon: Floats, normal: Floats, offset: float) -> Floats:
    """The part of a convex polygon with ``normal . r >= offset`` (Sutherland and Hodgman 1974); empty without area."""
    if not len(polygon):
        return polygon
    heights = polygon @ normal - offset
    size = float(np.ptp(polygon, axis=0).max())
    heights[np.abs(heights) <= FLAT * size] = 0.0
    if (heights >= 0).all():
        return polygon
    corners: list[Floats] = []
    for index, height in enumerate(heights):
        follower = (index + 1) % len(polygon)
        if height >= 0:
            corners.append(polygon[index])
        if height * heights[follower] < 0:
            part = height / (height - heights[follower])
            corners.append(polygon[index] + part * (polygon[follower] - polygon[index]))
    if len(corners) < 3 or not (heights > 0).any():
        return np.empty((0, 3))
    return np.array(corners)
