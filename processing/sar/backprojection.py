"""Back-projection: every pixel sums the pulses at its own range, phase turned back. The exact method for any track.

    image(p) = sum_n w_n g_n(p) s_n(R_n(p)) exp(+j 4 pi centre R_n(p) / c) / sum_n w_n g_n(p)^2

with the pulses' profiles s_n, the range R_n(p) of the pixel (with two antennas half the path from one to the other),
the aperture's window w_n, and the two-way amplitude pattern g_n(p) (1 where no beam width is given). An isotropic
target of RCS sigma in range-compensated profiles therefore shows ``A sqrt(sigma)`` with its own phase at its place, A
as in :class:`processing.radar.profiles.RangeProfiles`. Platforms that move within a sweep:
:mod:`processing.sar.continuous`.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.antenna import AntennaPair, boresight, pattern_exponent
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.aperture import Pulses, usable_pulses
from processing.sar.backprojection_reference import backproject_reference
from processing.sar.continuous import Motion, SweepMotion, sweep_motion
from processing.sar.grid import Grid, ImageGrid, check_grid
from processing.sar.interpolation import check_bins, taps_of
from processing.sar.patches import best_patch, flat_places, on_lines
from processing.sar.paths import channel_groups

__all__ = ["LiveImage", "backproject", "backproject_reference", "distance_m"]

ROWS = 256
"""Rows of a grid whose places are in memory at a time, where they cannot be told from its axes."""

SMALL_TURNS = 4e-6
"""Bound of the phase error, turns, up to which offsets within a patch of pixels may be float32: -92 dB of a pixel at
the very worst, 20 to 30 dB less as a root mean square. Filters of sixteen taps set it lower."""

TABLE_BYTES = 16_000_000
"""Size of the tables that are in memory at a time, at most, unless that were less than one pulse. It sets the blocks in
which pulses are added, and so rounding: a constant, that images formed in tiles have the bits of those in one piece."""


def backproject(
    profiles: RangeProfiles,
    grid: Grid,
    *,
    interpolator: str = "sinc8",
    weights: NDArray[np.floating] | None = None,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
    motion: Motion = "auto",
) -> NDArray[np.complex64]:
    """Focus all channels in one pass of a compiled kernel.

    :func:`backproject_reference` is the definition; ranges and phases agree with it within float32 rounding
    (:mod:`processing.sar.backprojection_kernel`). Each pixel sums its pulses in order: results have the same bits on
    any number of threads.

    Args:
        profiles: (channels, positions, bins); profiles that are NaN throughout count as missing.
        grid: where to form the image.
        interpolator: how profiles are read between bins, see :mod:`processing.sar.interpolation`.
        weights: (positions,) window along the aperture; rectangular where left out.
        beamwidth_rad: half-power beam width of one antenna for pattern compensation; none where left out.
        depression_rad: angle of the antennas' axes below horizontal; they look along +y.
        motion: whether motion within a sweep is modelled, see :func:`processing.sar.continuous.sweep_motion`.

    Returns:
        (channels, rows, columns) complex64; NaN where a pulse's range is off the profiles' axis, where a NaN sample was
        touched, where no pulse illuminates the pixel, and where the grid has no place.

    Raises:
        DataError: unusable profiles, weights, grid or beam width, or an unknown interpolator.
    """
    live = LiveImage(grid, interpolator=interpolator, beamwidth_rad=beamwidth_rad, depression_rad=depression_rad)
    live.add(profiles, weights=weights, motion=motion)
    return live.finish()


def pulses_in_block(profiles: RangeProfiles, interpolator: str = "sinc8") -> int:
    """Pulses that :func:`backproject` adds at a time before it rounds to complex64; the same for every image.

    A :class:`LiveImage` to which pulses are added in multiples of that, with ``track_m`` given, has the bits of the
    image in one piece.

    Raises:
        DataError: unknown interpolator, or antenna pairs that do not fit the channels.
    """
    from processing.sar.segments import segment_polynomials, table_stride

    powers = len(segment_polynomials(interpolator, _oversampling(profiles)))
    members = max(len(members) for _, members in channel_groups(profiles))
    return _block(members, table_stride(len(profiles.range_m)), powers)


def _block(channels: int, stride: int, powers: int) -> int:
    fitting = TABLE_BYTES // (8 * channels * stride * powers)
    return max(fitting // 128 * 128, min(fitting, 128), 1)


def _oversampling(profiles: RangeProfiles) -> float:
    step = (profiles.range_m[-1] - profiles.range_m[0]) / (len(profiles.range_m) - 1)
    return round(float(profiles.resolution_m / step), 9)


class LiveImage:
    """An image that grows with the collect: positions are added as they come, in any order and number.

    Args:
        grid: where to form the image.
        interpolator: see :func:`backproject`.
        beamwidth_rad: see :func:`backproject`.
        depression_rad: see :func:`backproject`.
        track_m: (any number, 3) the whole track, where it is known beforehand and its positions come in blocks: what
            follows from it is then the same for every block (see :func:`pulses_in_block`).

    Raises:
        DataError: unusable grid or beam width, or an unknown interpolator.
    """

    def __init__(
        self,
        grid: Grid,
        *,
        interpolator: str = "sinc8",
        beamwidth_rad: float | None = None,
        depression_rad: float = 0.0,
        track_m: NDArray[np.float64] | None = None,
    ) -> None:
        check_grid(grid)
        check_bins(interpolator, 1 << 30)
        self.grid, self.interpolator = grid, interpolator
        self._exponent = 0.0 if beamwidth_rad is None else pattern_exponent(beamwidth_rad)
        self._axis = boresight(depression_rad)
        self._track_m = track_m
        self._patches: dict[AntennaPair, tuple[int, bool]] = {}
        self._signal: tuple[object, ...] | None = None
        self._total = np.zeros((0, *grid.shape), dtype=np.complex64)
        self._weights: list[NDArray[np.float64]] = []
        self._gains = np.zeros((0, *grid.shape), dtype=np.float32)

    def add(
        self, profiles: RangeProfiles, *, weights: NDArray[np.floating] | None = None, motion: Motion = "auto"
    ) -> SweepMotion:
        """Add positions; arguments and errors as in :func:`backproject`. Returns how motion was treated.

        A channel that has no profile at these positions gains nothing; it is no error unless nothing is ever added.

        Raises:
            DataError: also where channels or the radar's signal are not those of the first positions.
        """
        from processing.sar.segments import filter_error_db, segment_polynomials

        signal = (profiles.channels, profiles.centre_hz, profiles.bandwidth_hz)
        if self._signal not in (None, signal):
            raise DataError("these profiles have other channels or another signal", "begin a new image for them")
        pulses = usable_pulses(profiles, weights, every_channel=self._signal is None)
        check_bins(self.interpolator, len(profiles.range_m))
        moving = sweep_motion(profiles, motion)
        groups = channel_groups(profiles)
        channels = len(pulses.values)
        same = bool((pulses.weights == pulses.weights[0]).all()) and len(groups) == 1
        if self._signal is None:
            self._signal = signal
            self._total = np.zeros((channels, *self.grid.shape), dtype=np.complex64)
            sets = 0 if not self._exponent else 1 if same else channels
            self._gains = np.zeros((sets, *self.grid.shape), dtype=np.float32)
        elif len(self._gains) == 1 and not same:
            self._gains = np.repeat(self._gains, channels, axis=0)
        self._weights.append(pulses.weights)
        if not pulses.antenna_m.size:
            return moving
        step = _oversampling(profiles)
        polynomials = segment_polynomials(self.interpolator, step)
        # Only the longest filters are so exact that float64 ranges everywhere are worth their time.
        exact = taps_of(self.interpolator) > 8
        small = min(SMALL_TURNS, 10 ** (filter_error_db(self.interpolator, step) / 20)) if exact else SMALL_TURNS
        for pair, members in groups:
            whole = len(members) == channels
            total = self._total if whole else self._total[members]
            gains = self._gains if whole or not len(self._gains) else self._gains[members]
            self._sum(profiles, pulses, pair, members, moving, polynomials, small, total, gains)
            if not whole:
                self._total[members] = total
                if len(self._gains):
                    self._gains[members] = gains
        return moving

    def _sum(
        self,
        profiles: RangeProfiles,
        pulses: Pulses,
        pair: AntennaPair,
        members: list[int],
        moving: SweepMotion,
        polynomials: NDArray[np.float64],
        small_turns: float,
        total: NDArray[np.complex64],
        gains: NDArray[np.float32],
    ) -> None:
        from processing.sar.backprojection_kernel import Signal, Table, add_pulses
        from processing.sar.backprojection_live import FEW, add_few
        from processing.sar.segments import segment_tables, table_stride

        bins = len(profiles.range_m)
        bins_per_m = (bins - 1) / float(profiles.range_m[-1] - profiles.range_m[0])
        layout = Table(len(polynomials) - 1, len(members), bins, table_stride(bins))
        signal = Signal(
            bins_per_m=bins_per_m,
            turns_per_m=2 * profiles.centre_hz / SPEED_OF_LIGHT_M_S,
            bistatic=pair.transmit_m != pair.receive_m,
            moving=moving.modelled,
            walk_s=profiles.centre_hz / moving.slope_hz_s,
            video=2 * moving.slope_hz_s / SPEED_OF_LIGHT_M_S**2 if moving.modelled else 0.0,
            axis_x=float(self._axis[0]),
            axis_y=float(self._axis[1]),
            axis_z=float(self._axis[2]),
            exponent=float(self._exponent),
            small_turns=small_turns,
        )
        track = _track(pulses, pair)
        # Sets of weights for the antennas' gains; without a pattern none is read.
        factors = np.ascontiguousarray(pulses.weights[members][: max(len(gains), 1)], dtype=np.float32)
        if not len(gains):
            gains = np.zeros((1, 1, 1), dtype=np.float32)
        seen = track[:3] if self._track_m is None else (self._track_m + np.asarray(pair.transmit_m)).T
        if pair not in self._patches:
            across = best_patch(self.grid, seen, bins_per_m)
            self._patches[pair] = across, on_lines(self.grid, across, signal.turns_per_m)
        across, line = self._patches[pair]
        block = _block(len(members), layout.stride, len(polynomials))
        for p0 in range(0, track.shape[1], block):
            some = slice(p0, p0 + block)
            # All channels are taken without a copy.
            chosen = pulses.values[:, some] if len(members) == len(pulses.values) else pulses.values[members, some]
            values = np.ascontiguousarray(chosen, dtype=np.complex64)
            table = segment_tables(values, np.ascontiguousarray(pulses.weights[members, some]), polynomials)
            count = values.shape[1]
            numbers = np.pad(track[:, some], ((0, 0), (0, -count % 16)), mode="edge").ravel()
            factor = np.ascontiguousarray(factors[:, some])
            add = add_few if count <= FEW else add_pulses
            for pixel, ground in flat_places(self.grid, across, ROWS, line):
                add(table, layout, signal, count, numbers, factor, pixel, ground, total, gains)
            del chosen, values, table  # before the next ones are made

    def image(self) -> NDArray[np.complex64]:
        """The image of what was added so far, (channels, rows, columns) complex64; more can be added afterwards."""
        return self._normalised(self._total.copy())

    def finish(self) -> NDArray[np.complex64]:
        """As :meth:`image`, without a copy; nothing can be added any more."""
        total, self._total = self._total, np.zeros((0, *self.grid.shape), dtype=np.complex64)
        return self._normalised(total)

    def _normalised(self, total: NDArray[np.complex64]) -> NDArray[np.complex64]:
        for c, plane in enumerate(total):
            # Correctly rounded, so that it does not matter in how many parts the pulses came.
            weight = math.fsum(itertools.chain.from_iterable(weights[c] for weights in self._weights))
            with np.errstate(invalid="ignore", divide="ignore"):
                if len(self._gains):
                    gain = self._gains[min(c, len(self._gains) - 1)]
                    plane /= gain
                    plane[~(gain > 0)] = np.nan
                elif weight > 0:
                    plane /= np.float32(weight)
                else:
                    plane[:] = np.nan
        return total


def _track(pulses: Pulses, pair: AntennaPair) -> NDArray[np.float64]:
    """(10, pulses) of the kernel: transmission, reception, velocity, first range."""
    track = np.zeros((10, len(pulses.antenna_m)))
    track[0:3] = (pulses.antenna_m + np.asarray(pair.transmit_m)).T
    track[3:6] = (pulses.antenna_m + np.asarray(pair.receive_m)).T
    if pulses.velocity_m_s is not None:
        track[6:9] = pulses.velocity_m_s.T
    track[9] = pulses.start_m
    return track


def distance_m(antenna_m: NDArray[np.float64], grid: ImageGrid) -> NDArray[np.float64]:
    """Distance, (ny, nx) m, from one place (3,) to every pixel."""
    dx = grid.x_m[None, :] - antenna_m[0]
    dy = grid.y_m[:, None] - antenna_m[1]
    distance: NDArray[np.float64] = np.sqrt(dx**2 + dy**2 + (grid.z_m - antenna_m[2]) ** 2)
    return distance
