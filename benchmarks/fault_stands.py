"""Stands on which faults are tried: a driver, the simulated device at its other end, and what one round of work is."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

from drivers.camera.process import CameraProcess
from drivers.polarizer.ell14 import Ell14
from drivers.radar.sound_port import SoundPort
from drivers.records import Channel
from drivers.switches.dowkey_ms import DowKeyMs
from drivers.switches.minicircuits_rc import MiniCircuitsRc
from drivers.switches.numato_relay import NumatoRelay
from drivers.trolley.encoder import EncoderTrolley
from drivers.trolley.grbl import GrblTrolley
from hw_mocks.encoder import start_encoder
from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.grbl import start_grbl
from hw_mocks.minicircuits import host_and_port, start_rc_box
from hw_mocks.numato import start_relays
from hw_mocks.rotator import start_rotator
from hw_mocks.scene_camera import SceneCamera
from hw_mocks.scene_radar import SceneRadar
from hw_mocks.sound_card import AudioSettings, PulseSource, Sink, SoundCard, StreamServer, Synthesizer, available_paths
from hw_mocks.switch_box import start_switch_box
from hw_mocks.wire import Wire
from hw_mocks.world import World
from hw_mocks.world_link import WorldServer
from polfuse_lab.live import sync_problem
from polfuse_lab.rig import Rig
from processing.scene.model import FrontEnd, Point, Scene

HUNG_S = 15.0
"""A round that takes longer hangs."""

SCENE = """\
[[surface]]
name = "wall"
corner_m = [-20.0, 20.0, -10.0]
edge_u_m = [40.0, 0.0, 0.0]
edge_v_m = [0.0, 0.0, 20.0]
s0 = 0.5
"""
RIG = {
    "waveform": {"centre_hz": 2.4e9, "bandwidth_hz": 80e6, "ramp_up_s": 0.02, "sweep_period_s": 0.04},
    "geometry": {"antenna_height_m": 1.069},
    "radar": {"driver": "scene"},
    "switches": {"driver": "dowkey_ms"},
    "trolley": {"driver": "grbl", "length_m": 1.0},
}


class Untruthful(Exception):
    """A driver said something that is not so, and did not notice."""


class Noticed(Exception):
    """A fault was noticed in the data that a driver delivered; the text is what the user is told."""


class Hung(Exception):
    """A round of work did not end."""


class Stand(Protocol):
    """A driver with its simulated device."""

    name: str
    driver: Any
    timeout_s: float
    """The driver's own time-out, s."""
    opening_s: float
    """Its own time-out for opening, s."""

    def round(self) -> None:
        """One round of work. Raises DeviceError, :class:`Noticed`, :class:`Untruthful` or :class:`Hung`."""

    def begin(self, kind: FaultKind, amount: float) -> None:
        """Begin a fault."""

    def end(self, kind: FaultKind) -> None:
        """End it."""

    def reset(self) -> None:
        """What a person does before the driver is opened again."""

    def close(self) -> None:
        """Release everything."""


def within(seconds: float = HUNG_S) -> Iterator[None]:
    """Ticks of 5 ms for a poll; raises :class:`Hung` when they are used up."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        yield
        time.sleep(0.005)
    raise Hung(f"no end after {seconds:g} s")


class _SerialStand:
    """What serial stands share: the wire's script."""

    def __init__(self, name: str, wire: Wire, driver: Any, timeout_s: float) -> None:
        self.name, self._wire, self.driver, self.timeout_s = name, wire, driver, timeout_s
        self.opening_s = timeout_s + 3.0
        self._late_s = 0.0

    def begin(self, kind: FaultKind, amount: float) -> None:
        """Begin a fault of the line or the device; ``SLOW`` by 0 is half as much again as the driver's time-out."""
        if kind is FaultKind.SLOW and amount == 0:
            amount = 1.5 * self.timeout_s
        self._late_s = amount if kind is FaultKind.SLOW else 0.0
        self._wire.faults.start(kind, amount=amount)
        self._wire.wake()

    def end(self, kind: FaultKind) -> None:
        """End it, and wait until the cable is back or late answers have arrived."""
        self._wire.faults.stop(kind)
        self._wire.wake()
        time.sleep(0.1 + self._late_s)

    def reset(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Close the driver, then its device."""
        self.driver.close()
        self._wire.close()


class SwitchStand(_SerialStand):
    """From HH to VV and back; the route that the driver states is compared with the true one."""

    def __init__(self, name: str, wire: Wire, driver: Any, timeout_s: float, world: World) -> None:
        super().__init__(name, wire, driver, timeout_s)
        self._world = world

    def round(self) -> None:
        """Both switches there and back."""
        for channel in (Channel.VV, Channel.HH):
            state = self.driver.select(channel)
            true = (self._world.transmit.at(), self._world.receive.at())
            if true != (state.transmit, state.receive):
                raise Untruthful(f"says {state.transmit}{state.receive}, is {''.join(true)}")


def dowkey_stand(folder: Path, timeout_s: float = 1.0) -> SwitchStand:
    """Dow-Key MS over a serial line."""
    world = World()
    wire = start_switch_box(world)
    options = DowKeyMs.Options(port=wire.url, timeout_s=timeout_s, settle_s=0.03, cycles_folder=str(folder))
    return SwitchStand("switches: Dow-Key MS", wire, DowKeyMs(options), timeout_s, world)


def numato_stand(folder: Path, timeout_s: float = 1.0) -> SwitchStand:
    """Numato relays over a serial line, with fail-safe switches."""
    world = World()
    wire = start_relays(world)
    options = NumatoRelay.Options(port=wire.url, timeout_s=timeout_s, settle_s=0.03, cycles_folder=str(folder))
    return SwitchStand("switches: Numato relays", wire, NumatoRelay(options), timeout_s, world)


def rc_stand(folder: Path, timeout_s: float = 1.0) -> SwitchStand:
    """Mini-Circuits RC over HTTP."""
    world = World()
    wire = start_rc_box(world)
    host, port = host_and_port(wire)
    options = MiniCircuitsRc.Options(
        host=host, port=port, timeout_s=timeout_s, settle_s=0.03, cycles_folder=str(folder)
    )
    return SwitchStand("switches: Mini-Circuits RC", wire, MiniCircuitsRc(options), timeout_s, world)


class TrolleyStand(_SerialStand):
    """GRBL: 0.2 m there and back; the position that the driver states is compared with the true one."""

    def __init__(self, folder: Path, timeout_s: float = 2.0) -> None:
        self._world = World()
        wire = start_grbl(self._world, length_m=1.0, feed_limit_m_s=2.0)
        options = GrblTrolley.Options(port=wire.url, length_m=1.0, feed_m_s=2.0, timeout_s=timeout_s)
        super().__init__("trolley: GRBL", wire, GrblTrolley(options), timeout_s)

    def round(self) -> None:
        """There and back."""
        for x_m in (0.2, 0.0):
            self.driver.start_move(x_m)
            for _ in within():
                fix = self.driver.poll()
                if not fix.moving:
                    break
            true_m = self._world.trolley_x_m.at()
            if abs(true_m - fix.x_m) > 4 * fix.sd_m:
                raise Untruthful(f"says x = {fix.x_m:.4f} m, is {true_m:.4f} m")


class _Hand:
    """A person who does what is asked, and confirms nothing."""

    def ask(self, prompt: str) -> int:
        """Nothing to show."""
        return 1

    def answered(self, ticket: int) -> bool:
        """Never: the encoder itself tells."""
        return False

    def withdraw(self, ticket: int) -> None:
        """Nothing to take back."""


class EncoderStand(_SerialStand):
    """Hand-pushed with an encoder: 0.1 m there and back; the stated position is compared with the true one."""

    def __init__(self, folder: Path, timeout_s: float = 1.0) -> None:
        world = World()
        self._track = world.trolley_x_m
        wire = start_encoder(world)
        options = EncoderTrolley.Options(
            port=wire.url, length_m=1.0, counts_per_m=10_000.0, start_x_m=0.0, rest_s=0.1, silence_s=timeout_s
        )
        super().__init__("trolley: encoder", wire, EncoderTrolley(options, _Hand()), timeout_s)

    def round(self) -> None:
        """There and back, at 0.5 m/s. A trolley that does not seem to arrive within a second is no error by itself."""
        for x_m in (0.1, 0.0):
            self.driver.start_move(x_m)
            now_ns = time.monotonic_ns()
            start_m = self._track.at(now_ns)
            self._track.move(start_m, x_m, now_ns, now_ns + round(abs(x_m - start_m) / 0.5 * 1e9) + 1)
            for _ in within(2.0):
                fix = self.driver.poll()
                if not fix.moving:
                    break
            true_m = self._track.at()
            if abs(true_m - fix.x_m) > max(4 * fix.sd_m, 0.005):
                raise Untruthful(f"says x = {fix.x_m:.4f} m, is {true_m:.4f} m")

    def reset(self) -> None:
        """The trolley is pushed to where it stands when the driver is opened."""
        self._track.hold(0.0)


class PolarizerStand(_SerialStand):
    """ELL14: 60 degrees there and back; the angle that the driver states is compared with the true one."""

    def __init__(self, folder: Path, timeout_s: float = 2.0) -> None:
        self._world = World()
        wire = start_rotator(self._world)
        options = Ell14.Options(port=wire.url, timeout_s=timeout_s, turn_timeout_s=max(timeout_s, 1.5))
        super().__init__("polarizer: ELL14", wire, Ell14(options), max(timeout_s, 1.5))

    def round(self) -> None:
        """There and back."""
        for angle_deg in (60.0, 0.0):
            self.driver.start_turn(math.radians(angle_deg))
            for _ in within():
                fix = self.driver.poll()
                if not fix.moving:
                    break
            true_rad = self._world.polarizer_rad.at()
            if abs(math.remainder(true_rad - fix.angle_rad, 2 * math.pi)) > 4 * fix.sd_rad:
                raise Untruthful(f"says {fix.angle_rad:.3f} rad, is {true_rad:.3f} rad")


class RadarStand:
    """The simulated sound card over loopback TCP, or over PortAudio: records of four sweeps."""

    def __init__(self, folder: Path, timeout_s: float = 2.0, *, portaudio: bool = False) -> None:
        rig = Rig.model_validate(RIG)
        self._rig = rig
        self._faults = FaultScript()
        self.timeout_s = timeout_s
        self.opening_s = 5.0 if portaudio else timeout_s
        settings = AudioSettings()
        scene = Scene(
            "one point",
            points=(Point("p", (0.0, 9.0, -1.0), [[30, 0], [0, 30]]),),  # type: ignore[arg-type]
            front_end=FrontEnd(noise=0.01),
        )
        synthesizer = Synthesizer(scene, rig.waveform, rig.geometry, settings, World(), 1)
        rate = settings.sample_rate_hz
        sinks: list[Sink]
        if portaudio:
            source = PulseSource(rate)
            sinks = [source]
            self.name = "radar: PortAudio"
            sound = {"device": source.device, "environment": source.environment, "latency_s": 0.02, "guard_s": 0.03}
            self.driver: Any = SoundPort(SoundPort.Options(**sound, stall_timeout_s=timeout_s))  # type: ignore[arg-type]
        else:
            stream = StreamServer(rate)
            sinks = [stream]
            self.name = "radar: loopback"
            self.driver = SceneRadar(SceneRadar.Options(url=stream.url, timeout_s=timeout_s))
        self._card = SoundCard(synthesizer, sinks, faults=self._faults)
        self._card.start()
        self._within_record: tuple[FaultKind, float] | None = None

    def round(self) -> None:
        """One record; what is missing in it or wrong with it is told as the scheduler and the live view tell it."""
        rate = self.driver.sample_rate_hz
        self.driver.begin(round(0.16 * rate))
        begun = time.monotonic()
        try:
            for _ in within():
                if self._within_record is not None and time.monotonic() - begun > 0.08:
                    kind, amount = self._within_record
                    self._faults.start(kind, amount=amount)
                    self._within_record = None
                block = self.driver.poll()
                if block is not None:
                    break
        finally:
            self.driver.cancel()
        if block.lost_frames:
            raise Noticed(f"radar: {block.lost_frames} audio frames were lost; the record is taken again")
        problem = sync_problem(self._rig, block.samples, block.sample_rate_hz)
        if problem is not None:
            raise Noticed(f"radar: {problem}")

    def begin(self, kind: FaultKind, amount: float) -> None:
        """Begin a fault of the sound card; frames are lost in the middle of the next record."""
        if kind in (FaultKind.OVERFLOW, FaultKind.CLOCK_JUMP):
            self._within_record = kind, amount
        else:
            self._faults.start(kind, amount=amount)

    def end(self, kind: FaultKind) -> None:
        """End it."""
        self._faults.stop(kind)
        time.sleep(0.1)

    def reset(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Close the driver, then the sound card."""
        self.driver.close()
        self._card.close()


class CameraStand:
    """A camera in a process of its own that sees a scene: one frame. The faults are those of the process."""

    name = "camera: its process"

    def __init__(self, folder: Path, timeout_s: float = 1.5) -> None:
        self.timeout_s = timeout_s
        self.opening_s = 10.0
        self._world = WorldServer(World())
        scene = folder / "wall.toml"
        scene.write_text(SCENE)
        options = SceneCamera.Options(scene_file=str(scene), world_url=self._world.url, width_px=32, height_px=24)
        self.driver = CameraProcess("scene", options, watchdog_s=timeout_s)

    def round(self) -> None:
        """One frame."""
        self.driver.trigger()
        for _ in within():
            if self.driver.poll() is not None:
                return

    def begin(self, kind: FaultKind, amount: float) -> None:
        """``DISCONNECT``: the process dies. ``STALL``: it hangs."""
        pid = self.driver.pid
        assert pid is not None
        os.kill(pid, signal.SIGKILL if kind is FaultKind.DISCONNECT else signal.SIGSTOP)

    def end(self, kind: FaultKind) -> None:
        """A process that hangs goes on."""
        if kind is FaultKind.STALL and self.driver.pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.driver.pid, signal.SIGCONT)

    def reset(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Close the driver and the simulated world."""
        self.driver.close()
        self._world.close()


def portaudio_stand(folder: Path, timeout_s: float = 2.0) -> RadarStand:
    """The sound card over PortAudio."""
    return RadarStand(folder, timeout_s, portaudio=True)


STANDS: dict[str, Callable[..., Stand]] = {
    "switches: Dow-Key MS": dowkey_stand,
    "switches: Numato relays": numato_stand,
    "switches: Mini-Circuits RC": rc_stand,
    "trolley: GRBL": TrolleyStand,
    "trolley: encoder": EncoderStand,
    "polarizer: ELL14": PolarizerStand,
    "radar: loopback": RadarStand,
    "radar: PortAudio": portaudio_stand,
    "camera: its process": CameraStand,
}
"""Every stand by its name; called with a folder and, where it is to be quick, the driver's time-out."""


def missing(name: str) -> str:
    """Why a stand cannot be set up on this machine; empty when it can."""
    if name == "radar: PortAudio" and "pulse" not in available_paths():
        return "needs libportaudio2, libasound2-plugins and pulseaudio (Debian packages)"
    return ""


@contextlib.contextmanager
def standing(name: str, timeout_s: float | None = None) -> Iterator[Stand]:
    """A stand with its driver open, in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="polfuse-faults-") as folder:
        stand = STANDS[name](Path(folder)) if timeout_s is None else STANDS[name](Path(folder), timeout_s)
        try:
            stand.driver.open()
            yield stand
        finally:
            stand.close()
