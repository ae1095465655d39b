"""Exposures of a turning polarizer between which something moved, corrected by its velocity: stage ``"motion"``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.optics import UNITS, pinhole, pinhole_of
from polfuse_lab.products.optics_frames import camera_of, is_active, refuse_changes, stacked, usable_frames
from polfuse_lab.products.store import Products
from polfuse_lab.session import Session, open_session
from processing.motion.division_of_time import camera_displacement, compensate, error_image, touched
from processing.motion.flow import displacement_by_pictures
from processing.optics.camera_model import Pinhole
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stack import SAME_ANGLE_RAD, AveragedSeries
from processing.optics.stokes import StokesImage

Floats = NDArray[np.float64]

STAGE = "motion"


@dataclass(frozen=True)
class MotionResult:
    """Pictures before and after the correction."""

    products: Path
    before: StokesImage
    after: StokesImage
    error_before: Floats
    """(rows, columns) how far the exposures contradict each other, counts."""
    error_after: Floats
    object_mask: NDArray[np.bool_]
    hidden: NDArray[np.uint8]
    displacement_px: Floats
    """(K, 2) mean over the object, down and right, in the order of the exposures in time."""
    time_s: Floats
    """(K,) exposures, from the first."""
    velocity_from: str
    """``"given"`` or ``"pictures"``."""

    @property
    def error_down_db(self) -> float:
        """By how much the error image's power falls where the exposures contradicted each other, dB."""
        return float(10 * np.log10(self._power(self.error_before) / max(self._power(self.error_after), 1e-300)))

    @property
    def undefined(self) -> int:
        """Pixels of which too few exposures are left."""
        return int(np.count_nonzero(~np.isfinite(self.error_after)))

    def _power(self, error: Floats) -> float:
        typical = float(np.median(self.error_before)) / 0.674
        there = (self.error_before > 6 * typical) & np.isfinite(self.error_after)
        return float(np.mean(error[there] ** 2)) if there.any() else 1e-300


def correct_exposures(
    session_path: Path | str,
    products_path: Path | str,
    *,
    velocity_m_s: tuple[float, float] | None = None,
    height_m: float = 0.0,
) -> MotionResult:
    """Take the traces of one moving object out of a polarizer series and write the stage ``"motion"``.

    Arrays as of stage "optics", and ``dolp_before``, ``error_before``, ``error_after`` (counts), ``object``,
    ``hidden``. Everything is shown where it was at the first exposure.

    Args:
        session_path: a session with a polarizer series of four angles or more.
        products_path: the products file; made if it is not there, its other stages are kept.
        velocity_m_s: (vx, vy) of the object over the ground, as the radar measured it; without it the pictures tell.
        height_m: height of the object's surface above the ground.

    Raises:
        PolfuseError: no such series.
        DataError: nothing moved, or too few angles.
    """
    with open_session(session_path) as session:
        camera = camera_of(session)
        if is_active(session) or camera.has_mosaic or session.rig is None or session.rig.polarizer is None:
            raise PolfuseError(
                "holds no frames of a polarizer that turned before the camera alone",
                where=str(session.path),
                advice="only such series are taken angle by angle; use 'polfuse optics'",
            )
        refuse_changes(session)
        averaged = stacked(session, camera, usable_frames(session)).averaged(
            noise=SensorNoise(camera.read_noise_counts, camera.electrons_per_count),
            extinction_ratio=session.rig.polarizer.extinction_ratio,
        )
        time = _times(session, averaged.series.angles_rad)
        ground = height_m - session.rig.geometry.antenna_height_m
        seen = pinhole(camera)
    result = _corrected(averaged, time, seen, ground, velocity_m_s, Path(products_path))
    _write(result, session_path, velocity_m_s, height_m)
    return result


def correct_simulated(
    products_path: Path | str, *, velocity_m_s: tuple[float, float] | None = None, height_m: float = 0.0
) -> MotionResult:
    """As :func:`correct_exposures`, of the stage "exposures" of a simulated scene; written to the same file.

    Args:
        products_path: the simulation's products file.
        velocity_m_s, height_m: as :func:`correct_exposures`.

    Raises:
        PolfuseError: no such stage.
        DataError: nothing moved.
    """
    store = Products(products_path)
    held, settings = store.read("exposures"), store.settings("exposures")
    light, angles = held["electrons"], tuple(settings["angles_rad"])
    count = len(angles)
    series = PolarizerSeries(angles, (int(settings["frames"]),) * count, (0.0,) * count, noise=SensorNoise(0.0, 1.0))
    averaged = AveragedSeries(light, np.zeros(light.shape[1:], dtype=np.bool_), series, incomplete=False)
    result = _corrected(averaged, held["time_s"], pinhole_of(settings), height_m, velocity_m_s, store.path)
    _write(result, store.path, velocity_m_s, height_m)
    return result


def _corrected(
    averaged: AveragedSeries,
    time: Floats,
    camera: Pinhole,
    z_m: float,
    velocity_m_s: tuple[float, float] | None,
    products: Path,
) -> MotionResult:
    """Exposures without the traces of what moves on the plane ``z_m``."""
    order = np.argsort(time)
    light = averaged.light[order].astype(np.float64)
    matrix = averaged.series.matrix[order]
    if velocity_m_s is None:
        fields, told = displacement_by_pictures(light, matrix, time[order]), "pictures"
    else:
        fields = camera_displacement(camera, (*velocity_m_s, 0.0), time[order], z_m)
        told = "given"
    made = compensate(light, matrix, fields)
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    after = replace(averaged, light=made.light[back].astype(np.float32))
    shown = made.object_mask if made.object_mask.any() else touched(light, matrix)
    way = np.array([[np.nanmean(axis[shown]) for axis in pair] for pair in fields]) if shown.any() else np.zeros((4, 2))
    return MotionResult(
        products, averaged.stokes(), after.stokes(), error_image(light, matrix),
        error_image(made.light, matrix), made.object_mask, made.hidden, way, time[order] - time.min(), told,
    )  # fmt: skip


def _write(
    result: MotionResult, session_path: Path | str, velocity_m_s: tuple[float, float] | None, height_m: float
) -> None:
    Products(result.products).write(
        STAGE,
        {
            **{name: getattr(result.after, name) for name in UNITS},
            "dolp_before": result.before.dolp,
            "error_before": result.error_before.astype(np.float32),
            "error_after": result.error_after.astype(np.float32),
            "object": result.object_mask.astype(np.uint8),
            "hidden": result.hidden,
        },
        settings={
            "velocity_m_s": velocity_m_s,
            "velocity_from": result.velocity_from,
            "height_m": height_m,
            "displacement_px": result.displacement_px.tolist(),
            "time_s": result.time_s.tolist(),
            "error_down_db": result.error_down_db,
        },
        inputs=[Path(session_path)],
        units={**UNITS, "dolp_before": "1", "error_before": "counts", "error_after": "counts"},
    )


def _times(session: Session, angles_rad: tuple[float, ...]) -> Floats:
    """(K,) mean time of the frames at each angle, s."""
    rows = session.frames
    usable = [rows[index] for index in usable_frames(session)]
    out = []
    for angle in angles_rad:
        at = [
            int(row["t_host_ns"]) for row in usable
            if not row["dark"] and not row["incomplete"] and abs(float(row["angle_rad"]) - angle) < SAME_ANGLE_RAD
        ]  # fmt: skip
        out.append(float(np.mean(np.asarray(at, dtype=np.float64) - session.first_host_ns)) * 1e-9)
    return np.asarray(out)
