"""WAV recordings of a cart pushed along a rail, the radar switched off in between, made by the simulated sound card."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.io import wavfile

from hw_mocks.sound_card.settings import AudioSettings
from hw_mocks.sound_card.synthesizer import Synthesizer
from hw_mocks.world import World
from polfuse_lab.rig import Geometry, Waveform
from processing.scene.model import FrontEnd, Point, Scene

HEIGHT_M = 1.069
STEP_M = 0.0508
WAVEFORM = Waveform(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.02, sweep_period_s=0.04)
GEOMETRY = Geometry(antenna_height_m=HEIGHT_M)
TARGETS = {"near": (-1.0, 6.0, -HEIGHT_M), "far": (1.5, 14.0, -HEIGHT_M)}
SCATTERING = {
    # Both co-polarized; only the far one turns the polarization, by closed form S_hv = S_vh.
    "near": np.diag([3.0, 3.0]).astype(np.complex128),
    "far": np.array([[6.0, 2.0], [2.0, -6.0]], dtype=np.complex128),
}


@dataclass(frozen=True)
class Gap:
    """What the sound card hears while the radar is off."""

    seconds: float = 0.5
    hum: float = 0.0
    """50 Hz on both channels, of full scale."""
    clicks: int = 0
    idle: float = 0.0
    """Level of the sync."""


def scene(targets=None, noise=0.002):
    points = tuple(Point(name, place, SCATTERING[name]) for name, place in (targets or TARGETS).items())
    return Scene("rail", points=points, front_end=FrontEnd(amplitude_at_1m=1.0, coupling=0.05, noise=noise))


def gap(settings, rng, sync_channel):
    count = round(settings.seconds * rng.uniform(0.8, 1.2) * 48_000)
    samples = rng.normal(size=(count, 2)) * 0.0005
    samples += settings.hum * np.sin(2 * np.pi * 50 * np.arange(count) / 48_000 + rng.uniform(0, 6))[:, None]
    samples[:, sync_channel] += settings.idle
    for _ in range(settings.clicks):
        at, width = rng.integers(0, count - 40), rng.integers(1, 30)
        samples[at : at + width] += rng.choice([-0.9, 0.9])
    return np.clip(np.rint(samples * 32_767), -32_768, 32_767).astype(np.int16)


def walk(
    positions=61,
    *,
    channel="VV",
    sweeps=4.6,
    silence=Gap(),
    step=STEP_M,
    stops=None,
    lengths=None,
    inverted=False,
    sync_channel=1,
    ramp_share=0.5,
    seed=1,
    the_scene=None,
    centre=0.0,
):
    """(n, 2) int16 samples at 48 kHz.

    ``stops`` are the numbers of the places visited (0, 1, 2, ... unless told), ``lengths`` how long the radar is on at
    each (in sweeps); ``centre`` moves the whole rail.
    """
    rng = np.random.default_rng(seed)
    period = 1920.5
    audio = AudioSettings(sync_inverted=inverted, sync_channel=sync_channel, sweep_period_samples=period)
    world = World()
    waveform = WAVEFORM.model_copy(update={"ramp_up_s": ramp_share * period / 48_000})
    card = Synthesizer(the_scene or scene(), waveform, GEOMETRY, audio, world, seed)
    world.transmit.set(channel[0], 0)
    world.receive.set(channel[1], 0)
    stops = range(positions) if stops is None else stops
    lengths = [sweeps] * len(stops) if lengths is None else lengths
    pieces = [gap(silence, rng, sync_channel)]
    for index, (stop, length) in enumerate(zip(stops, lengths, strict=True)):
        t_ns = (index + 1) * 10_000_000_000
        world.trolley_x_m.hold(centre + (stop - (positions - 1) / 2) * step, t_ns)
        # The switch is thrown at any moment of the sweep.
        first = int(rng.integers(0, audio.cycle_samples))
        pieces += [card.block(first, round(length * period), t_ns), gap(silence, rng, sync_channel)]
    return np.concatenate(pieces)


def write(path, samples, rate=48_000):
    wavfile.write(path, rate, samples)
    return path
