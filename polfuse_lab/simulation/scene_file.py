"""The scene file of ``polfuse simulate``: flight, radar, camera, light, grid, substances and bodies, in TOML.

x along the track, y away from it, z up; the ground is z = 0 and the middle of the grid is the origin, which both eyes
look at from (0, -altitude tan(look), altitude).
"""

from __future__ import annotations

import contextlib
import math
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, PositiveFloat, field_validator, model_validator

from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import FileModel, parse_model
from polfuse_lab.rig.toml_model import read_text
from polfuse_lab.simulation.solid_parts import MeshPart, SolidPart, SubstancePart
from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S

if TYPE_CHECKING:
    from processing.raytrace.sources import Source
    from processing.sar.grid import ImageGrid
    from processing.scattering.shooting import Density
    from processing.scene.both_eyes import Airborne
    from processing.scene.solids import SolidScene

Seed = Annotated[int, Field(ge=0)]
Length = Annotated[float, Field(ge=1e-3, le=1e7)]
"""Of flights, grids and cells, m."""
MOST_PIXELS = 4_000_000
"""Of the ground grid and of the camera's picture."""
MOST_SAMPLES = 10_000_000
"""Pulses times frequencies."""


TABLES: dict[str, dict[str, dict[str, Any]]] = {
    "6.1": {
        "flight": {"track_m": 3000.0, "pulses": 1501, "speed_m_s": 200.0},
        "radar": {"centre_hz": SPEED_OF_LIGHT_M_S / 0.312, "bandwidth_hz": 150e6, "frequencies": 128},
    },
    "7.2": {},
    "8.1": {
        "flight": {"track_m": 240.0 * 4350 / 362.53, "pulses": 4351, "speed_m_s": 240.0},
        "radar": {"centre_hz": 1.2575e9, "bandwidth_hz": 80e6, "frequencies": 256, "beamwidth_deg": 4.5},
    },
}
"""Flight and radar of the thesis's tables where they are not those of Table 7.2; all fly at 15 km and look down by 45
degrees.

Printed are, of Table 6.1, a wavelength of 31.2 cm, 200 m/s and a pulse every 10 ms; track and bandwidth, of which it
tells nothing, make cells of a metre here. Of Table 8.1, 80 MHz, 240 m/s, 362.53 pulses a second and 4.5 degrees; the
wavelength is that of UAVSAR, whose parameters it says they are, and 12 s are as long as a point is seen, and half as
much again.
"""


class FlightPart(FileModel):
    """Where both eyes fly (thesis Table 7.1): straight along x; the camera looks from the middle of the track."""

    altitude_m: Length = 15_000.0
    look_deg: Annotated[float, Field(ge=5, le=85)] = 45.0
    """From straight down to the line of sight, across the track."""
    track_m: Length = 300.0
    """Length of the track that a picture is made from."""
    pulses: Annotated[int, Field(ge=2, le=100_000)] = 600
    speed_m_s: Annotated[float, Field(gt=0, le=1e5)] = 200.0
    """Along x: time 0 is the middle of the track."""
    table: Literal["6.1", "7.2", "8.1"] = "7.2"
    """Table of the thesis whose flight and radar hold where none is given (:data:`TABLES`)."""


class RadarPart(FileModel):
    """The radar (thesis Table 7.2), and how finely it is simulated."""

    centre_hz: Annotated[float, Field(ge=1e8, le=1e11)] = 15e9
    bandwidth_hz: PositiveFloat = 0.75e9
    frequencies: Annotated[int, Field(ge=2, le=100_000)] = 512
    """Even; c times them over twice the bandwidth is the unambiguous range."""
    noise_equivalent_db: Annotated[float, Field(ge=-200, le=100)] = -30.0
    """Noise, as the backscatter coefficient that it looks like."""
    beamwidth_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    """Half-power width of one antenna's beam, broadside, along the track; without it all is lit evenly."""
    move_m: Length = 1.0
    """Rays are sent anew when a body has moved by this."""
    bounces: Annotated[int, Field(ge=1, le=11)] = 3
    cell_m: Length = 0.15
    """Edge of the cells between rays, before they are split at edges."""
    levels: Annotated[int, Field(ge=0, le=12)] = 2
    """How often a cell is split in four."""
    points_per_m2: Annotated[float, Field(gt=0, le=1e6)] = 20.0
    """Scatterers of rough ground."""
    seed: Seed = 0

    @field_validator("frequencies")
    @classmethod
    def _even(cls, count: int) -> int:
        if count % 2:
            raise ValueError("an even number")
        return count

    @model_validator(mode="after")
    def _band(self) -> RadarPart:
        if self.bandwidth_hz >= 2 * self.centre_hz:
            raise ValueError("bandwidth_hz must be less than twice centre_hz")
        return self

    @property
    def density(self) -> Density:
        """Of rays."""
        from processing.scattering.shooting import Density

        return Density(self.cell_m, self.levels, self.bounces)


class CameraPart(FileModel):
    """The polarization camera (thesis Table 7.2), and how finely its picture is traced."""

    focal_length_m: Annotated[float, Field(ge=1e-4, le=1e3)] = 1.110
    pixel_pitch_m: Annotated[float, Field(ge=1e-8, le=1)] = 30e-6
    electrons: Annotated[float, Field(gt=0, le=1e12)] = 10_500.0
    """Of a pixel at full scale behind each polarizer, for shot noise."""
    frames: Annotated[int, Field(ge=1, le=1_000_000)] = 30
    """Pictures that are averaged."""
    samples: Annotated[int, Field(ge=1, le=1_000_000)] = 1000
    """Rays for each pixel."""
    exposure_interval_s: Annotated[float, Field(ge=0, le=1e4)] = 0.0
    """Between the polarizer's four angles, the first at time 0; 0: all at once."""
    seed: Seed = 0


class LightPart(FileModel):
    """Sun and sky."""

    sun_azimuth_deg: float = 0.0
    """From the eyes' own: 0 has the sun behind the camera, 90 at +x."""
    sun_zenith_deg: Annotated[float, Field(ge=0, lt=90)] = 45.0
    sky_share: Annotated[float, Field(ge=0, le=100)] = 0.2
    """Irradiance of the sky on level ground over the sun's; 0.2 is a clear day's."""

    def sources(self) -> tuple[Source, ...]:
        """As the ray tracer has them."""
        from processing.scene.both_eyes import sunlight

        return sunlight(math.radians(self.sun_azimuth_deg), math.radians(self.sun_zenith_deg), self.sky_share)


class GridPart(FileModel):
    """The ground grid around the origin, on which both pictures are told."""

    width_m: Length
    """Along the track."""
    depth_m: Length
    """Away from it."""
    step_x_m: Length = 0.2
    step_y_m: Length = 0.28

    @model_validator(mode="after")
    def _size(self) -> GridPart:
        pixels = (self.width_m / self.step_x_m + 1) * (self.depth_m / self.step_y_m + 1)
        if pixels > MOST_PIXELS:
            raise ValueError(f"{MOST_PIXELS} pixels at most; these are {pixels:.3g}")
        if self.step_x_m > self.width_m or self.step_y_m > self.depth_m:
            raise ValueError("steps that are smaller than the grid")
        return self

    def grid(self) -> ImageGrid:
        """Its pixels; the width and depth are kept to the nearest step."""
        import numpy as np

        from processing.sar.grid import ImageGrid

        sizes = (self.width_m, self.step_x_m), (self.depth_m, self.step_y_m)
        counts = [round(size / step) for size, step in sizes]
        x, y = (
            np.asarray((np.arange(count + 1) - count / 2) * step, dtype=np.float64)
            for count, (_, step) in zip(counts, sizes, strict=True)
        )
        return ImageGrid(x, y, 0.0)


class BodyTables(FileModel):
    """What every scene file of bodies holds."""

    substance: Annotated[tuple[SubstancePart, ...], Field(min_length=1)]
    solid: Annotated[tuple[SolidPart, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _known(self) -> Self:
        names = [part.name for part in self.substance]
        if len(set(names)) != len(names):
            raise ValueError("two substances have the same name")
        for number, solid in enumerate(self.solid, start=1):
            for name in solid.made_of:
                if name not in names:
                    raise ValueError(f"solid {number} ({solid.shape}) is of '{name}', there are {', '.join(names)}")
        return self

    def bodies(self, name: str, path: Path, centre_hz: float) -> SolidScene:
        """The bodies; mesh files are looked for beside ``path``, the scene file.

        Raises:
            PolfuseError: a mesh file that cannot be used, or a substance or body that cannot be, with its number.
        """
        from processing.scene.solids import Solid, SolidScene, Substance

        substances: list[Substance] = []
        for number, part in enumerate(self.substance, start=1):
            try:
                substances.append(part.substance(centre_hz))
            except DataError as error:
                raise PolfuseError(
                    error.what, where=f"{path}, substance {number} ({part.name})", advice=error.advice
                ) from error
        solids: list[Solid] = []
        for number, body in enumerate(self.solid, start=1):
            try:
                solids.append(body.solid(number, path.parent))
            except DataError as error:
                raise PolfuseError(
                    error.what, where=f"{path}, solid {number} ({body.shape})", advice=error.advice
                ) from error
        return SolidScene(name, tuple(substances), tuple(solids))

    def files(self, folder: Path) -> list[Path]:
        """Mesh files that the bodies name, each once."""
        return list(dict.fromkeys(folder / body.file for body in self.solid if isinstance(body, MeshPart)))


class SolidSceneFile(BodyTables):
    """A scene of bodies for both eyes of an aircraft."""

    title: str = ""
    flight: FlightPart = FlightPart()
    radar: RadarPart = RadarPart()
    camera: CameraPart = CameraPart()
    light: LightPart = LightPart()
    grid: GridPart

    @model_validator(mode="before")
    @classmethod
    def _of_table(cls, given: Any) -> Any:
        """What is not given is that of the table."""
        flight = given.get("flight") if isinstance(given, dict) else None
        table = flight.get("table") if isinstance(flight, dict) else None
        if not isinstance(table, str) or table not in TABLES:
            return given
        parts = {name: given.get(name, {}) for name in TABLES[table]}
        # What is no table is refused where it stands.
        merged = {name: {**TABLES[table][name], **part} for name, part in parts.items() if isinstance(part, dict)}
        return {**given, **merged}

    @model_validator(mode="after")
    def _sizes(self) -> SolidSceneFile:
        if self.flight.pulses * self.radar.frequencies > MOST_SAMPLES:
            raise ValueError(f"pulses times frequencies of {MOST_SAMPLES} at most")
        across = self.slant_m * self.camera.pixel_pitch_m / self.camera.focal_length_m
        seen = self.grid.width_m * self.grid.depth_m * math.cos(math.radians(self.flight.look_deg))
        if seen / across**2 > MOST_PIXELS:
            raise ValueError(
                f"{MOST_PIXELS} pixels of the camera at most; of {across:.3g} m on the scene they are "
                f"{seen / across**2:.3g}: make pixel_pitch_m larger, or focal_length_m or the grid smaller"
            )
        return self

    @property
    def slant_m(self) -> float:
        """From the eyes to the origin."""
        return self.flight.altitude_m / math.cos(math.radians(self.flight.look_deg))

    def airborne(self) -> Airborne:
        """Flight, radar and camera as the simulation has them."""
        from processing.scene.both_eyes import Airborne

        return Airborne(
            altitude_m=self.flight.altitude_m,
            look_rad=math.radians(self.flight.look_deg),
            centre_hz=self.radar.centre_hz,
            bandwidth_hz=self.radar.bandwidth_hz,
            pulses=self.flight.pulses,
            track_m=self.flight.track_m,
            frequencies=self.radar.frequencies,
            focal_length_m=self.camera.focal_length_m,
            pixel_pitch_m=self.camera.pixel_pitch_m,
            noise_equivalent_db=self.radar.noise_equivalent_db,
            electrons=self.camera.electrons,
            frames=self.camera.frames,
            speed_m_s=self.flight.speed_m_s,
            beamwidth_rad=None if self.radar.beamwidth_deg is None else math.radians(self.radar.beamwidth_deg),
            exposure_interval_s=self.camera.exposure_interval_s,
        )

    def scene(self, path: Path) -> SolidScene:
        """The bodies; mesh files are looked for beside ``path``, the scene file.

        Raises:
            PolfuseError: a mesh file that cannot be used, or a substance or body that cannot be, with its number.
        """
        return self.bodies(self.title or path.stem, path, self.radar.centre_hz)


RIG = ("rail", "geometry", "waveform", "audio", "front_end", "sun", "rays", "point", "reflector", "bush", "surface")
"""Tables that only the scene files of the simulated rig have."""


def read_solid_scene(path: Path | str) -> SolidSceneFile:
    """Read a scene file.

    Raises:
        PolfuseError: a file that cannot be read, is not TOML, or is a scene of the rig.
        FileMistake: entries are wrong, each with line, field, found and allowed.
    """
    text = read_text(path)
    with contextlib.suppress(tomllib.TOMLDecodeError):
        if found := [name for name in RIG if name in tomllib.loads(text)]:
            raise PolfuseError(
                f"is a scene before the rig's rail (it has [{found[0]}]), not one that is flown over",
                where=str(path),
                advice="give it to 'polfuse sim', or describe the flight ([flight], [radar], [light], [grid]) instead",
            )
    return parse_model(text, SolidSceneFile, path)
