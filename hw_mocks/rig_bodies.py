"""Bodies before the simulated rig: what the radar hears of them at any place of the rail, what the camera sees."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hw_mocks.scene_file import CameraEntry, SceneFile
from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import Geometry
from processing.errors import DataError
from processing.optics.camera_model import Pinhole
from processing.radar.antenna import boresight
from processing.scattering.contributions import Beam
from processing.scattering.rail_echoes import RailEchoes, RailRadar
from processing.scattering.shooting import Density
from processing.scene.model import Scene
from processing.scene.rail_scene import (
    Daylight,
    RailRays,
    bodies_along_rail,
    camera_picture,
    moved,
    points_along_rail,
)
from processing.scene.solids import SolidScene

Progress = Callable[[str, float], None]
"""Told which eye ("radar" or "camera") and the fraction of it that is done."""


@dataclass(frozen=True)
class Seen:
    """A scene as the rig's devices need it."""

    scene: Scene
    """With the camera's picture, if bodies are before a camera."""
    echoes: RailEchoes | None = None
    """Of bodies, or of points before antennas that are apart; else points are summed up when they are asked for."""


def look_at(
    file: SceneFile, bodies: SolidScene | None = None, *, where: str = "scene file", progress: Progress | None = None
) -> Seen:
    """What both eyes have of a scene file, before anything moves.

    Args:
        file: the scene file.
        bodies: its bodies, standing on z = 0: the ground, that is ``antenna_height_m`` below the rail.
        where: names the file in errors.
        progress: called as it goes on.

    Raises:
        PolfuseError: bodies that were not given, or given to a file without, or that cannot be simulated.
    """
    if bodies is None or not file.solid:
        if bodies is None and not file.solid:
            return Seen(file.scene(), _points_before_antennas_apart(file, where))
        raise PolfuseError(
            "bodies were not read from the scene file" if file.solid else "bodies are given, and the file has none",
            where=where,
            advice="read them with polfuse_lab.simulation.rig_scene.read_bodies",
        )
    try:
        placed = moved(bodies, (0.0, 0.0, -file.geometry.antenna_height_m))
        scene = file.scene()
        if file.camera is not None:
            picture = camera_picture(
                placed,
                pinhole(file.camera),
                Daylight(scene.sun_direction, file.sun.sky_share),
                samples=file.rays.samples,
                seed=file.seed,
                progress=_told(progress, "camera"),
            )
            # As the camera's own process will read it.
            scene = replace(scene, picture=picture.astype(np.float32))
        rays = RailRays(
            Density(file.rays.cell_m, file.rays.levels, file.rays.bounces),
            file.rays.points_per_m2,
            file.rays.step_m,
            file.seed,
        )
        seen = bodies_along_rail(placed, _span(file), _radar(file), rays, progress=_told(progress, "radar"))
    except DataError as error:
        raise PolfuseError(error.what, where=where, advice=error.advice) from error
    return Seen(scene, seen.echoes)


def _points_before_antennas_apart(file: SceneFile, where: str) -> RailEchoes | None:
    if file.geometry.phase_centres is None:
        return None
    try:
        return points_along_rail(file.scene(), _span(file), _radar(file))
    except DataError as error:
        raise PolfuseError(error.what, where=where, advice=error.advice) from error


def _span(file: SceneFile) -> tuple[float, float]:
    """x of the rail's ends, m."""
    return -file.rail.length_m / 2, file.rail.length_m / 2


def _radar(file: SceneFile) -> RailRadar:
    return rail_radar(file.geometry, file.waveform.centre_hz, file.waveform.bandwidth_hz)


def rail_radar(geometry: Geometry, centre_hz: float, bandwidth_hz: float) -> RailRadar:
    """The radar on its rail as a scene file tells it."""
    centres = geometry.phase_centres
    sent, received = np.zeros((2, 3)), np.zeros((2, 3))
    if centres is not None:
        sent = np.array([centres.transmit_h_m, centres.transmit_v_m], dtype=np.float64)
        received = np.array([centres.receive_h_m, centres.receive_v_m], dtype=np.float64)
    axis = boresight(math.radians(geometry.antenna_elevation_deg))
    return RailRadar(centre_hz, bandwidth_hz, sent, received, Beam(axis, math.radians(geometry.beamwidth_deg)))


def pinhole(camera: CameraEntry) -> Pinhole:
    """The scene file's camera."""
    return Pinhole(
        camera.focal_length_m,
        camera.pixel_pitch_m,
        camera.width_px,
        camera.height_px,
        camera.position_m,
        math.radians(camera.depression_deg),
    )


def _told(progress: Progress | None, eye: str) -> Callable[[float], None] | None:
    return None if progress is None else lambda done: progress(eye, done)
