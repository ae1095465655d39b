"""Error of factorized back-projection, predicted for a track and a grid from the filters and what they are given.

Each merging reads grids of samples between their places. How wrong it is about one pulse and one frequency follows from
the phase gradient that these have at the place, in cycles per sample. Filters err at the edges of their bands: what few
pulses or few frequencies have in common is spread over many resolution cells, and what lies beyond the image is not in
its error. So the error is transformed over the pulses of a part, and over the band, to distances from the target.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.radar.ranging import window_weights
from processing.sar.factorized_plan import (
    PULSES_OF_PART,
    Level,
    Settings,
    Track,
    phase_gradients,
    plan_levels,
    polar_places,
    scene_border,
    track_order,
)
from processing.sar.filter_design import least_squares_weights
from processing.sar.grid import ImageGrid
from processing.sar.patch_sum import COLUMNS, ROWS

TABLES_DB = -94.0
"""What linear interpolation in the tables of weights leaves of each merging."""

SAMPLES = 64
"""Of a part's pulses and of the band, from which errors are transformed to places."""

FINER = 4
"""Distances in a resolution cell, which the edges of the spectrum make necessary."""

PLACES, PARTS, FRACTIONS, BINS = 5, 8, 8, 257
"""Places of the image along each axis, parts of a level, places between two samples, and a filter's frequencies."""


def merging_error_db(
    antenna_m: NDArray[np.float64],
    grid: ImageGrid,
    settings: Settings,
    *,
    centre_hz: float,
    bandwidth_hz: float,
    window: str = "rectangular",
) -> float:
    """Expected error of all mergings together, dB: root mean square over the image, relative to exact back-projection.

    Args:
        antenna_m: (positions, 3).
        grid: of the image.
        settings: of the interpolation.
        centre_hz: centre frequency.
        bandwidth_hz: of the ramp.
        window: over the ramp.

    Raises:
        DataError: the image reaches abreast of the track, so that there is no polar grid.
    """
    x, y, z = grid.places_m()
    border = scene_border(x, y)
    order = track_order(antenna_m, border)
    place = antenna_m[order]
    track = Track(place, place, np.zeros(len(place)), centre_hz, bandwidth_hz)
    height = float(z.flat[0])
    levels = plan_levels(track, border, height, settings, x.size)
    inner = np.ix_(*(np.linspace(0, n - 1, PLACES + 2).round().astype(int)[1:-1] for n in x.shape))
    places = np.column_stack([x[inner].ravel(), y[inner].ravel(), np.full(PLACES**2, height)])
    box = np.array([[x.min(), x.max()], [y.min(), y.max()]])
    power = sum(_read_error(level, track, places, box, settings, window) for level in levels)
    return 10 * math.log10(power)


def _read_error(
    level: Level, track: Track, places: NDArray[np.float64], box_m: NDArray[np.float64], settings: Settings, window: str
) -> float:
    """Relative error power of reading one level's grids, mean over targets at places (places, 3)."""
    chosen = np.unique(np.linspace(0, len(level.start) - 1, PARTS).round().astype(int))
    by_s, by_r = (gradient[chosen] for gradient in phase_gradients(track, level, places[:, :2], places[0, 2]))
    step_r, step_s = level.step[chosen].T[..., None]
    turns = 2 / SPEED_OF_LIGHT_M_S
    unit = (np.arange(SAMPLES) + 0.5) / SAMPLES
    # Along the angle a part's pulses are the spectrum, across it the ramp's frequencies.
    cycles = turns * track.centre_hz * step_s[..., None] * by_s
    at = unit * (PULSES_OF_PART - 1)
    below = np.minimum(at.astype(int), PULSES_OF_PART - 2)
    along = cycles[..., below] + (at - below) * (cycles[..., below + 1] - cycles[..., below])
    frequency = track.centre_hz + track.bandwidth_hz * (unit - 0.5)
    across = turns * step_r[..., None, None] * (by_r[..., None] * frequency - track.centre_hz)
    away = np.asarray(np.fft.fftfreq(FINER * SAMPLES, 1 / SAMPLES), dtype=np.float64)
    wide = step_s / np.maximum(np.abs(cycles[..., -1] - cycles[..., 0]), 1e-12)
    inside_s, inside_r = _inside(
        level, chosen, places, box_m, wide[..., None] * away, away / (turns * track.bandwidth_hz)
    )
    power = _in_image(_filter(ROWS, settings.angle_oversampling), along, np.ones(SAMPLES), inside_s)
    weights = window_weights(window, unit - 0.5, 1e9)
    of_pulses = _in_image(_filter(COLUMNS, settings.range_oversampling), across, weights, inside_r[:, None, None])
    power += of_pulses.mean(axis=2)
    return float(np.average(power.mean(axis=1), weights=np.diff(level.first)[chosen])) + 10 ** (TABLES_DB / 10)


def _inside(
    level: Level,
    chosen: NDArray[np.intp],
    places: NDArray[np.float64],
    box_m: NDArray[np.float64],
    by_s: NDArray[np.float64],
    by_r: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Whether places at distances from targets along s (parts, targets, distances) are in the image, 1 or 0; and the
    share of targets (parts, distances) for which those along R are."""
    z = float(places[0, 2])
    inside_s, inside_r = np.empty(by_s.shape), np.empty((len(chosen), by_r.size))
    for i, part in enumerate(chosen):
        away = places[:, :2] - level.centre_m[part, :2]
        r = np.sqrt(np.sum(away**2, axis=1) + (z - level.centre_m[part, 2]) ** 2)[:, None]
        s = (away @ level.axis[part])[:, None] / r
        inside_s[i] = _in_box(polar_places(level, part, z, s + by_s[i], r + 0 * by_s[i]), box_m)
        inside_r[i] = _in_box(polar_places(level, part, z, s + 0 * by_r, r + by_r), box_m).mean(axis=0)
    return inside_s, inside_r


def _in_box(places: NDArray[np.float64], box_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    within = (places[..., :2] >= box_m[:, 0]) & (places[..., :2] <= box_m[:, 1])
    return np.asarray(within.all(axis=-1) & (places[..., 2] == 0))


def _in_image(
    response: _Response, cycles: NDArray[np.float64], spectrum: NDArray[np.float64], inside: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Error power (...) in the image over the spectrum's own; of ``cycles`` (..., samples), ``inside`` (..., bins)."""
    power = np.zeros(cycles.shape[:-1])
    for fraction in range(FRACTIONS):
        spread = np.fft.fft(response(fraction, cycles) * spectrum, FINER * SAMPLES, axis=-1)
        power += np.sum((spread.real**2 + spread.imag**2) * inside, axis=-1)
    power /= FRACTIONS * FINER * SAMPLES * np.sum(spectrum**2)
    return power


class _Response:
    """A filter's complex error by frequency, cycles per sample, at some places between two samples."""

    def __init__(self, taps: int, oversampling: float) -> None:
        self.cycles = np.linspace(-0.5, 0.5, BINS)
        fraction = (np.arange(FRACTIONS) + 0.5) / FRACTIONS
        weights = least_squares_weights(fraction, taps, oversampling)
        bins = np.arange(1 - taps // 2, taps // 2 + 1)
        made = weights @ np.exp(2j * np.pi * np.outer(bins, self.cycles))
        # Relative to the wave itself, so that what is left turns slowly with the frequency.
        self.error = made * np.exp(-2j * np.pi * np.outer(fraction, self.cycles)) - 1

    def __call__(self, fraction: int, cycles: NDArray[np.float64]) -> NDArray[np.complex128]:
        return np.asarray(np.interp(cycles, self.cycles, self.error[fraction]))


@functools.lru_cache(maxsize=16)
def _filter(taps: int, oversampling: float) -> _Response:
    return _Response(taps, oversampling)
