"""A session's camera frames, averaged by the setting at which they were taken."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import FrameFlag
from polfuse_lab.rig import CameraSection
from polfuse_lab.session import Session
from processing.optics.stack import SAME_ANGLE_RAD, FrameStack


def camera_of(session: Session) -> CameraSection:
    """The session's camera. Raises :class:`PolfuseError` where there is none, or nothing that it took."""
    if session.rig is None or session.rig.camera is None:
        raise PolfuseError(
            "was taken without a camera",
            where=str(session.path),
            advice="collect with [camera] and [polarizer] in the rig file and [optics] in the plan",
        )
    if len(session.frames) == 0:
        raise PolfuseError(
            "holds no camera frames", where=str(session.path), advice="collect with [optics] in the plan file"
        )
    return session.rig.camera


def refuse_changes(session: Session, names: Iterable[str] = ("exposure_s", "gain_db")) -> None:
    """Raise :class:`PolfuseError` for frames of one series that were taken with different exposures or gains."""
    for name in names:
        values = np.unique(session.frames[name])
        if len(values) > 1:
            raise PolfuseError(
                f"its frames were taken with different {name}: {values[0]:g} to {values[-1]:g} "
                f"{'s' if name == 'exposure_s' else 'dB'}",
                where=str(session.path),
                advice="switch automatic exposure and gain off and take the series again",
            )


def usable_frames(session: Session) -> list[int]:
    """Numbers of the frames that were not taken again: those which no polarizer turned in."""
    return [index for index, row in enumerate(session.frames) if not int(row["flags"]) & int(FrameFlag.MOVED)]


def stacked(session: Session, camera: CameraSection, frames: Iterable[int]) -> FrameStack:
    """Frames of the session, averaged by angle of the camera's polarizer.

    Raises:
        PolfuseError: frames of another size than the rig file says.
    """
    stack = FrameStack(saturation_counts=camera.saturation_counts, black_level_counts=camera.black_level_counts)
    rows = session.frames
    for index in frames:
        image, row = session.frame(index), rows[index]
        if image.shape != (camera.height_px, camera.width_px):
            raise PolfuseError(
                f"frame {index} has {image.shape[1]} x {image.shape[0]} pixels, "
                f"its rig file says {camera.width_px} x {camera.height_px}",
                where=str(session.path),
                advice="give the rig file's [camera] the size that the camera delivers",
            )
        stack.add(
            image,
            float(row["angle_rad"]),
            angle_sd_rad=float(row["angle_sd_rad"]),
            dark=bool(row["dark"]),
            incomplete=bool(row["incomplete"]),
        )
    return stack


def is_active(session: Session) -> bool:
    """Whether frames were taken with a polarizer before the light source."""
    return bool(np.isfinite(session.frames["source_angle_rad"]).any())


def by_source_angle(session: Session) -> tuple[list[tuple[float, list[int]]], list[int], list[int]]:
    """Usable frames by angle of the source's polarizer in ascending order (radians, frame numbers), then those of
    ambient light, then the dark ones."""
    rows = session.frames
    groups: list[tuple[float, list[int]]] = []
    ambient, dark = [], []
    for index in usable_frames(session):
        angle = float(rows[index]["source_angle_rad"])
        if bool(rows[index]["dark"]):
            dark.append(index)
        elif not np.isfinite(angle):
            ambient.append(index)
        else:
            for known, members in groups:
                if abs(known - angle) < SAME_ANGLE_RAD:
                    members.append(index)
                    break
            else:
                groups.append((angle, [index]))
    return sorted(groups, key=lambda group: group[0]), ambient, dark
