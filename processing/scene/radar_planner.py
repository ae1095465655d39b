"""How finely a radar's scene must be simulated: bounces, rays, and how often they are sent, by a tolerance.

At a few pulses of the track the echoes of ever denser rays, sent from each pulse itself, are refined until they change
by less than a part of the tolerance. They stand for the truth, and every cheaper setting is held against them as the
simulation would use it: with so many bounces, cells of such a size (within which a wavefront is taken as flat: the near
field's term), split so often at edges, and rays sent from the middle of a segment of the track only. By Parseval's
theorem errors of windowed echoes are those of the focused picture, which holds all echoes: relative to them, root mean
square, dB. Thermal noise is not counted, and rough ground and volumes are as the scene tells.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.scattering.contributions import Contributions, together
from processing.scattering.history import pattern_nodes, phase_history
from processing.scattering.rough import rough_points
from processing.scattering.shooting import Density, shoot
from processing.scattering.target import Target
from processing.scene.radar_simulation import RadarLook
from processing.scene.solids import SolidScene
from processing.tolerances import check_tolerance

Echoes = NDArray[np.complex64]
Floats = NDArray[np.float64]

PULSES_AT = (0.301, 0.4, 0.469, 0.531, 0.6, 0.699)
"""Pulses that are looked at, of the track: the middles of equal parts of the area of Hann's squared window."""
MOST_BOUNCES = 6
"""That the dense rays follow."""
MOST_LEVELS, MOST_REFINEMENTS = 10, 7
MOST_RAYS, MOST_CELLS = 500_000, 250_000
"""Of one look of the dense rays, after which they are not refined further; cells that it begins with at most."""
SAFETY_DB = 0.2
"""How far below the tolerance the expected error must be."""
TRUTH_SHARE = 0.3
"""Part of the tolerance by which the dense rays may still change."""
TRUTH_CELL = 0.3
"""Wavelengths of the cells that the dense rays begin with at most: tips of bodies that reach between the corners of a
larger cell are not seen, however often edges are split."""
RUNG = 2**0.25
"""From one size of cells to the next that is looked at."""
SMALLEST_RATIO = 0.25
"""Of one refinement's change over the one before."""
FOOTPRINT_NS, NODE_NS, RAY_NS = 80.0, 60.0, 900.0
"""Core time of a footprint at a pulse, of each frequency that its pattern is worked out at, and of a ray, as measured
where the focusing planner's tables are from."""


@dataclass(frozen=True)
class Considered:
    """One setting: what it was expected to leave, and its core time."""

    density: Density
    error_db: float
    seconds: float


@dataclass(frozen=True)
class RadarPlan:
    """What was chosen, and what it leaves out."""

    tolerance_db: float
    density: Density
    segments: int
    """How often rays are sent."""
    turn_rad: float
    """The same as the direction's turn that a segment may have (:class:`RadarLook`)."""
    predicted_error_db: float
    """Of the picture, all below together."""
    bounces_db: float
    """Echoes of the bounces that are not followed; -inf where there are none up to :data:`MOST_BOUNCES`."""
    rays_db: float
    """What coarser rays leave at edges, and wavefronts that bend within footprints."""
    segments_db: float
    """What rays from a segment's middle leave at its other pulses."""
    truth_db: float
    """What is not known of the truth: by how much the densest rays would still change, and what bounces beyond
    :data:`MOST_BOUNCES` would add, of which the last two tell."""
    considered: tuple[Considered, ...]
    """All that was tried, cheapest first."""

    @property
    def reached(self) -> bool:
        """Whether the tolerance is kept."""
        return self.predicted_error_db <= self.tolerance_db

    def explain(self) -> list[str]:
        """The choice in words."""
        how = self.density
        chosen = next(one for one in self.considered if one.density == how)
        lines = [
            f"{how.bounces} bounces, cells of {how.cell_m:.3g} m split {how.levels} times, rays sent {self.segments} "
            f"times: expected error {self.predicted_error_db:.1f} dB, tolerance {self.tolerance_db:g} dB"
            + ("" if self.reached else ", which is not reached"),
            f"further bounces {self.bounces_db:.1f} dB, rays (edges, bent wavefronts) {self.rays_db:.1f} dB, segments "
            f"{self.segments_db:.1f} dB; denser rays and still more bounces would change it by {self.truth_db:.1f} dB",
        ]
        cheaper = [one for one in self.considered if one.seconds < chosen.seconds]
        dearer = [one for one in self.considered if one.seconds > chosen.seconds]
        for one in (*cheaper[-2:], *dearer[:1]):
            d = one.density
            lines.append(
                f"not {d.bounces} bounces, {d.cell_m:.3g} m split {d.levels} times: {one.error_db:.1f} dB, "
                f"{one.seconds / chosen.seconds:.2f} times the time"
            )
        return lines


def plan_radar(scene: SolidScene, look: RadarLook, tolerance_db: float) -> RadarPlan:
    """The cheapest density of rays, bounces and segments whose expected error is within the tolerance.

    Args:
        scene: bodies.
        look: track and sweep; its density and turn are not used.
        tolerance_db: largest error of the picture, dB (negative).

    Raises:
        DataError: a tolerance that is no negative number, a scene that returns nothing, or one that cannot be
            simulated.
    """
    check_tolerance(tolerance_db, "picture")
    pilot = _Pilot(scene, look)
    allowed = 10 ** ((tolerance_db - SAFETY_DB) / 20)
    unknown = math.hypot(pilot.refine(TRUTH_SHARE * allowed), pilot.tail())
    segments, turning = 1, math.inf
    while True:
        turning = pilot.error(pilot.densest, segments)[-1]
        if turning <= 0.7 * allowed or segments >= len(look.track_m):
            break
        segments = min(2 * segments, len(look.track_m))
    search = _Search(pilot, segments, allowed, unknown)
    for cell_m in pilot.cells():
        search.look(cell_m)
    best = search.best
    if best is None:  # the densest that simulations are offered, short of the truth itself
        best = min(search.tried.values(), key=lambda one: one.error_db)
    every = pilot.error(best.density, 0)[-1]
    return RadarPlan(
        tolerance_db=tolerance_db,
        density=best.density,
        segments=segments,
        turn_rad=pilot.turn_rad(segments),
        predicted_error_db=best.error_db,
        bounces_db=_db(pilot.beyond(best.density.bounces)),
        rays_db=_db(every),
        segments_db=_db(turning),
        truth_db=_db(unknown),
        considered=tuple(sorted(search.tried.values(), key=lambda one: one.seconds)),
    )


class _Search:
    """The cheapest setting within what is allowed, of those that were looked at."""

    def __init__(self, pilot: _Pilot, segments: int, allowed: float, unknown: float) -> None:
        self._pilot, self._segments, self._allowed, self._unknown = pilot, segments, allowed, unknown
        self.tried: dict[Density, Considered] = {}
        self.best: Considered | None = None

    def look(self, cell_m: float) -> None:
        """Look at cells of one size, split ever more often, with every number of bounces."""
        pilot, before = self._pilot, list[float]()
        for level in pilot.levels(cell_m):
            density = Density(cell_m, level, pilot.bounces)
            errors, costs = pilot.error(density, self._segments), pilot.seconds(density, self._segments)
            for bounces, (error, cost) in enumerate(zip(errors, costs, strict=True), start=1):
                off = math.hypot(error, self._unknown)
                one = Considered(replace(density, bounces=bounces), _db(off), cost)
                self.tried[one.density] = one
                if off <= self._allowed and (self.best is None or cost < self.best.seconds):
                    self.best = one
            # Splitting further costs more, and helps no more where cells are too large.
            before.append(errors[-1])
            saturated = len(before) > 2 and before[-1] > 0.8 * before[-2] > 0.64 * before[-3]
            dearer = self.best is not None and costs[self.best.density.bounces - 1] >= self.best.seconds
            if saturated or dearer:
                break


class _Pilot:
    """Echoes of a few pulses by rays of any density; all that was traced is kept."""

    def __init__(self, scene: SolidScene, look: RadarLook) -> None:
        self.look = look
        self.target: Target = scene.target(look.sweep.wavelength_m)
        self.reference = np.asarray(look.reference_m, dtype=np.float64)
        count = len(look.track_m)
        self.pulses = sorted({min(int(part * count), count - 1) for part in PULSES_AT})
        self.window = np.hanning(look.sweep.count + 2)[1:-1]
        self.first_cell_m = _first_cell_m(scene)
        self.shots: dict[tuple[Density, int], Contributions] = {}
        self.rays: dict[tuple[Density, int], int] = {}
        self.footprints_ns: dict[tuple[Density, int], Floats] = {}
        self.seen: dict[tuple[Density, int], Echoes] = {}
        self.bounces = MOST_BOUNCES
        others = []
        for pulse in self.pulses:
            antenna = look.track_m[pulse]
            rough = rough_points(self.target, scene.radar_surfaces, antenna, look.points_per_m2, seed=look.seed)
            others.append(self._echoes(together([rough, scene.volumes(self.target, antenna)]), [pulse]))
        self.others = np.concatenate(others)
        self.densest = Density(self.first_cell_m, 0, self.bounces)
        self.truth: Echoes = np.zeros(0, dtype=np.complex64)
        self.size = 0.0

    def refine(self, allowed: float) -> float:
        """Make the truth: refine until it changes by less; returns by how much it would still change."""
        before: Echoes | None = None
        changes: list[float] = []
        # Edges in longer steps than a part of a wavelength return anything.
        wavelength = self.look.sweep.wavelength_m
        sides = np.sort(np.ptp(self.target.corners_m.reshape(-1, 3), axis=0))
        room = math.sqrt(float(sides[1] * sides[2]) / MOST_CELLS)
        cell = max(min(self.first_cell_m, TRUTH_CELL * wavelength), room)
        levels = max(math.ceil(math.log2(8 * cell / wavelength)), 1)
        for step in range(MOST_REFINEMENTS):
            self.densest = Density(cell * 0.84**step, min(levels + step, MOST_LEVELS), self.bounces)
            self.truth = self.of(self.densest, 0)
            whole = self.truth.sum(axis=1) + self.others
            self.size = float(np.linalg.norm(whole))
            if not self.size > 0:
                raise DataError("the scene returns nothing to the radar", "give a body that the radar sees")
            if before is not None:
                changes.append(float(np.linalg.norm((self.truth - before).sum(axis=1))) / self.size)
                if self._change(changes) <= allowed or self.rays[self.densest, self.pulses[0]] > MOST_RAYS:
                    break
            before = self.truth
        ratio = changes[-1] / changes[-2] if len(changes) > 1 and changes[-2] > 0 else 0.35
        ratio = min(max(ratio, SMALLEST_RATIO), 0.7)
        return self._change(changes) * ratio / (1 - ratio)

    @staticmethod
    def _change(changes: list[float]) -> float:
        """The last one; edges may fall together by chance: no less is believed than a part of the one before."""
        return max(changes[-1], SMALLEST_RATIO * changes[-2]) if len(changes) > 1 else changes[-1]

    def cells(self) -> Iterator[float]:
        """Cells from the largest on, no smaller than the truth's, m."""
        cell = self.first_cell_m
        while cell >= 0.99 * self.densest.cell_m:
            yield cell
            cell /= RUNG

    def levels(self, cell_m: float) -> list[int]:
        """How often such cells may be split: cheaper than the truth."""
        finest = self.densest.cell_m / 2**self.densest.levels
        coarsest = 2 * self.look.sweep.wavelength_m
        return [n for n in range(MOST_LEVELS + 1) if 1.6 * finest <= cell_m / 2**n <= coarsest]

    def error(self, density: Density, segments: int) -> list[float]:
        """Of the picture, for each number of bounces up to the density's; 0 segments: rays from each pulse itself."""
        found = self.of(replace(density, bounces=self.bounces), segments)
        truth = self.truth.sum(axis=1)
        kept = np.cumsum(found, axis=1)
        return [float(np.linalg.norm(kept[:, b] - truth)) / self.size for b in range(density.bounces)]

    def beyond(self, bounces: int) -> float:
        """Echoes of more bounces than these."""
        return float(np.linalg.norm(self.truth[:, bounces:].sum(axis=1))) / self.size

    def tail(self) -> float:
        """Echoes of more bounces than are followed, if they go on as the last two do."""
        before, last = (float(np.linalg.norm(self.truth[:, n])) for n in (-2, -1))
        ratio = min(max(last / before if before > 0 else 1.0, SMALLEST_RATIO), 0.7)
        return last * ratio / (1 - ratio) / self.size

    def seconds(self, density: Density, segments: int) -> list[float]:
        """Core time of the whole simulation for each number of bounces."""
        middles = {self.middle(pulse, segments) for pulse in self.pulses}
        keys = [(density, middle) for middle in middles]
        pulses = len(self.look.track_m)
        rays = segments * np.mean([self.rays[key] for key in keys]) * RAY_NS
        footprints = np.mean([self.footprints_ns[key] for key in keys], axis=0)
        return [float(1e-9 * (rays + pulses * one)) for one in np.cumsum(footprints)]

    def turn_rad(self, segments: int) -> float:
        """Of the direction to the scene within a segment."""
        ways = self.look.track_m - self.reference
        ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
        whole = float(np.linalg.norm(np.diff(ways, axis=0), axis=1).sum())
        return max(whole / segments * (1 + 1e-9), 1e-12)

    def middle(self, pulse: int, segments: int) -> int:
        """The pulse that rays are sent from."""
        if not segments:
            return pulse
        for part in np.array_split(np.arange(len(self.look.track_m)), segments):
            if pulse <= part[-1]:
                return int(part[len(part) // 2])
        return pulse

    def of(self, density: Density, segments: int) -> Echoes:
        """(pulses, bounces, 3 channels, frequencies) windowed echoes by number of bounces."""
        found = np.zeros((len(self.pulses), self.bounces, 3, self.look.sweep.count), dtype=np.complex64)
        middles = np.array([self.middle(pulse, segments) for pulse in self.pulses])
        for middle in np.unique(middles):
            which = np.flatnonzero(middles == middle)
            shot = self._shot(density, int(middle))
            for bounces in range(1, self.bounces + 1):
                part = shot.chosen(shot.bounces == bounces)
                found[which, bounces - 1] = self._echoes(part, [self.pulses[n] for n in which])
        return found

    def _shot(self, density: Density, middle: int) -> Contributions:
        key = density, middle
        if key not in self.shots:
            shot = shoot(self.target, self.look.track_m[middle], self.look.reference_m, density)
            self.shots[key], self.rays[key] = shot.contributions, shot.rays
            nodes = pattern_nodes(shot.contributions, self.look.track_m[middle], self.look.sweep)
            each = FOOTPRINT_NS + NODE_NS * nodes
            by_bounces = np.bincount(shot.contributions.bounces, each, minlength=self.bounces + 1)
            self.footprints_ns[key] = by_bounces[1:].astype(np.float64)
        return self.shots[key]

    def _echoes(self, part: Contributions, pulses: list[int]) -> Echoes:
        """(pulses, 3, frequencies)."""
        if not len(part):
            return np.zeros((len(pulses), 3, self.look.sweep.count), dtype=np.complex64)
        track = self.look.track_m[pulses]
        history = phase_history(lambda _: part, track, self.reference, self.look.sweep, beam=self.look.beam)
        # The cross-polarized element is in two channels.
        weights = np.array([1.0, math.sqrt(2), 1.0])[:, None] * self.window
        return np.asarray(history.echoes[[0, 1, 3]].transpose(1, 0, 2) * weights, dtype=np.complex64)


def _first_cell_m(scene: SolidScene) -> float:
    """Half of the second longest side of the smallest part that radar meets: no part hides between rays."""
    sizes = []
    known = {substance.name: substance for substance in scene.substances}
    for solid in scene.solids:
        for part in solid.parts:
            if known[part.substance].radar is not None:
                sides = np.sort(np.ptp(part.mesh.vertices_m, axis=0))
                sizes.append(float(sides[1]))
    if not sizes:
        raise DataError("the radar meets no body", "give a body that radar waves do not pass")
    return max(min(size for size in sizes if size > 0), 1e-3) / 2


def _db(value: float) -> float:
    return 20 * math.log10(value) if value > 0 else -math.inf
