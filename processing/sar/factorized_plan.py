"""How an aperture is divided for factorized back-projection, and on which polar grids its parts are held.

A part of the aperture (subaperture) sees little: its image, with the phase of the distance R to the part's centre taken
off, changes slowly along the angle. It is held on a grid of R and of ``s = t / R``, t the distance from the centre
along a horizontal axis (for a straight track: the cosine of the angle from it). The steps follow from the largest phase
gradients that any pulse of the part has anywhere in the scene, so that they are right for any track, near or far:

    step_s = pi / (oversampling max |4 pi f / c  d R_n / d s|),
    step_R = pi / (oversampling max |4 pi f / c  d R_n / d R  -  4 pi centre / c|).

Ulander, Hellsten, Stenstroem 2003 give the method; here the gradients are evaluated, not bounded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.patch_sum import COLUMNS, ROWS

BASE_PULSES = 32
"""Pulses of the smallest parts, which are formed exactly."""

BRANCHES = 4
"""Parts that are merged into one."""

PULSE_NANOSECONDS = 2.0
"""Core time of one pulse at one sample of a smallest part (2.5 GHz server core)."""

MERGE_NANOSECONDS = 12.0
"""Core time of one part at one sample of the part that it is merged into."""

PULSES_OF_PART = 9
"""Pulses of a part whose phase gradients are asked for, its first and last among them."""

BORDER = 65
"""Places along each side of a region whose extent is asked for."""


@dataclass(frozen=True)
class Settings:
    """What decides error and cost of factorized back-projection."""

    angle_oversampling: float
    range_oversampling: float


@dataclass(frozen=True)
class Track:
    """Where the pulses came from, and what they hold; in the order in which they are grouped."""

    transmit_m: NDArray[np.float64]
    """(pulses, 3)."""
    receive_m: NDArray[np.float64]
    """(pulses, 3)."""
    start_m: NDArray[np.float64]
    """(pulses,) range of the first bin."""
    centre_hz: float
    bandwidth_hz: float


@dataclass(frozen=True)
class Level:
    """Parts of the aperture of one size, and where their samples lie in one flat array."""

    first: NDArray[np.int64]
    """(parts + 1,) first pulse of each, and the number of pulses."""
    centre_m: NDArray[np.float64]
    """(parts, 3) mean place of the part's pulses."""
    axis: NDArray[np.float64]
    """(parts, 2) horizontal unit vector that s is counted along."""
    ahead: NDArray[np.float64]
    """(parts, 2) horizontal unit vector across it, toward the scene."""
    start: NDArray[np.float64]
    """(parts, 2) R in m and s of the first sample."""
    step: NDArray[np.float64]
    """(parts, 2) steps of R and s."""
    shape: NDArray[np.int64]
    """(parts, 2) samples along s (rows) and R (columns)."""
    offset: NDArray[np.int64]
    """(parts,) first sample of each in the flat array."""
    children: NDArray[np.int64]
    """(parts + 1,) first part of the next finer level that belongs to each; empty on the finest."""

    @property
    def samples(self) -> int:
        """Samples of all parts."""
        return int(np.prod(self.shape, axis=1).sum())


def plan_levels(
    pulses: Track, border_m: NDArray[np.float64], z_m: float, settings: Settings, pixels: int
) -> list[Level]:
    """Divide an aperture, finest level first; the cheapest number of levels by the cost of each.

    Args:
        pulses: the aperture.
        border_m: (places, 2) x and y around the scene and within it.
        z_m: height of the scene.
        settings: interpolation.
        pixels: of the image.

    Raises:
        DataError: part of the scene is abreast of or behind a part of the aperture, so that there is no polar grid.
    """
    parts = [max(1, round(len(pulses.transmit_m) / BASE_PULSES))]
    while parts[-1] > 1:
        parts.append(math.ceil(parts[-1] / BRANCHES))
    frames, sizes = [], []
    for index, n in enumerate(parts):
        try:
            frame = _frames(pulses, n, border_m, z_m)
        except DataError:
            # Of a circle around the scene, parts that are too long have their centre in it: they stay apart.
            if index == 0:
                raise
            break
        step = _steps(pulses, frame, border_m, z_m, settings)
        frames.append(frame)
        sizes.append(_sampled(frame, _extent(frame, border_m[None], z_m), step, settings, np.zeros(1, np.int64)))
    cost = []
    work = PULSE_NANOSECONDS * BASE_PULSES * sizes[0].samples
    for depth, level in enumerate(sizes):
        if depth:
            work += MERGE_NANOSECONDS * BRANCHES * level.samples
        cost.append(work + MERGE_NANOSECONDS * pixels * parts[depth])
    depth = int(np.argmin(cost))
    levels: list[Level] = []
    region = np.broadcast_to(border_m, (parts[depth], *border_m.shape))
    for index in range(depth, -1, -1):
        step = sizes[index].step
        children = np.zeros(1, np.int64) if index == 0 else _bounds(parts[index - 1], parts[index])
        level = _sampled(frames[index], _extent(frames[index], region, z_m), step, settings, children)
        levels.insert(0, level)
        if index:
            rim = _rim(level, z_m)
            region = np.repeat(rim, np.diff(children), axis=0)
    return levels


def phase_gradients(
    pulses: Track, frame: _Frame | Level, places: NDArray[np.float64], z_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Derivatives of pulses' ranges R_n by s and by R of their part, (parts, places, :data:`PULSES_OF_PART`).

    Args:
        pulses: the aperture; of each part, pulses evenly from its first to its last.
        frame: the parts.
        places: (places, 2) x and y.
        z_m: height of the scene.
    """
    chosen = np.linspace(frame.first[:-1], frame.first[1:] - 1, PULSES_OF_PART).round().astype(int).T
    along, forward, distance = _coordinates(frame, places[None], z_m)
    s = along / distance
    forward = np.maximum(forward, 1e-9 * distance)
    axis, ahead = frame.axis[:, None], frame.ahead[:, None]
    by_s = distance[..., None] * axis - (distance**2 * s / forward)[..., None] * ahead
    by_r = s[..., None] * axis + (distance * (1 - s**2) / forward)[..., None] * ahead
    gradient_s = np.zeros((*distance.shape, PULSES_OF_PART))
    gradient_r = np.zeros_like(gradient_s)
    for antenna in (pulses.transmit_m, pulses.receive_m):
        away = places[None, :, None] - antenna[chosen][:, None, :, :2]
        path = np.sqrt(np.sum(away**2, axis=3) + (z_m - antenna[chosen][:, None, :, 2]) ** 2)
        gradient_s += 0.5 * np.einsum("npmk,npk->npm", away, by_s) / path
        gradient_r += 0.5 * np.einsum("npmk,npk->npm", away, by_r) / path
    return gradient_s, gradient_r


def track_order(antenna_m: NDArray[np.float64], border_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Order of the pulses (positions, 3) in which neighbours stand side by side.

    That of recording, or by direction as seen from the scene where that makes the way along them shorter. A bad order
    costs time, not accuracy.
    """
    middle = 0.5 * (border_m.min(axis=0) + border_m.max(axis=0))
    away = antenna_m[:, :2] - middle
    mean = np.arctan2(*away.mean(axis=0)[::-1])
    angle = np.arctan2(away[:, 1], away[:, 0]) - mean
    by_angle = np.argsort(np.angle(np.exp(1j * angle)), kind="stable")
    recorded = np.arange(len(antenna_m))
    ways = [float(np.linalg.norm(np.diff(antenna_m[order], axis=0), axis=1).sum()) for order in (recorded, by_angle)]
    return np.asarray(by_angle if ways[1] < 0.999 * ways[0] else recorded, dtype=np.int64)


def scene_border(x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (n, 2) around an image and within it, from the places of its pixels, both (rows, columns)."""
    rows, columns = (np.unique(np.linspace(0, n - 1, BORDER).round().astype(int)) for n in x_m.shape)
    chosen = np.zeros((len(rows), len(columns)), dtype=np.bool_)
    chosen[[0, -1]] = chosen[:, [0, -1]] = chosen[::8, ::8] = True
    at = np.ix_(rows, columns)
    return np.column_stack([x_m[at][chosen], y_m[at][chosen]])


def polar_places(
    level: Level, part: int, z_m: float, s: NDArray[np.float64], r: NDArray[np.float64]
) -> NDArray[np.float64]:
    """x, y and excess, (..., 3), of places at s and R of one part.

    A grid's margin may reach beyond what exists: where ``t^2`` exceeds ``R^2 - height^2``. There the place is taken
    abreast of the centre, and the excess, ``R^2 - height^2 - t^2 < 0``, belongs to the square of any distance from it:
    for a straight part that continues the image analytically, so that it stays smooth up to the edge.
    """
    height = z_m - level.centre_m[part, 2]
    along = s * r
    square = r**2 - height**2 - along**2
    ahead = np.sqrt(np.maximum(square, 0.0))
    places = level.centre_m[part, :2] + along[..., None] * level.axis[part] + ahead[..., None] * level.ahead[part]
    return np.concatenate([places, np.minimum(square, 0.0)[..., None]], axis=-1)


@dataclass(frozen=True)
class _Frame:
    first: NDArray[np.int64]
    centre_m: NDArray[np.float64]
    axis: NDArray[np.float64]
    ahead: NDArray[np.float64]


def _bounds(count: int, parts: int) -> NDArray[np.int64]:
    return np.linspace(0, count, parts + 1).round().astype(np.int64)


def _frames(pulses: Track, parts: int, border_m: NDArray[np.float64], z_m: float) -> _Frame:
    place = 0.5 * (pulses.transmit_m + pulses.receive_m)
    # Boundaries of coarse parts must be boundaries of fine ones: each level divides the one below it.
    counts = [max(1, round(len(place) / BASE_PULSES))]
    bounds = _bounds(len(place), counts[0])
    while counts[-1] > parts:
        counts.append(math.ceil(counts[-1] / BRANCHES))
        bounds = bounds[_bounds(counts[-2], counts[-1])]
    centre = np.add.reduceat(place, bounds[:-1], axis=0) / np.diff(bounds)[:, None]
    middle = 0.5 * (border_m.min(axis=0) + border_m.max(axis=0))
    look = middle - centre[:, :2]
    look /= np.maximum(np.linalg.norm(look, axis=1, keepdims=True), 1e-300)
    along = (place[bounds[1:] - 1] - place[bounds[:-1]])[:, :2]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = along / np.where(length > 0, length, 1.0)
    across = np.stack([-look[:, 1], look[:, 0]], axis=1)
    # The track's own direction makes the image of a straight part independent of height; not where it points ahead.
    usable = (length[:, 0] > 0) & (np.abs(np.sum(along * look, axis=1)) < 0.5)
    axis = np.where(usable[:, None], along, across)
    ahead = np.stack([-axis[:, 1], axis[:, 0]], axis=1)
    ahead *= np.where(np.sum(ahead * look, axis=1, keepdims=True) < 0, -1.0, 1.0)
    forward = np.einsum("npk,nk->np", border_m[None] - centre[:, None, :2], ahead)
    if not (forward > 1e-6 * np.abs(z_m - centre[:, 2:])).all() or not (forward > 0).all():
        raise DataError(
            "part of the image is abreast of the track or on its other side",
            "focus by back-projection, or form the image on one side of the track",
        )
    return _Frame(bounds, centre, axis, ahead)


def _coordinates(frame: _Frame | Level, places: NDArray[np.float64], z_m: float) -> tuple[NDArray[np.float64], ...]:
    """t, forward distance and R, each (parts, places), of places (parts or 1, places, 2 or 3: excess)."""
    away = places[..., :2] - frame.centre_m[:, None, :2]
    along = np.einsum("npk,nk->np", away, frame.axis)
    forward = np.einsum("npk,nk->np", away, frame.ahead)
    square = np.sum(away**2, axis=2) + (z_m - frame.centre_m[:, 2:]) ** 2
    if places.shape[2] > 2:
        square = square + places[..., 2]
    return along, forward, np.sqrt(np.maximum(square, 1e-12))


def _extent(frame: _Frame, places: NDArray[np.float64], z_m: float) -> NDArray[np.float64]:
    """(parts, 2, 2): least and largest R, least and largest s."""
    along, _, distance = _coordinates(frame, places, z_m)
    s = along / distance
    return np.stack(
        [
            np.stack([distance.min(axis=1), distance.max(axis=1)], axis=1),
            np.stack([s.min(axis=1), s.max(axis=1)], axis=1),
        ],
        axis=1,
    )


def _steps(
    pulses: Track, frame: _Frame, border_m: NDArray[np.float64], z_m: float, settings: Settings
) -> NDArray[np.float64]:
    """(parts, 2) steps of R and s that the pulses' phase gradients allow over the scene."""
    places = border_m[:: max(1, len(border_m) // 120)]
    gradient_s, gradient_r = phase_gradients(pulses, frame, places, z_m)
    along, _, distance = _coordinates(frame, places[None], z_m)
    s = along / distance
    k = 4 * math.pi / SPEED_OF_LIGHT_M_S
    edges = pulses.centre_hz + 0.5 * pulses.bandwidth_hz * np.array([-1.0, 1.0])
    band_s = k * edges[1] * np.abs(gradient_s).max(axis=(1, 2))
    band_r = k * np.max([np.abs(f * gradient_r - pulses.centre_hz).max(axis=(1, 2)) for f in edges], axis=0)
    span = s.max(axis=1) - s.min(axis=1)
    step_s = math.pi / (settings.angle_oversampling * np.maximum(band_s, 1e-300))
    # A single pulse has the same phase at all angles: any step would do.
    return np.stack(
        [math.pi / (settings.range_oversampling * band_r), np.minimum(step_s, np.maximum(span / 4, 1e-9))], axis=1
    )


def _sampled(
    frame: _Frame,
    extent: NDArray[np.float64],
    step: NDArray[np.float64],
    settings: Settings,
    children: NDArray[np.int64],
) -> Level:
    reach = np.array([COLUMNS // 2, ROWS // 2]) + 0.5
    start = extent[:, :, 0] - reach * step
    shape = np.ceil((extent[:, :, 1] + reach * step - start) / step).astype(np.int64) + 1
    sizes = np.prod(shape, axis=1)
    offset = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    return Level(frame.first, frame.centre_m, frame.axis, frame.ahead, start, step, shape[:, ::-1], offset, children)


def _rim(level: Level, z_m: float) -> NDArray[np.float64]:
    """(parts, places, 3): places around each part's grid, with their excess."""
    unit = np.linspace(0.0, 1.0, BORDER)
    none, one = np.zeros(BORDER), np.ones(BORDER)
    u = np.concatenate([unit, unit, none, one])
    v = np.concatenate([none, one, unit, unit])
    last = level.start + level.step * (level.shape[:, ::-1] - 1)
    rim = np.empty((len(level.start), 4 * BORDER, 3))
    for part in range(len(rim)):
        r = level.start[part, 0] + u * (last[part, 0] - level.start[part, 0])
        s = level.start[part, 1] + v * (last[part, 1] - level.start[part, 1])
        rim[part] = polar_places(level, part, z_m, s, r)
    return rim
