"""Quad-polarized phase history of contributions along a track.

Every echo is spread over a few samples of delay and all frequencies come from one transform (Kaiser-Bessel gridding,
:mod:`processing.sar.gridding`), so that the cost does not grow with their number. A footprint's pattern at any
frequency is interpolated from that at a few of them (Chebyshev's nodes), as many as its size requires. So neighbours
cancel at all frequencies as they do in truth: with the pattern of one frequency, cells in step with the wave would
return ghosts off it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.phase_history import PhaseHistory
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.gridding import Kernel
from processing.scattering.contributions import ISOTROPIC, Beam, Contributions, leg, sine_over
from processing.scattering.patterns import chebyshev_nodes, lagrange

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

CHANNELS = ("HH", "HV", "VH", "VV")
KERNEL = Kernel(6, 1.5)
STEPS = 1024
"""Intervals of the kernel's table between two samples, within which it is taken as linear."""
PATTERN_ERROR = 1e-3
"""Of a footprint's pattern between the frequencies that it is worked out at, relative to its side lobes there."""
MOST_NODES = 32
"""Such frequencies, at most: enough for footprints that reach over a dozen range cells."""
SPREAD_BYTES = 128_000_000
"""Memory of the samples of delay of as many pulses as are worked on at once."""


@dataclass(frozen=True)
class Sweep:
    """The radar's frequencies."""

    centre_hz: float
    bandwidth_hz: float
    count: int
    """Even number of frequencies; c count / 2 bandwidth is the unambiguous range."""

    def __post_init__(self) -> None:
        if not (0 < self.bandwidth_hz < 2 * self.centre_hz and math.isfinite(self.centre_hz)):
            raise DataError(
                f"a sweep of {self.bandwidth_hz} Hz around {self.centre_hz} Hz", "give a positive band below its centre"
            )
        if self.count < 2 or self.count % 2:
            raise DataError(f"a sweep of {self.count} frequencies", "give an even number")

    @property
    def step_hz(self) -> float:
        """From one frequency to the next."""
        return self.bandwidth_hz / self.count

    @property
    def wavelength_m(self) -> float:
        """At the centre."""
        return SPEED_OF_LIGHT_M_S / self.centre_hz

    @property
    def frequencies_hz(self) -> Floats:
        """(count,) from the lowest on."""
        return np.asarray(self.centre_hz + (np.arange(self.count) - self.count // 2) * self.step_hz, dtype=np.float64)

    def nodes(self, count: int) -> Floats:
        """(count,) zeros of Chebyshev's polynomial over the band, over the centre; the centre itself for 0."""
        half = self.bandwidth_hz / (2 * self.centre_hz)
        return chebyshev_nodes(max(count, 1), half)


def phase_history(
    seen: Callable[[Floats], Contributions],
    track_m: Floats,
    reference_m: Floats,
    sweep: Sweep,
    *,
    segments: int = 1,
    beam: Beam | None = None,
    time_s: Floats | None = None,
    progress: Callable[[float], None] | None = None,
) -> PhaseHistory:
    """Echoes of a scene along a track.

    Args:
        seen: what lights up as an antenna at a place (3,) sees it; asked for once in the middle of each segment.
        track_m: (pulses, 3) places of the antennas, m.
        reference_m: (3,) point to which the phases' reference ranges are taken.
        sweep: frequencies.
        segments: equal parts of the track; within one, what is lit (not its path and pattern) is that of its middle.
        beam: the antennas' pattern; isotropic if left out.
        time_s: (pulses,) when the pulses are sent: what moves is where ``seen`` tells it in the middle of each segment.
            Nothing moves where it is left out. Platform and bodies stand still within a pulse.
        progress: called with the fraction done.

    Returns:
        Amplitudes are those of a point of 1 m^2 at 1 m on the axis being 1; channels HH, HV, VH, VV.

    Raises:
        DataError: no pulse, fewer pulses than segments, or echoes from beyond the unambiguous range.
    """
    track = np.ascontiguousarray(track_m, dtype=np.float64)
    if track.ndim != 2 or track.shape[1] != 3 or not 1 <= segments <= len(track):
        raise DataError(f"a track of shape {track.shape} in {segments} segments", "give (pulses, 3), a segment or more")
    time = np.zeros(len(track)) if time_s is None else np.ascontiguousarray(time_s, dtype=np.float64)
    if time.shape != (len(track),):
        raise DataError(f"times of shape {time.shape} for {len(track)} pulses", "give one for each pulse")
    reference = np.linalg.norm(track - np.asarray(reference_m, dtype=np.float64), axis=1)
    row = ISOTROPIC if beam is None else beam.row()
    weights = KERNEL.weights((np.arange(STEPS + 1)) / STEPS)
    length = int(scipy.fft.next_fast_len(math.ceil(sweep.count * KERNEL.oversampling)))
    order = np.arange(sweep.count) - sweep.count // 2
    undone = 1 / KERNEL.response(order / length)
    frequencies = sweep.frequencies_hz / sweep.centre_hz
    echoes = np.empty((len(CHANNELS), len(track), sweep.count), dtype=np.complex64)
    k = 2 * np.pi / sweep.wavelength_m
    for number, pulses in enumerate(np.array_split(np.arange(len(track)), segments)):
        middle = pulses[len(pulses) // 2]
        part, since = seen(track[middle]), time[pulses] - time[middle]
        _check_depth(part, track[pulses], reference[pulses], since, sweep)
        total = np.zeros((3, len(pulses), sweep.count), dtype=np.complex128)
        needed = np.where(part.footprints, pattern_nodes(part, track[middle], sweep), 0)
        for count in np.unique(needed):
            chosen, nodes = part.chosen(needed == count), sweep.nodes(count)
            grown = (frequencies * lagrange(nodes, frequencies))[:, None] if count else 1.0
            parts = math.ceil(len(pulses) * 48 * length * len(nodes) / SPREAD_BYTES)
            for some in np.array_split(np.arange(len(pulses)), parts):
                spread = np.zeros((len(some), len(nodes), 3, length), dtype=np.complex128)
                spread_echoes(
                    chosen.places_m, chosen.motions(), chosen.amplitudes, count > 0, track[pulses[some]], since[some],
                    reference[pulses[some]], k, k * nodes, sweep.step_hz / SPEED_OF_LIGHT_M_S * length, row, weights,
                    spread,
                )  # fmt: skip
                spectrum = scipy.fft.fft(spread, axis=3)[..., order % length] * (undone * grown)
                total[:, some] += spectrum.sum(axis=1).transpose(1, 0, 2)
        for channel, which in enumerate((0, 1, 1, 2)):
            echoes[channel, pulses] = total[which]
        if progress:
            progress((number + 1) / segments)
    return PhaseHistory(echoes, float(sweep.frequencies_hz[0]), sweep.step_hz, track, reference, CHANNELS)


def pattern_nodes(part: Contributions, antenna_m: Floats, sweep: Sweep) -> NDArray[np.int64]:
    """(N,) frequencies that each footprint's pattern must be known at, 1 to :data:`MOST_NODES`.

    Over the band the pattern is the product of two sines over what does not change much; their arguments change by x
    together, half the band's wavenumbers times half of what the path grows by over both edges. The n-th derivative of
    the sines is at most ``x^n``, so that a polynomial through n zeros of Chebyshev's errs by ``2 (x / 2)^n / n!``.
    """
    out, back = part.places_m[:, 3] - antenna_m, part.places_m[:, 0] - antenna_m
    out, back = (way / np.linalg.norm(way, axis=1, keepdims=True) for way in (out, back))
    grown = sum(
        np.abs(np.sum(out * part.places_m[:, 3 + edge] + back * part.places_m[:, edge], axis=1)) for edge in (1, 2)
    )
    wide = np.pi * sweep.bandwidth_hz / SPEED_OF_LIGHT_M_S * grown / 2
    widest = [2 * (PATTERN_ERROR * math.factorial(count) / 2) ** (1 / count) for count in range(1, MOST_NODES)]
    return np.asarray(np.searchsorted(widest, wide) + 1, dtype=np.int64)


def history_reference(
    part: Contributions, track_m: Floats, reference_m: Floats, sweep: Sweep, *, beam: Beam | None = None
) -> Complexes:
    """Echoes (4, pulses, frequencies) of contributions, summed one frequency after the other: the definition."""
    from processing.scattering.contributions import echoes_reference

    row = ISOTROPIC if beam is None else beam.row()
    k = 2 * np.pi * sweep.frequencies_hz / SPEED_OF_LIGHT_M_S
    found = np.empty((4, len(track_m), sweep.count), dtype=np.complex128)
    for pulse, antenna in enumerate(track_m):
        sums = np.empty((sweep.count, 2, 2), dtype=np.complex128)
        reference = 2 * float(np.linalg.norm(antenna - reference_m))
        echoes_reference(part.places_m, part.amplitudes, part.footprints, antenna, k, reference, row, sums)
        # Channel names are transmit then receive.
        found[:, pulse] = sums[:, 0, 0], sums[:, 1, 0], sums[:, 0, 1], sums[:, 1, 1]
    return found


def segments_needed(track_m: Floats, reference_m: Floats, turn_rad: float) -> int:
    """Segments of a track in which the direction to the reference point turns by no more than ``turn_rad``."""
    ways = track_m - np.asarray(reference_m, dtype=np.float64)
    ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    steps = np.linalg.norm(np.diff(ways, axis=0), axis=1)
    return int(min(max(1, math.ceil(float(steps.sum()) / turn_rad)), len(track_m)))


def _check_depth(part: Contributions, track: Floats, reference: Floats, since: Floats, sweep: Sweep) -> None:
    if not len(part):
        return
    reach = 0.0
    footprint, image = part.motions().transpose(1, 0, 2) if part.motions_m_s is not None else np.zeros((2, 1, 3))
    for pulse in (0, len(track) // 2, len(track) - 1):
        out = np.linalg.norm(part.places_m[:, 3] + image * since[pulse] - track[pulse], axis=1)
        back = np.linalg.norm(part.places_m[:, 0] + footprint * since[pulse] - track[pulse], axis=1)
        reach = max(reach, float(np.abs((out + back) / 2 - reference[pulse]).max()))
    allowed = SPEED_OF_LIGHT_M_S / (4 * sweep.step_hz)
    if reach > allowed:
        raise DataError(
            f"echoes come from {reach:.4g} m off the reference, {sweep.count} frequencies tell {allowed:.4g} m",
            f"use {2 * math.ceil(sweep.count * reach / allowed / 2 * 1.05)} frequencies or more",
        )


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def spread_echoes(
    places: Floats, motions: Floats, amplitudes: Complexes, grows: bool, track: Floats, since: Floats,
    reference: Floats, wavenumber: float, nodes: Floats, samples_per_m: float, beam: Floats, weights: Floats,
    spread: Complexes,
) -> None:  # fmt: skip
    """Add echoes, at the centre frequency, to samples of delay around their own.

    Args:
        places, motions, amplitudes: of contributions.
        grows: footprints (True) or points.
        track: (P, 3) m.
        since: (P,) time since contributions were at their places, s.
        reference: (P,) range that phases are counted from, m.
        wavenumber: of the centre, 1/m.
        nodes: (K,) wavenumbers of the footprints' patterns, 1/m; points have one.
        samples_per_m: samples of delay in a metre of path.
        beam: of :meth:`processing.scattering.contributions.Beam.row`.
        weights: (steps + 1, taps) the kernel between two samples.
        spread: (P, K, 3, samples), added to: HH, the cross-polarized element, VV.
    """
    length, taps = spread.shape[3], weights.shape[1]
    steps = len(weights) - 1
    moving = len(motions) > 0
    for p in numba.prange(len(track)):
        # What moves is left where it is, and the antenna moved the other way.
        there, here = track[p].copy(), track[p].copy()
        for n in range(len(places)):
            if moving:
                for axis in range(3):
                    there[axis] = track[p, axis] - since[p] * motions[n, 1, axis]
                    here[axis] = track[p, axis] - since[p] * motions[n, 0, axis]
            out, out_across, out_up, out_gain = leg(places[n], 3, there, beam)
            back, back_across, back_up, back_gain = leg(places[n], 0, here, beam)
            across, up, even = out_across + back_across, out_up + back_up, out_gain * back_gain
            way = out + back - 2.0 * reference[p]
            if grows:
                even *= wavenumber
            angle = wavenumber * way
            factor = complex(even * math.cos(angle), -even * math.sin(angle))
            at = way * samples_per_m
            whole = math.floor(at)
            fine = (at - whole) * steps
            row = min(int(fine), steps - 1)
            fine -= row
            first = int(whole) - taps // 2 + 1
            for node in range(len(nodes)):
                pattern = factor
                if grows:
                    pattern *= sine_over(0.5 * nodes[node] * across) * sine_over(0.5 * nodes[node] * up)
                hh, hv = pattern * amplitudes[n, 0, 0], pattern * amplitudes[n, 0, 1]
                vv = pattern * amplitudes[n, 1, 1]
                for tap in range(taps):
                    sample = (first + tap) % length
                    weight = weights[row, tap] + fine * (weights[row + 1, tap] - weights[row, tap])
                    spread[p, node, 0, sample] += weight * hh
                    spread[p, node, 1, sample] += weight * hv
                    spread[p, node, 2, sample] += weight * vv
