"""Collects with the camera alone: a polarizer series with dark frames, and the active mode of the thesis's 6.3."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from polfuse_lab.plans.base import LoopedPlan
from polfuse_lab.plans.optics import OpticsPlan, covered_frames, turned_to
from polfuse_lab.plans.steps import Ask, AutoExpose, Checkpoint, Expose, Settle, Step, TurnSource

LAMP_OFF = "Switch the light source off for the frames of ambient light, then confirm."
LAMP_ON = "Switch the light source on again, then confirm."


class PolarizerSeriesPlan(LoopedPlan, OpticsPlan):
    """``polarizer_series``: frames at each angle of the polarizer, with dark frames before them."""

    kind: Literal["polarizer_series"] = "polarizer_series"
    """Frames at each angle of the polarizer."""
    dark_frames: int = Field(default=4, ge=0, le=10_000)
    """Frames taken with the lens covered, before the series; the operator is asked to cover and uncover it."""

    @property
    def uses_camera(self) -> bool:
        """Always."""
        return True

    def unpaused_steps(self, mosaic: bool) -> Iterator[Step]:
        """One series for each repeat."""
        for repeat in range(self.repeats):
            yield from OpticsPlan.steps(self, mosaic=mosaic)
            yield Checkpoint(repeat)

    def steps(self, *, mosaic: bool = False) -> Iterator[Step]:
        """Yield the plan's steps; see :meth:`polfuse_lab.plans.base.Plan.steps`."""
        return LoopedPlan.steps(self, mosaic=mosaic)


class ActiveOpticalPlan(LoopedPlan):
    """``active_optical``: polarizers before the light source and before the camera, as transmit and receive of a radar
    (thesis 6.3): frames HH, HV, VV and VH, source then camera, angles 0 and 90 degrees from horizontal."""

    kind: Literal["active_optical"] = "active_optical"
    """Polarized light source and camera."""
    source_angles_deg: tuple[float, ...] = Field(default=(0.0, 90.0), min_length=1)
    """Angles of the source's polarizer from horizontal, degrees."""
    sensor_angles_deg: tuple[float, ...] = Field(default=(0.0, 90.0), min_length=1)
    """Angles of the camera's polarizer from horizontal, degrees."""
    frames_per_pair: int = Field(default=4, ge=1, le=10_000)
    """Frames taken and averaged at each pair of angles."""
    settle_s: float = Field(default=0.05, ge=0, le=60)
    """Wait after a polarizer stands, s."""
    auto_exposure: bool = False
    """Find an exposure that saturates at no angle of the camera's polarizer, with the source at its first angle, and
    keep it; otherwise the rig file's holds."""
    dark_frames: int = Field(default=0, ge=0, le=10_000)
    """Frames taken with the lens covered, before all others; the operator is asked to cover and uncover it."""
    ambient_frames: int = Field(default=0, ge=0, le=10_000)
    """Frames at each angle of the camera's polarizer with the source switched off by the operator."""

    @property
    def uses_camera(self) -> bool:
        """Always."""
        return True

    def unpaused_steps(self, mosaic: bool) -> Iterator[Step]:
        """Source angle after source angle; the camera's angles there and back, so that less is turned."""
        source = tuple(map(math.radians, self.source_angles_deg))
        sensor = (0.0,) if mosaic else tuple(map(math.radians, self.sensor_angles_deg))
        for repeat in range(self.repeats):
            if self.auto_exposure:
                yield TurnSource(source[0])
                yield AutoExpose(() if mosaic else sensor)
            if self.dark_frames:
                yield from self._sensor_at(sensor[0], mosaic)
                yield from covered_frames(self.dark_frames, sensor[0])
            if self.ambient_frames:
                yield Ask(LAMP_OFF)
                for angle in sensor:
                    yield from self._sensor_at(angle, mosaic)
                    yield Expose(self.ambient_frames, angle)
                yield Ask(LAMP_ON)
            for number, lit in enumerate(source):
                yield TurnSource(lit)
                if self.settle_s:
                    yield Settle(self.settle_s)
                for angle in sensor[::-1] if number % 2 else sensor:
                    yield from self._sensor_at(angle, mosaic)
                    yield Expose(self.frames_per_pair, angle, source_angle_rad=lit)
            yield Checkpoint(repeat)

    def _sensor_at(self, angle_rad: float, mosaic: bool) -> Iterator[Step]:
        return iter(()) if mosaic else turned_to(angle_rad, self.settle_s)
