"""A radar's echoes of bodies along a track, apart by the mechanism that scatters: what is simulated and what is not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.radar.phase_history import PhaseHistory
from processing.scattering.contributions import Beam, Contributions, together
from processing.scattering.history import Sweep, phase_history, segments_needed
from processing.scattering.rough import rough_points
from processing.scattering.shooting import Density, Shot, shoot
from processing.scene.solids import SolidScene

Floats = NDArray[np.float64]

MECHANISMS = ("single", "double", "multiple")
"""One bounce off a body or rough ground; two or more bounces; volumes of dipoles."""


@dataclass(frozen=True)
class RadarLook:
    """How a radar looks at a scene, and how finely it is simulated."""

    track_m: Floats
    """(pulses, 3) places of the antennas, m."""
    reference_m: tuple[float, float, float]
    """Middle of the scene, m."""
    sweep: Sweep
    density: Density
    points_per_m2: float = 20.0
    """Scatterers of rough ground."""
    turn_rad: float = 0.02
    """Rays are sent anew when the direction to the scene has turned by this."""
    beam: Beam | None = None
    seed: int = 0
    time_s: Floats | None = None
    """(pulses,) when pulses are sent; bodies are at their places at time 0. Nothing moves where it is left out."""
    move_m: float = 1.0
    """Rays are sent anew when a body has moved by this: what it hides and is hidden by is at most so far off. Its path
    lengths are those of every pulse."""


@dataclass(frozen=True)
class Simulated:
    """Echoes apart by mechanism, and what was left out."""

    histories: dict[str, PhaseHistory]
    """For each of :data:`MECHANISMS`."""
    segments: int
    """How often rays were sent."""
    rays: int
    footprints: int
    """Largest number of footprints of a segment."""
    beyond_db: float
    """Strongest element of the bounce after the last one kept over the strongest of all, dB (middle of the track)."""
    curvature_rad: float
    """Largest phase by which a wavefront bends within a footprint, taken as flat."""
    parted: float
    """Largest share of the footprints' area at edges, of which a middle ray decided."""

    @property
    def total(self) -> PhaseHistory:
        """All mechanisms together."""
        every = [self.histories[name] for name in MECHANISMS]
        return replace(every[0], echoes=np.sum([history.echoes for history in every], axis=0))


def simulate_radar(scene: SolidScene, look: RadarLook, *, progress: Callable[[float], None] | None = None) -> Simulated:
    """Quad-polarized phase history of a scene.

    Bodies that move do so from pulse to pulse with exact paths, also of bounces between what moves and what stands
    (planes' images move with them); what is lit is that of the middle of each segment.

    Not modelled: diffraction by edges, extinction in volumes and their bounces off the ground, scattering of rough
    ground by way of a second bounce, waves inside bodies.

    Args:
        scene: bodies.
        look: track, sweep and fineness.
        progress: called with the fraction done.

    Raises:
        DataError: a scene, track, times or sweep that cannot be simulated.
    """
    track, reference = look.track_m, np.asarray(look.reference_m, dtype=np.float64)
    time = np.zeros(len(track)) if look.time_s is None else np.asarray(look.time_s, dtype=np.float64)
    if time.shape != (len(track),):
        raise DataError(f"times of shape {time.shape} for {len(track)} pulses", "give one for each pulse")
    segments = max(segments_needed(track, reference, look.turn_rad), _moves(scene, time, look.move_m))
    sent = _Sent()
    parts: dict[str, list[PhaseHistory]] = {name: [] for name in MECHANISMS}
    for number, pulses in enumerate(np.array_split(np.arange(len(track)), min(segments, len(track)))):
        middle = pulses[len(pulses) // 2]
        lit = _lit(scene.at(float(time[middle])), look, track[middle], sent)
        for name in MECHANISMS:

            def alone(antenna: Floats, found: Contributions = lit[name]) -> Contributions:
                return found

            parts[name].append(
                phase_history(alone, track[pulses], reference, look.sweep, beam=look.beam, time_s=time[pulses])
            )
        if progress:
            progress((number + 1) / min(segments, len(track)))
    return Simulated(
        {name: _joined(found) for name, found in parts.items()},
        sent.segments, sent.rays, sent.footprints, sent.beyond_db, sent.curvature_rad, sent.parted,
    )  # fmt: skip


@dataclass
class _Sent:
    """What all shots together say."""

    segments: int = 0
    rays: int = 0
    footprints: int = 0
    beyond_db: float = -math.inf
    curvature_rad: float = 0.0
    parted: float = 0.0

    def add(self, shot: Shot, beyond_db: float) -> None:
        self.segments += 1
        self.rays += shot.rays
        self.footprints = max(self.footprints, len(shot.contributions))
        self.beyond_db = max(self.beyond_db, beyond_db)
        self.curvature_rad = max(self.curvature_rad, shot.curvature_rad)
        self.parted = max(self.parted, shot.parted)


def _moves(scene: SolidScene, time_s: Floats, move_m: float) -> int:
    """Segments in which no body moves by more than ``move_m``."""
    if not move_m > 0:
        raise DataError(f"rays sent anew every {move_m} m", "give a positive length")
    return math.ceil(scene.speed_m_s * float(np.ptp(time_s)) / move_m)


def _lit(scene: SolidScene, look: RadarLook, antenna: Floats, sent: _Sent) -> dict[str, Contributions]:
    """What an antenna sees, apart by mechanism."""
    target = scene.target(look.sweep.wavelength_m)
    # One bounce more than is kept tells what is left out.
    shot = shoot(target, antenna, look.reference_m, replace(look.density, bounces=look.density.bounces + 1))
    found = shot.contributions
    sent.add(shot, _beyond(found, look, antenna))
    rough = rough_points(target, scene.radar_surfaces, antenna, look.points_per_m2, seed=look.seed)
    return {
        "single": together([found.chosen(found.bounces == 1), rough]),
        "double": found.chosen((found.bounces > 1) & (found.bounces <= look.density.bounces)),
        "multiple": scene.volumes(target, antenna),
    }


def _joined(parts: list[PhaseHistory]) -> PhaseHistory:
    """Histories of consecutive pulses as one."""
    return replace(
        parts[0],
        echoes=np.concatenate([part.echoes for part in parts], axis=1),
        antenna_m=np.concatenate([part.antenna_m for part in parts]),
        reference_m=np.concatenate([part.reference_m for part in parts]),
    )


def straight_track(middle_m: ArrayLike, length_m: float, pulses: int) -> Floats:
    """Places (pulses, 3) along x around a point, m."""
    track = np.tile(np.asarray(middle_m, dtype=np.float64), (pulses, 1))
    track[:, 0] += np.linspace(-length_m / 2, length_m / 2, pulses)
    return track


def _beyond(found: Contributions, look: RadarLook, antenna: Floats) -> float:
    """Strongest element of the last bounce over that of the others, each as the middle of the band sums it, dB."""
    level = []
    for which in (found.bounces > look.density.bounces, found.bounces <= look.density.bounces):
        told = found.chosen(which).scattering(antenna[None], look.sweep.wavelength_m, look.reference_m, beam=look.beam)
        level.append(float(np.abs(told).max()))
    return float(20 * np.log10(max(level[0], 1e-15 * level[1], 1e-300) / max(level[1], 1e-300)))
