"""What up- and down-ramp of a triangular sweep tell together about moving targets.

A range rate v shifts the beat by 2 v / lambda: upwards in the up-ramp, downwards in the down-ramp. So the same
target seems farther in the up-ramp than in the down-ramp by ``2 v f_c T / B`` while it recedes, and nearer while it
approaches. The mean of both is its range at the ramps' middle without that shift; the difference is its speed without
Doppler aliases and without knowing B (Stove 1992); and its sign tells which of the sync's levels the up-ramp is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.radar.ranging import compress, cut_sweeps, range_axis, unambiguous_range_m
from processing.radar.sync import Sync, opposite
from processing.radar.tracks import Track, find_tracks, moving_level_db

_AROUND_CELLS = 6.0  # extent of a target that is compared, to either side
_FARTHEST_CELLS = 16.0  # largest shift looked for
_TOP_DB = 20.0
_LEAST_LIKENESS = 0.4
_LEAST_TRAVEL_CELLS = 4.0  # a track that votes on the ramps' direction surely moves the way it seems to


@dataclass(frozen=True)
class RampShift:
    """By how much a target lies farther in the up-ramp than in the down-ramp."""

    shift_m: float
    """Range in the up-ramp minus range in the down-ramp at the same instant, m (scales as 1 / B)."""
    sd_m: float
    """Its standard deviation, from parts of the track, m."""
    likeness: float
    """Correlation of both ramps' pictures at that shift, 0 to 1."""

    def speed_m_s(self, ramp_s: float, bandwidth_hz: float, centre_hz: float) -> float:
        """Range rate from the shift, m/s: shift B / (2 f_c T). Independent of B, with which the shift scales."""
        return self.shift_m * bandwidth_hz / (2 * centre_hz * ramp_s)


def ramp_shift(
    track: Track,
    up_db: NDArray[np.float64],
    down_db: NDArray[np.float64],
    up_s: NDArray[np.float64],
    down_s: NDArray[np.float64],
    range_m: NDArray[np.float64],
    resolution_m: float,
) -> RampShift | None:
    """Compare a track's surroundings in up- and down-ramps by cross-correlation of their levels.

    Args:
        track: a track found in the up-ramps.
        up_db: (sweeps, bins) level over noise in the up-ramps.
        down_db: (other sweeps, bins) the same in the down-ramps.
        up_s: (sweeps,) instants of the up-ramps' centres, s.
        down_s: (other sweeps,) instants of the down-ramps' centres, s.
        range_m: (bins,) uniform range axis, m.
        resolution_m: range resolution, m.

    Returns:
        The shift, or None where the target is not recognised in the down-ramps.
    """
    step = float(range_m[1] - range_m[0])
    period = float(np.median(np.diff(up_s)))
    partner = np.searchsorted(down_s, up_s[track.sweeps])
    rows = partner < len(down_s)
    rows[rows] &= down_s[partner[rows]] - up_s[track.sweeps[rows]] < period
    if rows.sum() < 8:
        return None
    sweeps, partner, fitted = track.sweeps[rows], partner[rows], _fitted(track, up_s)[rows]
    later = fitted + track.speed_m_s * (down_s[partner] - up_s[sweeps])
    reach, far = int(np.ceil(_AROUND_CELLS * resolution_m / step)), int(np.ceil(_FARTHEST_CELLS * resolution_m / step))
    up = _around(up_db[sweeps], fitted, range_m, reach)
    down = _around(down_db[partner], later, range_m, reach + far)
    parts = [_products(up[part], down[part]) for part in np.array_split(np.arange(len(sweeps)), 4)]
    likeness = _likeness(*(np.sum(terms, axis=0) for terms in zip(*parts, strict=True)))
    peak = int(np.argmax(likeness))
    shift = _peak(likeness, peak)
    near = slice(max(peak - reach, 0), peak + reach + 1)
    each = [near.start + _peak(part, int(np.argmax(part))) for part in (_likeness(*terms)[near] for terms in parts)]
    spread = float(np.std(each, ddof=1)) / np.sqrt(len(each))
    if likeness[peak] < _LEAST_LIKENESS or peak in (0, len(likeness) - 1):
        return None
    return RampShift(-(shift - far) * step, spread * step, float(likeness[peak]))


def ramp_direction(samples: NDArray[np.generic], sync: Sync) -> Sync | None:
    """Tell from moving targets which level of the sync is the up-ramp.

    Args:
        samples: (n, 2) recording.
        sync: its sync with either polarity.

    Returns:
        The sync with the right polarity (``polarity_from = "motion"``), or None where no target moves clearly enough.
    """
    other = opposite(sync)
    if other is None or len(sync.starts) < 16 or len(other.starts) < 16:
        return None
    # Only signs count here: the bandwidth fixes the scale of ranges, and cancels.
    bandwidth, centre = 80e6, 2.4e9
    resolution = SPEED_OF_LIGHT_M_S / (2 * bandwidth)
    longest = min(unambiguous_range_m(bandwidth, min(sync.ramp_samples, other.ramp_samples)), 250.0)
    axis = range_axis(bandwidth, longest - resolution, 2)
    pictures, times = [], []
    for clock in (sync, other):
        sweeps = cut_sweeps(samples, clock)
        pictures.append(compress(sweeps, axis, centre_hz=centre, bandwidth_hz=bandwidth))
        times.append(sweeps.start_s + sweeps.ramp_s / 2)
    try:
        tracks = find_tracks(
            pictures[0], times[0], axis, wavelength_m=SPEED_OF_LIGHT_M_S / centre, resolution_m=resolution
        )
    except DataError:
        return None
    levels = [moving_level_db(picture, sync.period_s) for picture in pictures]
    shifts = [ramp_shift(track, levels[0], levels[1], times[0], times[1], axis, resolution) for track in tracks]
    vote = direction_vote(tracks, shifts, resolution)
    if vote == 0:
        return None
    right = sync if vote > 0 else other
    return replace(right, polarity_from="motion")


def direction_vote(tracks: Sequence[Track], shifts: Sequence[RampShift | None], resolution_m: float) -> int:
    """1 where targets seem farther in the up-ramp while they recede, as they must; -1 the other way round; else 0.

    Only tracks that travel at least four resolution cells vote, with the square of their shift over its error; the
    winner needs three quarters of the votes.
    """
    votes = []
    for track, shift in zip(tracks, shifts, strict=True):
        if shift is None or abs(track.r1_m - track.r0_m) < _LEAST_TRAVEL_CELLS * resolution_m:
            continue
        if abs(shift.shift_m) > 3 * shift.sd_m:
            # Errors below a twentieth of a cell are luck, not knowledge.
            weight = min((shift.shift_m / max(shift.sd_m, resolution_m / 20)) ** 2, 400.0)
            votes.append(np.copysign(weight, shift.shift_m * track.speed_m_s))
    total = float(np.sum(np.abs(votes)))
    if total < 9 or abs(float(np.sum(votes))) < 0.5 * total:
        return 0
    return int(np.sign(np.sum(votes)))


def _fitted(track: Track, up_s: NDArray[np.float64]) -> NDArray[np.float64]:
    along = track.r0_m + track.speed_m_s * (up_s[track.sweeps] - track.t0_s)
    return np.asarray(along, dtype=np.float64)


def _around(
    level_db: NDArray[np.float64], at_m: NDArray[np.float64], range_m: NDArray[np.float64], reach: int
) -> NDArray[np.float64]:
    """Levels within ``reach`` bins of a moving place, linearly interpolated, limited to 0 … 20 dB; 0 off the axis."""
    at = (at_m - range_m[0]) / (range_m[1] - range_m[0])
    place = at[:, None] + np.arange(-reach, reach + 1)
    index = np.clip(np.floor(place).astype(np.intp), 0, level_db.shape[1] - 2)
    part = np.clip(place - index, 0.0, 1.0)
    limited = np.clip(level_db, 0.0, _TOP_DB)
    row = np.arange(len(at))[:, None]
    values = limited[row, index] * (1 - part) + limited[row, index + 1] * part
    return np.where((place < 0) | (place > level_db.shape[1] - 1), 0.0, values)


def _products(
    up: NDArray[np.float64], down: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Sums at each shift: of the products, of the up-ramp's squares and of the down-ramp's squares."""
    windows = np.lib.stride_tricks.sliding_window_view(down, up.shape[1], axis=1)
    squares = np.einsum("ikw,ikw->k", windows, windows)
    return np.einsum("iw,ikw->k", up, windows), np.full_like(squares, (up**2).sum()), squares


def _likeness(
    products: NDArray[np.float64], up_squares: NDArray[np.float64], down_squares: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.asarray(products / np.sqrt(np.maximum(up_squares * down_squares, 1e-300)), dtype=np.float64)


def _peak(values: NDArray[np.float64], index: int) -> float:
    """Place of a maximum by a parabola through three values."""
    if not 0 < index < len(values) - 1:
        return float(index)
    left, middle, right = values[index - 1 : index + 2]
    curvature = left - 2 * middle + right
    return index + (0.5 * float((left - right) / curvature) if curvature < 0 else 0.0)
