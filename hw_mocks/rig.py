"""A whole simulated rig: serial devices and sound card at the wire, the camera there or in process; one scene."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hw_mocks.faults import Fault, FaultKind, FaultScript
from hw_mocks.gige_camera import GigeCamera
from hw_mocks.grbl import start_grbl
from hw_mocks.line_faults import LINE_FAULTS
from hw_mocks.rig_bodies import Progress, look_at
from hw_mocks.rig_camera import start_gige_camera
from hw_mocks.rotator import start_rotator
from hw_mocks.scene_file import SceneFile, load_scene_file
from hw_mocks.sound_card import PulseSource, Sink, SoundCard, StreamServer, Synthesizer, available_paths
from hw_mocks.sound_card.card_faults import CARD_FAULTS
from hw_mocks.switch_box import start_switch_box
from hw_mocks.wire import Kind, Wire
from hw_mocks.world import World
from hw_mocks.world_link import WorldServer
from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig.toml_model import toml_value
from processing.scene.solids import SolidScene

Audio = Literal["auto", "pulse", "tcp"]
Camera = Literal["scene", "gige"]

ACTUATION_S = 0.015
SETTLE_S = 0.03
"""Twice the simulated switches' actuation."""
ACCELERATION_M_S2 = 10.0
"""A light trolley on a toothed belt."""
PULSE_LATENCY_S = 0.02
PULSE_GUARD_S = 0.03
"""Frames leave the simulator in blocks of 10 ms: the frame count's estimate of their instant is up to 11 ms late."""

DEVICE_FAULTS: Mapping[str, tuple[FaultKind, ...]] = {
    "switches": (*LINE_FAULTS, FaultKind.STUCK_SWITCH),
    "trolley": (*LINE_FAULTS, FaultKind.LOST_STEPS, FaultKind.STALL),
    "polarizer": (*LINE_FAULTS, FaultKind.LOST_STEPS, FaultKind.STALL, FaultKind.HEAT_ALARM),
    "radar": CARD_FAULTS,
    "camera": tuple(kind for kind in FaultKind if kind not in (FaultKind.STUCK_SWITCH, FaultKind.LOST_STEPS)),
}
"""The faults that each simulated device can have."""


class SimulatedRig:
    """Runs from construction to :meth:`close`; use it with ``with``.

    Args:
        scene_path: scene file.
        directory: where the rig keeps its copy of the scene (made if absent).
        seed: of all noise; the scene file's own if left out.
        audio: ``"pulse"`` (PortAudio over a private PulseAudio server), ``"tcp"`` (loopback, needs nothing installed),
            or ``"auto"`` for the best that this machine has. The stream over TCP is always there as well.
        serial: ``"pty"`` or ``"tcp"`` for the serial devices; the best that this machine has if left out.
        camera: ``"scene"`` (a driver that renders the scene by itself; works everywhere) or ``"gige"`` (a GigE Vision
            camera on a loopback address, which the rig file reaches through the project's GenTL producer). The scene's
            extinction ratio, noise and seed hold for either.
        bodies: those of a scene file of bodies (``polfuse_lab.simulation.rig_scene.read_bodies``). Both eyes' views of
            them are made before the devices start.
        progress: told which eye's, and the fraction done.

    Raises:
        PolfuseError: the scene file or a body is wrong, the audio path asked for is not installed, or the camera cannot
            start.
    """

    def __init__(
        self,
        scene_path: Path | str,
        directory: Path | str,
        *,
        seed: int | None = None,
        audio: Audio = "auto",
        serial: Kind | None = None,
        camera: Camera = "scene",
        bodies: SolidScene | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.file: SceneFile = load_scene_file(scene_path)
        self.seed = self.file.seed if seed is None else seed
        if self.seed < 0:
            raise PolfuseError(f"found seed {seed}", where="simulated rig", advice="give a seed of 0 or more")
        self.world = World()
        self._directory = Path(directory)
        self._directory.mkdir(parents=True, exist_ok=True)
        self._scene_copy = (self._directory / "scene.toml").resolve()
        if Path(scene_path).resolve() != self._scene_copy:
            # The camera reads the scene when it opens: it must be the one that the radar sees.
            shutil.copyfile(scene_path, self._scene_copy)
        self._seen = look_at(self.file, bodies, where=str(scene_path), progress=progress)
        self._picture = self._directory / "picture.npy"
        if self._seen.scene.picture is not None:
            np.save(self._picture, self._seen.scene.picture, allow_pickle=False)
        self._closing = contextlib.ExitStack()
        try:
            self._start(audio, serial, camera)
        except BaseException:
            self.close()
            raise

    def _start(self, audio: Audio, serial: Kind | None, camera: Camera) -> None:
        world, file = self.world, self.file
        self._pulse = self._open_pulse(audio)
        self._wires: dict[str, Wire] = {}
        self.switches = self._wire("switches", start_switch_box(world, actuation_s=ACTUATION_S, kind=serial))
        self.trolley = self._wire(
            "trolley",
            start_grbl(
                world,
                length_m=file.rail.length_m,
                feed_limit_m_s=file.rail.speed_m_s,
                acceleration_m_s2=ACCELERATION_M_S2,
                kind=serial,
            ),
        )
        self.polarizer = self._wire("polarizer", start_rotator(world, kind=serial))
        self.link = self._closing.enter_context(WorldServer(world))
        self.camera: GigeCamera | None = None
        if camera == "gige":
            self.camera = self._closing.enter_context(start_gige_camera(file, self._seen.scene, world, self.seed))
        self.stream = StreamServer(file.audio.sample_rate_hz)
        sinks: list[Sink] = [self.stream] if self._pulse is None else [self.stream, self._pulse]
        synthesizer = Synthesizer(
            self._seen.scene, file.waveform, file.geometry, file.audio, world, self.seed, self._seen.echoes
        )
        self._radar_faults = FaultScript()
        self.sound_card = SoundCard(synthesizer, sinks, faults=self._radar_faults)
        self._closing.callback(self.sound_card.close)
        self.sound_card.start()

    def _wire(self, name: str, wire: Wire) -> Wire:
        self._wires[name] = wire
        self._closing.callback(wire.close)
        return wire

    def _open_pulse(self, audio: Audio) -> PulseSource | None:
        if audio == "tcp" or (audio == "auto" and "pulse" not in available_paths()):
            return None
        if "pulse" not in available_paths():
            raise PolfuseError(
                "PortAudio over PulseAudio is not installed",
                where="simulated rig",
                advice="apt-get install libportaudio2 libasound2-plugins pulseaudio, or use audio = 'tcp'",
            )
        try:
            return PulseSource(self.file.audio.sample_rate_hz)
        except PolfuseError:
            if audio == "pulse":
                raise
            return None

    @property
    def faults(self) -> dict[str, FaultScript]:
        """The fault scripts of the devices that have one; time runs from when a fault is added."""
        camera = {} if self.camera is None else {"camera": self.camera.faults}
        return {name: wire.faults for name, wire in self._wires.items()} | {"radar": self._radar_faults} | camera

    def arm(self, faults: Iterable[tuple[str, Fault]]) -> None:
        """Add faults to devices; their time runs from now.

        Raises:
            PolfuseError: there is no such device, or it cannot have such a fault; nothing has been added then.
        """
        faults = list(faults)
        for name, fault in faults:
            allowed = [kind.value for kind in DEVICE_FAULTS.get(name, ())]
            if fault.kind.value not in allowed:
                what = f"cannot have the fault {fault.kind.value!r}" if allowed else "is no device with faults"
                advice = f"choose one of: {', '.join(allowed or DEVICE_FAULTS)}"
                raise PolfuseError(what, where=f"simulated {name}", advice=advice)
            if name not in self.faults:
                raise PolfuseError(
                    "has no faults while it is simulated in process",
                    where=f"simulated {name}",
                    advice="put it on the wire: camera = 'gige'",
                )
        for name, fault in faults:
            self.faults[name].add(fault)

    def __enter__(self) -> SimulatedRig:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all devices. Idempotent."""
        self._closing.close()

    def check(self) -> None:
        """Raise what ended the sound card or the camera by itself, if anything did.

        Raises:
            PolfuseError: the simulated sound card or camera failed.
        """
        if self.camera is not None:
            try:
                self.camera.check()
            except RuntimeError as error:
                raise PolfuseError(str(error), where="simulated rig", advice="check the scene file") from error
        failure = self.sound_card.failure
        if failure is not None:
            raise PolfuseError(
                f"the simulated sound card failed ({failure})", where="simulated rig", advice="check the scene file"
            ) from failure

    @property
    def picture(self) -> NDArray[np.float64] | None:
        """What the camera sees of bodies, :attr:`processing.scene.model.Scene.picture`; None for other scenes."""
        return self._seen.scene.picture

    @property
    def audio(self) -> str:
        """``"pulse"`` or ``"tcp"``: how the rig file reaches the sound card."""
        return "tcp" if self._pulse is None else "pulse"

    @property
    def endpoints(self) -> dict[str, str]:
        """Where each device is reached: serial addresses, the sound card's name, the loopback services."""
        radar = self.stream.url if self._pulse is None else f"portaudio:{self._pulse.device}"
        camera = {} if self.camera is None else {"camera": f"gige://{self.camera.address}:{self.camera.port}"}
        return {
            "switches": self.switches.url,
            "trolley": self.trolley.url,
            "polarizer": self.polarizer.url,
            "radar": radar,
            "audio_stream": self.stream.url,
            "world": self.link.url,
            **camera,
        }

    def write_rig(self, path: Path | str | None = None) -> Path:
        """Write a rig file that reaches this rig (``rig.toml`` in its directory unless told); returns where."""
        path = self._directory / "rig.toml" if path is None else Path(path)
        try:
            # It holds the tokens of the loopback services: for this user's eyes only.
            path.touch(mode=0o600)
            path.chmod(0o600)
            path.write_text(self.rig_toml(), encoding="utf-8")
        except OSError as error:
            raise PolfuseError(
                f"cannot be written ({error.strerror})", where=str(path), advice="choose another place for the rig file"
            ) from error
        return path

    def rig_toml(self) -> str:
        """The rig file's text."""
        file, wave, place = self.file, self.file.waveform, self.file.geometry
        radar_driver, radar_options = self._radar()
        rate = {"sample_rate_hz": file.audio.sample_rate_hz}
        parts = [
            "# A simulated rig, alive as long as the program that wrote this file.\n"
            "# The devices are simulated; the drivers that talk to them are the real ones.\n",
            _table("", {"name": f"simulated: {file.name}"}),
            _table("waveform", wave.model_dump()),
            _table("geometry", place.model_dump()),
            _table("radar", {"driver": radar_driver, **rate}),
            _table("radar.options", {**radar_options, **rate}),
            _table("switches", {"driver": "dowkey_ms", "settle_s": SETTLE_S}),
            # Simulated cycles are nothing that the user's own counters should know of.
            _table(
                "switches.options",
                {"port": self.switches.url, "settle_s": SETTLE_S, "cycles_folder": str(self._directory.resolve())},
            ),
            _table("trolley", {"driver": "grbl", "length_m": file.rail.length_m, "speed_m_s": file.rail.speed_m_s}),
            _table(
                "trolley.options",
                {"port": self.trolley.url, "length_m": file.rail.length_m, "feed_m_s": file.rail.speed_m_s},
            ),
        ]
        if file.camera is not None:
            camera = file.camera.model_dump()
            extinction = {"extinction_ratio": camera.pop("extinction_ratio")}
            driver, options = self._camera(camera, extinction)
            section = {"driver": driver, "pixel_format": "Mono16", **camera}
            if file.camera.mosaic != "none":
                section["mosaic_extinction_ratio"] = file.camera.extinction_ratio
            parts += [
                _table("camera", section),
                _table("camera.options", options),
            ]
        if file.camera is not None and file.camera.mosaic == "none":
            parts += [
                _table("polarizer", {"driver": "ell14", **extinction}),
                _table("polarizer.options", {"port": self.polarizer.url}),
            ]
        return "\n".join(parts)

    def _camera(self, camera: dict[str, object], extinction: dict[str, object]) -> tuple[str, dict[str, object]]:
        if self.camera is not None:
            # The rest is in the section already. Asked by its address alone: nothing may leave this machine.
            return "harvesters", {"cti": "aravis", "addresses": [self.camera.address]}
        source = {"scene_file": str(self._scene_copy), "world_url": self.link.url, "seed": self.seed}
        if self._seen.scene.picture is not None:
            source["picture_file"] = str(self._picture.resolve())
        return "scene", {**source, **camera, **extinction}

    def _radar(self) -> tuple[str, dict[str, object]]:
        if self._pulse is None:
            return "scene", {"url": self.stream.url}
        options = {"device": self._pulse.device, "latency_s": PULSE_LATENCY_S, "guard_s": PULSE_GUARD_S}
        return "sounddevice", {**options, "environment": self._pulse.environment}


NOTES = {
    "waveform": "nominal; the true sweep period is measured from the sync",
    "geometry": "the ground is z = -antenna_height_m",
    "radar": "beat and sync on a stereo audio port",
    "radar.options": "the simulated sound card",
    "switches": "two RF transfer switches",
    "trolley": "a stepper motor on a GRBL board",
    "camera": "sees the scene file through the simulated polarizer",
    "polarizer": "a rotation mount",
}


def _table(name: str, values: Mapping[str, object]) -> str:
    note = f"  # {NOTES[name]}" if name in NOTES else ""
    lines = [f"[{name}]{note}"] if name else []
    # TOML has no word for None: what is not there is left out.
    lines += [f"{key} = {toml_value(value)}" for key, value in values.items() if value is not None]
    return "\n".join([*lines, ""])
