"""What the sound card samples: beat and sync of the radar that looks at the scene from where the trolley stands.

**Reproducibility.** A recording starts at whatever instant the computer is ready, yet two runs with the same seed must
lead to the same products to the last bit. So the simulator has this property: with the trolley and the switches at
rest, the whole signal, noise and sub-sample sweep phase included, is a fixed function of (seed, trolley position
rounded to 0.01 mm, transmit, receive) and of the sample number modulo ``noise_cycle`` sweep periods, which are a whole
number of samples. Any ``noise_cycle`` contiguous whole sweeps therefore hold the same set of sweeps, in rotated order.
Noise of different positions and channels is independent.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hw_mocks.sound_card.settings import AudioSettings
from hw_mocks.world import World
from polfuse_lab.rig import Geometry, Waveform
from processing.radar.antenna import boresight, one_way_gain
from processing.radar.beat import TriangleFm, beat_of_ranges, sync
from processing.radar.beat_kernel import beat_along_track
from processing.scattering.rail_echoes import RailEchoes
from processing.scene.model import Scene
from processing.scene.radar_response import scatterers

Floats = NDArray[np.float64]
Samples = NDArray[np.int16]

FULL_SCALE = 32_767
POSITION_STEP_M = 1e-5
POLARIZATIONS = {"H": 0, "V": 1}
SCATTERING_STEP_M = 0.005
"""Way within which a moving trolley sees the scene scatter the same: 0.03 degrees at 10 m."""
KEPT_CYCLES = 16


class Synthesizer:
    """Makes blocks of int16 stereo samples from the state of the world at each sample's instant. Not thread-safe."""

    def __init__(
        self,
        scene: Scene,
        waveform: Waveform,
        geometry: Geometry,
        audio: AudioSettings,
        world: World,
        seed: int,
        bodies: RailEchoes | None = None,
    ) -> None:
        self._scene, self._world, self._audio, self._seed = scene, world, audio, seed
        self._beamwidth_rad = math.radians(geometry.beamwidth_deg)
        self._axis = boresight(math.radians(geometry.antenna_elevation_deg))
        self._range_offset_m = geometry.range_offset_m
        self._wavelength_m = waveform.wavelength_m
        self.sweep = TriangleFm(
            waveform.centre_hz,
            waveform.bandwidth_hz,
            waveform.ramp_up_s,
            audio.sweep_period_samples / audio.sample_rate_hz,
        )
        count = audio.cycle_samples
        # Exact in integers: phase of sample n is (n * noise_cycle mod cycle) / noise_cycle samples.
        phase_s = (np.arange(count) * audio.noise_cycle % count) / (audio.noise_cycle * audio.sample_rate_hz)
        self._frequency_hz, self._slope_hz_s = self.sweep.frequency(phase_s)
        level = sync(self.sweep, phase_s, audio.sync_edge_samples / audio.sample_rate_hz)
        self._sync = audio.sync_amplitude * (-level if audio.sync_inverted else level)
        front_end = scene.front_end
        self._coupling = beat_of_ranges(
            self._frequency_hz, self._slope_hz_s, [front_end.coupling_range_m], [front_end.coupling]
        )
        self._bodies, self._waves = bodies, np.zeros((2, 0, 0), dtype=np.complex128)
        if bodies is not None:
            self._bodies = bodies.through(front_end.amplitude_at_1m * front_end.receive, front_end.transmit)
            self._waves = bodies.waves(self._frequency_hz, self._slope_hz_s, delay_m=self._range_offset_m)
        self._cycles: OrderedDict[tuple[int, str, str], Samples] = OrderedDict()
        self._nearby: OrderedDict[tuple[int, str, str], tuple[Floats, NDArray[np.complex128]]] = OrderedDict()

    @property
    def audio(self) -> AudioSettings:
        """The sound card's settings."""
        return self._audio

    def block(self, first: int, frames: int, t_ns: int) -> Samples:
        """Samples ``first`` to ``first + frames``, the first one taken at host time ``t_ns``; shape (frames, 2)."""
        # One sample more: a sample stands if the trolley is still there at the next one. So every sample after a move's
        # end is a standing one, wherever the block's borders lie.
        offsets_ns = np.rint(np.arange(frames + 1) * (1e9 / self._audio.true_rate_hz)).astype(np.int64)
        x_m = self._world.trolley_x_m.at_many(t_ns + offsets_ns)
        stands = x_m[:-1] == x_m[1:]
        within = (first + np.arange(frames)) % self._audio.cycle_samples
        samples = np.empty((frames, 2), dtype=np.int16)
        for start, stop, transmit, receive in self._routes(t_ns, offsets_ns[:-1]):
            for part in _runs(stands, start, stop):
                if stands[part.start]:
                    place = round(float(x_m[part.start]) / POSITION_STEP_M)
                    samples[part] = self._standing(place, transmit, receive)[within[part]]
                else:
                    samples[part] = self._moving(x_m[part], transmit, receive, within[part])
        return samples if self._audio.sync_channel == 1 else np.ascontiguousarray(samples[:, ::-1])

    def _routes(self, t_ns: int, offsets_ns: NDArray[np.int64]) -> Iterator[tuple[int, int, str, str]]:
        """Runs of samples during which both switches stand."""
        end_ns = t_ns + int(offsets_ns[-1])
        transmit = self._world.transmit.changes(t_ns, end_ns)
        receive = self._world.receive.changes(t_ns, end_ns)
        instants = sorted({t_ns, *(t for t, _ in transmit + receive if t > t_ns)})
        starts = [*np.searchsorted(offsets_ns, np.array(instants, dtype=np.int64) - t_ns).tolist(), len(offsets_ns)]
        for instant, start, stop in zip(instants, starts, starts[1:], strict=False):
            if stop > start:
                yield start, stop, _last(transmit, instant), _last(receive, instant)

    def _standing(self, place: int, transmit: str, receive: str) -> Samples:
        """One cycle of samples (cycle, 2) with the rig at rest."""
        key = (place, transmit, receive)
        cycle = self._cycles.get(key)
        if cycle is None:
            everything = np.arange(self._audio.cycle_samples)
            cycle = self._samples(np.array([place * POSITION_STEP_M]), place, transmit, receive, everything)
            self._cycles[key] = cycle
            if len(self._cycles) > KEPT_CYCLES:
                self._cycles.popitem(last=False)
        else:
            self._cycles.move_to_end(key)
        return cycle

    def _moving(self, x_m: Floats, transmit: str, receive: str, within: NDArray[np.int64]) -> Samples:
        """Samples while the trolley moves: ranges change with every sample, scattering once for the run."""
        place = round(float(x_m[len(x_m) // 2]) / POSITION_STEP_M)
        return self._samples(x_m, place, transmit, receive, within)

    def _samples(
        self, x_m: Floats, place: int, transmit: str, receive: str, within: NDArray[np.int64]
    ) -> NDArray[np.int16]:
        voltage = np.stack((np.zeros(len(within)), self._sync[within]), axis=1)
        if transmit in POLARIZATIONS and receive in POLARIZATIONS:
            voltage[:, 0] = self._coupling[within] + self._echoes(x_m, transmit, receive, within)
        voltage += self._noise(place, transmit, receive)[within]
        counts: Samples = np.rint(np.clip(voltage, -1, 1) * FULL_SCALE).astype(np.int16)
        return counts

    def _echoes(self, x_m: Floats, transmit: str, receive: str, within: NDArray[np.int64]) -> Floats:
        if self._bodies is not None:
            # Pattern, phase centres and both ways are in the bodies' echoes already.
            return self._bodies.beat(x_m, self._waves[:, within], POLARIZATIONS[receive], POLARIZATIONS[transmit])
        antenna = np.zeros((len(x_m), 3))
        antenna[:, 0] = x_m
        if len(x_m) > 1:
            # In real time, while the trolley moves: how the scene scatters changes slowly, its distance does not.
            place = round(float(x_m[len(x_m) // 2]) / SCATTERING_STEP_M)
            centres, amplitudes = self._scattering_near(place, transmit, receive)
            return beat_along_track(
                self._frequency_hz[within],
                self._slope_hz_s[within],
                antenna,
                centres,
                amplitudes,
                delay_m=self._range_offset_m,
            )
        centres, amplitudes = self._scattering(antenna[0], transmit, receive)
        ranges = np.linalg.norm(antenna[:, None, :] - centres, axis=-1)
        return beat_of_ranges(
            self._frequency_hz[within],
            self._slope_hz_s[within],
            # Cables and electronics delay, but do not spread.
            ranges + self._range_offset_m,
            amplitudes / ranges**2,
        )

    def _scattering(self, antenna: Floats, transmit: str, receive: str) -> tuple[Floats, NDArray[np.complex128]]:
        """Scatterers and their beat voltages at 1 m as seen from one place."""
        centres, scattering = scatterers(self._scene, antenna, self._wavelength_m)
        voltages = effective_amplitudes(self._scene, antenna, centres, scattering, self._axis, self._beamwidth_rad)
        return centres, voltages[:, POLARIZATIONS[receive], POLARIZATIONS[transmit]]

    def _scattering_near(self, place: int, transmit: str, receive: str) -> tuple[Floats, NDArray[np.complex128]]:
        """As :meth:`_scattering` from ``place`` times :data:`SCATTERING_STEP_M`; those used last are kept."""
        key = (place, transmit, receive)
        if key not in self._nearby:
            self._nearby[key] = self._scattering(np.array([place * SCATTERING_STEP_M, 0.0, 0.0]), transmit, receive)
            if len(self._nearby) > KEPT_CYCLES:
                self._nearby.popitem(last=False)
        return self._nearby[key]

    def _noise(self, place: int, transmit: str, receive: str) -> Floats:
        """Noise (cycle, 2) of beat and sync, a function of its arguments and the seed alone."""
        key = [abs(self._seed), 2**31 + place, ord(transmit), ord(receive)]
        noise: Floats = np.random.default_rng(key).standard_normal((self._audio.cycle_samples, 2))
        return noise * (self._scene.front_end.noise, self._audio.sync_noise)


def effective_amplitudes(
    scene: Scene,
    antenna_m: Floats,
    centres_m: Floats,
    scattering: NDArray[np.complex128],
    axis: Floats,
    beamwidth: float,
) -> NDArray[np.complex128]:
    """Beat voltages at 1 m, fractions of full scale: receive @ S @ transmit, weighted by the antennas' pattern.

    Returns (N, 2, 2) [rx, tx].

    Args:
        scene: the scene, for its front end.
        antenna_m: (3,) antenna, m.
        centres_m: (N, 3) scatterers, m.
        scattering: (N, 2, 2) their scattering matrices, sqrt(m^2).
        axis: (3,) unit vector of the antennas' axes.
        beamwidth: half-power beamwidth of one antenna, rad.
    """
    front_end = scene.front_end
    sight = centres_m - antenna_m
    cos_angle = sight @ axis / np.linalg.norm(sight, axis=1)
    gain = front_end.amplitude_at_1m * one_way_gain(cos_angle, beamwidth)
    voltages: NDArray[np.complex128] = gain[:, None, None] * (front_end.receive @ scattering @ front_end.transmit)
    return voltages


def _runs(flags: NDArray[np.bool_], start: int, stop: int) -> list[slice]:
    """Slices of ``start`` to ``stop`` within which a flag does not change."""
    borders = [start, *(start + 1 + np.flatnonzero(np.diff(flags[start:stop]))).tolist(), stop]
    return [slice(a, b) for a, b in pairwise(borders)]


def _last(changes: list[tuple[int, str]], instant: int) -> str:
    """Value that holds at ``instant``; the first one before anything else."""
    value = changes[0][1]
    for t_ns, later in changes:
        if t_ns <= instant:
            value = later
    return value
