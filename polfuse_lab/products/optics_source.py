"""A session with polarizers before the light source and before the camera, as mean light at each pair of angles."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.optics_frames import by_source_angle, is_active, refuse_changes, stacked
from polfuse_lab.rig import CameraSection
from polfuse_lab.session import Session
from processing.optics.analyser_calibration import SAME_SETTING_RAD
from processing.optics.demosaic import demosaic_by
from processing.optics.flat import Corrections
from processing.optics.mosaic import ANGLES_DEG, parse_mosaic, spread
from processing.optics.stack import Means


class SourceSeries:
    """Mean light of a session of plan kind ``active_optical`` at each pair of angles, and what belongs to it.

    Raises:
        PolfuseError: no source angles, or camera angles that are not the same at each of them.
        DataError: no complete frame at one of them.
    """

    light: NDArray[Any]
    """(J, K, rows, columns) corrected counts above black."""
    ambient: NDArray[Any] | None
    """(K, rows, columns) of the same with the source off; None where no such frame was taken."""
    frames: NDArray[np.int64]
    """(J, K) frames averaged."""
    ambient_frames: NDArray[np.int64] | None
    """(K,) frames averaged."""

    def __init__(self, session: Session, camera: CameraSection, corrections: Corrections) -> None:
        if not is_active(session) or session.rig is None or session.rig.source_polarizer is None:
            raise PolfuseError(
                "holds no frames with a polarizer before the light source",
                where=str(session.path),
                advice="collect with a plan of kind 'active_optical' and [source_polarizer] in the rig file",
            )
        refuse_changes(session)
        self._camera, self._corrections = camera, corrections
        polarizer = session.rig.polarizer
        self.source_extinction = session.rig.source_polarizer.extinction_ratio
        self.sensor_extinction = (
            camera.mosaic_extinction_ratio if camera.has_mosaic or polarizer is None else polarizer.extinction_ratio
        )
        groups, ambient, dark = by_source_angle(session)
        self.source_rad = tuple(angle for angle, _ in groups)
        means = [self._means(session, [*members, *dark]) for _, members in groups]
        background = self._means(session, [*ambient, *dark]) if ambient else None
        self.sensor_rad = means[0].angles_rad
        others = [*means[1:], *([] if background is None else [background])]
        if any(not self._same_angles(m) for m in others) or any(m.incomplete for m in means):
            raise PolfuseError(
                "its camera's polarizer did not stand at the same angles for each angle of the source's",
                where=str(session.path),
                advice="collect the whole series again",
            )
        self.light = np.stack([m.light for m in means])
        self.saturated = np.any([m.saturated for m in means], axis=0)
        self.frames = np.array([m.frames for m in means])
        self.dark_frames = means[0].dark_frames
        self.ambient = None if background is None else background.light
        self.ambient_frames = None if background is None else np.array(background.frames)

    @property
    def frames_taken(self) -> int:
        """Frames used, ambient and dark ones not counted."""
        return int(self.frames[:, 0].sum() if self._camera.has_mosaic else self.frames.sum())

    @property
    def ambient_taken(self) -> int:
        """Frames of ambient light used."""
        if self.ambient_frames is None:
            return 0
        return int(self.ambient_frames[0] if self._camera.has_mosaic else self.ambient_frames.sum())

    def _same_angles(self, other: Means) -> bool:
        a, b = np.asarray(self.sensor_rad), np.asarray(other.angles_rad)
        return a.shape == b.shape and bool(np.all(np.abs(a - b) < SAME_SETTING_RAD))

    def _means(self, session: Session, frames: list[int]) -> Means:
        """Corrected means; a mosaic's at its four angles."""
        camera = self._camera
        means = stacked(session, camera, frames).means(together=camera.has_mosaic)
        light, _ = self._corrections.apply(means.light)
        if not camera.has_mosaic:
            return replace(means, light=light.astype(np.float32))
        planes = demosaic_by("bilinear", light[0], parse_mosaic(camera.mosaic))
        angles = tuple(math.radians(angle) for angle in ANGLES_DEG)
        return Means(
            angles, (0.0,) * 4, means.frames * 4, planes, spread(means.saturated), means.dark_frames, means.incomplete
        )
