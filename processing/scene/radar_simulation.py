"""A radar's echoes of bodies along a track, apart by the mechanism that scatters: what is simulated and what is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

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

    Not modelled: diffraction by edges, extinction in volumes and their bounces off the ground, scattering of rough
    ground by way of a second bounce, waves inside bodies.

    Args:
        scene: bodies.
        look: track, sweep and fineness.
        progress: called with the fraction done.

    Raises:
        DataError: a scene, track or sweep that cannot be simulated.
    """
    target = scene.target(look.sweep.wavelength_m)
    segments = segments_needed(look.track_m, np.asarray(look.reference_m), look.turn_rad)
    lit: dict[bytes, dict[str, Contributions]] = {}
    shots: list[Shot] = []
    beyond: list[float] = []

    def all_seen(antenna: Floats) -> dict[str, Contributions]:
        key = antenna.tobytes()
        if key not in lit:
            # One bounce more than is kept tells what is left out.
            shot = shoot(target, antenna, look.reference_m, replace(look.density, bounces=look.density.bounces + 1))
            shots.append(shot)
            found = shot.contributions
            beyond.append(_beyond(found, look, antenna))
            rough = rough_points(target, scene.radar_surfaces, antenna, look.points_per_m2, seed=look.seed)
            lit[key] = {
                "single": together([found.chosen(found.bounces == 1), rough]),
                "double": found.chosen((found.bounces > 1) & (found.bounces <= look.density.bounces)),
                "multiple": scene.volumes(target, antenna),
            }
        return lit[key]

    histories = {}
    for number, name in enumerate(MECHANISMS):

        def part(antenna: Floats, name: str = name) -> Contributions:
            return all_seen(antenna)[name]

        def told(done: float, number: int = number) -> None:
            if progress:
                progress((number + done) / len(MECHANISMS))

        histories[name] = phase_history(
            part, look.track_m, np.asarray(look.reference_m), look.sweep, segments=segments, beam=look.beam,
            progress=told,
        )  # fmt: skip
    return Simulated(
        histories,
        segments,
        sum(shot.rays for shot in shots),
        max(len(shot.contributions) for shot in shots),
        max(beyond),
        max(shot.curvature_rad for shot in shots),
        max(shot.parted for shot in shots),
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
