"""Moving targets in range-time data: where they are, how fast, and how sure that is.

1. The background is removed (a sliding mean over slow time), the rest normalised to the noise.
2. Ridges are found by track-before-detect: dynamic programming over states (range, speed) finds the path with the
   largest sum of scores, whose speed changes little from sweep to sweep (Barniv 1985). Its surroundings are
   taken away and the search repeated.
3. A ridge is split where its speed changes, and a robust line fitted to each stretch.
4. Doppler comes from the phase from sweep to sweep along the stretch (pulse-pair, Miller and Rochwarger 1972).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError, undefined_is_nan
from processing.radar.doppler import remove_background, unambiguous_speed_m_s
from processing.radar.line_fit import breaks, robust_line
from processing.radar.ridges import best_path


@dataclass(frozen=True, eq=False)
class Track:
    """A stretch of steady motion. Speeds are range rates, positive when the range grows."""

    t0_s: float
    t1_s: float
    r0_m: float
    r1_m: float
    speed_m_s: float
    """Slope of the range over time, m/s; scales with the ramp's assumed bandwidth as 1 / B."""
    speed_sd_m_s: float
    """Standard deviation of ``speed_m_s`` from the scatter of the ranges (not of the bandwidth), m/s."""
    doppler_m_s: float
    """Range rate from the phase, at the alias nearest to ``speed_m_s``, m/s; independent of the bandwidth."""
    doppler_sd_m_s: float
    """Standard deviation of ``doppler_m_s``, its alias taken as right, m/s."""
    snr_db: float
    """Median over the stretch of peak power over noise, dB."""
    sweeps: NDArray[np.intp] = field(repr=False)
    """(points,) indices of the sweeps of the stretch."""
    range_m: NDArray[np.float64] = field(repr=False)
    """(points,) measured ranges at those sweeps, m."""


@dataclass(frozen=True)
class TrackSettings:
    """What counts as a track."""

    max_speed_m_s: float = 40.0
    """Fastest range rate looked for, m/s."""
    min_speed_m_s: float = 0.4
    """Slower stretches are not reported: what the background leaves behind stands still, m/s."""
    min_duration_s: float = 0.8
    """Shortest stretch, s; stretches within one resolution cell are not reported either."""
    background_s: float = 1.0
    """Length of the sliding mean that is removed, s."""
    min_range_m: float = 0.0
    """Nearest range looked at, m."""
    max_tracks: int = 24
    """Ridges looked for at most."""


def find_tracks(
    profiles: NDArray[np.complexfloating],
    time_s: NDArray[np.float64],
    range_m: NDArray[np.float64],
    *,
    wavelength_m: float,
    resolution_m: float,
    settings: TrackSettings | None = None,
) -> list[Track]:
    """Tracks of moving targets, the most evident (largest sum of levels in dB over the noise) first.

    Args:
        profiles: (sweeps, bins) complex range profiles from one place, in the order of time.
        time_s: (sweeps,) instants of the ramps' centres, s; evenly spaced or nearly so.
        range_m: (bins,) uniform range axis, m.
        wavelength_m: wavelength at the ramp's centre, m.
        resolution_m: range resolution c / 2B, m.
        settings: what counts as a track.

    Raises:
        DataError: fewer than 8 sweeps, shapes that do not fit, undefined samples.
    """
    settings = settings or TrackSettings()
    count = len(time_s)
    if profiles.shape != (count, len(range_m)) or len(range_m) < 3:
        raise DataError(f"profiles of shape {profiles.shape} for {count} sweeps and {len(range_m)} ranges",
                        "give one row per sweep and one column per range")  # fmt: skip
    if count < 8:
        raise DataError(f"{count} sweeps are too few for a track", "record at least 8 sweeps")
    if not np.isfinite(profiles).all():
        raise DataError("the range profiles contain undefined samples", "leave out the sweeps that have them")
    period = float(np.median(np.diff(time_s)))
    background = _background_sweeps(settings, period, count)
    moving = remove_background(profiles, background)
    level_db = noise_normalised_db(moving)
    power = np.abs(moving) ** 2
    score = _score(level_db, range_m, settings, resolution_m)
    shortest = max(int(np.ceil(settings.min_duration_s / period)), 4)
    speeds = _speeds(range_m[1] - range_m[0], period, settings.max_speed_m_s, resolution_m)
    tracks: list[Track] = []
    for _ in range(settings.max_tracks):
        path = best_path(score, speeds)
        if path.total < _LEAST_TOTAL_DB or len(path.rows) < shortest:
            break
        rows, columns = _best_section(score, path.rows, path.columns, shortest)
        positions = _refine(power, range_m, columns, rows, resolution_m)
        for first, last in breaks(
            time_s[rows], positions, sd=resolution_m / 2, penalty=_BREAK_PENALTY, shortest=shortest
        ):
            piece = slice(first, last)
            track = _track(
                moving, level_db, time_s, range_m, rows[piece], positions[piece], wavelength_m, period, background
            )
            slowest = max(settings.min_speed_m_s, 3 * track.speed_sd_m_s)
            # A stretch whose line runs through noise is a path's leap from one target to another.
            seen = track.snr_db >= _SCORE_BIAS_DB
            if seen and abs(track.speed_m_s) >= slowest and abs(track.r1_m - track.r0_m) >= resolution_m:
                tracks.append(track)
        _erase(score, level_db, rows, columns, resolution_m / (range_m[1] - range_m[0]), shortest)
    return sorted(tracks, key=lambda track: -track.snr_db * len(track.sweeps))


_BREAK_PENALTY = 60.0  # in squared sd: a bend must explain this much
_SCORE_BIAS_DB = 4.0  # noise exceeds its median by 4 dB in a sixth of the cells
_SCORE_TOP_DB = 20.0
_WIDEST_CELLS = 10.0  # half the greatest extent of one target, in resolution cells
_LEAST_TOTAL_DB = 80.0  # sum of scores that noise alone does not reach (see the tests)


def moving_level_db(
    profiles: NDArray[np.complexfloating], period_s: float, settings: TrackSettings | None = None
) -> NDArray[np.float64]:
    """What moves, in dB over the noise: (sweeps, bins), the picture in which :func:`find_tracks` searches."""
    settings = settings or TrackSettings()
    return noise_normalised_db(remove_background(profiles, _background_sweeps(settings, period_s, len(profiles))))


def _background_sweeps(settings: TrackSettings, period_s: float, count: int) -> int:
    return min(max(round(settings.background_s / period_s), 4), count)


@undefined_is_nan
def noise_normalised_db(moving: NDArray[np.complexfloating]) -> NDArray[np.float64]:
    """Power in dB over the noise: of each range over time (lower quartile), then of each sweep over range (median).

    Targets fill a range for a part of the time only: up to three quarters of it do not lift the noise that is found.
    """
    power = 20 * np.log10(np.maximum(np.abs(moving), 1e-300))
    if not power.size:
        return np.asarray(power)
    # Of exponentially distributed power the median lies 10 log10(ln 2 / ln(4/3)) = 3.82 dB over the lower quartile.
    power = power - np.percentile(power, 25, axis=0) - 3.82
    result: NDArray[np.float64] = power - np.maximum(np.median(power, axis=1, keepdims=True), 0.0)
    return result


def _score(
    level_db: NDArray[np.float64], range_m: NDArray[np.float64], settings: TrackSettings, resolution_m: float
) -> NDArray[np.float64]:
    score = np.clip(level_db, 0.0, _SCORE_TOP_DB) - _SCORE_BIAS_DB
    score[:, range_m < max(settings.min_range_m, 1.5 * resolution_m)] = -_SCORE_TOP_DB
    return score


def _speeds(step_m: float, period_s: float, max_speed_m_s: float, resolution_m: float) -> NDArray[np.float64]:
    """Speeds of the search, bins per sweep: neighbouring ones part by one resolution cell within 40 sweeps."""
    speed_step = resolution_m / (40 * period_s)
    half = max(int(np.ceil(max_speed_m_s / speed_step)), 1)
    return np.arange(-half, half + 1, dtype=np.float64) * np.float64(speed_step * period_s / step_m)


def _refine(
    power: NDArray[np.float64],
    range_m: NDArray[np.float64],
    columns: NDArray[np.intp],
    rows: NDArray[np.intp],
    resolution_m: float,
) -> NDArray[np.float64]:
    """Centroid of the power within one resolution cell on either side of the path, then of the centroid, m.

    Of the power itself: levels over the noise lean to ranges in which a slow target has not stood for long.
    """
    step = range_m[1] - range_m[0]
    reach = max(int(np.ceil(resolution_m / step)), 1)
    centre = columns
    for _ in range(3):
        index = np.clip(centre[:, None] + np.arange(-reach, reach + 1), 0, len(range_m) - 1)
        weight = power[rows[:, None], index]
        centroid: NDArray[np.float64] = (weight * range_m[index]).sum(axis=1) / weight.sum(axis=1)
        centre = np.clip(np.round((centroid - range_m[0]) / step).astype(np.intp), columns - reach, columns + reach)
    return centroid


def _track(
    moving: NDArray[np.complexfloating],
    level_db: NDArray[np.float64],
    time_s: NDArray[np.float64],
    range_m: NDArray[np.float64],
    rows: NDArray[np.intp],
    positions: NDArray[np.float64],
    wavelength_m: float,
    period_s: float,
    background: int,
) -> Track:
    steady = _with_full_background(rows, len(time_s), background)
    line = robust_line(time_s[rows[steady]], positions[steady])
    fitted = line.middle + line.slope * (time_s[rows] - line.t_middle)
    columns = np.clip(np.round((fitted - range_m[0]) / (range_m[1] - range_m[0])).astype(np.intp), 0, len(range_m) - 1)
    doppler, doppler_sd = _pulse_pair(moving, rows, columns, wavelength_m, period_s, line.slope)
    return Track(
        t0_s=float(time_s[rows[0]]),
        t1_s=float(time_s[rows[-1]]),
        r0_m=line.at(float(time_s[rows[0]])),
        r1_m=line.at(float(time_s[rows[-1]])),
        speed_m_s=line.slope,
        speed_sd_m_s=line.slope_sd,
        doppler_m_s=doppler,
        doppler_sd_m_s=doppler_sd,
        snr_db=float(np.median(level_db[rows, columns])),
        sweeps=rows,
        range_m=positions,
    )


def _with_full_background(rows: NDArray[np.intp], count: int, background: int) -> slice:
    """The part of a stretch that is far from the record's ends, if that is most of it, else all of it.

    Near the ends the background is a mean over one side only; it takes more off the side on which a slow target will
    be or has been, and so pushes it away.
    """
    first = int(np.searchsorted(rows, background // 2))
    last = int(np.searchsorted(rows, count - background // 2))
    return slice(first, last) if last - first >= max(len(rows) // 2, 4) else slice(0, len(rows))


def _pulse_pair(
    moving: NDArray[np.complexfloating],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    wavelength_m: float,
    period_s: float,
    near_m_s: float,
) -> tuple[float, float]:
    """Range rate from the mean phase step between sweeps, m/s, at the alias nearest to ``near_m_s``, and its sd."""
    pairs = np.conj(moving[rows[:-1], columns[:-1]]) * moving[rows[1:], columns[:-1]]
    total = pairs.sum()
    ambiguity = 2 * unambiguous_speed_m_s(wavelength_m, period_s)
    wrapped = -float(np.angle(total)) / (2 * np.pi) * ambiguity
    speed = wrapped + ambiguity * round((near_m_s - wrapped) / ambiguity)
    # Circular standard deviation of the phase steps (Mardia), over the root of their number.
    steadiness = min(float(np.abs(total) / np.maximum(np.abs(pairs).sum(), 1e-300)), 1.0)
    spread = np.sqrt(-2 * np.log(max(steadiness, 1e-12)))
    return speed, float(spread / (2 * np.pi) * ambiguity / np.sqrt(len(pairs)))


def _best_section(
    score: NDArray[np.float64], rows: NDArray[np.intp], columns: NDArray[np.intp], window: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The part of a path with the largest total among those in which the score, averaged over a window, is positive.

    A path may cross a stretch of noise from one target to another; this cuts it there.
    """
    values = score[rows, columns]
    smooth = np.convolve(values, np.ones(window) / window, mode="same")
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], (smooth > 0).astype(np.int8), [0]])))
    sections = [slice(first, last) for first, last in zip(bounds[::2], bounds[1::2], strict=True)]
    if not sections:
        return rows, columns
    best = max(sections, key=lambda section: float(values[section].sum()))
    return rows[best], columns[best]


def _erase(
    score: NDArray[np.float64],
    level_db: NDArray[np.float64],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    cell: float,
    window: int,
) -> None:
    """Take a ridge's surroundings out of the search: two cells on either side, and what adjoins them above the noise.

    A long vehicle, or a far target smeared by a ramp that is not quite linear, is one target and not many.
    """
    reach, near = int(np.ceil(_WIDEST_CELLS * cell)), max(int(np.ceil(2 * cell)), 1)
    offsets = np.arange(-reach, reach + 1)
    index = np.clip(columns[:, None] + offsets, 0, score.shape[1] - 1)
    around = np.clip(level_db[rows[:, None], index], 0.0, _SCORE_TOP_DB)
    kernel = np.ones(min(window, len(rows))) / min(window, len(rows))
    strong = np.apply_along_axis(np.convolve, 0, around, kernel, mode="same") > _SCORE_BIAS_DB
    strong[:, np.abs(offsets) <= near] = True
    below, above = strong[:, reach::-1], strong[:, reach:]
    joined = np.concatenate(
        [np.logical_and.accumulate(below, axis=1)[:, :0:-1], np.logical_and.accumulate(above, axis=1)], axis=1
    )
    score[np.broadcast_to(rows[:, None], index.shape)[joined], index[joined]] = -_SCORE_TOP_DB
