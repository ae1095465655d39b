"""A camera in rig coordinates, shared by rendering and by registration: a pinhole, with its lens's distortion if known.

Image coordinates: ``u`` counts columns to the right and ``v`` rows downwards; pixel centres have whole numbers, and
the optical axis passes through ``((width_px - 1) / 2, (height_px - 1) / 2)`` unless a calibration says otherwise. The
camera looks along +y, depressed towards the ground, with its rows parallel to the rail.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError, undefined_is_nan
from processing.optics.distortion import NONE, Coefficients, distorted, undistorted

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pinhole:
    """A perspective camera.

    Args:
        focal_length_m: focal length, m.
        pixel_pitch_m: distance of neighbouring pixels on the sensor, m.
        width_px: columns.
        height_px: rows.
        position_m: entrance pupil in rig coordinates (x along the rail, y away, z up), m.
        depression_rad: angle of the optical axis below horizontal, radians.
        distortion: the lens's k1, k2, p1, p2 (:mod:`processing.optics.distortion`).
        principal_offset_px: optical axis against the sensor's middle, right and down, pixels.

    Raises:
        DataError: a size, pitch or focal length that is not positive, or a direction that is not finite.
    """

    focal_length_m: float
    pixel_pitch_m: float
    width_px: int
    height_px: int
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    depression_rad: float = 0.0
    distortion: Coefficients = NONE
    principal_offset_px: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        sizes = (self.focal_length_m, self.pixel_pitch_m, self.width_px, self.height_px)
        if not all(math.isfinite(size) and size > 0 for size in sizes):
            raise DataError(
                f"focal length, pixel pitch, width and height of the camera are {sizes}",
                "give positive numbers in the rig file's [camera]",
            )
        if len(self.position_m) != 3 or not all(math.isfinite(x) for x in (*self.position_m, self.depression_rad)):
            raise DataError(
                f"the camera stands at {self.position_m} with depression {self.depression_rad} rad",
                "give three finite coordinates and a finite angle in the rig file's [camera]",
            )
        lens = (*self.distortion, *self.principal_offset_px)
        if len(lens) != 6 or not all(math.isfinite(number) for number in lens):
            raise DataError(
                f"the lens has distortion {self.distortion} and its axis {self.principal_offset_px} pixels off",
                "give four and two finite numbers in the rig file's [camera]",
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height_px, self.width_px

    @property
    def focal_length_px(self) -> float:
        """Focal length in pixels: the pixel's angular size is its reciprocal."""
        return self.focal_length_m / self.pixel_pitch_m

    @property
    def principal_point(self) -> tuple[float, float]:
        """(u, v) of the optical axis."""
        right, down = self.principal_offset_px
        return (self.width_px - 1) / 2 + right, (self.height_px - 1) / 2 + down

    @property
    def axes(self) -> Floats:
        """(3, 3): unit vectors to the right, down and forward, one a row, in rig coordinates."""
        sine, cosine = math.sin(self.depression_rad), math.cos(self.depression_rad)
        return np.array([[1.0, 0.0, 0.0], [0.0, -sine, -cosine], [0.0, cosine, -sine]])

    @undefined_is_nan
    def project(self, xyz_m: ArrayLike) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Image of points in the world.

        Args:
            xyz_m: (..., 3) points in rig coordinates, m.

        Returns:
            ``u``, ``v`` (pixels, NaN for points that are not in front of the camera) and ``in_front``, each of shape
            (...). A point may be in front of the camera and yet outside its frame; see :meth:`inside`.

        Raises:
            DataError: the last axis does not hold three coordinates.
        """
        points = np.asarray(xyz_m, dtype=np.float64)
        if points.ndim == 0 or points.shape[-1] != 3:
            raise DataError(f"points have shape {points.shape}", "give x, y and z along the last axis")
        local = (points - np.asarray(self.position_m)) @ self.axes.T
        depth = local[..., 2]
        # A point nearer than a pixel's pitch is at the pupil itself and has no image.
        in_front = depth > self.pixel_pitch_m
        safe = np.where(in_front, depth, np.nan)
        u0, v0 = self.principal_point
        a, b = local[..., 0] / safe, local[..., 1] / safe
        if any(self.distortion):
            ideal, (a, b) = (a, b), distorted(a, b, self.distortion)
            # What the lens cannot show (where its polynomial folds back) has no image.
            back = undistorted(a, b, self.distortion)
            shown = np.abs(back[0] - ideal[0]) + np.abs(back[1] - ideal[1]) < 1e-6
            a, b = np.where(shown, a, np.nan), np.where(shown, b, np.nan)
        return u0 + self.focal_length_px * a, v0 + self.focal_length_px * b, in_front

    def inside(self, u: ArrayLike, v: ArrayLike) -> NDArray[np.bool_]:
        """Whether image coordinates lie on the sensor (on or within its outermost pixels' edges); NaN does not."""
        column, row = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
        on_sensor: NDArray[np.bool_] = (
            (column >= -0.5) & (column <= self.width_px - 0.5) & (row >= -0.5) & (row <= self.height_px - 0.5)
        )
        return on_sensor

    def rays(self, u: ArrayLike | None = None, v: ArrayLike | None = None) -> Floats:
        """Unit vectors from the pupil through image points, in rig coordinates.

        Args:
            u: columns; without them every pixel's centre is taken.
            v: rows, of a shape that broadcasts with ``u``.

        Returns:
            (..., 3); for every pixel (height_px, width_px, 3).
        """
        if u is None or v is None:
            u, v = np.meshgrid(np.arange(self.width_px), np.arange(self.height_px))
        column, row = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
        u0, v0 = self.principal_point
        a, b = undistorted((column - u0) / self.focal_length_px, (row - v0) / self.focal_length_px, self.distortion)
        local = np.stack([a, b, np.ones(a.shape)], axis=-1)
        local /= np.linalg.norm(local, axis=-1, keepdims=True)
        directions: Floats = local @ self.axes
        return directions

    def on_plane(self, u: ArrayLike, v: ArrayLike, z_m: float) -> Floats:
        """Points (..., 3) where rays through image points meet the plane ``z = z_m``; NaN where they do not."""
        directions = self.rays(u, v)
        height = z_m - self.position_m[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = height / directions[..., 2]
        distance = np.where(np.isfinite(distance) & (distance > 0), distance, np.nan)
        points: Floats = np.asarray(self.position_m) + distance[..., None] * directions
        return points
