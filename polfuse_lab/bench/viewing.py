"""The camera in set-up mode: frame after frame for the live view, its exposure set or looked for."""

from __future__ import annotations

import time
from typing import cast

from drivers import contracts
from drivers.camera.auto_exposure import ExposureGoal, Seen, search
from drivers.errors import DeviceRefused, DeviceTimeout
from drivers.records import Frame
from polfuse_lab.bench.protocol import CameraView
from polfuse_lab.bench.station import Bench, Station
from polfuse_lab.records import Exposure, FrameFlag

FRAMES_PER_S = 30.0
"""As many frames are taken in a second, at most."""
SLACK_S = 10.0
"""A frame may come so much later than its exposure ends before the camera counts as lost, s."""
SPARSE = 4
"""Every so many rows and columns tell how much is saturated."""


class CameraStation(Station):
    """The camera."""

    LOOK_S = 0.005

    def __init__(self, bench: Bench, kind: str) -> None:
        super().__init__(bench, kind)
        section = bench.rig.camera
        assert section is not None
        self._section = section
        self._exposure_s = section.exposure_s
        self._limits_s: tuple[float, float] | None = None
        self._running, self._searching = True, False
        self._asked_at: float | None = None
        self._frames = 0
        self._saturated = 0.0

    @property
    def view(self) -> CameraView | None:
        """How it is; None while it is not open."""
        made = self.made
        if made is None or made.identity is None:
            return None
        shortest, longest = self._limits_s or (None, None)
        return CameraView(
            self._exposure_s, shortest, longest, self._frames, self._saturated, self._running, self._searching
        )

    def run(self, running: bool) -> None:
        """Take frame after frame, or none."""

        def switch() -> None:
            self._running = running
            self.bench.on_change()

        self.ask(switch)

    def expose(self, seconds: float) -> None:
        """Expose so long from the next frame on, s."""
        self.ask(lambda: self._expose(seconds))

    def find_exposure(self) -> None:
        """Look for an exposure that does not saturate."""
        self.ask(self._search)

    @property
    def _device(self) -> contracts.Camera:
        assert self.made is not None
        return cast(contracts.Camera, self.made.device)

    @property
    def _adjustable(self) -> contracts.ExposureControl:
        if self._limits_s is None:
            raise DeviceRefused(
                "its exposure cannot be set from here",
                where=f"camera ({self.driver})",
                advice="set exposure_s in the rig file",
            )
        return cast(contracts.ExposureControl, self._device)

    def opened(self) -> None:
        """Ask for the limits of the exposure, where it has any."""
        self._asked_at = None
        self._exposure_s = self._section.exposure_s
        try:
            device = cast(contracts.ExposureControl, self._device)
            adjustable = isinstance(self._device, contracts.ExposureControl)
            self._limits_s = self.call(device.exposure_limits) if adjustable else None
        except DeviceRefused:
            self._limits_s = None

    def look(self) -> None:
        """Ask for a frame, or for the one that was asked for. Raises :class:`DeviceError`."""
        if self._asked_at is None:
            if not self._running or self.made is None:
                self.LOOK_S = 0.1
                return
            self._trigger()
        frame = self._arrived()
        if frame is None:
            self.LOOK_S = 0.004
            return
        self._show(frame)
        # From trigger to trigger.
        self.LOOK_S = max(1 / FRAMES_PER_S - (time.monotonic() - self._triggered_at), 0.002)

    _triggered_at = 0.0

    def _trigger(self) -> None:
        self.call(self._device.trigger)
        self._asked_at = self._triggered_at = time.monotonic()

    def _arrived(self) -> Frame | None:
        frame = self.call(self._device.poll)
        if frame is not None:
            self._asked_at = None
        elif self._asked_at is not None and time.monotonic() > self._asked_at + self._exposure_s + SLACK_S:
            self._asked_at = None
            raise DeviceTimeout(
                "delivered no frame",
                where=f"camera ({self.driver})",
                advice="check its cable and its power, then try it again",
            )
        return frame

    def _show(self, frame: Frame) -> None:
        angle_rad, sd_rad, turning = self.bench.camera_angle()
        flags = FrameFlag.MOVED if turning else FrameFlag.NONE
        self.bench.feed.offer(Exposure(frame, angle_rad, sd_rad, flags=flags))
        self._frames += 1
        sparse = frame.image[::SPARSE, ::SPARSE]
        self._saturated = float((sparse >= self._section.saturation_counts).mean())

    def _take(self) -> Frame:
        """One frame with the present exposure, whatever was asked for before. Raises :class:`DeviceError`."""
        self._trigger()
        while (frame := self._arrived()) is None:
            self._control.slice(0.005)
        self._show(frame)
        return frame

    def _expose(self, seconds: float) -> None:
        low, high = self._limits_s or (0.0, float("inf"))
        control = self._adjustable
        if not low <= seconds <= high:
            raise DeviceRefused(
                f"an exposure of {seconds:g} s is outside {low:g} to {high:g} s",
                where=f"camera ({self.driver})",
                advice="choose one within",
            )
        self._exposure_s = self.call(control.set_exposure, seconds)
        self.bench.on_change()

    def _search(self) -> None:
        control = self._adjustable
        assert self._limits_s is not None
        goal = ExposureGoal(self._limits_s, self._section.saturation_counts, self._section.black_level_counts)
        asking = search(goal, self._exposure_s, 1)
        self._searching = True
        self.bench.on_change()
        seen: Seen | None = None
        try:
            while True:
                try:
                    look = next(asking) if seen is None else asking.send(seen)
                except StopIteration as end:
                    if end.value.problem:
                        self.bench.refuse(f"automatic exposure: {end.value.problem}")
                    return
                self._exposure_s = self.call(control.set_exposure, look.exposure_s)
                seen = Seen(self._exposure_s, goal.level(self._take().image))
        finally:
            self._searching = False
            self.bench.on_change()

    def closed(self) -> None:
        """Nothing is asked for any more."""
        self._asked_at = None
