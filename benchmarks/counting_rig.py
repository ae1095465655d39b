"""A rig without wires whose samples and frames count, as fast as they are asked for.

Every one can be accounted for: audio frame n is the number n (modulo 2**32) in two int16, camera frame n is a slope
plus n (modulo 2**16) in every pixel. The numbers go on from one session to the next.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.contracts import Operator
from drivers.records import (
    AudioBlock,
    Channel,
    ClockFix,
    Frame,
    Identity,
    Level,
    PolarizerFix,
    SwitchState,
    TrolleyFix,
)
from polfuse_lab.plans import Plan, parse_plan
from polfuse_lab.plans.dry_run import record_frames
from polfuse_lab.rig import Rig, parse_model
from polfuse_lab.scheduler import Control
from polfuse_lab.scheduler.devices import Device, DeviceSet
from polfuse_lab.scheduler.lane import Lane

RATE_HZ = 192_000
FRAME_HZ = 60
SHAPE = (582, 782)
EXPOSURE_S = 0.001
PROBE_FRAMES = 256
"""Frames that the scheduler listens to before it begins, and does not keep."""
SWEEPS = 117
"""With a period of 40 ms: about 5 s of audio in one record."""
STEP_M = 0.1
ANGLES = 4

RIG = f"""\
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = 1.069
[radar]
driver = "counting"
sample_rate_hz = {RATE_HZ}
[switches]
driver = "counting"
settle_s = 0.0
[trolley]
driver = "counting"
length_m = 100.0
speed_m_s = 10.0
[camera]
driver = "counting"
width_px = {SHAPE[1]}
height_px = {SHAPE[0]}
exposure_s = 0.001
focal_length_m = 0.008
pixel_pitch_m = 8e-6
[polarizer]
driver = "counting"
"""


def rig() -> Rig:
    """The rig's description."""
    return parse_model(RIG, Rig, "counting rig")


def plan_toml(positions: int) -> str:
    """A plan of so many positions (1 to 30), with as many frames as the camera delivers during its audio."""
    audio_s = 4 * positions * record_frames(rig(), SWEEPS, RATE_HZ) / RATE_HZ
    return (
        f"aperture_m = {(positions - 1) * STEP_M:.4f}\nstep_m = {STEP_M if positions > 1 else 1e-9}\n"
        f"sweeps_per_channel = {SWEEPS}\nmove_settle_s = 0.0\n"
        f"[optics]\nangles_deg = [0.0, 45.0, 90.0, 135.0]\nframes_per_angle = {round(FRAME_HZ * audio_s / ANGLES)}\n"
        "settle_s = 0.0\n"
    )


def plan(positions: int) -> Plan:
    """:func:`plan_toml`, read."""
    return parse_plan(plan_toml(positions), "counting plan")


def counted_audio(first: int, frames: int) -> NDArray[np.int16]:
    """Audio frames ``first`` to ``first + frames``: (frames, 2)."""
    return np.arange(first, first + frames, dtype=np.int64).astype("<u4").view("<i2").reshape(-1, 2)


def counted_image(number: int, out: NDArray[np.uint16] | None = None) -> NDArray[np.uint16]:
    """Camera frame ``number``."""
    image: NDArray[np.uint16] = np.add(_SLOPE, np.uint16(number % 65_536), out=out)
    return image


_SLOPE = np.add.outer(np.arange(SHAPE[0]) * 13, np.arange(SHAPE[1]) * 7).astype(np.uint16)


class _Still:
    """What all these devices have in common."""

    kind = ""

    def open(self) -> Identity:
        """It is there."""
        return Identity(self.kind, "counting", f"counting {self.kind}")

    def make_safe(self) -> None:
        """It is safe."""

    def close(self) -> None:
        """Nothing to release."""

    def stop(self) -> None:
        """It stands."""


class CountingRadar(_Still):
    """Delivers whatever is asked for at once."""

    kind = "radar"
    sample_rate_hz = float(RATE_HZ)
    lost_frames = 0

    def __init__(self, first: int) -> None:
        self.next = first
        self._asked = 0

    def begin(self, frames: int) -> None:
        """Ask for frames."""
        self._asked = frames

    def poll(self) -> AudioBlock:
        """The frames asked for."""
        first, frames = self.next, self._asked
        if frames > PROBE_FRAMES:
            self.next += frames
        samples = counted_audio(first, frames)
        # They are here since they are over.
        begun_ns = time.monotonic_ns() - round(frames / RATE_HZ * 1e9)
        return AudioBlock(samples, self.sample_rate_hz, first, first / RATE_HZ, begun_ns)

    def cancel(self) -> None:
        """Nothing waits."""

    def level(self) -> Level:
        """None."""
        return Level()

    def clock(self) -> ClockFix:
        """The host's clock itself."""
        now = time.monotonic_ns()
        return ClockFix("radar", now * 1e-9, now, 1000)


class CountingCamera(_Still):
    """A frame for each trigger, at once."""

    kind = "camera"
    shape = SHAPE
    lost_frames = 0

    def __init__(self, first: int) -> None:
        self.next = first

    def trigger(self) -> None:
        """Ask for a frame."""

    def poll(self) -> Frame:
        """The next frame."""
        number = self.next
        self.next += 1
        # It is here since its exposure is over.
        begun_ns = time.monotonic_ns() - round(EXPOSURE_S * 1e9)
        return Frame(counted_image(number), number, EXPOSURE_S, 0.0, number / FRAME_HZ, begun_ns)

    def clock(self) -> ClockFix | None:
        """It has none."""
        return None


class _Switches(_Still):
    kind = "switches"
    route = Channel.HH

    def select(self, channel: Channel) -> SwitchState:
        self.route = channel
        return self.state()

    def state(self) -> SwitchState:
        return SwitchState(self.route.transmit, self.route.receive, True, time.monotonic_ns())


class _Trolley(_Still):
    kind = "trolley"
    limits_m = (-50.0, 50.0)
    x_m = 0.0

    def start_move(self, x_m: float, speed_m_s: float | None = None) -> None:
        self.x_m = x_m

    def poll(self) -> TrolleyFix:
        return TrolleyFix(self.x_m, 0.0005, False, time.monotonic_ns(), "Idle")


class _Polarizer(_Still):
    kind = "polarizer"
    angle_rad = 0.0

    def start_turn(self, angle_rad: float) -> None:
        self.angle_rad = angle_rad

    def poll(self) -> PolarizerFix:
        return PolarizerFix(self.angle_rad, 0.001, False, time.monotonic_ns())


class CountingRig:
    """Makes the devices of one collect after another; the numbers go on. A ``DeviceMaker`` of the scheduler."""

    def __init__(self, first_sample: int = 0, first_frame: int = 0) -> None:
        self.radar = CountingRadar(first_sample)
        self.camera = CountingCamera(first_frame)

    def __call__(self, rig: Rig, path: Path, operator: Operator, control: Control, kinds: Sequence[str]) -> DeviceSet:
        """The devices of a collect."""
        devices = DeviceSet(control)
        for made in (self.radar, _Switches(), _Trolley(), self.camera, _Polarizer()):
            if made.kind in kinds:
                devices.by_kind[made.kind] = Device(made.kind, "counting", made, Lane(made.kind), by_hand=False)
        return devices
