"""Autofocus: errors along the aperture estimated from the image, applied only where they do it good.

Two kinds of error are looked for. A *phase* of each position, common to all targets: of an oscillator that drifts, or
of a path that grows for all of them (:func:`phase_gradient`, :func:`minimum_entropy_phase`). And a *place*: a trolley
pushed by hand is not quite where it is thought to be along its rail, slowly varying, which turns the phases of targets
by the sine of their angle (:func:`track_of_points`, :func:`minimum_entropy_track`).

An estimate is tried on the whole image and refused unless the image's entropy falls; by how much more than free phases
make any image's fall, if peaks would move; and where all but nothing is to be corrected the data are left alone.
Focused data so come out as they went in.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from processing.errors import DataError
from processing.radar.profiles import RangeProfiles
from processing.sar.autofocus_chips import REACH_CELLS, Chips, cut_chips, cut_field
from processing.sar.autofocus_entropy import minimum_entropy_phase, minimum_entropy_track
from processing.sar.autofocus_gradient import along_track, entropy_of, phase_gradient, track_of_points, without_shift
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid
from processing.sar.peak_search import find_peaks
from processing.sar.quality import Peak
from processing.sar.resolution import Resolution, point_resolution
from processing.sar.sharpness import image_entropy

METHODS = ("auto", "phase-gradient", "minimum-entropy", "track")

MIN_POSITIONS = 8
"""Fewer positions say too little of an error along the aperture."""

FOCUSED_RAD = 0.2
"""Phase error, root mean square, below which data count as focused: it costs a peak 0.17 dB."""

LARGEST_MOVE_CELLS = 0.05
"""How far peaks of focused data may move."""

SHARPENED, PER_FREEDOM = 0.05, 0.8
"""Fall of the entropy, nats, from which on data were not focused before, so that peaks may move: so much, and so much
for each free number of the estimate over the image's resolution cells. Free numbers make any image sharper: noise by
half of that (measured)."""

POINTS = 24
FLOOR_DB = -25.0
"""Strong points that are looked at: at most so many, down to this level below the strongest."""


@dataclass(frozen=True)
class Autofocus:
    """An estimate of the errors along an aperture, and what became of it."""

    method: str
    """``"phase-gradient"``, ``"minimum-entropy"`` or ``"track"``."""
    applied: bool
    """Whether :meth:`corrected` corrects anything."""
    reason: str
    """Why it was applied or refused, one sentence."""
    phase_rad: NDArray[np.float64]
    """(positions,) phase that the profiles are turned by; zeros for ``"track"``."""
    shift_m: NDArray[np.float64]
    """(positions,) by how much the positions are moved along ``axis``; zeros but for ``"track"``."""
    axis: tuple[float, float, float]
    error_rad: float
    """Root mean square of the phase error found, without what would only move points."""
    entropy_before: float
    entropy_after: float
    """Of the whole image with the estimate applied, whether it was kept or not; NaN where there was none to try."""
    largest_move_cells: float
    """Of the peaks within 10 dB of the strongest; NaN where there was nothing to try."""
    points: int
    """How many strong points it was estimated from."""

    def corrected(self, profiles: RangeProfiles) -> RangeProfiles:
        """The profiles with the correction, or as they are where it was refused."""
        return apply_correction(profiles, self.phase_rad, self.shift_m, self.axis) if self.applied else profiles


def apply_correction(
    profiles: RangeProfiles,
    phase_rad: NDArray[np.float64],
    shift_m: NDArray[np.float64],
    axis: tuple[float, float, float],
) -> RangeProfiles:
    """Profiles turned by a phase (positions,) and moved by (positions,) m along a unit vector."""
    values, antenna = profiles.values, profiles.antenna_m
    if np.any(phase_rad):
        values = (values * np.exp(1j * phase_rad)[None, :, None]).astype(values.dtype)
    if np.any(shift_m):
        antenna = antenna + shift_m[:, None] * np.asarray(axis)
    return replace(profiles, values=values, antenna_m=antenna)


def autofocus(
    profiles: RangeProfiles,
    grid: ImageGrid,
    *,
    method: str = "auto",
    weights: NDArray[np.floating] | None = None,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0),
) -> Autofocus:
    """Estimate errors along the aperture and decide whether correcting them does good.

    Args:
        profiles: (channels, positions, bins) in the order of the track; all channels share the errors.
        grid: where the image is formed that decides; its pixels are at most half of a resolution cell.
        method: ``"phase-gradient"``, ``"minimum-entropy"`` (begun from the former's phase), ``"track"``, or
            ``"auto"``: minimum entropy and the track, whichever makes the entropy less.
        weights: (positions,) window along the aperture; rectangular where left out.
        beamwidth_rad: for pattern compensation of the deciding image, as in back-projection.
        depression_rad: likewise.
        axis: unit vector along which positions may be wrong.

    Raises:
        DataError: unknown method, fewer than eight positions, profiles that cannot be focused, an axis of no length, or
            a phase method where no two channels share positions.
    """
    if method not in METHODS:
        raise DataError(f"there is no autofocus {method!r}", f"choose one of {', '.join(METHODS)}")
    direction = np.asarray(axis, dtype=np.float64)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not np.linalg.norm(direction) > 0:
        raise DataError(f"{axis} is no direction", "give a vector (x, y, z) along the rail")
    direction = direction / np.linalg.norm(direction)
    values = np.asarray(profiles.values)
    positions = len(profiles.antenna_m)
    if values.ndim != 3 or positions < MIN_POSITIONS or np.ptp(along_track(profiles.antenna_m)) <= 0:
        raise DataError(
            f"{positions} position{'s' * (positions != 1)} along the track are too few for autofocus",
            f"collect {MIN_POSITIONS} or more, or focus without it",
        )
    present = ~np.isnan(values).all(axis=2)
    apart = len(values) > 1 and bool((present.sum(axis=0) <= 1).all())
    if apart and method not in ("auto", "track"):
        raise DataError("every channel has positions of its own, so they share no phase", "use the method 'track'")
    window = np.ones(positions) if weights is None else np.asarray(weights, dtype=np.float64)
    judge = _Judge(profiles, grid, window, beamwidth_rad, depression_rad)
    tried = ("track",) if apart else ("minimum-entropy", "track") if method == "auto" else (method,)
    unit = (float(direction[0]), float(direction[1]), float(direction[2]))
    if not judge.peaks:
        return _nothing(tried[0], positions, unit, judge.entropy, "no point stands out of the image")
    chips = cut_chips(profiles, judge.peaks, grid, judge.cell, window)
    field = cut_field(profiles, grid, judge.span, judge.cell, window)
    found = [_attempt(name, chips, field, judge, unit) for name in tried]
    # More freedom makes any image sharper: what that is worth is not counted.
    return min(found, key=lambda one: (not one.applied, one.entropy_after + judge.by_chance(one.method)))


class _Judge:
    """The image before, and what a correction makes of it."""

    def __init__(
        self,
        profiles: RangeProfiles,
        grid: ImageGrid,
        weights: NDArray[np.float64],
        beamwidth_rad: float | None,
        depression_rad: float,
    ) -> None:
        self.profiles, self.grid, self.weights = profiles, grid, weights
        self.pattern = (beamwidth_rad, depression_rad)
        middle = float(np.median(grid.x_m)), float(np.median(grid.y_m)), grid.z_m
        self.cell: Resolution = point_resolution(
            profiles.antenna_m, middle, centre_hz=profiles.centre_hz, bandwidth_hz=profiles.bandwidth_hz,
            window=profiles.window, aperture_weights=weights,
        )  # fmt: skip
        self.sizes = min(self.cell.x_m, 1e3), min(self.cell.y_m, 2 * profiles.resolution_m)
        self.span = self._span(profiles)
        self.entropy = image_entropy(self.span)
        self.peaks = self._peaks(self.span, POINTS, FLOOR_DB)

    def look(self, corrected: RangeProfiles) -> tuple[float, float]:
        """Entropy, and the largest move of a strong peak in cells."""
        span = self._span(corrected)
        after = self._peaks(span, 2 * POINTS, 2 * FLOOR_DB)
        strong = [peak for peak in self.peaks if peak.level_db > self.peaks[0].level_db - 10]
        moves = [
            min(
                (max(abs(a.x_m - b.x_m) / self.sizes[0], abs(a.y_m - b.y_m) / self.sizes[1]) for a in after),
                default=np.inf,
            )
            for b in strong
        ]
        return image_entropy(span), float(max(moves))

    def by_chance(self, method: str) -> float:
        """Fall of the entropy that the free numbers of a method may bring about where there is no error at all."""
        steps = [
            float(np.median(np.abs(np.diff(axis)))) if len(axis) > 1 else 0.0 for axis in (self.grid.x_m, self.grid.y_m)
        ]
        pixels = float(np.isfinite(self.span).sum())
        cells = max(pixels * steps[0] * steps[1] / (self.sizes[0] * self.sizes[1]), 1.0)
        positions = self.profiles.antenna_m
        freedoms = shift_basis(positions).shape[1] if method == "track" else len(positions) - 2
        return PER_FREEDOM * freedoms / cells

    def _span(self, profiles: RangeProfiles) -> NDArray[np.float64]:
        image = backproject(
            profiles, self.grid, weights=self.weights, beamwidth_rad=self.pattern[0], depression_rad=self.pattern[1]
        )
        return np.asarray(np.sqrt(np.sum(np.abs(image.astype(np.complex128)) ** 2, axis=0)))

    def _peaks(self, span: NDArray[np.float64], count: int, floor_db: float) -> list[Peak]:
        apart = 2 * REACH_CELLS[0] * self.sizes[0], 2 * REACH_CELLS[1] * self.sizes[1]
        if not np.nanmax(span) > 0:
            return []
        return find_peaks(
            span, self.grid, count, floor_db=floor_db, separation_m=apart,
            range_compensated=self.profiles.range_compensated,
        )  # fmt: skip


def _attempt(method: str, chips: Chips, field: Chips, judge: _Judge, axis: tuple[float, float, float]) -> Autofocus:
    phase, shift, turn = _estimate(method, chips, field, np.asarray(axis))
    error = _error_rad(chips, turn)
    corrected = apply_correction(judge.profiles, phase, shift, axis)
    entropy, move = judge.look(corrected)
    fall, needed = judge.entropy - entropy, SHARPENED + judge.by_chance(method)
    reason, applied = f"the image's entropy falls by {fall:.3f}", True
    if error < FOCUSED_RAD:
        reason, applied = f"focused already: the error found is {error:.2f} rad, below {FOCUSED_RAD:g}", False
    elif not fall > 0:
        reason, applied = f"refused: the image's entropy would not fall but rise by {-fall:.3f}", False
    elif fall < needed and not move < LARGEST_MOVE_CELLS:
        reason = f"refused: peaks would move by {move:.2f} cells and entropy fall by {fall:.3f}, not by {needed:.3f}"
        applied = False
    return Autofocus(
        method, applied, reason, phase, shift, axis, error, judge.entropy, entropy, move, chips.terms.shape[2]
    )


def _estimate(
    method: str, chips: Chips, field: Chips, axis: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Phase and shift (positions,), and the turn (positions, 1 or points, 1 or pixels) of the chips that they give."""
    none = np.zeros(len(chips.antenna_m))
    if method == "track":
        basis = shift_basis(chips.antenna_m)
        starts = track_of_points(chips, field, basis, axis), np.zeros(basis.shape[1])
        ends = [basis @ minimum_entropy_track(field, basis, axis, start) for start in starts]
        shift = min(ends, key=lambda one: entropy_of(field, field.turn_of_shift(one, axis)))
        return none, shift, chips.turn_of_shift(shift, axis)
    phase = phase_gradient(chips, field)
    if method == "minimum-entropy":
        phase = minimum_entropy_phase(field, phase)
    return phase, none, phase[:, None, None]


def shift_basis(antenna_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cubic B-splines along the track, (positions, m), m one for eight positions but 4 to 12; each without its mean.

    A common shift only moves the image, so that it is left out.
    """
    along = along_track(antenna_m)
    count = int(np.clip(len(along) // 8, 4, 12))
    inner = np.linspace(along.min(), along.max(), count - 2)
    knots = np.concatenate([np.full(3, inner[0]), inner, np.full(3, inner[-1])])
    basis = BSpline.design_matrix(np.clip(along, inner[0], inner[-1]), knots, 3).toarray()
    # Their sum is one everywhere: without means one of them says what the others do.
    return np.asarray((basis - basis.mean(axis=0))[:, :-1])


def _error_rad(chips: Chips, turn: NDArray[np.float64]) -> float:
    """Root mean square of a turn over positions and points, for each without its mean and linear part."""
    middle = turn[:, :, turn.shape[2] // 2]
    return float(np.sqrt(np.mean([without_shift(column, chips.antenna_m) ** 2 for column in middle.T])))


def _nothing(method: str, positions: int, axis: tuple[float, float, float], entropy: float, reason: str) -> Autofocus:
    none = np.zeros(positions)
    return Autofocus(method, False, reason, none, none, axis, 0.0, entropy, np.nan, np.nan, 0)
