"""Polar format for spotlight data: pulses on rays of the scene's wavenumber plane, resampled to a grid and transformed.

With straight wavefronts (:mod:`processing.sar.polar_format_geometry`) back-projection's sum over pulses and frequencies
is a Fourier sum over points ``k d_n`` of the wavenumber plane. Range resampling brings the points of every pulse to
equal steps along the mean line of sight (the keystone), azimuth resampling those of each step to equal steps across it,
and a two-dimensional transform gives the scene, read at the places where straight wavefronts see each pixel. All three
use Kaiser-Bessel kernels (:mod:`processing.sar.gridding`), azimuth resampling as an exact sum, so that pulses may come
at any angles and amplitude and phase are those of back-projection. Walker 1980; Carrara, Goodman, Majewski 1995,
chapters 3 and 4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numba import get_num_threads
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.aperture import Pulses, usable_pulses
from processing.sar.continuous import sweep_motion
from processing.sar.grid import Grid, ImageGrid, check_grid
from processing.sar.gridding import Kernel
from processing.sar.polar_format_geometry import (
    REFUSED_DB,
    Spotlight,
    Straightening,
    spotlight,
    straighten,
    usable_radius_m,
)
from processing.sar.polar_format_kernel import TAPS, read_pixels, resample_azimuth, resample_range
from processing.sar.stolt import TABLE_STEPS, smooth_step, weight_table

KERNEL = Kernel(TAPS, 1.5)
BAND_MARGIN = 1.4
"""Width of the band that is kept, as a multiple of the ramp's, where ranges were cut off."""

RANGE_MARGIN, FLAT_MARGIN = 12, 4
"""Resolution cells of range kept beyond the image's, and those of them that do not roll off."""

UNDONE_STEPS = 4096
"""Intervals on either side of the table by which azimuth resampling's kernel is undone."""

BLOCK = 128
"""Pulses, or rows of wavenumbers, whose transforms are held at a time."""


def polar_format(
    profiles: RangeProfiles, grid: Grid, *, weights: NDArray[np.floating] | None = None
) -> NDArray[np.complex64]:
    """Focus all channels by polar format, with the scale and phase of back-projection.

    Args:
        profiles: (channels, pulses, bins), from a track that looks at the image from one side; any first ranges.
        grid: where to form the image, a plane.
        weights: (pulses,) window along the aperture; rectangular where left out.

    Returns:
        (channels, ny, nx) complex64; NaN where a pulse's range is off the profiles' axis.

    Raises:
        DataError: an image that reaches further from its middle than straight wavefronts allow (a point's error above
            -20 dB), no plane, antenna pairs of their own, motion within the sweeps that matters, directions that turn
            too far, single NaN samples, or unusable profiles.
    """
    advice = "focus by back-projection"
    if not isinstance(grid, ImageGrid):
        raise DataError("polar format forms images on a plane, in x and y", advice)
    check_grid(grid)
    pulses = usable_pulses(profiles, weights)
    if profiles.pairs is not None and any(pair != AntennaPair() for pair in profiles.pairs):
        raise DataError("transmitting and receiving antennas stand apart, which polar format does not model", advice)
    moving = sweep_motion(profiles)
    if moving.modelled:
        raise DataError(f"{moving.reason}, which polar format does not model", advice)
    if not np.isfinite(pulses.values).all():
        raise DataError("profiles hold single NaN samples", f"{advice}, which keeps them local")
    scene = spotlight(pulses.antenna_m, grid, pulses.weights.max(axis=0))
    k = 4 * math.pi * profiles.centre_hz / SPEED_OF_LIGHT_M_S
    straight = straighten(scene, grid, k)
    if straight.worst_db > REFUSED_DB:
        raise DataError(
            f"the image reaches {_reach(grid):.4g} m from its middle, and wavefronts are straight enough for "
            f"{REFUSED_DB:g} dB up to {usable_radius_m(scene, k, REFUSED_DB):.3g} m",
            "form a smaller image, or focus by back-projection or factorized back-projection",
        )
    outside = _outside(profiles, pulses, scene, grid)
    layout = _lay_out(profiles, pulses, scene, straight, grid)
    image = np.empty((len(pulses.values), *grid.shape), dtype=np.complex64)
    for channel in range(len(image)):
        fine = _transform(pulses, scene, layout, channel)
        _read(fine, layout, straight, float(pulses.weights[channel].sum()), image[channel])
        if outside is not None:
            image[channel][outside] = np.nan
    return image


@dataclass(frozen=True)
class _Layout:
    """Sizes and places of the transforms; wavenumbers in rad/m."""

    first_bin: NDArray[np.int64]
    """(pulses,) bin of each profile that is nearest to the scene's centre."""
    bins: NDArray[np.int64]
    """Bins around it that are kept."""
    roll: NDArray[np.float64]
    range_step_m: float
    range_length: int
    half_band: int
    k_step: float
    centre: float
    offset_m: NDArray[np.float64]
    """(pulses,) range of that bin beyond the scene's centre."""
    k_along: NDArray[np.float64]
    """(rows,) wavenumbers along the mean line of sight."""
    across_first: float
    across_step: float
    across_count: int
    reach_across_m: float
    length: tuple[int, int]
    """Of the two-dimensional transform."""


def _lay_out(
    profiles: RangeProfiles, pulses: Pulses, scene: Spotlight, straight: Straightening, grid: ImageGrid
) -> _Layout:
    step, bins = profiles.range_step_m, pulses.values.shape[2]
    first_bin = np.rint((scene.centre_range_m - pulses.start_m) / step).astype(np.int64)
    corners = np.array([[x, y, grid.z_m] for x in _ends(grid.x_m) for y in _ends(grid.y_m)])
    further = np.linalg.norm(corners[:, None] - scene.antenna_m, axis=2) - scene.centre_range_m
    reach = 1.01 * float(np.abs(further).max()) + step
    margin = RANGE_MARGIN * profiles.resolution_m
    most = math.ceil((reach + margin) / step)
    low, high = max(-most, -int(first_bin.max())), min(most, bins - 1 - int(first_bin.min()))
    if low >= high:
        raise DataError("the image's ranges are outside the profiles", "form the image where there are profiles")
    kept = np.arange(low, high + 1)
    flat = reach + FLAT_MARGIN * profiles.resolution_m
    roll = smooth_step(np.clip((reach + margin - np.abs(kept) * step) / (reach + margin - flat), 0, 1))

    length = scipy.fft.next_fast_len(math.ceil(KERNEL.oversampling * len(kept)) + KERNEL.taps)
    k_step = 2 * math.pi / (length * step)
    centre = 4 * math.pi * profiles.centre_hz / SPEED_OF_LIGHT_M_S
    width = 4 * math.pi * profiles.bandwidth_hz / SPEED_OF_LIGHT_M_S
    half = math.ceil(0.5 * min(BAND_MARGIN * width, 1.8 * centre) / k_step) + KERNEL.taps // 2
    half = min(half, (length - 1) // 2, int(0.95 * centre / k_step))

    along = scene.direction[:, 0]
    slope = scene.direction[:, 1] / along
    lowest, highest = (centre - half * k_step) * along.min(), (centre + half * k_step) * along.max()
    along_step = 2 * math.pi * along.min() / (1.02 * (reach + step * float(np.abs(kept).max())))
    k_along = along_step * np.arange(math.floor(lowest / along_step), math.ceil(highest / along_step) + 1)
    reach_across = 1.01 * float(np.abs(straight.nodes[1]).max()) + 0.5 * profiles.resolution_m
    across_step = math.pi / (KERNEL.oversampling * reach_across)
    edges = np.outer([k_along[0], k_along[-1]], [slope.min(), slope.max()])
    across_first = float(edges.min()) - (KERNEL.taps // 2 + 1) * across_step
    count = math.ceil((float(edges.max()) - across_first) / across_step) + KERNEL.taps // 2 + 2
    return _Layout(
        first_bin=first_bin, bins=kept, roll=roll, range_step_m=step, range_length=length, half_band=half,
        k_step=k_step, centre=centre, offset_m=pulses.start_m + first_bin * step - scene.centre_range_m,
        k_along=k_along, across_first=across_first, across_step=across_step, across_count=count,
        reach_across_m=reach_across,
        length=(
            scipy.fft.next_fast_len(math.ceil(KERNEL.oversampling * len(k_along)) + KERNEL.taps),
            scipy.fft.next_fast_len(math.ceil(KERNEL.oversampling * count) + KERNEL.taps),
        ),
    )  # fmt: skip


def _transform(pulses: Pulses, scene: Spotlight, layout: _Layout, channel: int) -> NDArray[np.complex64]:
    """One channel around the scene's centre, without the carrier, (samples, samples) and what each pixel reads beyond.

    What the last samples read goes on with the first: there are ``TAPS - 1`` more along each axis than in a period.
    """
    table = weight_table(KERNEL, TABLE_STEPS)
    values = pulses.values[channel]
    turns = layout.centre * scene.centre_range_m / (2 * math.pi)
    turns -= np.floor(turns)
    lined_up = np.empty((len(values), len(layout.k_along)), dtype=np.complex64)
    # Some pulses, then some rows at a time: these arrays would be larger than the image.
    for begin in range(0, len(values), BLOCK):
        some = slice(begin, min(begin + BLOCK, len(values)))
        resample_range(
            _band(values[some], layout.first_bin[some], layout), layout.centre - layout.half_band * layout.k_step,
            1 / layout.k_step, layout.centre, layout.offset_m[some], turns[some], scene.direction[some, 0],
            pulses.weights[channel, some], layout.k_along, table, lined_up[some],
        )  # fmt: skip
    rows, columns = len(layout.k_along), layout.across_count
    slope = scene.direction[:, 1] / scene.direction[:, 0]
    undone = [
        (1 / KERNEL.response((np.arange(count) - count // 2) / length)).astype(np.float32)
        for count, length in zip((rows, columns), layout.length, strict=True)
    ]
    tall, broad = layout.length
    whole = np.zeros((tall + TAPS - 1, broad + TAPS - 1), dtype=np.complex64)
    fine, left = whole[:tall, :broad], columns // 2
    for begin in range(0, rows, BLOCK):
        some = slice(begin, min(begin + BLOCK, rows))
        plane = np.empty((some.stop - begin, columns), dtype=np.complex64)
        resample_azimuth(
            np.ascontiguousarray(lined_up[:, some]), layout.k_along[some], slope, layout.across_first,
            1 / layout.across_step, table, plane,
        )  # fmt: skip
        plane *= undone[0][some, None]
        plane *= undone[1]
        to = (np.arange(begin, some.stop) - rows // 2) % tall
        fine[to, : columns - left], fine[to, broad - left :] = plane[:, left:], plane[:, :left]
    del lined_up
    made = scipy.fft.ifft2(fine, norm="forward", overwrite_x=True, workers=get_num_threads())
    if not np.may_share_memory(made, whole):
        fine[:] = made
    whole[tall:, :broad] = fine[: TAPS - 1]
    whole[:, broad:] = whole[:, : TAPS - 1]
    return whole


def _band(values: NDArray[np.complexfloating], first_bin: NDArray[np.int64], layout: _Layout) -> NDArray[np.complex64]:
    """(pulses, k) of some pulses around the carrier, referred to their bins next to the scene's centre."""
    bins = first_bin[:, None] + layout.bins
    there = (bins >= 0) & (bins < values.shape[1])
    correction = layout.range_step_m * layout.roll / KERNEL.response(layout.bins / layout.range_length)
    padded = np.zeros((len(values), layout.range_length), dtype=np.complex64)
    rows = np.arange(len(values))[:, None]
    padded[:, layout.bins % layout.range_length] = np.where(
        there, values[rows, np.clip(bins, 0, values.shape[1] - 1)], 0
    ) * correction.astype(np.float32)
    in_k = scipy.fft.fft(padded, axis=1, overwrite_x=True, workers=get_num_threads())
    half = layout.half_band
    return np.concatenate([in_k[:, layout.range_length - half :], in_k[:, : half + 1]], axis=1)


def _read(
    fine: NDArray[np.complex64], layout: _Layout, straight: Straightening, total: float, out: NDArray[np.complex64]
) -> None:
    """Write an image, some rows at a time."""
    table = weight_table(KERNEL, TABLE_STEPS)
    along_step = float(layout.k_along[1] - layout.k_along[0])
    steps = np.array([along_step, layout.across_step])
    carrier = np.array(
        [
            layout.k_along[len(layout.k_along) // 2],
            layout.across_first + layout.across_step * (layout.across_count // 2),
        ]
    )
    across = np.linspace(-1, 1, 2 * UNDONE_STEPS + 1) * layout.reach_across_m
    undone = along_step / (2 * math.pi * total) / KERNEL.response(across * layout.across_step / (2 * math.pi))
    at_columns = np.stack([np.einsum("ij,kj->ik", nodes, straight.to_columns) for nodes in straight.nodes])
    read_pixels(
        fine.view(np.float32), straight.to_rows, at_columns, np.array(layout.length) * steps / (2 * math.pi), carrier,
        table, undone.astype(np.float32), UNDONE_STEPS / layout.reach_across_m, out,
    )  # fmt: skip


def _outside(profiles: RangeProfiles, pulses: Pulses, scene: Spotlight, grid: ImageGrid) -> NDArray[np.bool_] | None:
    """Pixels that are off the range axis for any pulse (as back-projection with eight taps has it); None for none."""
    lowest = pulses.start_m + 3 * profiles.range_step_m
    highest = pulses.start_m + (pulses.values.shape[2] - 4) * profiles.range_step_m
    corners = np.array([[x, y, grid.z_m] for x in _ends(grid.x_m) for y in _ends(grid.y_m)])
    furthest = np.linalg.norm(corners[:, None] - scene.antenna_m, axis=2).max(axis=0)
    # Ranges are convex over the plane: the corners have the largest, and no range is below the plane that touches.
    tangent = (corners - scene.centre_m)[:, :2] @ scene.axes.T @ scene.direction.T
    if (furthest < highest).all() and (scene.centre_range_m + tangent.min(axis=0) >= lowest).all():
        return None
    x, y, z = grid.places_m()
    outside = np.zeros(grid.shape, dtype=np.bool_)
    for antenna, low, high in zip(scene.antenna_m, lowest, highest, strict=True):
        away = np.sqrt((x - antenna[0]) ** 2 + (y - antenna[1]) ** 2 + (z - antenna[2]) ** 2)
        outside |= (away < low) | (away >= high)
    return outside


def _reach(grid: ImageGrid) -> float:
    return 0.5 * math.hypot(float(np.ptp(grid.x_m)), float(np.ptp(grid.y_m)))


def _ends(axis: NDArray[np.float64]) -> tuple[float, float]:
    return float(axis.min()), float(axis.max())
