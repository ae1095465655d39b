"""Echoes of bodies all along a rail, kept in bins of delay at close places: what a simulated radar there receives.

At each place of a grid every echo is spread over a few bins of delay (Kaiser-Bessel gridding, as in
:mod:`processing.scattering.history`), from which any frequency of the band follows. Rays are sent from places farther
apart; between two of them both views count, in proportion to their nearness, with paths and patterns that are exact at
every place. The grid is so close (a twelfth of a wavelength) that what is between follows from its neighbours.
Footprints have patterns of a few frequencies, between which they are interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.filter_design import least_squares_polynomials
from processing.sar.gridding import Kernel
from processing.scattering.contributions import ISOTROPIC, Beam, Contributions, leg, sine_over
from processing.scattering.patterns import chebyshev_nodes, lagrange

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

KERNEL = Kernel(8, 2.0)
"""Over delay; -100 dB and less within the band."""
STEPS = 2048
"""Intervals of the kernel's table between two bins, within which it is taken as linear."""
TAPS, FINER, DEGREE = 8, 3.0, 9
"""Of the filter along the rail: -88 dB at the least, for echoes from along the rail."""
NODES = 3
"""Frequencies of the footprints' patterns: 80 MHz make of one whose path grows by half a metre 4e-4 of its side lobes
(:func:`processing.scattering.history.pattern_nodes`)."""
MOST_BINS = 40_000_000


@dataclass(frozen=True)
class RailRadar:
    """A radar on a rail along x: its band, where its antennas are on the trolley, and how they look."""

    centre_hz: float
    bandwidth_hz: float
    senders_m: Floats = field(default_factory=lambda: np.zeros((2, 3)))
    """(2, 3) phase centres of the transmitting antennas H and V, from the trolley's place, m."""
    receivers_m: Floats = field(default_factory=lambda: np.zeros((2, 3)))
    """(2, 3) of the receiving antennas H and V, m."""
    beam: Beam | None = None
    """The antennas' pattern; isotropic if left out."""

    def __post_init__(self) -> None:
        if not (0 < self.bandwidth_hz < 2 * self.centre_hz and math.isfinite(self.centre_hz)):
            raise DataError(
                f"a band of {self.bandwidth_hz} Hz around {self.centre_hz} Hz", "give a positive one below its centre"
            )

    @property
    def wavelength_m(self) -> float:
        """At the centre."""
        return SPEED_OF_LIGHT_M_S / self.centre_hz

    @property
    def nodes(self) -> Floats:
        """(NODES,) frequencies of the footprints' patterns, over the centre."""
        return chebyshev_nodes(NODES, self.bandwidth_hz / (2 * self.centre_hz))

    @property
    def place_step_m(self) -> float:
        """Of the grid along the rail: echoes change by no more than two turns in a wavelength of the highest
        frequency."""
        return SPEED_OF_LIGHT_M_S / (self.centre_hz + self.bandwidth_hz / 2) / (4 * FINER)

    @property
    def delay_step_s(self) -> float:
        """Of the bins."""
        return 1 / (KERNEL.oversampling * self.bandwidth_hz)


@dataclass(frozen=True, eq=False)
class RailEchoes:
    """Echoes at the places of a grid, in bins of delay."""

    first_m: float
    """x of the first place."""
    radar: RailRadar
    bins: Complexes
    """(NODES + 1, 2, 2, places, delays): footprints (which grow with frequency) by the patterns of each frequency, and
    points; receiving antenna; transmitting antenna. Delay 0 is bin ``KERNEL.taps / 2``. Amplitudes are those of a point
    of 1 m^2 at 1 m on the axis being 1."""

    def through(self, receive: ArrayLike, transmit: ArrayLike) -> RailEchoes:
        """What a front end makes of them: ``receive @ S @ transmit``."""
        mixed = np.einsum("ij,kjlpd,lm->kimpd", np.asarray(receive), self.bins, np.asarray(transmit), optimize=True)
        return replace(self, bins=np.ascontiguousarray(mixed))

    def rows(self, x_m: ArrayLike, receive: int, transmit: int) -> Complexes:
        """Bins (NODES + 1, n, delays) of one channel at places ``x_m`` (n,).

        Raises:
            DataError: a place off the rail.
        """
        at = (np.atleast_1d(np.asarray(x_m, dtype=np.float64)) - self.first_m) / self.radar.place_step_m
        half = TAPS // 2
        if not np.all((at >= half - 1) & (at < self.bins.shape[3] - half)):
            raise DataError("a place lies off the rail that echoes were made for", "make the rail longer")
        whole = np.floor(at).astype(np.int64)
        begin = whole - half + 1
        powers = (at - whole - 0.5)[:, None] ** np.arange(DEGREE + 1)
        weights = powers @ least_squares_polynomials(TAPS, FINER, DEGREE)
        channel = self.bins[:, receive, transmit]
        rows = np.empty((len(channel), len(at), channel.shape[2]), dtype=np.complex128)
        for first in np.unique(begin):
            chosen = begin == first
            rows[:, chosen] = weights[chosen] @ channel[:, first : first + TAPS]
        return rows

    def waves(self, frequency_hz: ArrayLike, slope_hz_s: ArrayLike, *, delay_m: float = 0.0) -> Complexes:
        """What each bin gives at instants of a ramp, residual video phase and all.

        The phase ``pi K tau^2`` is taken at the bins' delays. Echoes reach over half the kernel's taps of them, in
        which it changes by ``2 pi K tau taps / (2 over B)`` (for a ramp of length T: ``pi taps tau / over T``, 2e-4
        of the echo at 40 m and 20 ms).

        Args:
            frequency_hz: (n,) transmitted.
            slope_hz_s: (n,) K, its rate of change.
            delay_m: range that cables and electronics add, m: it delays, but does not spread.

        Returns:
            (NODES + 1, n, delays): the sum over bins of these times :meth:`rows` is the conjugate of the beat's
            analytic signal.
        """
        frequency = np.asarray(frequency_hz, dtype=np.float64)[:, None]
        slope = np.asarray(slope_hz_s, dtype=np.float64)[:, None]
        radar, step = self.radar, self.radar.delay_step_s
        bins = (np.arange(self.bins.shape[4]) - KERNEL.taps // 2) * step
        off = frequency - radar.centre_hz
        cables = 2 * delay_m / SPEED_OF_LIGHT_M_S
        turns = off * bins + frequency * cables - slope * (bins + cables) ** 2 / 2
        points = np.exp(-2j * np.pi * (turns - np.rint(turns))) / KERNEL.response(off * step)
        share = lagrange(radar.nodes, frequency[:, 0] / radar.centre_hz)[..., None]
        return np.concatenate([share * (points * (frequency / radar.centre_hz)), points[None]])

    def beat(self, x_m: ArrayLike, waves: Complexes, receive: int, transmit: int) -> Floats:
        """Beat voltage (n,) of one channel at places ``x_m``: (1,) for all instants, or (n,).

        Args:
            x_m: places of the trolley, m.
            waves: of :meth:`waves`.
            receive, transmit: 0 for H, 1 for V.

        Raises:
            DataError: a place off the rail.
        """
        rows = self.rows(x_m, receive, transmit)
        if rows.shape[1] == 1:
            return np.asarray(np.sum(waves @ rows[:, 0, :, None], axis=0)[:, 0].real)
        return np.asarray(np.einsum("knd,knd->n", waves, rows).real)


def rail_echoes(
    seen: Callable[[Floats], Contributions],
    span_m: tuple[float, float],
    radar: RailRadar,
    *,
    view_step_m: float = 0.1,
    progress: Callable[[float], None] | None = None,
) -> RailEchoes:
    """Echoes at all places of a rail along x through the origin.

    Args:
        seen: what lights up as an antenna at a place (3,) sees it.
        span_m: x of the rail's ends.
        radar: band and antennas.
        view_step_m: farthest distance of the places that ``seen`` is asked for.
        progress: called with the fraction done.

    Raises:
        DataError: ends out of order, a step that is not positive, or more bins than memory should hold.
    """
    low, high = span_m
    if not (math.isfinite(low) and math.isfinite(high) and low <= high and view_step_m > 0):
        raise DataError(f"a rail from {low} to {high} m seen every {view_step_m} m", "give its ends in order")
    step = radar.place_step_m
    first = low - (TAPS // 2) * step
    count = math.ceil((high - low) / step) + TAPS + 1
    kinds = NODES + 1
    if 4 * kinds * count * KERNEL.taps > MOST_BINS:
        raise DataError(f"a rail of {high - low:g} m has {count} places", "make it shorter")
    track = np.zeros((count, 3))
    track[:, 0] = first + np.arange(count) * step
    views = np.linspace(low, high, math.ceil((high - low) / view_step_m) + 1) if high > low else np.array([low])
    near = np.interp(track[:, 0], views, np.arange(len(views)))
    table = KERNEL.weights(np.arange(STEPS + 1) / STEPS)
    row = ISOTROPIC if radar.beam is None else radar.beam.row()
    reach = float(np.max(np.linalg.norm(np.concatenate([radar.senders_m, radar.receivers_m]), axis=1)))
    per_m = 1 / (SPEED_OF_LIGHT_M_S * radar.delay_step_s)
    parts: list[tuple[slice, Complexes]] = []
    for number, x in enumerate(views):
        shares = np.maximum(1 - np.abs(near - number), 0)
        which = np.flatnonzero(shares)
        chosen = slice(int(which[0]), int(which[-1]) + 1)
        antenna = np.array([x, 0.0, 0.0])
        part = seen(antenna)
        away = reach + float(np.max(np.abs(track[chosen, 0] - x)))
        delays = math.ceil((_longest(part, antenna) + 2 * away) * per_m) + KERNEL.taps + 2
        if 4 * kinds * count * delays > MOST_BINS:
            raise DataError(
                f"echoes at {count} places in {delays} bins of delay are too many", "make the scene or the rail smaller"
            )
        bins = np.zeros((kinds, chosen.stop - chosen.start, 2, 2, delays), dtype=np.complex128)
        wavenumber = 2 * math.pi / radar.wavelength_m
        for grows, into in ((True, bins[:NODES]), (False, bins[NODES:])):
            some = part.chosen(part.footprints == grows)
            spread_pairs(
                some.places_m, some.amplitudes, grows, track[chosen], shares[chosen],
                np.ascontiguousarray(radar.senders_m, dtype=np.float64),
                np.ascontiguousarray(radar.receivers_m, dtype=np.float64),
                wavenumber, wavenumber * radar.nodes, per_m, row, table, into,
            )  # fmt: skip
        parts.append((chosen, bins))
        if progress:
            progress((number + 1) / len(views))
    total = np.zeros((kinds, 2, 2, count, max(bins.shape[4] for _, bins in parts)), dtype=np.complex128)
    for chosen, bins in parts:
        total[:, :, :, chosen, : bins.shape[4]] += bins.transpose(0, 2, 3, 1, 4)
    return RailEchoes(first, radar, total)


def _longest(part: Contributions, antenna: Floats) -> float:
    """Path there and back."""
    if not len(part):
        return 0.0
    ways = sum(np.linalg.norm(part.places_m[:, row] - antenna, axis=1) for row in (0, 3))
    return float(np.max(ways))


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def spread_pairs(
    places: Floats, amplitudes: Complexes, grows: bool, track: Floats, shares: Floats, senders: Floats,
    receivers: Floats, wavenumber: float, nodes: Floats, bins_per_m: float, beam: Floats, weights: Floats,
    bins: Complexes,
) -> None:  # fmt: skip
    """Add echoes, at the centre frequency, to bins of delay around their own.

    Args:
        places, amplitudes: of contributions.
        grows: footprints (True) or points.
        track: (P, 3) places of the trolley, m.
        shares: (P,) factors of all echoes.
        senders, receivers: (2, 3) antennas H and V from there, m.
        wavenumber: of the centre, 1/m.
        nodes: (K,) wavenumbers of the footprints' patterns, 1/m; of points nothing but the centre counts.
        bins_per_m: bins of delay in a metre of path.
        beam: of :meth:`processing.scattering.contributions.Beam.row`.
        weights: (steps + 1, taps) the kernel between two bins.
        bins: (K, P, 2, 2, delays), added to: receiving antenna, transmitting antenna; points: (1, ...).
    """
    taps, steps = weights.shape[1], len(weights) - 1
    apart = False
    for axis in range(3):
        for other in (senders[1, axis], receivers[0, axis], receivers[1, axis]):
            apart = apart or other != senders[0, axis]
    for p in numba.prange(len(track)):
        antenna = np.empty(3)
        out, back = np.empty((2, 4)), np.empty((2, 4))
        patterns = np.ones(len(bins))
        for n in range(len(places)):
            for which in range(2 if apart else 1):
                for axis in range(3):
                    antenna[axis] = track[p, axis] + senders[which, axis]
                out[which, 0], out[which, 1], out[which, 2], out[which, 3] = leg(places[n], 3, antenna, beam)
                for axis in range(3):
                    antenna[axis] = track[p, axis] + receivers[which, axis]
                back[which, 0], back[which, 1], back[which, 2], back[which, 3] = leg(places[n], 0, antenna, beam)
            factor, first, row, fine = 0j, 0, 0, 0.0
            for r in range(2):
                for t in range(2):
                    if apart or (r == 0 and t == 0):
                        way = out[t, 0] + back[r, 0]
                        even = shares[p] * out[t, 3] * back[r, 3]
                        if grows:
                            across, up = out[t, 1] + back[r, 1], out[t, 2] + back[r, 2]
                            even *= wavenumber
                            for node in range(len(bins)):
                                half = 0.5 * nodes[node]
                                patterns[node] = sine_over(half * across) * sine_over(half * up)
                        angle = wavenumber * way
                        factor = complex(even * math.cos(angle), -even * math.sin(angle))
                        at = way * bins_per_m
                        whole = math.floor(at)
                        fine = (at - whole) * steps
                        row = min(int(fine), steps - 1)
                        fine -= row
                        first = int(whole) + 1
                    for node in range(len(bins)):
                        value = patterns[node] * factor * amplitudes[n, r, t]
                        for tap in range(taps):
                            weight = weights[row, tap] + fine * (weights[row + 1, tap] - weights[row, tap])
                            bins[node, p, r, t, first + tap] += weight * value
