"""A rig and its signals for tests of the live view, by the closed form of the beat (see processing.radar.ranging)."""

from __future__ import annotations

import numpy as np

from drivers.records import AudioBlock, Channel
from polfuse_lab.records import SweepFlag, Sweeps
from polfuse_lab.rig import Rig, parse_model

C = 299_792_458.0
RATE = 48_000.0
PERIOD = 1920
"""Frames of a sweep: 40 ms."""

RIG = """
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = 1.069
antenna_elevation_deg = 17.0
beamwidth_deg = 70.0
[radar]
driver = "scene"
sample_rate_hz = 48000.0
[switches]
driver = "dowkey_ms"
[trolley]
driver = "grbl"
length_m = 3.2
[camera]
driver = "scene"
width_px = 16
height_px = 12
exposure_s = 0.01
focal_length_m = 0.008
pixel_pitch_m = 8e-6
saturation_counts = 4095
black_level_counts = 100.0
[polarizer]
driver = "ell14"
extinction_ratio = 800.0
"""


def rig(**replaced: str) -> Rig:
    text = RIG
    for old, new in replaced.items():
        text = text.replace(old, new)
    return parse_model(text, Rig, "rig.toml")


def beat(range_m, amplitude=0.1, sweeps=8, first_sweep=0, speed_m_s=0.0):
    """(frames, 2) int16 of whole sweeps: beat on channel 0, sync (high during the up-ramp) on channel 1."""
    wave = rig().waveform
    k = wave.bandwidth_hz / wave.ramp_up_s
    frame = np.arange(sweeps * PERIOD) + first_sweep * PERIOD
    inside = frame % PERIOD
    t = (inside - PERIOD / 4) / RATE  # the up-ramp is the first half; its centre is at a quarter
    ranges = np.atleast_1d(np.asarray(range_m, dtype=float))
    samples = np.zeros((len(frame), 2))
    for distance in ranges:
        # The range of a sweep is that at its ramp's centre.
        now = distance + speed_m_s * (frame // PERIOD) * PERIOD / RATE
        tau = 2 * now / C
        samples[:, 0] += amplitude * np.cos(2 * np.pi * tau * (wave.centre_hz + k * t) - np.pi * k * tau**2)
    samples[:, 0] *= inside < PERIOD / 2
    samples[:, 1] = np.where(inside < PERIOD / 2, 0.7, -0.7)
    return np.round(samples * 32767).astype(np.int16)


def sweeps_record(samples, channel=Channel.HH, position=0, x_m=0.0, flags=SweepFlag.NONE, requested=0, t_ns=0):
    return Sweeps(AudioBlock(samples, RATE, 0, 0.0, t_ns), channel, position, x_m, 0.0, requested, flags)
