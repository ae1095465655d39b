"""Calibration targets as flat conducting faces at their places: what physical optics integrates over.

Body frame of a target: ``(cos el cos az, cos el sin az, sin el)`` is the direction in which an observer at azimuth az
and elevation el stands. A plate and a dihedral look along +x with y to the right of the radar that faces them and z up;
a trihedral's edges are x, y and z. Its reference point (face's centre, fold's centre, apex) is the origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.scene.model import Reflector

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Face:
    """A flat, convex, conducting polygon."""

    corners_m: Floats
    """(n, 3) corners in order, m."""
    normal: Floats
    """(3,) unit vector of the side that reflects; the other side absorbs."""

    def __post_init__(self) -> None:
        if self.corners_m.ndim != 2 or self.corners_m.shape[0] < 3 or self.corners_m.shape[1] != 3:
            raise DataError(f"a face has corners of shape {self.corners_m.shape}", "give at least three, (n, 3)")
        if not np.isfinite(self.corners_m).all():
            raise DataError("a face has a corner that is not finite", "give finite sizes and places")

    def height_m(self, point_m: ArrayLike) -> float:
        """Distance of a point in front of the face's plane, m; negative behind it."""
        return float(self.normal @ (np.asarray(point_m, dtype=np.float64) - self.corners_m[0]))

    def moved(self, rotation: Floats, place_m: Floats) -> Face:
        """The face turned by a rotation (3, 3) and then shifted by ``place_m``."""
        return Face(self.corners_m @ rotation.T + place_m, rotation @ self.normal)


@dataclass(frozen=True, eq=False)
class FacetTarget:
    """Faces that stand together, and the point that their range and phase are told from."""

    faces: tuple[Face, ...]
    reference_m: Floats
    """(3,) m."""
    largest_m: float
    """Largest distance of two corners, m: the D of the far field's 2 D^2 / lambda."""

    def moved(self, rotation: ArrayLike, place_m: ArrayLike) -> FacetTarget:
        """The target turned by a rotation (3, 3) about the origin and then shifted by ``place_m``."""
        turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(place_m, dtype=np.float64)
        faces = tuple(face.moved(turn, shift) for face in self.faces)
        return FacetTarget(faces, turn @ self.reference_m + shift, self.largest_m)


def plate_facets(width_m: float, height_m: float) -> FacetTarget:
    """A rectangular plate in its body frame: ``width_m`` along y, ``height_m`` along z."""
    _positive("width_m", width_m)
    _positive("height_m", height_m)
    y, z = width_m / 2, height_m / 2
    corners = np.array([[0, -y, -z], [0, y, -z], [0, y, z], [0, -y, z]])
    return _target(Face(corners, np.array([1.0, 0.0, 0.0])))


def dihedral_facets(fold_length_m: float, face_width_m: float, fold_rad: float = 0.0) -> FacetTarget:
    """A right-angled dihedral in its body frame; ``fold_rad`` is the fold's angle from horizontal (y)."""
    _positive("fold_length_m", fold_length_m)
    _positive("face_width_m", face_width_m)
    if not np.isfinite(fold_rad):
        raise DataError(f"the fold's angle is {fold_rad}", "give a finite angle")
    along = np.array([0.0, np.cos(fold_rad), np.sin(fold_rad)])
    across = np.array([0.0, -np.sin(fold_rad), np.cos(fold_rad)])
    ahead = np.array([1.0, 0.0, 0.0])
    first, second = (ahead + across) / np.sqrt(2), (ahead - across) / np.sqrt(2)
    half = along * fold_length_m / 2
    # Each face's normal points along the other face.
    return _target(
        *(
            Face(np.array([-half, half, half + face_width_m * edge, -half + face_width_m * edge]), other)
            for edge, other in ((first, second), (second, first))
        )
    )


def trihedral_facets(edge_m: float, *, triangular: bool = False) -> FacetTarget:
    """A right-angled trihedral with square (or triangular) faces in its body frame."""
    _positive("edge_m", edge_m)
    axes = np.eye(3)
    faces = []
    for number in range(3):
        u, v = edge_m * axes[(number + 1) % 3], edge_m * axes[(number + 2) % 3]
        corners = [np.zeros(3), u, v] if triangular else [np.zeros(3), u, u + v, v]
        faces.append(Face(np.array(corners), axes[number]))
    return _target(*faces)


def reflector_facets(reflector: Reflector) -> FacetTarget:
    """The faces of a reflector of a scene, at its place in rig coordinates.

    It stands so that the rig's origin is in the stated direction of its body frame, without roll: horizontal across
    the line of sight stays horizontal.

    Raises:
        DataError: a kind that has no flat faces, a size that is not positive, or a place at the origin.
    """
    edge = reflector.edge_m
    if reflector.kind == "plate":
        body = plate_facets(edge, edge)
    elif reflector.kind == "dihedral":
        body = dihedral_facets(edge, edge, reflector.fold_rad)
    elif reflector.kind == "trihedral":
        body = trihedral_facets(edge)
    elif reflector.kind == "trihedral_triangular":
        body = trihedral_facets(edge, triangular=True)
    else:
        raise DataError(
            f"a reflector of kind {reflector.kind!r} has no flat faces to integrate over",
            "use a plate, dihedral or trihedral",
        )
    place = np.asarray(reflector.position_m, dtype=np.float64)
    return body.moved(facing(-place, reflector.azimuth_rad, reflector.elevation_rad), place)


def facing(towards: ArrayLike, azimuth_rad: float, elevation_rad: float) -> Floats:
    """Rotation (3, 3) from a body frame to the rig's that turns the body direction (az, el) along ``towards`` (3,).

    Raises:
        DataError: ``towards`` is zero or not finite, or the angles are not.
    """
    sight = np.asarray(towards, dtype=np.float64)
    length = float(np.linalg.norm(sight))
    if not (np.isfinite(length) and length > 0 and np.isfinite([azimuth_rad, elevation_rad]).all()):
        raise DataError(
            f"a target cannot face the direction {sight.tolist()} from azimuth {azimuth_rad} and elevation "
            f"{elevation_rad} rad",
            "place it away from the antenna and give finite angles",
        )
    azimuth, elevation = np.arctan2(sight[1], sight[0]), np.arcsin(np.clip(sight[2] / length, -1, 1))
    return np.asarray(_triad(float(azimuth), float(elevation)) @ _triad(azimuth_rad, elevation_rad).T)


def _triad(azimuth: float, elevation: float) -> Floats:
    """Columns: the direction (az, el), the horizontal left of it, and up across it."""
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    return np.array([[ce * ca, -sa, -se * ca], [ce * sa, ca, -se * sa], [se, 0.0, ce]])


def _target(*faces: Face) -> FacetTarget:
    corners = np.concatenate([face.corners_m for face in faces])
    spread = np.linalg.norm(corners[:, None] - corners[None, :], axis=-1)
    return FacetTarget(faces, np.zeros(3), float(spread.max()))


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise DataError(f"{name} is {value}", f"give a positive, finite {name}")
