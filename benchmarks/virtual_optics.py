"""Polarizers and camera in virtual time; see :mod:`benchmarks.virtual_devices`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.virtual_devices import ANGLE_UNIT_RAD, SHAPE, TURN_RAD_S, Truth, VirtualDevice
from drivers.errors import DeviceRefused
from drivers.records import ClockFix, Frame, PolarizerFix
from hw_mocks.world import Track

ARRIVAL_S = 0.004


class VirtualPolarizer(VirtualDevice):
    """The camera's polarizer, or with ``kind = "source_polarizer"`` the light source's."""

    kind = "polarizer"

    def __init__(self, truth: Truth, kind: str = "polarizer") -> None:
        super().__init__(truth)
        self.kind = kind
        self._until_ns = 0

    @property
    def track(self) -> Track:
        """Its true angle over time."""
        return self.truth.source_rad if self.kind == "source_polarizer" else self.truth.world.polarizer_rad

    def start_turn(self, angle_rad: float) -> None:
        """Begin to turn; as a real mount, it takes no order while it turns."""
        self.call(command=True)
        now = self.now_ns
        if now < self._until_ns:
            raise DeviceRefused("the mount is still turning", where=self.kind, advice="wait until it stands")
        start = self.track.at(now)
        self._until_ns = now + round(abs(angle_rad - start) / TURN_RAD_S * 1e9)
        self.track.move(start, angle_rad, now, self._until_ns)

    def poll(self) -> PolarizerFix:
        """How it stands."""
        self.call()
        return PolarizerFix(self.track.at(self.now_ns), 0.001, self.now_ns < self._until_ns, self.now_ns)

    def twist(self, by_rad: float) -> None:
        """Fault: somebody turns it while it stands."""
        if self.now_ns >= self._until_ns:
            angle = self.track.at(self.now_ns)
            self.track.move(angle, angle + by_rad, self.now_ns, self.now_ns + 5_000_000)

    def stop(self) -> None:
        """Stop now."""
        self.call()
        self.rest()

    def rest(self) -> None:
        """Stop now."""
        self.track.hold(self.track.at(self.now_ns), self.now_ns)
        self._until_ns = self.now_ns


class VirtualCamera(VirtualDevice):
    """Frames whose first pixels are the number and both polarizers' angles in the middle of the exposure."""

    kind = "camera"
    shape = SHAPE
    lost_frames = 0

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        self.incomplete = False
        """The next frame is incomplete."""
        self._exposure_s = 0.01
        self._number = 0
        self._due_ns: int | None = None

    def trigger(self) -> None:
        """Expose."""
        self.call(command=True)
        self._due_ns = self.now_ns + round((self._exposure_s + ARRIVAL_S) * 1e9)

    def poll(self) -> Frame | None:
        """The frame, once it has arrived."""
        self.call()
        if self._due_ns is None or self.now_ns < self._due_ns:
            return None
        begin_ns = self._due_ns - round((self._exposure_s + ARRIVAL_S) * 1e9)
        end_ns = begin_ns + round(self._exposure_s * 1e9)
        self._due_ns = None
        self._number += 1
        image = np.zeros(self.shape, np.uint16)
        image[0, 0] = self._number
        tracks = (self.truth.world.polarizer_rad, self.truth.source_rad)
        for row, track in enumerate(tracks, start=1):
            angles = track.at_many(np.linspace(begin_ns, end_ns, 5).astype(np.int64))
            image[row, :5] = np.round(angles / ANGLE_UNIT_RAD).astype(np.int64) % 65_536
        incomplete, self.incomplete = self.incomplete, False
        self.truth.frames[self._number] = self.truth.step()
        if self.late:
            self.truth.late.add((self.kind, self._number))
        return Frame(image, self._number, self._exposure_s, 0.0, begin_ns * 1e-9, begin_ns, incomplete)

    def exposure_limits(self) -> tuple[float, float]:
        """From 1 ms to 0.1 s."""
        self.call()
        return 0.001, 0.1

    def set_exposure(self, seconds: float) -> float:
        """Expose so long from now on."""
        self.call()
        self._exposure_s = min(max(seconds, 0.001), 0.1)
        return self._exposure_s

    def rest(self) -> None:
        """Forget the frame asked for."""
        self._due_ns = None

    def clock(self) -> ClockFix | None:
        """The host's own clock."""
        self.call()
        return ClockFix("camera", self.now_ns * 1e-9, self.now_ns, 1000)


def decode_angles(image: NDArray[np.uint16]) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]:
    """Number of a frame, and the true angles of the polarizer and of the source's, rad, at 5 instants each."""
    angles = image[1:3, :5].astype(np.int64)
    angles = np.where(angles > 32_767, angles - 65_536, angles)
    return int(image[0, 0]), angles[0] * ANGLE_UNIT_RAD, angles[1] * ANGLE_UNIT_RAD
