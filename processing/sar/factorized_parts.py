"""The smallest parts of a factorized aperture: pulses back-projected exactly onto the parts' polar grids.

That is what :mod:`processing.sar.backprojection_kernel` does for any places; the phase of the distance R to the part's
centre is taken off afterwards, which is what makes the part's image slow enough for its grid.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.factorized_plan import Level, Track
from processing.sar.patches import SHAPES

if TYPE_CHECKING:
    from processing.sar.backprojection_kernel import Signal

SMALL_TURNS = 1e-4
"""Bound of the phase error, turns, up to which offsets within a patch of samples may be float32: -64 dB of a sample at
the very worst, 20 dB less as a root mean square."""

PATCH_BINS = 13.0
"""Bins from the first to the last column of a patch, so that a window of sixteen holds them."""


def form_parts(
    values: NDArray[np.complexfloating],
    weights: NDArray[np.float64],
    order: NDArray[np.int64],
    track: Track,
    level: Level,
    *,
    step_m: float,
    axis: NDArray[np.float64],
    exponent: float,
    z_m: float,
) -> NDArray[np.complex64]:
    """Sum the pulses of each part at the places of its grid, the phase of R taken off.

    Args:
        values: (channels, pulses, bins) of the channels that share the track.
        weights: (channels, pulses).
        order: (pulses,) pulse at each place of the order in which they are grouped.
        track: places of the pulses, in that order.
        level: the parts.
        step_m: range bins' spacing.
        axis: (3,) the antennas' axis.
        exponent: of their pattern; 0: none.
        z_m: height of the scene.

    Returns:
        (channels, samples) of all parts, one after the other; 0 where a pulse's range is off its profile.
    """
    from processing.sar.backprojection_kernel import Ground, Signal, Table, add_pulses
    from processing.sar.segments import segment_polynomials, segment_tables, table_stride

    channels, _, bins = values.shape
    oversampling = SPEED_OF_LIGHT_M_S / (2 * track.bandwidth_hz) / step_m
    polynomials = segment_polynomials("sinc8", round(oversampling, 9))
    turns = 2 * track.centre_hz / SPEED_OF_LIGHT_M_S
    signal = Signal(
        bins_per_m=1.0 / step_m,
        turns_per_m=turns,
        bistatic=bool((track.transmit_m != track.receive_m).any()),
        moving=False,
        walk_s=0.0,
        video=0.0,
        axis_x=float(axis[0]),
        axis_y=float(axis[1]),
        axis_z=float(axis[2]),
        exponent=float(exponent),
        small_turns=SMALL_TURNS,
    )
    out = np.zeros((channels, level.samples), np.complex64)
    no_gains, level_z = np.zeros((1, 1, 1), np.float32), np.array([z_m])
    for part, (first, last) in enumerate(zip(level.first[:-1], level.first[1:], strict=True)):
        rows, columns = level.shape[part]
        distance, x, y, excess = _places(level, part, z_m)
        lowest, highest = _bins(track, level, part, distance, step_m, bins)
        if highest - lowest < 2:
            continue
        chosen = order[first:last]
        some = np.ascontiguousarray(values[:, chosen, lowest:highest], dtype=np.complex64)
        table = segment_tables(some, np.ascontiguousarray(weights[:, chosen]), polynomials)
        layout = Table(len(polynomials) - 1, channels, some.shape[2], table_stride(some.shape[2]))
        numbers = np.zeros((10, last - first))
        numbers[:3], numbers[3:6] = track.transmit_m[first:last].T, track.receive_m[first:last].T
        numbers[9] = track.start_m[first:last] + lowest * step_m
        padded = np.pad(numbers, ((0, 0), (0, -(last - first) % 16)), mode="edge").ravel()
        apart = abs(float(level.step[part, 0])) / step_m
        across = next((shape for shape in SHAPES if (shape - 1) * apart <= PATCH_BINS), 1)
        ground = Ground(int(rows), int(columns), 0, across, False, *(int(columns), 1) * 2, 0, 0)
        image = np.zeros((channels, rows, columns), np.complex64)
        none = np.zeros((0, last - first), np.float32)
        add_pulses(table, layout, signal, int(last - first), padded, none, (x, y, level_z), ground, image, no_gains)
        beyond = np.flatnonzero(excess < 0)
        if beyond.size:
            nowhere = x[beyond], y[beyond], z_m, excess[beyond]
            image.reshape(channels, -1)[:, beyond] = _sum_beyond(
                some, weights[:, chosen], numbers, nowhere, polynomials, signal
            )
        back = turns * distance
        image *= np.exp(-2j * math.pi * (back - np.rint(back))).astype(np.complex64)
        # Places off the profiles have nothing; they are near no pixel that is shown.
        image[np.isnan(image)] = 0
        begin = level.offset[part]
        out[:, begin : begin + rows * columns] = image.reshape(channels, -1)
    return out


def _places(level: Level, part: int, z_m: float) -> tuple[NDArray[np.float64], ...]:
    """R of the columns, and x, y and excess of all samples, flat (:func:`processing.sar.factorized_plan.polar_places`).

    Written out, for there are millions of them.
    """
    rows, columns = level.shape[part]
    distance = level.start[part, 0] + level.step[part, 0] * np.arange(columns)
    s = (level.start[part, 1] + level.step[part, 1] * np.arange(rows))[:, None]
    excess = (1 - s**2) * distance**2 - (z_m - level.centre_m[part, 2]) ** 2
    ahead = np.sqrt(np.maximum(excess, 0.0))
    along = s * distance
    x, y = (level.centre_m[part, k] + along * level.axis[part, k] + ahead * level.ahead[part, k] for k in (0, 1))
    return distance, x.ravel(), y.ravel(), excess.ravel()


def _sum_beyond(
    values: NDArray[np.complex64],
    weights: NDArray[np.float64],
    numbers: NDArray[np.float64],
    places: tuple[NDArray[np.float64], NDArray[np.float64], float, NDArray[np.float64]],
    polynomials: NDArray[np.float64],
    signal: Signal,
) -> NDArray[np.complex128]:
    """The sum of a part's pulses at the few samples of a grid's margin that are no places, (channels, samples).

    Args:
        values: (channels, pulses, bins).
        weights: (channels, pulses).
        numbers: (10, pulses) track as kernels take it.
        places: x, y, z and excess.
        polynomials: of the interpolation.
        signal: as the kernel's.
    """
    x, y, z, excess = places
    taps, bins = polynomials.shape[1], values.shape[2]
    total = np.zeros((len(values), len(x)), np.complex128)
    for n in range(numbers.shape[1]):
        path, gain = np.zeros(len(x)), np.ones(len(x))
        for antenna in (numbers[0:3, n], numbers[3:6, n]):
            dx, dy, dz = x - antenna[0], y - antenna[1], z - antenna[2]
            distance = np.sqrt(np.maximum(dx**2 + dy**2 + dz**2 + excess, 1e-12))
            path += 0.5 * distance
            toward = (signal.axis_x * dx + signal.axis_y * dy + signal.axis_z * dz) / distance
            gain *= np.maximum(toward, 0.0) ** (0.5 * signal.exponent)
        place = (path - numbers[9, n]) * signal.bins_per_m
        whole = np.floor(place)
        first = whole.astype(np.int64) - (taps // 2 - 1)
        inside = (first >= 0) & (first + taps <= bins)
        filters = (place - whole - 0.5)[:, None] ** np.arange(len(polynomials)) @ polynomials
        turns = path * signal.turns_per_m
        factor = np.where(inside, gain, 0.0) * np.exp(2j * np.pi * (turns - np.rint(turns)))
        read = np.where(inside, first, 0)[:, None] + np.arange(taps)
        total += weights[:, n, None] * factor * (values[:, n][:, read] * filters).sum(axis=2)
    return total


def _bins(
    track: Track, level: Level, part: int, distance: NDArray[np.float64], step_m: float, bins: int
) -> tuple[int, int]:
    """First and last bin (exclusive) that any pulse of a part can read."""
    own = slice(int(level.first[part]), int(level.first[part + 1]))
    away = max(
        float(np.linalg.norm(antenna[own] - level.centre_m[part], axis=1).max())
        for antenna in (track.transmit_m, track.receive_m)
    )
    nearest, furthest = float(np.abs(distance).min()) - away, float(np.abs(distance).max()) + away
    start = track.start_m[own]
    lowest = math.floor((nearest - float(start.max())) / step_m) - 8
    highest = math.ceil((furthest - float(start.min())) / step_m) + 9
    return max(lowest, 0), min(highest, bins)
