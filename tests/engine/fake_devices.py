"""Small devices with faults on demand for tests; they stand in as installed drivers."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.errors import DeviceLost, DeviceRefused
from drivers.records import AudioBlock, Channel, ClockFix, Frame, Identity, Level, PolarizerFix, SwitchState, TrolleyFix

STRICT = {"extra": "forbid"}


def audio(frames: int, *, first: int = 0, rate: float = 48_000.0, beat: float = 0.1, sync: float = 0.5):
    """Stereo int16: a 1 kHz beat on channel 0, a 40 ms square sync on channel 1."""
    t = (first + np.arange(frames)) / rate
    samples = np.empty((frames, 2))
    samples[:, 0] = beat * np.sin(2 * np.pi * 1000 * t)
    samples[:, 1] = sync * np.where(t % 0.04 < 0.02, 1.0, -1.0)
    return np.round(np.clip(samples, -1, 1) * 32767).astype(np.int16)


class Base:
    """Open, safe and close, with a log of what happened in the folder named by the options."""

    kind = ""

    def __init__(self, options):
        self.o = options

    def log(self, what):
        if self.o.log:
            with open(self.o.log, "a") as file:
                file.write(f"{time.monotonic_ns()} {self.kind} {what}\n")

    def open(self):
        self.log("open")
        if self.o.fault == "open" or os.path.exists(f"{self.o.log}.unplugged"):
            raise DeviceLost("nobody answers", where=f"fake {self.kind}", advice="plug it in")
        if self.o.fault == "slow_open":
            time.sleep(5)
        if self.o.fault == "bug":
            raise RuntimeError("portaudio library not found")
        return Identity(self.kind, "fake", f"fake {self.kind}")

    def make_safe(self):
        self.log("safe")
        if self.o.fault == "slow_safe":
            time.sleep(5)

    def close(self):
        self.log("close")


class Radar(Base):
    kind = "radar"

    @dataclass(frozen=True)
    class Options:
        __pydantic_config__ = STRICT
        log: str = ""
        fault: str = ""
        speed: float = 1.0
        lose: tuple[int, ...] = ()
        beat: float = 0.1

    sample_rate_hz = 48_000.0
    lost_frames = 0
    count = 0
    due = 0.0

    def begin(self, frames):
        if self.o.fault == "hang" and self.count > 2:
            time.sleep(30)
        self.frames = frames
        self.due = time.monotonic() + frames / self.sample_rate_hz / self.o.speed

    def begin_stream(self, frames):
        self.begin(frames)
        self.stream = True
        self.following = (self.count + 1) * 100_000

    stream = False

    def poll(self):
        if time.monotonic() < self.due or self.o.fault == "stall":
            return None
        if self.stream:
            return self.next_of_the_stream()
        lost = 100 if self.count in self.o.lose else 0
        self.count += 1
        if self.o.fault == "kill_engine" and self.count == 6:
            os.kill(os.getpid(), signal.SIGKILL)
        first = self.count * 100_000
        if self.o.fault == "silent":
            samples = np.zeros((self.frames, 2), np.int16)
        else:
            samples = audio(self.frames, first=first, beat=self.o.beat)
        return AudioBlock(samples, 48_000.0, first, time.monotonic(), time.monotonic_ns(), lost, False)

    def next_of_the_stream(self):
        lost = 100 if self.count in self.o.lose else 0
        self.count += 1
        first, self.following = self.following, self.following + self.frames + lost
        began, self.due = (
            self.due - self.frames / self.sample_rate_hz / self.o.speed,
            self.due + (self.frames / self.sample_rate_hz / self.o.speed),
        )
        return AudioBlock(
            audio(self.frames, first=first, beat=self.o.beat),
            48_000.0,
            first,
            began,
            round(began * 1e9),
            lost,
        )

    def cancel(self):
        self.stream = False
        self.log("cancel")

    def level(self):
        return Level()

    def clock(self):
        if self.o.fault == "unplugged" and os.path.exists(f"{self.o.log}.unplugged"):
            raise DeviceLost("nobody answers", where="fake radar", advice="plug it in")
        now = time.monotonic_ns()
        return ClockFix("radar", now * 1e-9, now, 1000)


class Switches(Base):
    kind = "switches"

    @dataclass(frozen=True)
    class Options:
        __pydantic_config__ = STRICT
        log: str = ""
        fault: str = ""

    route = "HH"
    states = 0

    def select(self, channel: Channel):
        self.route = channel.name
        self.log(f"select {channel.name}")
        return SwitchState(channel.transmit, channel.receive, True, time.monotonic_ns())

    def state(self):
        self.states += 1
        route = self.route
        # The third record's second look finds the switches elsewhere.
        if self.o.fault == "jump" and self.states == 6:
            self.route = route = "VV" if route != "VV" else "HH"
        return SwitchState(route[0], route[1], self.o.fault != "unverified", time.monotonic_ns())


class Trolley(Base):
    kind = "trolley"

    @dataclass(frozen=True)
    class Options:
        __pydantic_config__ = STRICT
        log: str = ""
        fault: str = ""
        pace_m_s: float = 20.0

    limits_m = (-2.0, 2.0)
    x = 0.0
    target = 0.0

    def start_move(self, x_m, speed_m_s=None):
        self.pace_m_s = speed_m_s or self.o.pace_m_s
        if abs(x_m) > 2:
            raise DeviceRefused("beyond its limits", where="fake trolley", advice="stay inside")
        if self.o.fault == "lost" and x_m > 0:
            raise DeviceLost("unplugged", where="fake trolley", advice="plug it in")
        self.start, self.target, self.t0 = self.x, x_m, time.monotonic()

    def poll(self):
        if self.x != self.target:
            way = self.target - self.start
            done = (time.monotonic() - self.t0) * self.pace_m_s
            self.x = self.target if done >= abs(way) else self.start + np.sign(way) * done
        return TrolleyFix(float(self.x), 0.0005, bool(self.x != self.target), time.monotonic_ns(), "Idle")

    def make_safe(self):
        self.stop()
        super().make_safe()

    def stop(self):
        self.target = self.x


class HandTrolley(Trolley):
    """Asks the operator; arrives when the answer comes."""

    def __init__(self, options, operator):
        super().__init__(options)
        self.operator, self.ticket = operator, None

    def start_move(self, x_m, speed_m_s=None):
        self.target = x_m
        self.ticket = self.operator.ask(f"move the trolley to {x_m:.3f} m")

    def poll(self):
        if self.ticket is not None and self.operator.answered(self.ticket):
            self.operator.withdraw(self.ticket)
            self.ticket, self.x = None, self.target
        return TrolleyFix(self.x, 0.002, self.ticket is not None, time.monotonic_ns(), "")

    def stop(self):
        if self.ticket is not None:
            self.operator.withdraw(self.ticket)
            self.ticket = None


class Polarizer(Base):
    kind = "polarizer"

    @dataclass(frozen=True)
    class Options:
        __pydantic_config__ = STRICT
        log: str = ""
        fault: str = ""

    angle = 0.0

    def start_turn(self, angle_rad):
        self.angle = angle_rad

    def poll(self):
        return PolarizerFix(self.angle, 0.001, False, time.monotonic_ns())

    def stop(self):
        pass


class Camera(Base):
    kind = "camera"

    @dataclass(frozen=True)
    class Options:
        __pydantic_config__ = STRICT
        log: str = ""
        fault: str = ""

    shape = (6, 8)
    lost_frames = 0
    number = 0

    def trigger(self):
        self.number += 1

    def poll(self):
        if self.o.fault == "slow":
            return None
        incomplete = self.o.fault == "incomplete" and self.number == 2
        image = np.full(self.shape, self.number, np.uint16)
        return Frame(image, self.number, 0.01, 0.0, time.monotonic(), time.monotonic_ns(), incomplete)

    def clock(self):
        return None


def install(folder: Path) -> None:
    """Make the devices of this module look like an installed package in ``folder`` (to be put on the path)."""
    info = folder / "polfuse_fakes-0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: polfuse-fakes\nVersion: 0\n")
    kinds = {"radar": "Radar", "switches": "Switches", "trolley": "Trolley", "polarizer": "Polarizer",
             "camera": "Camera"}  # fmt: skip
    lines = [f"[polfuse_lab.{kind}]\nfake = fake_devices:{name}\n" for kind, name in kinds.items()]
    lines.insert(3, "by_hand_fake = fake_devices:HandTrolley\n")
    (info / "entry_points.txt").write_text("".join(lines))
