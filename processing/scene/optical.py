"""What the camera sees of a scene: its flat surfaces, nearest first, each with its reflected Stokes vector."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.optics.camera_model import Pinhole
from processing.scene.model import Scene, Surface

BACKGROUND = -1
"""Index of pixels that no surface covers."""


def stokes_image(scene: Scene, camera: Pinhole) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Render the scene's surfaces through a pinhole camera, one ray through every pixel's centre.

    A surface reflects its Stokes vector times the cosine of the sun's angle on the side that faces the camera; a side
    that the sun does not reach is black. Stokes vectors are in the camera's frame (x horizontal, S2 > 0 at +45 deg),
    so no rotation is applied. Nearer surfaces hide farther ones.

    Args:
        scene: surfaces, sun and background.
        camera: the camera in rig coordinates.

    A scene with a picture of its bodies is looked at already: that picture is given.

    Returns:
        Stokes parameters S0, S1, S2 of shape (3, rows, columns), for S0 = 1 under unit irradiance, and for each pixel
        the index of the surface in ``scene.surfaces`` (rows, columns), or :data:`BACKGROUND`.

    Raises:
        DataError: a picture of bodies that another camera took.
    """
    rows, columns = camera.shape
    if scene.picture is not None:
        if scene.picture.shape != (3, rows, columns):
            raise DataError(
                f"the bodies' picture is of shape {scene.picture.shape}, the camera has {rows} x {columns} pixels",
                "start 'polfuse sim' again and use the rig file that it writes",
            )
        return scene.picture.astype(np.float64), np.full((rows, columns), BACKGROUND, dtype=np.int32)
    stokes = np.empty((3, rows, columns))
    stokes[:] = np.asarray(scene.background_stokes, dtype=np.float64)[:, None, None]
    index = np.full((rows, columns), BACKGROUND, dtype=np.int32)
    depth = np.full((rows, columns), np.inf)
    rays = camera.rays()
    for number, surface in enumerate(scene.surfaces):
        distance = _distance(surface, camera, rays)
        nearer = distance < depth
        depth[nearer] = distance[nearer]
        index[nearer] = number
        stokes[:, nearer] = (np.asarray(surface.stokes) * sun_cosine(surface, camera, scene.sun_direction))[:, None]
    return stokes, index


def sun_cosine(surface: Surface, camera: Pinhole, sun_direction: tuple[float, float, float]) -> float:
    """Cosine of the sun's angle from the normal on the side of a surface that faces the camera; 0 when unlit."""
    normal = np.cross(surface.edge_u_m, surface.edge_v_m)
    length = float(np.linalg.norm(normal)) * float(np.linalg.norm(sun_direction))
    if length == 0.0:
        return 0.0
    towards_camera = float((np.asarray(camera.position_m) - np.asarray(surface.corner_m)) @ normal)
    return max(0.0, math.copysign(1.0, towards_camera) * float(np.asarray(sun_direction) @ normal) / length)


def _distance(surface: Surface, camera: Pinhole, rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance along each ray (unit vectors, (rows, columns, 3)) to a parallelogram; infinite where it is missed."""
    edge_u, edge_v = np.asarray(surface.edge_u_m), np.asarray(surface.edge_v_m)
    normal = np.cross(edge_u, edge_v)
    area_squared = float(normal @ normal)
    if area_squared == 0.0:
        return np.full(rays.shape[:2], np.inf)
    offset = np.asarray(surface.corner_m) - np.asarray(camera.position_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = float(offset @ normal) / (rays @ normal)
        hit = distance[..., None] * rays - offset
        # Coordinates along the two edges: a p = a u + b v on the plane gives a = (p x v).n / n.n, b = (u x p).n / n.n.
        along_u = hit @ (np.cross(edge_v, normal) / area_squared)
        along_v = hit @ (np.cross(normal, edge_u) / area_squared)
        inside = (distance > 0) & (along_u >= 0) & (along_u <= 1) & (along_v >= 0) & (along_v <= 1)
    reached: NDArray[np.float64] = np.where(inside, distance, np.inf)
    return reached
