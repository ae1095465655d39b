"""Bodies that both eyes see: triangles with a radar and an optical surface, and clouds of dipoles for radar alone.

One scene gives the ray tracer's world, the radar's target and the truth of what stands where. Coordinates are the
rig's directions (x along the track, y away from it, z up) with the origin anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.raytrace.materials import Material
from processing.raytrace.shapes import turn_about
from processing.raytrace.sources import Source
from processing.raytrace.triangles import Triangles, joined
from processing.raytrace.world import World, world
from processing.scattering.contributions import Contributions, of_points
from processing.scattering.rough import visible
from processing.scattering.surfaces import RadarSurface
from processing.scattering.target import Target, radar_target
from processing.scene.model import Bush
from processing.scene.radar_response import bush_cloud, dipole_scattering

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Substance:
    """What a surface is made of, for both eyes."""

    name: str
    radar: RadarSurface | None
    """None: radar waves pass, as between leaves (whose scattering a cloud of dipoles stands for)."""
    optical: Material


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one substance."""

    mesh: Triangles
    substance: str
    """Name of a substance of the scene."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A body."""

    name: str
    kind: str
    """Such as ``"building"``: what a truth map tells."""
    parts: tuple[Part, ...]
    clouds: tuple[Bush, ...] = ()
    """Thin dipoles that scatter radar waves and nothing else."""
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Steady, without turning; the body is at its place at time 0."""

    @property
    def moves(self) -> bool:
        """Whether it does."""
        return any(self.velocity_m_s)

    def at(self, time_s: float) -> Solid:
        """Where it is then."""
        return self.placed(np.asarray(self.velocity_m_s) * time_s) if self.moves and time_s else self

    def placed(self, position_m: ArrayLike, turn_rad: float = 0.0) -> Solid:
        """The body turned about z through the origin, then moved by (3,), m."""
        turn, offset = turn_about((0.0, 0.0, 1.0), turn_rad), np.asarray(position_m, dtype=np.float64)
        parts = tuple(Part(part.mesh.turned(turn).moved(offset), part.substance) for part in self.parts)
        clouds = []
        for cloud in self.clouds:
            x, y, z = turn @ np.asarray(cloud.position_m) + offset
            clouds.append(
                Bush(
                    cloud.name,
                    (float(x), float(y), float(z)),
                    cloud.radius_m,
                    cloud.scatterers,
                    cloud.rcs_m2,
                    cloud.seed,
                )
            )
        return Solid(self.name, self.kind, parts, tuple(clouds), self.velocity_m_s)


@dataclass(frozen=True, eq=False)
class SolidScene:
    """Bodies and what they are made of.

    Raises:
        DataError: no bodies, names that occur twice, or a part of an unknown substance.
    """

    name: str
    substances: tuple[Substance, ...]
    solids: tuple[Solid, ...]

    def __post_init__(self) -> None:
        names = [substance.name for substance in self.substances]
        if len(set(names)) != len(names) or not self.solids:
            raise DataError(
                f"scene '{self.name}' has {len(self.solids)} bodies and substances {names}",
                "give at least one body, and every substance a name of its own",
            )
        for solid in self.solids:
            for part in solid.parts:
                if part.substance not in names:
                    raise DataError(
                        f"'{solid.name}' is of '{part.substance}'", f"the scene's substances are {', '.join(names)}"
                    )

    @property
    def speed_m_s(self) -> float:
        """Of the fastest body; 0 where nothing moves."""
        return max(float(np.linalg.norm(solid.velocity_m_s)) for solid in self.solids)

    def at(self, time_s: float) -> SolidScene:
        """The scene at an instant."""
        return SolidScene(self.name, self.substances, tuple(solid.at(time_s) for solid in self.solids))

    def mesh(self, *, radar: bool = False) -> tuple[Triangles, NDArray[np.int64]]:
        """All triangles and the body (T,) that each belongs to; materials are numbers of ``substances``.

        Args:
            radar: only those that radar waves do not pass.

        Raises:
            DataError: there are none.
        """
        index = {substance.name: number for number, substance in enumerate(self.substances)}
        meshes, owners = [], []
        for number, solid in enumerate(self.solids):
            for part in solid.parts:
                material = index[part.substance]
                if radar and self.substances[material].radar is None:
                    continue
                meshes.append(part.mesh.of_material(material))
                owners.append(np.full(len(part.mesh), number))
        return joined(meshes), np.concatenate(owners) if owners else np.zeros(0, dtype=np.int64)

    def world(self, lights: Sequence[Source]) -> World:
        """As the ray tracer sees it. Raises :class:`DataError` without any light."""
        return world(self.mesh()[0], [substance.optical for substance in self.substances], lights)

    @property
    def radar_surfaces(self) -> tuple[RadarSurface, ...]:
        """The substances as radar meets them; those that it passes stand as conductors, of no triangle."""
        return tuple(substance.radar or RadarSurface() for substance in self.substances)

    def target(self, wavelength_m: float) -> Target:
        """As the radar's rays meet it. Raises :class:`DataError` for a wavelength that is not positive."""
        mesh, owner = self.mesh(radar=True)
        velocity = np.array([solid.velocity_m_s for solid in self.solids], dtype=np.float64)[owner]
        return radar_target(mesh, self.radar_surfaces, wavelength_m, velocity if velocity.any() else None)

    def volumes(self, target: Target, antenna_m: ArrayLike) -> Contributions:
        """The dipoles of all clouds that an antenna (3,) sees past the bodies."""
        antenna = np.asarray(antenna_m, dtype=np.float64)
        centres, matrices = [np.zeros((0, 3))], [np.zeros((0, 2, 2), dtype=np.complex128)]
        velocities = [np.zeros((0, 3))]
        for solid in self.solids:
            for bush in solid.clouds:
                cloud = bush_cloud(bush)
                centres.append(cloud.centres_m)
                matrices.append(dipole_scattering(cloud, antenna))
                velocities.append(np.tile(np.asarray(solid.velocity_m_s, dtype=np.float64), (len(cloud.centres_m), 1)))
        points, scattering, velocity = np.concatenate(centres), np.concatenate(matrices), np.concatenate(velocities)
        seen = visible(target, antenna, points) if len(points) else np.zeros(0, dtype=bool)
        return of_points(points[seen], scattering[seen], velocity[seen] if velocity.any() else None)
