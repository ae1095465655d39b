"""Bodies and substances of a scene file for both eyes, as users write them."""

from __future__ import annotations

import math
from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, PositiveFloat, field_validator, model_validator

from polfuse_lab.raytrace.scene_file import Four, MaterialPart, Three
from polfuse_lab.rig import FileModel
from processing.scattering.permittivity import FITS
from processing.scene.primitives import CONTAINER_M

if TYPE_CHECKING:
    from processing.raytrace.triangles import Triangles
    from processing.scene.solids import Solid, Substance

CONDUCTOR, PASSED, DIELECTRIC = "conductor", "passed", "dielectric"
RADAR = (CONDUCTOR, PASSED, DIELECTRIC, *FITS)
"""What a substance may be to radar waves: metal, nothing, of a stated permittivity, or a material of ITU-R P.2040-1."""

Count = Annotated[int, Field(ge=1, le=1_000_000)]


class SubstancePart(MaterialPart):
    """What bodies are made of: the ray tracer's material, and what radar waves meet."""

    radar: str
    """One of :data:`RADAR`."""
    permittivity: tuple[float, float] | None = None
    """e' and e'' of a dielectric."""
    height_sd_m: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Standard deviation of the surface's heights; 0 is smooth to the radar."""

    @field_validator("radar")
    @classmethod
    def _known(cls, radar: str) -> str:
        if radar not in RADAR:
            raise ValueError(", ".join(RADAR))
        return radar

    @model_validator(mode="after")
    def _stated(self) -> SubstancePart:
        if (self.radar == DIELECTRIC) != (self.permittivity is not None):
            raise ValueError(f"give 'permittivity' with radar = \"{DIELECTRIC}\", and only then")
        if self.permittivity is not None and not (self.permittivity[0] >= 1 and self.permittivity[1] >= 0):
            raise ValueError("permittivity = [e', e''] with e' of 1 or more and e'' not negative")
        if self.height_sd_m and self.radar == PASSED:
            raise ValueError("what radar waves pass has no height_sd_m")
        return self

    def substance(self, frequency_hz: float) -> Substance:
        """For both eyes. Raises DataError for shares of light that exceed 1, or a frequency without a permittivity."""
        from processing.scattering.permittivity import permittivity
        from processing.scattering.surfaces import RadarSurface
        from processing.scene.solids import Substance

        surface: RadarSurface | None
        if self.radar == PASSED:
            surface = None
        elif self.radar == CONDUCTOR:
            surface = RadarSurface(None, self.height_sd_m)
        elif self.permittivity is not None:
            surface = RadarSurface(complex(self.permittivity[0], -self.permittivity[1]), self.height_sd_m)
        else:
            surface = RadarSurface(permittivity(self.radar, frequency_hz), self.height_sd_m)
        return Substance(self.name, surface, self.material())


class Placed(FileModel):
    """A body's name and place. It stands on z = 0 around the origin before it is turned and moved."""

    shape: str
    """Which body it is."""
    name: str | None = None
    """Of the body; its shape and number by default."""
    kind: str | None = None
    """What the map of bodies calls it; its shape by default."""
    position_m: Three = (0.0, 0.0, 0.0)
    turn_deg: float = 0.0
    """About the vertical, from x towards y."""
    velocity_m_s: Three = (0.0, 0.0, 0.0)
    """Steady, without turning: the body is at its position at time 0."""

    @property
    @abstractmethod
    def made_of(self) -> tuple[str, ...]:
        """Substances that it names."""

    @abstractmethod
    def shaped(self, folder: Path) -> Solid:
        """The body before it is turned and moved; mesh files lie in ``folder``.

        Raises:
            PolfuseError: a mesh file that cannot be used.
            DataError: a shape that cannot be.
        """

    def solid(self, number: int, folder: Path) -> Solid:
        """In its place. ``number`` counts the file's bodies from 1. Raises as :meth:`shaped`."""
        from processing.scene.solids import Solid

        made = self.shaped(folder)
        named = Solid(
            self.name or f"{self.shape} {number}", self.kind or self.shape, made.parts, made.clouds, self.velocity_m_s
        )
        return named.placed(self.position_m, math.radians(self.turn_deg))


class OneSubstance(Placed):
    """A body of one substance."""

    substance: str
    """Name of a substance of the file."""

    @property
    def made_of(self) -> tuple[str, ...]:
        """Substances that it names."""
        return (self.substance,)


class _Mesh(OneSubstance):
    """Triangles that may be tilted before the body is turned."""

    tilt_deg: float = 0.0
    """About x, from y towards z."""

    @abstractmethod
    def triangles(self, folder: Path) -> Triangles:
        """Before they are tilted."""

    def shaped(self, folder: Path) -> Solid:
        """As :meth:`Placed.shaped`."""
        from processing.raytrace.shapes import turn_about
        from processing.scene.solids import Part, Solid

        tilted = self.triangles(folder).turned(turn_about((1.0, 0.0, 0.0), math.radians(self.tilt_deg)))
        return Solid(self.shape, self.shape, (Part(tilted, self.substance),))


class PlatePart(_Mesh):
    """A rectangle, flat on the ground; tilted by 90 degrees it is upright along x."""

    shape: Literal["plate"] = "plate"
    width_m: PositiveFloat
    """Along x."""
    depth_m: PositiveFloat | None = None
    """As wide by default."""

    def triangles(self, folder: Path) -> Triangles:
        """Centred."""
        from processing.raytrace.shapes import plate

        return plate(self.width_m, self.depth_m)


class DihedralPart(_Mesh):
    """Two squares at right angles, one on the ground and one upright, open towards the track."""

    shape: Literal["dihedral"] = "dihedral"
    edge_m: PositiveFloat

    def triangles(self, folder: Path) -> Triangles:
        """Their fold lies along x."""
        from processing.raytrace.shapes import dihedral, turn_about

        return dihedral(self.edge_m).turned(turn_about((0.0, 0.0, 1.0), math.pi))


class TrihedralPart(_Mesh):
    """Three squares that meet in a corner, one on the ground, open towards the track."""

    shape: Literal["trihedral"] = "trihedral"
    edge_m: PositiveFloat

    def triangles(self, folder: Path) -> Triangles:
        """Their corner is the origin."""
        from processing.raytrace.shapes import trihedral, turn_about

        return trihedral(self.edge_m).turned(turn_about((0.0, 0.0, 1.0), -0.75 * math.pi))


class SpherePart(_Mesh):
    """A ball on the ground, of triangles."""

    shape: Literal["sphere"] = "sphere"
    diameter_m: PositiveFloat
    divisions: Annotated[int, Field(ge=0, le=6)] = 4
    """How often an icosahedron is divided."""

    def triangles(self, folder: Path) -> Triangles:
        """It touches z = 0."""
        from processing.raytrace.shapes import sphere

        return sphere(self.diameter_m / 2, divisions=self.divisions).moved((0.0, 0.0, self.diameter_m / 2))


class MeshPart(_Mesh):
    """Triangles of a file, as they are."""

    shape: Literal["mesh"] = "mesh"
    file: str
    """OBJ or PLY, beside the scene file."""
    unit_m: PositiveFloat = 1.0
    """Length of 1 in the file."""

    def triangles(self, folder: Path) -> Triangles:
        """In metres."""
        from polfuse_lab.raytrace.meshes import read_mesh
        from processing.raytrace.triangles import Triangles

        read = read_mesh(folder / self.file)
        return Triangles(read.vertices_m * self.unit_m, read.faces)


class GroundPart(OneSubstance):
    """A rectangle of ground."""

    shape: Literal["ground"] = "ground"
    width_m: PositiveFloat
    """Along x."""
    depth_m: PositiveFloat
    hole_m: Four | None = None
    """x from, x to, y from, y to of a rectangle left out, for another ground."""

    def shaped(self, folder: Path) -> Solid:
        """As :meth:`Placed.shaped`."""
        from processing.scene import primitives

        return primitives.ground(self.width_m, self.depth_m, self.substance, hole_m=self.hole_m)


class BoxPart(OneSubstance):
    """A box without a bottom."""

    shape: Literal["box"] = "box"
    width_m: PositiveFloat
    depth_m: PositiveFloat
    height_m: PositiveFloat

    def shaped(self, folder: Path) -> Solid:
        """As :meth:`Placed.shaped`."""
        from processing.scene import primitives

        return primitives.box(self.width_m, self.depth_m, self.height_m, self.substance)


class BuildingPart(Placed):
    """A building with a flat roof."""

    shape: Literal["building"] = "building"
    width_m: PositiveFloat
    depth_m: PositiveFloat
    height_m: PositiveFloat
    wall: str
    """Substance of the walls."""
    roof: str
    """Substance of the roof."""
    door: str | None = None
    """Substance of a door in each long wall, 60 % wide and high; none by default."""

    @property
    def made_of(self) -> tuple[str, ...]:
        """Substances that it names."""
        return (self.wall, self.roof) if self.door is None else (self.wall, self.roof, self.door)

    def shaped(self, folder: Path) -> Solid:
        """As :meth:`Placed.shaped`."""
        from processing.scene import primitives

        size = self.width_m, self.depth_m, self.height_m
        return primitives.building(*size, wall=self.wall, roof=self.roof, door=self.door)


class ContainerPart(OneSubstance):
    """A shipping container, its length along x."""

    shape: Literal["container"] = "container"
    size_m: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = CONTAINER_M
    """Length, width, height; of 20 feet by default."""

    def shaped(self, folder: Path) -> Solid:
        """As :meth:`Placed.shaped`."""
        from processing.scene import primitives

        return primitives.container(self.substance, size_m=self.size_m)


class CarPart(Placed):
    """A car, its nose at +x."""

    shape: Literal["car"] = "car"
    body: str
    """Substance of the sheet metal."""
    glass: str
    """Substance of the windows."""

    @property
    def made_of(self) -> tuple[str, ...]:
        """Substances that it names."""
        return self.body, self.glass

    def shaped(self, folder: Path) -> Solid:
        """As :meth:`Placed.shaped`."""
        from processing.scene import primitives

        return primitives.car(self.body, self.glass)


class TreePart(Placed):
    """A trunk and a crown: leaves for light, randomly turned thin dipoles for radar."""

    shape: Literal["tree"] = "tree"
    crown_m: PositiveFloat
    """Radius of the crown."""
    trunk_m: PositiveFloat
    """Height of the trunk up to the crown."""
    leaf: str
    """Substance of the leaves; its radar should be "passed"."""
    bark: str
    """Substance of the trunk."""
    backscatter: Annotated[float, Field(gt=0, le=10)] = 0.1
    """Co-polarized RCS of the crown over its cross-section."""
    dipoles: Count = 1500
    leaves: Count = 500
    leaf_m: PositiveFloat = 0.35
    """Edge of a tuft of leaves."""
    seed: Annotated[int, Field(ge=0)] = 0

    @property
    def made_of(self) -> tuple[str, ...]:
        """Substances that it names."""
        return self.leaf, self.bark

    def shaped(self, folder: Path) -> Solid:
        """As :meth:`Placed.shaped`."""
        from processing.scene import primitives

        return primitives.tree(
            self.crown_m,
            self.trunk_m,
            leaf=self.leaf,
            bark=self.bark,
            backscatter=self.backscatter,
            dipoles=self.dipoles,
            leaves=self.leaves,
            leaf_m=self.leaf_m,
            seed=self.seed,
        )


class PersonPart(OneSubstance):
    """A person, as an upright ellipsoid."""

    shape: Literal["person"] = "person"

    def shaped(self, folder: Path) -> Solid:
        """As :meth:`Placed.shaped`."""
        from processing.scene import primitives

        return primitives.person(self.substance)


SolidPart = Annotated[
    PlatePart
    | DihedralPart
    | TrihedralPart
    | SpherePart
    | MeshPart
    | GroundPart
    | BoxPart
    | BuildingPart
    | ContainerPart
    | CarPart
    | TreePart
    | PersonPart,
    Field(discriminator="shape"),
]
"""A body, by its ``shape``."""
