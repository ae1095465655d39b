"""Pictures of a chessboard through a camera with a known lens."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from processing.optics.camera_model import Pinhole

Floats = NDArray[np.float64]
CORNERS = (6, 9)
SIDE_M = 0.05
LENS = (-0.22, 0.09, 0.0008, -0.0012)
CAMERA = Pinhole(0.008, 8.3e-6, 782, 582, distortion=LENS, principal_offset_px=(6.3, -4.8))
"""The thesis's camera with the distortion of a cheap lens of 8 mm."""


def poses(count: int, seed: int = 0) -> list[tuple[Rotation, Floats]]:
    """Boards tilted by 15 to 40 degrees this way and that, over the whole sensor."""
    random = np.random.default_rng(seed)
    out = []
    for k in range(count):
        way = 2 * np.pi * k / count + random.uniform(-0.3, 0.3)
        tilt = np.radians(random.uniform(15, 40))
        turn = Rotation.from_rotvec(tilt * np.array([np.cos(way), np.sin(way), 0])) * Rotation.from_euler(
            "z", random.uniform(-20, 20), degrees=True
        )
        middle = np.array([random.uniform(-0.12, 0.12), random.uniform(-0.09, 0.09), random.uniform(0.75, 0.95)])
        out.append((turn, middle))
    return out


def board_to_world(turn: Rotation, middle: Floats, places: Floats) -> Floats:
    """Rig coordinates of places (..., 2) on the board from its middle; the camera looks along +y from the origin."""
    flat = np.concatenate([places, np.zeros((*places.shape[:-1], 1))], axis=-1)
    local = flat @ turn.as_matrix().T + middle
    return np.stack([local[..., 0], local[..., 2], -local[..., 1]], axis=-1)


def corners_of(turn: Rotation, middle: Floats, camera: Pinhole = CAMERA) -> Floats:
    """(rows, columns, 2) true image places of the inner corners."""
    rows, columns = CORNERS
    x, y = np.meshgrid(np.arange(columns) - (columns - 1) / 2, np.arange(rows) - (rows - 1) / 2)
    u, v, _ = camera.project(board_to_world(turn, middle, SIDE_M * np.stack([x, y], axis=-1)))
    return np.stack([u, v], axis=-1)


def picture_of(turn: Rotation, middle: Floats, random: np.random.Generator, camera: Pinhole = CAMERA) -> Floats:
    """(rows, columns) picture, 0 to 1, each pixel the mean of 3 x 3 rays, with 1 % of noise on a grey wall."""
    column, row = np.meshgrid(np.arange(float(camera.width_px)), np.arange(float(camera.height_px)))
    total = np.zeros(camera.shape)
    axes = turn.as_matrix()
    for du in (-1 / 3, 0.0, 1 / 3):
        for dv in (-1 / 3, 0.0, 1 / 3):
            ray = camera.rays(column + du, row + dv)
            local = np.stack([ray[..., 0], -ray[..., 2], ray[..., 1]], axis=-1)
            distance = (middle @ axes[:, 2]) / (local @ axes[:, 2])
            place = (local * distance[..., None] - middle) @ axes / SIDE_M
            i, k = place[..., 0] + (CORNERS[1] + 1) / 2, place[..., 1] + (CORNERS[0] + 1) / 2
            inside = (i > 0) & (i < CORNERS[1] + 1) & (k > 0) & (k < CORNERS[0] + 1)
            paper = (np.abs(i - 5) < 5.6) & (np.abs(k - 3.5) < 4.1)
            dark = inside & ((np.floor(i) + np.floor(k)) % 2 == 0)
            total += np.where(dark, 0.08, np.where(paper, 0.85, 0.45))
    return np.asarray(total / 9 + random.normal(0, 0.01, camera.shape))
