"""Series of frames behind the rotating polarizer, alone or in the middle of a radar plan."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pydantic import Field

from polfuse_lab.plans.steps import Ask, AutoExpose, Expose, Settle, StartTurn, Step, TurnPolarizer
from polfuse_lab.rig import FileModel

COVER = "Cover the camera's lens for the dark frames, then confirm."
UNCOVER = "Take the cover off the camera's lens, then confirm."


class OpticsPlan(FileModel):
    """The polarizer series that is taken at the aperture's centre."""

    angles_deg: tuple[float, ...] = Field(default=(0.0, 45.0, 90.0, 135.0), min_length=3)
    """Polarizer angles from horizontal, degrees."""
    frames_per_angle: int = Field(default=4, ge=1, le=10_000)
    """Frames taken and averaged at each angle."""
    settle_s: float = Field(default=0.05, ge=0, le=60)
    """Wait after the polarizer stands, s."""
    auto_exposure: bool = False
    """Find an exposure that saturates at no angle before the series, and keep it; otherwise the rig file's holds."""
    dark_frames: int = Field(default=0, ge=0, le=10_000)
    """Frames taken with the lens covered, before the series; the operator is asked to cover and uncover it."""

    @property
    def angles_rad(self) -> tuple[float, ...]:
        """Polarizer angles, radians."""
        return tuple(math.radians(angle_deg) for angle_deg in self.angles_deg)

    def early_steps(self, *, mosaic: bool) -> Iterator[Step]:
        """What can be begun while the radar still records: the turn to the first angle."""
        if not mosaic:
            yield StartTurn(self.angles_rad[0])

    def steps(self, *, mosaic: bool) -> Iterator[Step]:
        """The series; with a mosaic of polarizers on the sensor, its frames are taken once and nothing is turned."""
        angles = () if mosaic else self.angles_rad
        if self.auto_exposure:
            yield AutoExpose(angles)
        if mosaic:
            yield from covered_frames(self.dark_frames, 0.0)
            yield Expose(self.frames_per_angle, 0.0)
            return
        if self.dark_frames:
            yield TurnPolarizer(angles[0])
            yield from covered_frames(self.dark_frames, angles[0])
        for angle in angles:
            yield from turned_to(angle, self.settle_s)
            yield Expose(self.frames_per_angle, angle)


def covered_frames(frames: int, angle_rad: float) -> Iterator[Step]:
    """Frames with the lens covered by the operator, at the present angle; nothing for 0 frames."""
    if frames:
        yield Ask(COVER)
        yield Expose(frames, angle_rad, dark=True)
        yield Ask(UNCOVER)


def turned_to(angle_rad: float, settle_s: float) -> Iterator[Step]:
    """Turn the polarizer and let it settle."""
    yield TurnPolarizer(angle_rad)
    if settle_s:
        yield Settle(settle_s)
