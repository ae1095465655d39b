"""Sessions of point targets along a rail, samples computed from the closed form of the beat."""

import numpy as np
from rail_data import BANDWIDTH_HZ, CENTRE_HZ, HEIGHT_M, C

from drivers.records import AudioBlock, Channel
from polfuse_lab.records import Sweeps
from polfuse_lab.rig import Waveform
from polfuse_lab.session import SessionConfig, SessionWriter

RATE_HZ, RAMP, PERIOD = 48_000.0, 960.25, 1920.5
"""Samples of the up-ramp and of the period."""
BEAMWIDTH, DEPRESSION = np.radians(70), np.radians(17)
AMPLITUDE = 0.5
"""Beat of 1 m^2 at 1 m on the axis, of full scale."""

RIG = f"""
name = "rail"
[waveform]
centre_hz = {CENTRE_HZ}
bandwidth_hz = {BANDWIDTH_HZ}
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = {HEIGHT_M}
antenna_elevation_deg = 17.0
beamwidth_deg = 70.0
[radar]
driver = "sounddevice"
[switches]
driver = "dowkey_ms"
[trolley]
driver = "by_hand"
length_m = 3.2
"""


def gain(antenna, target):
    """Two-way amplitude pattern: cos^n, half power of one antenna at half the beam width; looks along +y, down."""
    n = np.log(0.5) / np.log(np.cos(BEAMWIDTH / 2))
    sight = np.asarray(target) - antenna
    cosine = sight @ np.array([0, np.cos(DEPRESSION), -np.sin(DEPRESSION)]) / np.linalg.norm(sight)
    return max(cosine, 0.0) ** n


def samples(x, targets, channel, seconds=0.125, start=300.25, centres=None):
    """(n, 2) float32: beat ``Re{conj(M) g / R^2 exp(j phi)}`` on channel 0, sync on channel 1.

    ``centres``: phase centres by the rig file's names; the wave goes from the one antenna to the other.
    """
    n = np.arange(round(seconds * RATE_HZ), dtype=np.float64)
    since = np.mod(n - start, PERIOD)
    up = since < RAMP
    slope = np.where(up, 1, -1) * BANDWIDTH_HZ / np.where(up, RAMP, PERIOD - RAMP) * RATE_HZ
    frequency = CENTRE_HZ + slope * (since - np.where(up, RAMP / 2, (PERIOD + RAMP) / 2)) / RATE_HZ
    beat = np.zeros(len(n))
    antenna = np.array([x, 0.0, 0.0])
    row, column = "HV".index(channel.receive), "HV".index(channel.transmit)
    for place, s in targets:
        there, back = (np.zeros(3), np.zeros(3))
        if centres is not None:
            there = np.asarray(centres[f"transmit_{channel.transmit.lower()}_m"])
            back = np.asarray(centres[f"receive_{channel.receive.lower()}_m"])
        sight = np.asarray(place) - antenna
        away = (np.linalg.norm(sight - there) + np.linalg.norm(sight - back)) / 2
        tau = 2 * away / C
        phase = 2 * np.pi * tau * frequency - np.pi * slope * tau**2
        m = AMPLITUDE * gain(antenna, place) / away**2 * np.asarray(s)[row, column]
        beat += (np.conj(m) * np.exp(1j * phase)).real
    edges = sum(np.clip((since - at) / 3 + 0.5, 0, 1) * sign for at, sign in ((0.0, 1), (RAMP, -1), (PERIOD, 1)))
    return np.stack([beat, 0.8 * (2 * edges - 1)], axis=1).astype(np.float32)


def write_session(
    path, targets, positions, channels=tuple(Channel), *, rig=RIG, plan=None, skip=(), told=None, centres=None
):
    """A finished session; ``skip`` holds (channel, position) pairs that were not recorded, ``told`` where the trolley
    was thought to be; ``centres`` as for :func:`samples`."""
    waveform = Waveform(centre_hz=CENTRE_HZ, bandwidth_hz=BANDWIDTH_HZ, ramp_up_s=0.02, sweep_period_s=0.04)
    config = SessionConfig("collect", waveform, RATE_HZ, sample_dtype="float32", rig_toml=rig, plan_toml=plan)
    with SessionWriter.create(path, config, ballast_bytes=0) as writer:
        for position, x in enumerate(positions):
            for channel in channels:
                if (channel, position) in skip:
                    continue
                block = AudioBlock(samples(x, targets, channel, centres=centres), RATE_HZ, 0, 0.0, position * 1_000_000)
                seen = float(x if told is None else told[position])
                writer.write(Sweeps(block, channel, position, x_m=seen, sweeps_requested=2))
    return path
