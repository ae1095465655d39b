"""A simulated sound card and its records, for the audio tests."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import pytest

from drivers.contracts import Radar
from drivers.records import AudioBlock
from hw_mocks.sound_card import AudioSettings, PulseSource, Sink, SoundCard, StreamServer, Synthesizer, available_paths
from hw_mocks.world import World
from polfuse_lab.rig import Geometry, Waveform
from processing.scene.model import FrontEnd, Point, Scene


@dataclass
class Rig:
    """World, synthesizer and sound card with one strong point."""

    world: World
    synthesizer: Synthesizer
    card: SoundCard
    stream: StreamServer
    pulse: PulseSource | None


def take(radar: Radar, frames: int, timeout_s: float = 8.0) -> AudioBlock:
    """One record, polled for."""
    radar.begin(frames)
    return finish(radar, timeout_s)


def finish(radar: Radar, timeout_s: float = 8.0) -> AudioBlock:
    """The record that was asked for."""
    deadline = time.monotonic() + timeout_s
    while (block := radar.poll()) is None:
        assert time.monotonic() < deadline, "the record never became whole"
        time.sleep(0.002)
    return block


def position_in_cycle(samples: np.ndarray, cycle: np.ndarray) -> int:
    """Where in the standing rig's cycle a record begins; -1 where it is not that signal, sample for sample."""
    doubled = np.concatenate([cycle] * (len(samples) // len(cycle) + 2))
    for start in np.flatnonzero((doubled[: len(cycle)] == samples[0]).all(axis=1)):
        if np.array_equal(doubled[start : start + len(samples)], samples):
            return int(start)
    return -1


def start_rig(*, pulse: bool = False, **audio: float) -> Rig:
    """A running sound card; the caller closes ``rig.card``."""
    world = World()
    scene = Scene(
        "one point",
        points=(Point("p", (0.0, 9.0, -1.0), np.array([[30, 9j], [9j, -30]])),),
        front_end=FrontEnd(noise=0.01),
    )
    waveform = Waveform(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.020, sweep_period_s=0.040)
    settings = AudioSettings(**audio)
    synthesizer = Synthesizer(scene, waveform, Geometry(antenna_height_m=1.069), settings, world, 1)
    stream = StreamServer(settings.sample_rate_hz)
    source = PulseSource(settings.sample_rate_hz) if pulse else None
    sinks: list[Sink] = [stream] if source is None else [stream, source]
    card = SoundCard(synthesizer, sinks)
    card.start()
    return Rig(world, synthesizer, card, stream, source)


def need(path: str) -> None:
    """Skip where this machine lacks an audio path."""
    if path not in available_paths():
        pytest.skip(f"audio path {path!r} needs libportaudio2 libasound2-plugins pulseaudio (Debian packages)")
