"""Radar over camera while both are being collected: the camera's light on the ground, the radar's colours on it."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.live.board import Board
from polfuse_lab.live.forming import Formed, pauli_rgb
from polfuse_lab.live.listening import level_db
from polfuse_lab.live.pictures import Polarized
from polfuse_lab.live.ring import Array
from polfuse_lab.products.optics import pinhole
from polfuse_lab.rig import Rig
from processing.fusion.registration import GeometryErrors, ground_to_camera, registration_error, sample_bilinear
from processing.optics.debias import debias
from processing.sar.grid import ImageGrid

EVERY_S = 0.5
ANGLE_SD_RAD = float(np.radians(1.0))
HEIGHT_SD_M = 0.3
"""How well direction and heights are usually known, as 'polfuse fuse' takes them."""


class Overlay:
    """Puts the newest image over the newest picture, where the camera's place is known. Used by one thread."""

    def __init__(self, rig: Rig, board: Board) -> None:
        self._rig, self._board = rig, board
        self._camera = None if rig.camera is None else pinhole(rig.camera)
        self._done: tuple[int, int] = (-1, -1)
        self._at = 0.0
        self._error: tuple[ImageGrid, float] | None = None

    def show(self, formed: Formed | None, polarized: Polarized | None, *, now: bool = False) -> None:
        """Make the picture when either has changed; not too often, unless ``now``."""
        if formed is None or polarized is None or self._camera is None:
            return
        news = formed.t_sample_ns, polarized.t_sample_ns
        at = time.monotonic()
        if news == self._done or (at - self._at < EVERY_S and not now):
            return
        self._done, self._at = news, at
        grid, image = formed.grid, polarized.image
        u, v = ground_to_camera(self._camera, grid.x_m, grid.y_m, grid.z_m)
        # From pixels of the sensor to those of the picture, whose centres are whole numbers too.
        u, v = ((at + 0.5) / polarized.factor - 0.5 for at in (u, v))
        # Stokes parameters are interpolated, never DOLP.
        masked = ~np.isfinite(image.dolp)
        planes = [np.where(masked, np.nan, plane) for plane in (image.s0, image.s1, image.s2, image.s0_sd)]
        s0, s1, s2, sd = (sample_bilinear(plane, u, v) for plane in planes)
        with np.errstate(divide="ignore", invalid="ignore"):
            # Behind angles that are spread evenly, S1 and S2 have twice the variance of S0.
            dolp = debias(np.hypot(s1, s2), 2 * sd**2) / s0
        span_db = level_db(np.sqrt(np.sum(np.abs(formed.image) ** 2, axis=0)))
        arrays: dict[str, Array] = {
            "x_m": grid.x_m,
            "y_m": grid.y_m,
            "s0": s0.astype(np.float32),
            "dolp": dolp.astype(np.float32),
            "span_db": span_db,
            "rgb": blended(s0, formed, span_db),
        }
        self._board.put(
            "fusion",
            arrays,
            t_sample_ns=max(news),
            units={"x_m": "m", "y_m": "m", "s0": "counts", "dolp": "1", "span_db": "dB of full scale * m^2",
                   "registration_error_px": "px"},
            values={"registration_error_px": self._registration(grid)},
            slots=2,
        )  # fmt: skip

    def _registration(self, grid: ImageGrid) -> float:
        """Median error of the registration where the camera sees the ground, pixels of the sensor."""
        if self._error is None or self._error[0] is not grid:
            assert self._camera is not None
            cell = self._rig.waveform.range_resolution_m / np.sqrt(12)
            errors = GeometryErrors(cell, cell, ANGLE_SD_RAD, HEIGHT_SD_M)
            u, _ = ground_to_camera(self._camera, grid.x_m, grid.y_m, grid.z_m)
            seen = np.isfinite(u)
            total = registration_error(self._camera, grid.x_m, grid.y_m, grid.z_m, errors).total
            self._error = grid, float(np.nanmedian(total[seen])) if seen.any() else -1.0
        return self._error[1]


def blended(s0: NDArray[np.float64], formed: Formed, span_db: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(ny, nx, 3): the camera's light in grey, and over it the radar in Pauli colours as strong as its span.

    Where the camera sees nothing it is black; where the channels for Pauli colours are missing the radar is amber.
    """
    defined = s0[np.isfinite(s0)]
    low, high = np.percentile(defined, (1, 99)) if defined.size else (0.0, 1.0)
    grey = np.nan_to_num(np.clip((s0 - low) / max(high - low, 1e-9), 0, 1)) * 255
    share = np.nan_to_num(np.clip((span_db - formed.low_db) / max(formed.high_db - formed.low_db, 1e-6), 0, 1))
    colours = pauli_rgb(formed)
    if colours is None:
        colours = np.broadcast_to(np.array([255, 176, 0], dtype=np.uint8), (*s0.shape, 3))
    weight = share[..., None] ** 2
    mixed: NDArray[np.uint8] = (grey[..., None] * (1 - weight) + colours * weight).astype(np.uint8)
    return mixed
