"""Stands of the radar's audio port, over loopback TCP and over PortAudio."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from benchmarks.stand import Noticed, within
from drivers.radar.sound_port import SoundPort
from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.scene_radar import SceneRadar
from hw_mocks.sound_card import AudioSettings, PulseSource, Sink, SoundCard, StreamServer, Synthesizer
from hw_mocks.world import World
from polfuse_lab.live import sync_problem
from polfuse_lab.rig import Rig
from processing.scene.model import FrontEnd, Point, Scene

RIG = {
    "waveform": {"centre_hz": 2.4e9, "bandwidth_hz": 80e6, "ramp_up_s": 0.02, "sweep_period_s": 0.04},
    "geometry": {"antenna_height_m": 1.069},
    "radar": {"driver": "scene"},
    "switches": {"driver": "dowkey_ms"},
    "trolley": {"driver": "grbl", "length_m": 1.0},
}


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


def portaudio_stand(folder: Path, timeout_s: float = 2.0) -> RadarStand:
    """The sound card over PortAudio."""
    return RadarStand(folder, timeout_s, portaudio=True)
