"""Records for tests, each of which follows from its number alone."""

from __future__ import annotations

import numpy as np

from drivers.records import AudioBlock, Channel, ClockFix, Frame
from polfuse_lab.records import Exposure, Sweeps
from polfuse_lab.rig import Waveform
from polfuse_lab.session import SessionConfig

WAVEFORM = Waveform(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.02, sweep_period_s=0.04)
SHAPE = (12, 16)


def config(**changes) -> SessionConfig:
    fields = {"source": "test", "waveform": WAVEFORM, "sample_rate_hz": 48_000.0, "audio_block_frames": 500,
              "frame_shape": SHAPE}  # fmt: skip
    return SessionConfig(**(fields | changes))


def sweeps(number: int, frames: int = 500, dtype: str = "int16", **changes) -> Sweeps:
    samples = np.random.default_rng(number).integers(-30_000, 30_000, (frames, 2)).astype(dtype)
    block = AudioBlock(samples, 48_000.0, number * 10_000, number * 0.1, number * 100_000_000)
    return Sweeps(block, Channel(number % 4), number // 4, x_m=number * 0.01, **changes)


def exposure(number: int) -> Exposure:
    image = np.random.default_rng(number).integers(0, 65_536, SHAPE).astype(np.uint16)
    return Exposure(Frame(image, number, 0.01, 0.0, number * 0.1, number * 100_000_000), 0.5)


def clock(number: int) -> ClockFix:
    return ClockFix("radar", number * 5.0, number * 5_000_000_000, 20_000)
