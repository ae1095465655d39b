"""A camera's focal length, axis and lens distortion from pictures of a plane board (Zhang 2000, IEEE TPAMI 22(11)
1330).

Each picture's homography gives two equations for the camera's matrix; with all of them it is found in closed form, and
then with the distortion and each board's pose by least squares over the corners' image places.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from processing.errors import DataError
from processing.optics.distortion import Coefficients, distorted

Floats = NDArray[np.float64]

FEWEST = 3
"""Pictures from different directions below which focal length and pose are not told apart."""

_ALIKE = "the boards' directions are too alike"
_TILT = "tilt the board by 20 degrees or more, each time another way"


@dataclass(frozen=True)
class CameraCalibration:
    """A camera's own numbers; standard deviations from the fit."""

    focal_length_px: float
    focal_length_sd_px: float
    principal_point: tuple[float, float]
    """u, v of the optical axis."""
    principal_point_sd: tuple[float, float]
    distortion: Coefficients
    distortion_sd: Coefficients
    rms_px: float
    """Of a corner's coordinate about the fit."""
    pictures: int

    def principal_offset_px(self, width_px: int, height_px: int) -> tuple[float, float]:
        """The axis against the sensor's middle, as rig files have it."""
        return self.principal_point[0] - (width_px - 1) / 2, self.principal_point[1] - (height_px - 1) / 2


def board_places(rows: int, columns: int, side_m: float = 1.0) -> Floats:
    """(rows, columns, 2) places of inner corners on the board, m."""
    x, y = np.meshgrid(np.arange(columns) * side_m, np.arange(rows) * side_m)
    return np.stack([x, y], axis=-1)


def calibrate_camera(corners: Sequence[ArrayLike], width_px: int, height_px: int) -> CameraCalibration:
    """Calibrate from the corners of one board in several pictures.

    The side of its fields does not matter: it sets the boards' distance only. Pixels are square.

    Args:
        corners: (rows, columns, 2) u and v in each picture (:func:`processing.optics.chessboard.find_chessboard`);
        boards that
            are tilted against each other, over the whole sensor.
        width_px, height_px: the sensor.

    Raises:
        DataError: too few pictures, shapes that do not fit, or boards whose directions are too alike.
    """
    seen = [np.asarray(picture, dtype=np.float64) for picture in corners]
    if len(seen) < FEWEST:
        raise DataError(f"{len(seen)} pictures of a board", f"take {FEWEST} or more, from different directions")
    if any(p.ndim != 3 or p.shape != seen[0].shape or p.shape[2] != 2 or min(p.shape[:2]) < 2 for p in seen):
        raise DataError("corners of the pictures have different shapes", "give (rows, columns, 2) of one board for all")
    board = board_places(*seen[0].shape[:2]).reshape(-1, 2)
    points = [picture.reshape(-1, 2) for picture in seen]
    homographies = [_homography(board, picture) for picture in points]
    middle = ((width_px - 1) / 2, (height_px - 1) / 2)
    focal = _focal(homographies, middle)
    poses = [_pose(h, focal, middle) for h in homographies]
    start = np.concatenate([[focal / width_px, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], *poses])
    image = np.stack(points)

    def residual(numbers: Floats) -> Floats:
        f = numbers[0] * width_px
        pose = numbers[7:].reshape(-1, 6)
        turned = Rotation.from_rotvec(pose[:, :3]).as_matrix()
        local = np.einsum("nij,pj->npi", turned[:, :, :2], board) + pose[:, None, 3:]
        a, b = distorted(local[..., 0] / local[..., 2], local[..., 1] / local[..., 2], tuple(numbers[3:7]))
        u = middle[0] + numbers[1] * width_px + f * a
        v = middle[1] + numbers[2] * width_px + f * b
        return np.asarray((np.stack([u, v], axis=-1) - image).ravel())

    fit = least_squares(residual, start, method="lm")
    free = len(fit.fun) - len(fit.x)
    normal = fit.jac.T @ fit.jac
    if free <= 0 or not np.linalg.cond(normal) < 1e15:
        raise DataError(_ALIKE, _TILT)
    variance = float(2 * fit.cost / free)
    sd = np.sqrt(np.diag(np.linalg.inv(normal)) * variance)
    x = fit.x
    return CameraCalibration(
        focal_length_px=float(x[0] * width_px),
        focal_length_sd_px=float(sd[0] * width_px),
        principal_point=(middle[0] + float(x[1] * width_px), middle[1] + float(x[2] * width_px)),
        principal_point_sd=(float(sd[1] * width_px), float(sd[2] * width_px)),
        distortion=(float(x[3]), float(x[4]), float(x[5]), float(x[6])),
        distortion_sd=(float(sd[3]), float(sd[4]), float(sd[5]), float(sd[6])),
        rms_px=float(np.sqrt(np.mean(fit.fun**2))),
        pictures=len(seen),
    )


def _homography(board: Floats, image: Floats) -> Floats:
    """(3, 3) from board to picture, by the direct linear transform of normalised coordinates (Hartley 1997)."""

    def scaling(points: Floats) -> Floats:
        centre = points.mean(axis=0)
        size = np.sqrt(2) / np.mean(np.linalg.norm(points - centre, axis=1))
        return np.array([[size, 0, -size * centre[0]], [0, size, -size * centre[1]], [0, 0, 1.0]])

    ones = np.ones((len(board), 1))
    to_board, to_image = scaling(board), scaling(image)
    x, y = np.hstack([board, ones]) @ to_board.T, np.hstack([image, ones]) @ to_image.T
    zero = np.zeros_like(x)
    system = np.vstack([np.hstack([x, zero, -y[:, :1] * x]), np.hstack([zero, x, -y[:, 1:2] * x])])
    scaled = np.linalg.svd(system)[2][-1].reshape(3, 3)
    found = np.linalg.inv(to_image) @ scaled @ to_board
    return np.asarray(found / found[2, 2])


def _focal(homographies: list[Floats], middle: tuple[float, float]) -> float:
    """Focal length with the axis in the sensor's middle: both of Zhang's equations are linear in 1 / f^2 then."""
    left, right = [], []
    shift = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, 1.0]])
    for homography in homographies:
        h = shift @ homography
        h /= np.linalg.norm(h)
        left += [h[0, 0] * h[0, 1] + h[1, 0] * h[1, 1], np.sum(h[:2, 0] ** 2) - np.sum(h[:2, 1] ** 2)]
        right += [-h[2, 0] * h[2, 1], h[2, 1] ** 2 - h[2, 0] ** 2]
    inverse = float(np.dot(left, right) / np.dot(left, left))
    if not inverse > 0:
        raise DataError(_ALIKE, _TILT)
    return 1 / float(np.sqrt(inverse))


def _pose(homography: Floats, focal: float, middle: tuple[float, float]) -> Floats:
    """Rotation vector and place of a board from its homography."""
    inverse = np.array([[1 / focal, 0, -middle[0] / focal], [0, 1 / focal, -middle[1] / focal], [0, 0, 1.0]])
    columns = inverse @ homography
    scale = 2 / (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1]))
    columns = columns * (scale if columns[2, 2] > 0 else -scale)
    u, _, v = np.linalg.svd(np.stack([columns[:, 0], columns[:, 1], np.cross(columns[:, 0], columns[:, 1])], axis=1))
    turn = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), columns[:, 2]])
