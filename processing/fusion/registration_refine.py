"""Geometric registration, corrected by what both pictures show.

Two ways, both a shift of the camera's picture (a camera that is turned by a small angle shifts its picture, but for
second-order terms):

- :func:`shift_by_points`: corner reflectors, whose places the radar tells to a small part of its cell, at the pixels
  where the camera shows them. It is as good as their number and contrast, and is told in pixels.
- :func:`shift_by_pictures`: the shift at which the mutual information of both pictures on the ground is largest (Viola
  and Wells 1997), or that of their channel features of oriented gradients (CFOG, Ye et al. 2019, IEEE TGRS 57(11)
  9059). Both sensors see different things, so that nothing but statistics is common; it needs a scene with structure,
  and cannot be better than the radar's cell seen by the camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from processing.errors import DataError
from processing.fusion.registration import GeometryErrors, sample_bilinear

Floats = NDArray[np.float64]

Measure = Literal["mutual_information", "cfog"]
MEASURES: tuple[Measure, ...] = ("mutual_information", "cfog")

_BINS = 24
_ORIENTATIONS = 9
_BLOCKS = 5
_RESAMPLES = 100


@dataclass(frozen=True)
class PictureShift:
    """Where the camera shows the ground's pixels, less where geometry puts them: right and down, pixels, with sds."""

    right_px: float
    down_px: float
    right_sd_px: float
    down_sd_px: float
    gain: float
    """Of points: rms distance before over after. Of pictures: the measure at its best over that without any shift."""

    @property
    def size_px(self) -> float:
        """Length."""
        return float(np.hypot(self.right_px, self.down_px))


def point_range_sd_m(cell_m: float, snr_db: float) -> float:
    """How well a point's place in a cell is known, one standard deviation (Cramer and Rao's bound for a flat band).

    ``sqrt(12) / (2 pi sqrt(2 SNR))`` of the cell c / 2B; the same holds across with the cell of the aperture.

    Args:
        cell_m: resolution.
        snr_db: power of the focused point over noise and clutter.
    """
    return float(cell_m * np.sqrt(12) / (2 * np.pi * np.sqrt(2 * 10 ** (snr_db / 10))))


def point_errors(
    range_cell_m: float, cross_cell_m: float, snr_db: float, *, angle_rad: float, height_m: float
) -> GeometryErrors:
    """Errors of places of point-like targets, such as corner reflectors whose height is known."""
    return GeometryErrors(
        point_range_sd_m(range_cell_m, snr_db), point_range_sd_m(cross_cell_m, snr_db), angle_rad, height_m
    )


def shift_by_points(u: ArrayLike, v: ArrayLike, seen_u: ArrayLike, seen_v: ArrayLike) -> PictureShift:
    """Mean shift from projected to seen places of two or more points; standard deviations from their scatter.

    Args:
        u, v: (n,) where geometry projects the radar's points.
        seen_u, seen_v: (n,) where the camera shows them.

    Raises:
        DataError: fewer than two points, or undefined ones.
    """
    places = np.stack([np.asarray(a, dtype=np.float64).ravel() for a in (u, v)])
    seen = np.stack([np.asarray(a, dtype=np.float64).ravel() for a in (seen_u, seen_v)])
    if places.shape != seen.shape or places.shape[1] < 2 or not np.isfinite([places, seen]).all():
        raise DataError(
            f"{places.shape[1]} projected and {seen.shape[1]} seen points", "give two or more that both sensors see"
        )
    off = seen - places
    mean = off.mean(axis=1)
    sd = off.std(axis=1, ddof=1) / np.sqrt(off.shape[1])
    before, after = np.sum(off**2), np.sum((off - mean[:, None]) ** 2)
    return PictureShift(
        float(mean[0]), float(mean[1]), float(sd[0]), float(sd[1]), float(np.sqrt(before / max(after, 1e-300)))
    )


def shift_by_pictures(
    ground: ArrayLike,
    picture: ArrayLike,
    u: ArrayLike,
    v: ArrayLike,
    *,
    measure: Measure = "mutual_information",
    largest_px: float = 30.0,
    step_px: float = 3.0,
) -> PictureShift:
    """The shift of the camera's picture at which it is most like the radar's.

    Args:
        ground: (ny, nx) radar picture on the ground, such as the span in dB; NaN is left out.
        picture: (rows, columns) camera picture.
        u, v: (ny, nx) camera pixels of the ground's.
        measure: ``"mutual_information"`` or ``"cfog"``.
        largest_px: largest shift looked for, each way.
        step_px: first step of the search; then a parabola around the best.

    Returns:
        Standard deviations come from resampling blocks of the ground (bootstrap); they are infinite where the best
        shift lies at the border of the search.

    Raises:
        DataError: shapes that do not fit, no common pixels, or an unknown measure.
    """
    radar, camera = np.asarray(ground, dtype=np.float64), np.asarray(picture, dtype=np.float64)
    column, row = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
    if measure not in MEASURES:
        raise DataError(f"there is no measure {measure!r}", f"take one of {', '.join(MEASURES)}")
    if radar.ndim != 2 or camera.ndim != 2 or column.shape != radar.shape or row.shape != radar.shape:
        raise DataError(
            f"pictures of shapes {radar.shape} and {camera.shape} with pixels of shape {column.shape}",
            "give the camera pixel of each ground pixel",
        )
    known = np.isfinite(radar) & np.isfinite(column) & np.isfinite(row)
    if np.count_nonzero(known) < 400 or not step_px > 0 or not largest_px >= 2 * step_px:
        raise DataError(f"{np.count_nonzero(known)} common pixels", "give 400 or more, and steps within the search")
    likeness = _Likeness(radar, camera, column, row, known, measure)
    steps = np.arange(-largest_px, largest_px + step_px / 2, step_px)
    values = np.array([[likeness.total(right, down) for right in steps] for down in steps])
    at_down, at_right = np.unravel_index(int(np.nanargmax(values)), values.shape)
    if not (0 < at_down < len(steps) - 1 and 0 < at_right < len(steps) - 1):
        return PictureShift(float(steps[at_right]), float(steps[at_down]), float("inf"), float("inf"), 1.0)
    offsets = steps[1] - steps[0]
    blocks = np.array(
        [
            [likeness.blocks(steps[at_right] + i * offsets, steps[at_down] + k * offsets) for i in (-1, 0, 1)]
            for k in (-1, 0, 1)
        ]
    )
    right, down = _peak(blocks.sum(axis=2), offsets)
    random = np.random.default_rng(0)
    chosen = random.integers(0, blocks.shape[2], (_RESAMPLES, blocks.shape[2]))
    scatter = np.std([_peak(blocks[:, :, pick].sum(axis=2), offsets) for pick in chosen], axis=0)
    best, unmoved = float(values[at_down, at_right]), likeness.total(0.0, 0.0)
    return PictureShift(
        float(steps[at_right] + right), float(steps[at_down] + down), float(scatter[0]), float(scatter[1]),
        best / unmoved if unmoved > 0 else float("inf"),
    )  # fmt: skip


class _Likeness:
    def __init__(
        self, radar: Floats, camera: Floats, column: Floats, row: Floats, known: NDArray[np.bool_], measure: Measure
    ) -> None:
        self._camera, self._column, self._row, self._known = camera, column, row, known
        self._information = measure == "mutual_information"
        filled = np.where(known, radar, np.median(radar[known]))
        self._classes = _equal_classes(filled)
        self._features = _features(filled)
        ny, nx = radar.shape
        self._block = (np.arange(ny)[:, None] * _BLOCKS // ny) * _BLOCKS + np.arange(nx) * _BLOCKS // nx

    def total(self, right: float, down: float) -> float:
        """The measure at a shift."""
        return float(self._each(right, down)[0])

    def blocks(self, right: float, down: float) -> Floats:
        """(blocks,) parts of it from each part of the ground."""
        _, each, inside = self._each(right, down)
        sums = np.bincount(self._block[inside], weights=each[inside], minlength=_BLOCKS**2)
        return np.asarray(sums / max(int(np.count_nonzero(inside)), 1))

    def _each(self, right: float, down: float) -> tuple[float, Floats, NDArray[np.bool_]]:
        seen = sample_bilinear(self._camera, self._column + right, self._row + down)
        inside = self._known & np.isfinite(seen)
        if np.count_nonzero(inside) < 200:
            return -np.inf, np.zeros(seen.shape), inside
        filled = np.where(inside, seen, np.median(seen[inside]))
        if self._information:
            classes = _equal_classes(filled)
            joint = np.zeros((_BINS, _BINS))
            np.add.at(joint, (self._classes[inside], classes[inside]), 1.0)
            # Neighbouring classes share their counts: the measure is smooth in the shift.
            joint = ndimage.gaussian_filter(joint, 1.0, mode="nearest") + 1e-9
            joint /= joint.sum()
            gain = np.log(joint / np.outer(joint.sum(axis=1), joint.sum(axis=0)))
            each = gain[self._classes, classes]
        else:
            each = np.sum(self._features * _features(filled), axis=0)
        return float(np.mean(each[inside])), each, inside


def _equal_classes(values: Floats) -> NDArray[np.intp]:
    """Classes of equal number: both sensors' contrasts are what they are."""
    edges = np.quantile(values, np.linspace(0, 1, _BINS + 1)[1:-1])
    return np.asarray(np.searchsorted(edges, values))


def _features(values: Floats) -> Floats:
    """Channel features of oriented gradients, (orientations, ny, nx), each pixel's of length 1."""
    smooth = ndimage.gaussian_filter(values, 1.0)
    down, right = np.gradient(smooth)
    angles = np.arange(_ORIENTATIONS) * np.pi / _ORIENTATIONS
    channels = np.abs(right * np.cos(angles)[:, None, None] + down * np.sin(angles)[:, None, None])
    channels = ndimage.gaussian_filter(channels, (0, 1.5, 1.5))
    channels = ndimage.convolve1d(channels, [0.25, 0.5, 0.25], axis=0, mode="wrap")
    length = np.sqrt(np.sum(channels**2, axis=0))
    centred = channels / np.maximum(length, 1e-12 * max(float(length.max()), 1e-300))
    # Orientations that are everywhere alike say nothing.
    return np.asarray(centred - centred.mean(axis=0))


def _peak(values: Floats, step: float) -> tuple[float, float]:
    """(right, down) of the peak of a paraboloid through 3 x 3 values, within a step of the middle."""
    k, i = np.mgrid[-1:2, -1:2].reshape(2, -1).astype(np.float64)
    a = np.stack([i**2, i * k, k**2, i, k, np.ones(9)], axis=1)
    xx, xy, yy, x, y, _ = np.linalg.lstsq(a, values.ravel(), rcond=None)[0]
    determinant = 4 * xx * yy - xy**2
    if not (determinant > 0 and xx < 0):
        return 0.0, 0.0
    right, down = (xy * y - 2 * yy * x) / determinant, (xy * x - 2 * xx * y) / determinant
    return float(np.clip(right, -1, 1)) * step, float(np.clip(down, -1, 1)) * step
