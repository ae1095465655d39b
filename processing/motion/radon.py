"""Radon transform of small pictures, and streaks in them against speckle at a known rate of false alarms.

    R(rho, theta) = sum of pixels f(x, y) delta(rho - x cos theta - y sin theta)      (thesis 3.3.2)

Here the angle is counted from the rows' direction, so that a streak along azimuth (along a row) has angle 0 and rho is
its row. A moving target smears along azimuth; speckle averages out along the line (Murphy 1986, Pattern Recognition
Letters 4, 279).

Clutter is kept out in four ways: pictures are cut into tiles, so that no long line far away adds up; bright pixels are
clipped at a multiple of the tile's typical power, so that a bright point is no streak; each angle's line sums are set
against the scatter of the tile's own sums at that angle; and the threshold on the largest of them is that of speckle
alone.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from processing.errors import DataError

Floats = NDArray[np.float64]

CLIP = 8.0
"""Power, in means of single-look speckle, above which a pixel counts no more."""
_TRIALS = 600
_EULER = 0.5772156649015329


@dataclass(frozen=True)
class RadonSettings:
    """Tiles and lines."""

    tile_px: int = 64
    """Side of a square tile."""
    max_angle_rad: float = math.radians(10.0)
    """Largest angle between a streak and the rows."""
    angles: int = 21
    """Odd number of angles from minus to plus the largest."""
    false_alarm: float = 1e-3
    """Probability that a tile of speckle shows a streak."""

    def __post_init__(self) -> None:
        if self.tile_px < 16 or self.angles < 1 or self.angles % 2 == 0 or not 0 < self.false_alarm < 0.5:
            raise DataError(
                f"tiles of {self.tile_px} pixels, {self.angles} angles, a false alarm rate of {self.false_alarm}",
                "take tiles of 16 pixels or more, an odd number of angles and a rate above 0 and below 0.5",
            )
        if not 0 <= self.max_angle_rad < math.pi / 4:
            raise DataError("streaks may lie up to 45 degrees from the rows", "take a smaller angle")

    @property
    def angle_rad(self) -> Floats:
        """(angles,)."""
        return np.linspace(-self.max_angle_rad, self.max_angle_rad, self.angles)


@dataclass(frozen=True)
class Streak:
    """A line in a picture; rows and columns are those of the whole picture."""

    row: float
    """Of its middle."""
    column: float
    angle_rad: float
    """From the rows, towards larger rows at larger columns."""
    length_px: float
    """Where it stands out, along the line."""
    z: float
    """Line sum over the scatter of its tile's line sums."""
    tile: tuple[int, int]
    """First row and column of the tile."""


def radon(image: ArrayLike, angle_rad: ArrayLike) -> Floats:
    """Line sums of a square picture, (side, angles): offset of the line from the middle (whole pixels), and its angle.

    Each pixel falls upon the two nearest lines by its distance, so that each angle's sums add up to the picture's total
    within the tile's inscribed lines. A line at angle a and offset d holds the points ``(row - c) cos a - (column - c)
    sin a = d`` with the middle c.

    Args:
        image: (side, side) finite.
        angle_rad: (angles,) from the rows.

    Raises:
        DataError: a picture that is not square or not finite.
    """
    values = np.asarray(image, dtype=np.float64)
    if values.ndim != 2 or values.shape[0] != values.shape[1] or not np.isfinite(values).all():
        raise DataError(f"a picture of shape {values.shape}", "give a square one without undefined pixels")
    matrix = _lines(len(values), tuple(float(a) for a in np.atleast_1d(np.asarray(angle_rad))))
    return np.asarray((matrix @ values.ravel()).reshape(-1, len(values)).T)


@functools.lru_cache(maxsize=8)
def _lines(side: int, angles: tuple[float, ...]) -> sparse.csr_matrix:
    """(angles * side, side^2) weights of pixels in lines."""
    centre = (side - 1) / 2
    row, column = np.mgrid[0:side, 0:side]
    parts = []
    pixels = np.arange(side * side)
    for angle in angles:
        offset = ((row - centre) * math.cos(angle) - (column - centre) * math.sin(angle) + centre).ravel()
        low = np.floor(offset).astype(np.int64)
        share = offset - low
        lines, weights = np.concatenate([low, low + 1]), np.concatenate([1 - share, share])
        inside = (lines >= 0) & (lines < side)
        both = np.concatenate([pixels, pixels])
        parts.append(sparse.csr_matrix((weights[inside], (lines[inside], both[inside])), shape=(side, side * side)))
    return sparse.vstack(parts, format="csr")


def line_scores(tiles: NDArray[np.float64], settings: RadonSettings) -> Floats:
    """How far each line's sum lies above the tile's others at the same angle, in their standard deviations.

    Args:
        tiles: (count, side, side) power, finite.
        settings: tiles and lines.

    Returns:
        (count, angles, side); NaN for lines that cross less than half the tile.
    """
    count, side, _ = tiles.shape
    matrix = _lines(side, tuple(float(a) for a in settings.angle_rad))
    flat = tiles.reshape(count, -1)
    # Of exponentially distributed power the median is ln 2 of the mean; targets do not move it.
    typical = np.median(flat, axis=1, keepdims=True) / math.log(2)
    with np.errstate(invalid="ignore", divide="ignore"):
        clipped = np.minimum(np.where(typical > 0, flat / typical, 0.0), CLIP)
    angles = len(settings.angle_rad)
    sums = np.asarray(matrix @ clipped.T).T.reshape(count, angles, side)
    # Weights and squares of weights: lengths of lines and variances of their sums.
    length = np.asarray(matrix.sum(axis=1)).reshape(angles, side)
    squares = np.asarray(matrix.multiply(matrix).sum(axis=1)).reshape(angles, side)
    long = length >= side / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        even = np.where(long, (sums - np.median(clipped, axis=1)[:, None, None] * length) / np.sqrt(squares), np.nan)
    middle = np.nanmedian(even, axis=2, keepdims=True)
    spread = 1.4826 * np.nanmedian(np.abs(even - middle), axis=2, keepdims=True)
    # Half the lines decide the scatter, and by chance find it too small: angles are taken together.
    spread = np.sqrt(np.mean(spread**2, axis=1, keepdims=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(spread > 0, (even - middle) / spread, np.nan))


@functools.lru_cache(maxsize=16)
def threshold(settings: RadonSettings, cell_px: tuple[float, float] = (1.0, 1.0)) -> float:
    """Largest score of a tile that speckle alone exceeds with the rate of false alarms.

    Maxima of simulated speckle are fitted by Gumbel's distribution, whose tail goes on beyond the trials.

    Args:
        settings: tiles, lines and rate.
        cell_px: resolution along rows and columns (down, along), pixels; neighbours within it are alike.
    """
    random = np.random.default_rng(20_000)
    largest: list[float] = []
    for _ in range(0, _TRIALS, 100):
        tiles = speckle_tiles(100, settings.tile_px, cell_px, random)
        largest.extend(np.nanmax(line_scores(tiles, settings), axis=(1, 2)))
    scale = float(np.std(largest, ddof=1)) * math.sqrt(6) / math.pi
    place = float(np.mean(largest)) - _EULER * scale
    return place - scale * math.log(-math.log1p(-settings.false_alarm))


def speckle_tiles(count: int, side: int, cell_px: tuple[float, float], random: np.random.Generator) -> Floats:
    """(count, side, side) power of single-look speckle whose band fills ``1 / cell_px`` of the sampled one."""
    field = random.normal(size=(2, count, side, side))
    spectrum = np.fft.fft2(field[0] + 1j * field[1])
    down, along = (np.abs(np.fft.fftfreq(side)) <= 0.5 / max(cell, 1.0) + 1e-9 for cell in cell_px)
    return np.asarray(np.abs(np.fft.ifft2(spectrum * (down[:, None] & along))) ** 2)


def find_streaks(
    power: ArrayLike, settings: RadonSettings | None = None, *, cell_px: tuple[float, float] = (1.0, 1.0)
) -> list[Streak]:
    """Streaks along the rows of a picture, the most evident first; one for each place.

    Args:
        power: (rows, columns) power, rows of one range; tiles with undefined pixels are left out.
        settings: tiles, lines, rate of false alarms for each tile.
        cell_px: resolution (down, along), pixels.

    Raises:
        DataError: the picture is smaller than a tile.
    """
    settings = settings or RadonSettings()
    image = np.asarray(power, dtype=np.float64)
    side = settings.tile_px
    if image.ndim != 2 or min(image.shape) < side:
        raise DataError(f"a picture of shape {image.shape} holds no tile of {side} pixels", "take smaller tiles")
    corners = [(r, c) for r in _starts(image.shape[0], side) for c in _starts(image.shape[1], side)]
    limit = threshold(settings, cell_px)
    found: list[Streak] = []
    for first in range(0, len(corners), 64):
        some = corners[first : first + 64]
        tiles = np.stack([image[r : r + side, c : c + side] for r, c in some])
        sound = np.asarray(np.isfinite(tiles).all(axis=(1, 2)))
        scores = line_scores(np.where(sound[:, None, None], tiles, 0.0), settings)
        for tile, score, corner, usable in zip(tiles, scores, some, sound, strict=True):
            if usable and np.isfinite(score).any() and np.nanmax(score) > limit:
                found.append(_streak(tile, score, corner, settings))
    return _merged(found, side)


def tiles_in(shape: tuple[int, int], settings: RadonSettings) -> int:
    """How many tiles a picture of a shape is cut into."""
    return len(_starts(shape[0], settings.tile_px)) * len(_starts(shape[1], settings.tile_px))


def _starts(length: int, side: int) -> list[int]:
    """Tiles overlap by half; the last one ends with the picture."""
    starts = list(range(0, length - side + 1, side // 2))
    if starts[-1] != length - side:
        starts.append(length - side)
    return starts


def _streak(tile: Floats, score: Floats, corner: tuple[int, int], settings: RadonSettings) -> Streak:
    which, line = np.unravel_index(int(np.nanargmax(score)), score.shape)
    angle, side = float(settings.angle_rad[which]), settings.tile_px
    centre = (side - 1) / 2
    columns = np.arange(side)
    rows = (line - centre + (columns - centre) * math.sin(angle)) / math.cos(angle) + centre
    near = np.clip(np.rint(rows).astype(int), 0, side - 1)
    typical = np.median(tile) / math.log(2)
    along = np.minimum(tile[near, columns] / max(typical, 1e-300), CLIP) - 1.0
    # The stretch with the largest sum above what speckle gives (Kadane), with half its mean taken off as price.
    level = along - 0.5 * max(float(np.mean(np.sort(along)[-8:])), 0.5) * 0.5
    first, last = _best_stretch(level)
    middle = (first + last) / 2
    return Streak(
        row=corner[0] + float(np.interp(middle, columns, rows)),
        column=corner[1] + middle,
        angle_rad=angle,
        length_px=float(last - first + 1),
        z=float(score[which, line]),
        tile=corner,
    )


def _best_stretch(values: Floats) -> tuple[int, int]:
    total = np.concatenate([[0.0], np.cumsum(values)])
    gains = total[None, 1:] - total[:-1, None]
    gains[np.tril_indices(len(values), -1)] = -np.inf
    first, last = np.unravel_index(int(np.argmax(gains)), gains.shape)
    return int(first), int(last)


def _merged(found: list[Streak], side: int) -> list[Streak]:
    kept: list[Streak] = []
    for streak in sorted(found, key=lambda item: -item.z):
        near = any(abs(streak.row - other.row) < 6 and abs(streak.column - other.column) < side for other in kept)
        if not near:
            kept.append(streak)
    return kept
