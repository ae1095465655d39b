"""Range migration (omega-k) for a straight rail with equal steps: back-projection's sum, done in wavenumbers.

With k = 4 pi f / c, the back-projected image over (x, rho), rho the slant distance from the rail, is a convolution
along the rail with ``exp(j k sqrt(u^2 + rho^2))``, whose transform over u is, but for terms of relative size
3 / (8 k_rho rho),

    sqrt(2 pi rho) k k_rho^(-3/2) exp(j pi / 4) exp(j rho k_rho),      k_rho = sqrt(k^2 - k_x^2).

After the change of variable from k to k_rho (Stolt 1978) the image is a two-dimensional inverse transform. The factor
above makes amplitude and phase those of back-projection; nothing is fitted. The spectrum along the rail is continued
periodically beyond the sampling's own band, as back-projection does implicitly, so that grating lobes agree too.
Algorithm: Cafforio, Prati, Rocca 1991; Carrara, Goodman, Majewski 1995, chapter 10.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.signal import czt

from processing.errors import DataError
from processing.radar.antenna import AntennaPair, pattern_exponent
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.aperture import EvenTrack, Pulses, even_track, two_way_gain, usable_pulses, widest_angle_rad
from processing.sar.continuous import sweep_motion
from processing.sar.grid import ImageGrid, check_grid
from processing.sar.interpolation import tap_weights
from processing.sar.stolt import stolt

RANGE_PADDING = 4
"""How many times longer than the profiles the range period is made; the Stolt filter's oversampling follows from it."""

SLANT_OVERSAMPLING = 4
"""Samples per resolution cell of the slant image before it is read at the grid's rows."""

BAND_MARGIN = 2.0
"""Width of the band that is kept, as a multiple of the ramp's."""

RANGE_MARGIN = 8
"""Resolution cells of range that are kept beyond the grid's; half of them roll off."""


def range_migration(
    profiles: RangeProfiles,
    grid: ImageGrid,
    *,
    weights: NDArray[np.floating] | None = None,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
) -> NDArray[np.complex64]:
    """Focus all channels by range migration, on the same grid and with the same scale and phase as back-projection.

    Args:
        profiles: (channels, positions, bins); profiles that are NaN throughout count as missing.
        grid: where to form the image: x uniform, all of it in front of the rail.
        weights: (positions,) window along the aperture; rectangular where left out.
        beamwidth_rad: half-power beam width of one antenna for pattern compensation; none where left out.
        depression_rad: angle of the antennas' axes below horizontal; they look along +y.

    Returns:
        (channels, ny, nx) complex64; NaN where a pulse's range is off the profiles' axis.

    Raises:
        DataError: positions that are uneven by more than 1 % of their step, first ranges or antenna pairs of their
            own, motion within the sweeps that matters, single NaN samples (all advise back-projection), a grid that is
            no plane, not in front of the rail or not uniform in x, or unusable profiles.
    """
    pulses = usable_pulses(profiles, weights)
    _check(profiles, pulses, grid)
    if np.isnan(pulses.values).any():
        raise DataError("profiles hold single NaN samples", "focus by back-projection, which keeps them local")
    track = even_track(pulses.antenna_m)
    if np.min(grid.y_m) <= track.y_m:
        raise DataError(
            f"the image grid begins at y = {np.min(grid.y_m):g} m, not in front of the rail (y = {track.y_m:g} m)",
            "form the image in front of the rail",
        )
    x_step = _uniform_step(grid.x_m)
    slant = np.hypot(grid.y_m - track.y_m, grid.z_m - track.z_m)
    outside, nearest, furthest = _ranges(profiles, pulses, track, grid)
    profiles, pulses = _crop(profiles, pulses, nearest, furthest)
    view = _View(profiles, pulses, track, grid, slant)
    exponent = 0.0 if beamwidth_rad is None else pattern_exponent(beamwidth_rad)
    image = np.empty((len(pulses.values), *grid.shape), dtype=np.complex64)
    spectral_filter = view.filter(exponent)
    for c in range(len(image)):
        mapped = stolt(view.spectrum(c), view.along, view.k[0], view.k_step, view.across, RANGE_PADDING)
        mapped *= spectral_filter
        lines = view.read_rows(view.read_columns(mapped, float(grid.x_m[0]), x_step, len(grid.x_m)))
        scale = view.carrier() * _tilt(grid, track, slant, depression_rad) ** exponent
        second = _second_order(profiles, grid, track, slant, exponent)
        norm = _normalisation(pulses, c, grid, beamwidth_rad, depression_rad)
        with np.errstate(invalid="ignore", divide="ignore"):
            image[c] = np.where(outside | (norm <= 0), np.nan, (lines * scale).T * second / norm)
    return image


def _check(profiles: RangeProfiles, pulses: Pulses, grid: ImageGrid) -> None:
    """What the method does not model is refused, not focused wrongly."""
    advice = "focus by back-projection"
    if not isinstance(grid, ImageGrid):
        raise DataError("range migration forms images on a plane, in x and y", advice)
    check_grid(grid)
    if profiles.start_m is not None and np.any(np.asarray(profiles.start_m) != 0):
        raise DataError("positions have first ranges of their own, which range migration does not take", advice)
    if profiles.pairs is not None and any(pair != AntennaPair() for pair in profiles.pairs):
        raise DataError("transmitting and receiving antennas stand apart, which range migration does not model", advice)
    moving = sweep_motion(profiles)
    if moving.modelled:
        raise DataError(f"{moving.reason}, which range migration does not model", advice)


class _View:
    """Where one focusing task lies in wavenumbers, and the transforms between there and its profiles and image."""

    def __init__(
        self,
        profiles: RangeProfiles,
        pulses: Pulses,
        track: EvenTrack,
        grid: ImageGrid,
        slant: NDArray[np.float64],
    ) -> None:
        self.profiles, self.pulses, self.track, self.slant = profiles, pulses, track, slant
        self.middle = 0.5 * float(slant.min() + slant.max())
        furthest = float(profiles.range_m[-1])
        ends = pulses.antenna_m[:, 0].min(), pulses.antenna_m[:, 0].max()

        bins = len(profiles.range_m)
        self.range_length = scipy.fft.next_fast_len(RANGE_PADDING * bins)
        self.k_step = 2 * math.pi / (self.range_length * profiles.range_step_m)
        width = 4 * math.pi * profiles.bandwidth_hz / SPEED_OF_LIGHT_M_S
        self.centre = 4 * math.pi * profiles.centre_hz / SPEED_OF_LIGHT_M_S
        half = math.ceil(0.5 * min(BAND_MARGIN * width, 1.9 * self.centre) / self.k_step)
        half = min(half, (self.range_length - 1) // 2)
        self.k_index = np.arange(-half, half + 1)
        self.k = self.centre + self.k_step * self.k_index
        self.bulk = 0.5 * float(profiles.range_m[0] + profiles.range_m[-1])

        self.widest = widest_angle_rad(pulses.antenna_m, grid)
        self.limit = min(self.widest + math.radians(15), 0.5 * (self.widest + math.pi / 2))
        # Echoes reach as far aside as the profiles reach in range; the period keeps them from folding into the grid.
        reach = max(ends[1] + furthest - grid.x_m.min(), grid.x_m.max() - ends[0] + furthest)
        self.rail_length = scipy.fft.next_fast_len(max(math.ceil(reach / track.step_m), int(track.index.max()) + 1))
        self.along_step = 2 * math.pi / (self.rail_length * track.step_m)
        last = math.ceil(self.k[-1] * math.sin(self.limit) / self.along_step)
        self.along_index = np.arange(-last, last + 1)
        self.along = self.along_step * self.along_index

        self.across_step = 2 * math.pi / (1.5 * furthest)
        lowest = self.k[0] * math.cos(self.limit)
        self.across = lowest + self.across_step * np.arange(math.ceil((self.k[-1] - lowest) / self.across_step) + 1)

    def spectrum(self, channel: int) -> NDArray[np.complex64]:
        """(along, k) spectrum of one channel, weighted, referred to the middle of the scene."""
        profiles, track = self.profiles, self.track
        values = self.pulses.values[channel] * self.pulses.weights[channel][:, None]
        in_k = scipy.fft.fft(values, self.range_length, axis=1)[:, self.k_index]
        # Bulk range removed: what is left turns slowly in k at every angle, which the Stolt filter relies on.
        in_k *= profiles.range_step_m * np.exp(1j * (self.k - self.centre) * (self.bulk - profiles.range_m[0]))
        even = np.zeros((self.rail_length, len(self.k)), dtype=np.complex128)
        even[track.index] = in_k
        both = scipy.fft.fft(even, axis=0)[self.along_index % self.rail_length]
        both *= np.exp(-1j * self.along * track.first_m)[:, None]
        referred: NDArray[np.complex64] = both.astype(np.complex64)
        return referred

    def filter(self, exponent: float) -> NDArray[np.complex64]:
        """(along, across) factor of the mapped spectrum.

        It has back-projection's amplitude, the pattern and the angles that the grid needs, and refers what was
        referred to the bulk range in k to the middle of the scene in k_rho.
        """
        k = np.sqrt(self.across**2 + self.along[:, None] ** 2)
        cosine = self.across / k
        inner, outer = math.cos(self.widest), math.cos(self.limit)
        edge = np.clip((cosine - outer) / (inner - outer), 0, 1)
        taper = 0.5 - 0.5 * np.cos(np.pi * edge)
        cell = self.along_step * self.across_step / (2 * math.pi) ** 2
        factor = cell * math.sqrt(2 * math.pi) / np.sqrt(self.across) * cosine**exponent * taper
        turned = np.exp(1j * (self.middle * self.across - self.bulk * (k - self.centre)))
        return np.asarray(factor * turned, dtype=np.complex64)

    def read_columns(self, mapped: NDArray[np.complex64], x0: float, dx: float, columns: int) -> NDArray[np.complex128]:
        """(columns, across): inverse transform along the rail at equal steps of x, by the chirp z-transform."""
        turn = self.along_step
        lines = czt(mapped, columns, w=np.exp(1j * turn * dx), a=np.exp(-1j * turn * x0), axis=0)
        x = x0 + dx * np.arange(columns)
        referred: NDArray[np.complex128] = lines * np.exp(1j * self.along[0] * x)[:, None]
        return referred

    def read_rows(self, lines: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """(columns, rows): inverse transform across the rail at the slant distances of the grid's rows."""
        count = len(self.across)
        length = scipy.fft.next_fast_len(SLANT_OVERSAMPLING * count)
        half = count // 2
        centred = np.zeros((len(lines), length), dtype=np.complex128)
        centred[:, : count - half] = lines[:, half:]
        centred[:, length - half :] = lines[:, :half]
        fine = scipy.fft.ifft(centred, axis=1) * length
        place = (self.slant - self.middle) * self.across_step * length / (2 * math.pi)
        whole = np.floor(place).astype(np.int64)
        filters = tap_weights("sinc8", place - whole, SLANT_OVERSAMPLING)
        rows = np.zeros((len(lines), len(place)), dtype=np.complex128)
        for tap, weight in zip(range(-3, 5), filters.T, strict=True):
            rows += fine[:, (whole + tap) % length] * weight
        return rows

    def carrier(self) -> NDArray[np.complex128]:
        """(rows,) what :meth:`read_rows` leaves out: the carrier and back-projection's growth with distance."""
        middle_across = self.across[len(self.across) // 2]
        phase = (self.slant - self.middle) * middle_across + math.pi / 4
        return np.asarray(np.sqrt(self.slant) * np.exp(1j * phase))


def _uniform_step(x_m: NDArray[np.float64]) -> float:
    if len(x_m) == 1:
        return 1.0
    step = float(x_m[-1] - x_m[0]) / (len(x_m) - 1)
    if step == 0 or np.abs(np.diff(x_m) - step).max() > 1e-6 * abs(step) * len(x_m):
        raise DataError("the image grid's x is not uniform", "give equal steps, or focus by back-projection")
    return step


def _tilt(grid: ImageGrid, track: EvenTrack, slant: NDArray[np.float64], depression_rad: float) -> NDArray[np.float64]:
    """(ny,) cosine between the antennas' axis and the direction to each row straight ahead."""
    ahead = math.cos(depression_rad) * (grid.y_m - track.y_m) - math.sin(depression_rad) * (grid.z_m - track.z_m)
    return np.asarray(np.clip(ahead / slant, 0, 1))


def _normalisation(
    pulses: Pulses, channel: int, grid: ImageGrid, beamwidth_rad: float | None, depression_rad: float
) -> NDArray[np.float64]:
    weights = pulses.weights[channel]
    if beamwidth_rad is None:
        return np.full(grid.shape, weights.sum())
    total = np.zeros(grid.shape)
    for antenna, weight in zip(pulses.antenna_m, weights, strict=True):
        total += weight * two_way_gain(antenna, grid, beamwidth_rad, depression_rad) ** 2
    return total


def _second_order(
    profiles: RangeProfiles, grid: ImageGrid, track: EvenTrack, slant: NDArray[np.float64], exponent: float
) -> NDArray[np.complex128]:
    """(ny, nx) next term of the transform's expansion, ``exp(j a / (k_rho rho))``, for a pattern ``cos^n``.

    With R = rho cosh t the integral over the rail is ``int cosh^m(s + t0) exp(j z cosh s) ds``, m = 1 - n, z = k_rho
    rho, tanh t0 = k_x / k; its second term gives a = (m + m (m - 1) sin^2 angle) / 2 - 1/8. It is small, so that the
    angle seen from the aperture's centre serves for all positions.
    """
    middle = track.first_m + 0.5 * track.step_m * float(track.index.max())
    aside = grid.x_m[None, :] - middle
    distance = np.hypot(aside, slant[:, None])
    m = 1 - exponent
    a = 0.5 * (m + m * (m - 1) * (aside / distance) ** 2) - 0.125
    k = 4 * math.pi * profiles.centre_hz / SPEED_OF_LIGHT_M_S
    return np.asarray(np.exp(1j * a * distance / (k * slant[:, None] ** 2)))


def _ranges(
    profiles: RangeProfiles, pulses: Pulses, track: EvenTrack, grid: ImageGrid
) -> tuple[NDArray[np.bool_], float, float]:
    """Pixels that are off the range axis for any pulse (as back-projection with eight taps has it), and the ranges.

    Of a straight rail the nearest position and the further end have the shortest and the longest distance.
    """
    lowest = profiles.range_m[0] + 3 * profiles.range_step_m
    highest = profiles.range_m[-1] - 4 * profiles.range_step_m
    x = np.sort(pulses.antenna_m[:, 0])
    after = np.clip(np.searchsorted(x, grid.x_m), 1, len(x) - 1)
    beside = np.minimum(np.abs(grid.x_m - x[after - 1]), np.abs(grid.x_m - x[after]))
    end = np.maximum(np.abs(grid.x_m - x[0]), np.abs(grid.x_m - x[-1]))
    slant = np.hypot(grid.y_m - track.y_m, grid.z_m - track.z_m)[:, None]
    shortest, longest = np.hypot(slant, beside), np.hypot(slant, end)
    return (shortest < lowest) | (longest >= highest), float(shortest.min()), float(longest.max())


def _crop(profiles: RangeProfiles, pulses: Pulses, nearest: float, furthest: float) -> tuple[RangeProfiles, Pulses]:
    """Keep the ranges that the grid needs and a margin that rolls off smoothly, so that nothing leaks off the band."""
    margin = RANGE_MARGIN * profiles.resolution_m
    beyond = np.maximum(nearest - profiles.range_m, profiles.range_m - furthest) / margin
    kept = np.flatnonzero(beyond < 1)
    if kept.size < 2:
        raise DataError(
            f"the image's ranges, {nearest:.3g} to {furthest:.3g} m, are outside the profiles, "
            f"{profiles.range_m[0]:.3g} to {profiles.range_m[-1]:.3g} m",
            "form the image where there are profiles",
        )
    roll = 0.5 + 0.5 * np.cos(np.pi * np.clip(2 * beyond[kept] - 1, 0, 1))
    return (
        replace(profiles, range_m=profiles.range_m[kept], values=profiles.values[..., kept]),
        replace(pulses, values=pulses.values[..., kept] * roll),
    )
