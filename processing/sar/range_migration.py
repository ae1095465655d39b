"""Range migration (omega-k) for a straight rail: back-projection's sum, done in wavenumbers.

With k = 4 pi f / c, the back-projected image over (x, rho), rho the slant distance from the rail, is a convolution
along the rail with ``exp(j k sqrt(u^2 + rho^2))``, whose transform over u is, but for terms of relative size
1 / (k_rho rho)^2,

    sqrt(2 pi rho) k k_rho^(-3/2) exp(j pi / 4 + j rho k_rho + j a / (k_rho rho)),      k_rho = sqrt(k^2 - k_x^2).

After the change of variable from k to k_rho (Stolt 1978) the image is a two-dimensional inverse transform. The factor
above makes amplitude and phase those of back-projection; nothing is fitted. Transforms from positions, to rows and to
columns are non-uniform (:mod:`processing.sar.gridding`), so that positions may stand anywhere on the line and rows and
columns anywhere on the plane, and grating lobes agree with back-projection's. Each row is formed from the k_x under
which it is seen, and no others. Algorithm: Cafforio, Prati, Rocca 1991; Carrara, Goodman, Majewski 1995, chapter 10.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy.fft
from numba import get_num_threads
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.antenna import pattern_exponent
from processing.radar.profiles import RangeProfiles
from processing.sar.grid import ImageGrid
from processing.sar.gridding import places
from processing.sar.range_migration_kernel import read_columns, read_rows, spread_track
from processing.sar.range_migration_plan import (
    COLUMN_KERNEL,
    ROW_KERNEL,
    TRACK_KERNEL,
    MigrationPlan,
    plan_migration,
)
from processing.sar.range_migration_task import Task, prepare
from processing.sar.stolt import CHUNK, FILTERS, Filter, stolt
from processing.sar.straight_track import ahead_cosine, pattern_sum

DIRECT_WORTH = 1.5
"""How much longer than one with a kernel's reading a transform along x may be that needs none."""

BLOCK_SAMPLES = 400_000
"""Samples of the transforms along x that are held at a time, a few megabytes."""


def range_migration(
    profiles: RangeProfiles,
    grid: ImageGrid,
    *,
    weights: NDArray[np.floating] | None = None,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
    taps: str = "kaiser-bessel",
) -> NDArray[np.complex64]:
    """Focus all channels by range migration, on the same grid and with the same scale and phase as back-projection.

    Args:
        profiles: (channels, positions, bins); profiles that are NaN throughout count as missing.
        grid: where to form the image, all of it in front of the rail.
        weights: (positions,) window along the aperture; rectangular where left out.
        beamwidth_rad: half-power beam width of one antenna for pattern compensation; none where left out.
        depression_rad: angle of the antennas' axes below horizontal; they look along +y.
        taps: filter of the Stolt interpolation, see :data:`processing.sar.stolt.FILTERS`.

    Returns:
        (channels, ny, nx) complex64; NaN where a pulse's range is off the profiles' axis.

    Raises:
        DataError: positions off a straight line along x, first ranges or antenna pairs of their own, motion within the
            sweeps that matters, single NaN samples (all advise back-projection), a grid that is no plane or not in
            front of the rail, an unknown filter, or unusable profiles.
    """
    if taps not in FILTERS:
        raise DataError(f"there is no Stolt filter called {taps!r}", f"choose one of {', '.join(FILTERS)}")
    task = prepare(profiles, grid, weights)
    exponent = 0.0 if beamwidth_rad is None else pattern_exponent(beamwidth_rad)
    plan = plan_migration(task.profiles, task.track, grid, FILTERS[taps], exponent)
    tilt = ahead_cosine(task.track, grid, depression_rad) ** exponent
    image = np.empty((len(task.pulses.values), *grid.shape), dtype=np.complex64)
    for c in range(len(image)):
        lines = _lines(task, plan, FILTERS[taps], c, image[c].reshape(-1))
        total = float(task.pulses.weights[c].sum())
        _form(lines, plan, task, grid, tilt / total, image[c])
        del lines
        if beamwidth_rad is not None:
            gain = pattern_sum(task.track, task.pulses.weights[c], grid, beamwidth_rad, depression_rad) / total
            with np.errstate(invalid="ignore", divide="ignore"):
                image[c] = np.where(gain > 0, image[c] / gain, np.nan)
        if task.outside is not None:
            image[c][task.outside] = np.nan
    return image


def _lines(
    task: Task, plan: MigrationPlan, taps: Filter, channel: int, spare: NDArray[np.complex64]
) -> NDArray[np.complex64]:
    """(samples across the rail, lines) of one channel: spectrum, Stolt interpolation, and back to distance.

    ``spare`` is memory to work in, such as that of the image that is not there yet.
    """
    workers = get_num_threads()
    values = task.pulses.values[channel]
    bins, middle, length = values.shape[1], plan.middle_bin, plan.range_length
    step = task.profiles.range_step_m
    correction = (step * task.roll / taps.response((np.arange(bins) - middle) / length)).astype(np.float32)
    # The middle of the ranges comes first: that refers the spectrum to it.
    padded = np.zeros((len(values), length), dtype=np.complex64)
    np.multiply(values[:, middle:], correction[middle:], out=padded[:, : bins - middle], casting="same_kind")
    np.multiply(values[:, :middle], correction[:middle], out=padded[:, length - middle :], casting="same_kind")
    in_k = scipy.fft.fft(padded, axis=1, overwrite_x=True, workers=workers)
    band = np.concatenate([in_k[:, length - plan.half_band :], in_k[:, : plan.half_band + 1]], axis=1).T.copy()
    # What is done with goes at once: these arrays are as large as the image.
    del padded, in_k

    place = task.track.x_m - task.track.middle_m
    samples = plan.track_length
    first, weights = places(place * (samples / plan.period_m), TRACK_KERNEL, samples)
    turned = np.exp(-1j * plan.mapping.along[plan.middle_line] * place) * task.pulses.weights[channel]
    spread = np.empty((len(band), samples), dtype=np.complex64)
    spread_track(band, first, (weights * turned[:, None]).astype(np.complex64), spread)
    del band
    both = scipy.fft.fft(spread, axis=1, overwrite_x=True, workers=workers)
    before = plan.middle_line
    needed = len(both) * plan.lines
    spectrum = (spare[:needed] if spare.size >= needed else np.empty(needed, np.complex64)).reshape(len(both), -1)
    np.concatenate([both[:, samples - before :], both[:, : plan.lines - before]], axis=1, out=spectrum)
    del spread, both

    count, samples = plan.mapping.across_count, plan.row_length
    before = count // 2
    undone = (1 / ROW_KERNEL.response((np.arange(count) - before) / samples)).astype(np.float32)[:, None]
    fine = np.zeros((samples, plan.lines), dtype=np.complex64)
    size = max(1, BLOCK_SAMPLES // (count * CHUNK)) * CHUNK
    for begin in range(0, plan.lines, size):
        some = slice(begin, min(begin + size, plan.lines))
        part = replace(plan.mapping, along=plan.mapping.along[some], across_first=plan.mapping.across_first[some])
        mapped = stolt(np.ascontiguousarray(spectrum[:, some]), part, taps)
        np.multiply(mapped[before:], undone[before:], out=fine[: count - before, some])
        np.multiply(mapped[:before], undone[:before], out=fine[samples - before :, some])
    del spectrum, mapped
    lines: NDArray[np.complex64] = scipy.fft.ifft(fine, axis=0, norm="forward", overwrite_x=True, workers=workers)
    return lines


def _form(
    lines: NDArray[np.complex64],
    plan: MigrationPlan,
    task: Task,
    grid: ImageGrid,
    scale: NDArray[np.float64],
    out: NDArray[np.complex64],
) -> None:
    """Write the image from lines across the rail, some rows at a time; ``scale`` is (ny,)."""
    mapping, edges = plan.mapping, plan.edges
    offset = plan.slant - mapping.middle_m
    samples = plan.row_length
    first, weights = places(offset * (samples * mapping.across_step / (2 * math.pi)), ROW_KERNEL, samples)
    cell = plan.along_step * mapping.across_step / (2 * math.pi) ** 2
    size = (cell * scale * np.sqrt(plan.slant)).astype(np.float32)
    index = np.arange(plan.lines)
    undone = 1 / TRACK_KERNEL.response((index - plan.middle_line) / plan.track_length)
    second = second_term(mapping.along, mapping.centre, mapping.exponent)
    limits = edges.limits
    x = grid.x_m - task.track.middle_m
    rows = len(plan.slant)
    longest = max(plan.direct, math.ceil(COLUMN_KERNEL.oversampling * plan.lines))
    block = max(1, BLOCK_SAMPLES // longest)
    for begin in range(0, rows, block):
        some = slice(begin, min(rows, begin + block))
        low = max(0, math.ceil((float(limits[0, some].min()) - mapping.along[0]) / plan.along_step))
        high = min(plan.lines - 1, math.floor((float(limits[3, some].max()) - mapping.along[0]) / plan.along_step))
        middle = (low + high) // 2
        length = scipy.fft.next_fast_len(math.ceil(COLUMN_KERNEL.oversampling * (high - low + 1)) + COLUMN_KERNEL.taps)
        direct = 0 < plan.direct <= DIRECT_WORTH * length
        length = plan.direct if direct else length
        at = (x - x[0]) * (length / plan.period_m)
        if direct:
            column, read = np.rint(at).astype(np.int64) % length, np.ones((len(x), 1))
            factor = undone
        else:
            column, read = places(at, COLUMN_KERNEL, length)
            inside = np.clip((index - middle) / length, -0.5, 0.5)
            factor = undone / COLUMN_KERNEL.response(inside)
        phase = math.pi / 4 + plan.along_step * (index - middle) * x[0]
        fine = np.empty((some.stop - begin, length), dtype=np.complex64)
        # A part of all rows would be another type to the compiler than all of them.
        edge = np.ascontiguousarray(limits[:, some])
        read_rows(
            lines.view(np.float32), first[some], weights[some].astype(np.float32), offset[some], plan.slant[some],
            size[some], plan.across_middle, phase, second, factor.astype(np.float32), edge,
            mapping.along[0], plan.along_step, middle, fine.view(np.float32),
        )  # fmt: skip
        wide = scipy.fft.ifft(fine, axis=1, norm="forward", overwrite_x=True, workers=get_num_threads())
        carrier = np.exp(1j * mapping.along[middle] * x).astype(np.complex64)
        read_columns(wide, column, read.astype(np.float32), carrier, out[some])


def second_term(along: NDArray[np.float64], centre: float, exponent: float) -> NDArray[np.float64]:
    """(lines,) ``a / k_rho``, the next term of the transform's expansion for a pattern ``cos^n``.

    With R = rho cosh t the integral over the rail is ``int cosh^m(s + t0) exp(j z cosh s) ds``, m = 1 - n, z = k_rho
    rho, tanh t0 = k_x / k; its second term gives a = (m + m (m - 1) sin^2 angle) / 2 - 1/8.
    """
    sine = np.clip(along / centre, -1, 1)
    m = 1 - exponent
    a = 0.5 * (m + m * (m - 1) * sine**2) - 0.125
    return np.asarray(a / np.sqrt(np.clip(centre**2 - along**2, (1e-2 * centre) ** 2, None)))
