"""The scene file: what the simulated radar and camera look at, in the units that people write."""

from __future__ import annotations

import cmath
import contextlib
import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hw_mocks.sound_card.settings import AudioSettings
from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import FileMistake, FileModel, Geometry, Waveform, parse_model
from polfuse_lab.rig.toml_model import read_text
from processing.scene.model import Bush, FrontEnd, Point, Reflector, Scene, Surface, Vector

Matrix = tuple[tuple[float, float], tuple[float, float]]
ComplexMatrix = tuple[tuple[tuple[float, float], tuple[float, float]], tuple[tuple[float, float], tuple[float, float]]]
Fraction = Annotated[float, Field(ge=0, le=1)]


class PointEntry(FileModel):
    """A point scatterer; its scattering in exactly one of three ways."""

    name: str
    """A name for reports and checks."""
    position_m: Vector
    """Place in rig coordinates, m."""
    rcs_dbsm: float | None = None
    """RCS of an odd-bounce point (S_hh = S_vv, no cross-polarization), dBsm."""
    scattering: ComplexMatrix | None = None
    """S[rx][tx] = [re, im], sqrt(m^2), order H, V."""
    scattering_dbsm: Matrix | None = None
    """|S[rx][tx]|^2 in dBsm, order H, V; with scattering_deg."""
    scattering_deg: Matrix = ((0.0, 0.0), (0.0, 0.0))
    """Phases of S[rx][tx], degrees."""

    @model_validator(mode="after")
    def _one_way(self) -> PointEntry:
        if sum(way is not None for way in (self.rcs_dbsm, self.scattering, self.scattering_dbsm)) != 1:
            raise ValueError("exactly one of rcs_dbsm, scattering, scattering_dbsm")
        return self

    @property
    def matrix(self) -> NDArray[np.complex128]:
        """(2, 2) S[rx, tx], sqrt(m^2)."""
        if self.rcs_dbsm is not None:
            return np.eye(2, dtype=np.complex128) * 10 ** (self.rcs_dbsm / 20)
        if self.scattering is not None:
            return np.array([[complex(*entry) for entry in row] for row in self.scattering])
        return np.asarray(
            10 ** (np.array(self.scattering_dbsm) / 20) * np.exp(1j * np.radians(self.scattering_deg)),
            dtype=np.complex128,
        )


class ReflectorEntry(FileModel):
    """An analytic reflector."""

    name: str
    """A name for reports and checks."""
    kind: Literal["plate", "dihedral", "trihedral", "trihedral_triangular", "sphere"]
    """Square plate, dihedral of two square faces, trihedral of three square (or triangular) faces, or sphere."""
    position_m: Vector
    """Phase centre (face's centre, fold's centre, apex) in rig coordinates, m."""
    edge_m: float = Field(gt=0)
    """Edge of a face, m; of a triangular one from the corner to a tip, of a sphere its diameter."""
    azimuth_deg: float = Field(default=0.0, ge=-180, le=180)
    """Direction to the aperture's centre in the reflector's frame: from the boresight, for a trihedral from an edge."""
    elevation_deg: float = Field(default=0.0, ge=-90, le=90)
    """The same, elevation."""
    fold_deg: float = Field(default=0.0, ge=-180, le=180)
    """Dihedral only: angle of the fold from horizontal."""


class BushEntry(FileModel):
    """A cloud of thin dipoles."""

    name: str
    """A name for reports and checks."""
    position_m: Vector
    """Centre in rig coordinates, m."""
    radius_m: float = Field(gt=0)
    """Radius of the cloud, m."""
    scatterers: int = Field(default=60, ge=1, le=10_000)
    """Number of dipoles."""
    rcs_dbsm: float
    """Mean total co-polarized RCS, dBsm."""
    seed: int = Field(default=0, ge=0)
    """Seed of the dipoles' places and directions."""


class SurfaceEntry(FileModel):
    """A flat optical patch: a corner and two edges, and the polarization of what it reflects."""

    name: str
    """A name for reports and checks."""
    corner_m: Vector
    """One corner in rig coordinates, m."""
    edge_u_m: Vector
    """Edge from the corner, m."""
    edge_v_m: Vector
    """The other edge from the corner, m."""
    s0: float = Field(ge=0)
    """Reflectance: S0 for unit unpolarized sun at normal incidence."""
    dolp: Fraction = 0.0
    """Degree of linear polarization of the reflected light."""
    aop_deg: float = Field(default=0.0, ge=-180, le=180)
    """Angle of polarization from horizontal, degrees."""

    @property
    def stokes(self) -> tuple[float, float, float]:
        """(S0, S1, S2)."""
        polarized, angle = self.s0 * self.dolp, 2 * math.radians(self.aop_deg)
        return self.s0, polarized * math.cos(angle), polarized * math.sin(angle)


class SunEntry(FileModel):
    """Where the sun stands and how bright it is."""

    azimuth_deg: float = Field(default=180.0, ge=-360, le=360)
    """Sun over the ground, degrees from +y (away from the rail) towards +x; 180 is behind the radar."""
    elevation_deg: float = Field(default=60.0, gt=0, le=90)
    """Height above the horizon, degrees."""
    counts: float = Field(default=30_000.0, gt=0)
    """Camera counts without a polarizer for S0 = 1."""
    background_s0: float = Field(default=0.05, ge=0)
    """S0 of whatever no surface covers; unpolarized. Of scenes of surfaces: bodies have a sky."""
    sky_share: float = Field(default=0.2, ge=0, le=100)
    """Irradiance of the sky on level ground over the sun's; 0.2 is a clear day's. Of scenes of bodies."""


class PathEntry(FileModel):
    """Imperfection of the receive or the transmit path, relative to its own H channel."""

    imbalance_db: float = Field(default=0.0, ge=-40, le=40)
    """Gain of V over H, dB."""
    imbalance_deg: float = Field(default=0.0, ge=-360, le=360)
    """Phase of V against H, degrees."""
    crosstalk_db: float | None = Field(default=None, le=0)
    """Leakage from one polarization into the other, dB; none if left out."""
    crosstalk_deg: float = Field(default=0.0, ge=-360, le=360)
    """Phase of the leakage, degrees."""

    @property
    def matrix(self) -> NDArray[np.complex128]:
        """(2, 2) receive matrix [out, in]: leakage between the antennas, then the channels' gains."""
        leak = 0.0 if self.crosstalk_db is None else 10 ** (self.crosstalk_db / 20)
        leakage = cmath.rect(leak, math.radians(self.crosstalk_deg))
        gain = cmath.rect(10 ** (self.imbalance_db / 20), math.radians(self.imbalance_deg))
        return np.asarray(np.diag([1, gain]) @ np.array([[1, leakage], [leakage, 1]]), dtype=np.complex128)


class FrontEndEntry(FileModel):
    """The radar's electronics."""

    amplitude_at_1m: float = Field(default=1.0, gt=0)
    """Beat of 1 m^2 at 1 m on the antennas' axes, fraction of full scale."""
    coupling: float = Field(default=0.0, ge=0)
    """Beat of the direct path between the antennas, fraction of full scale."""
    coupling_range_m: float = Field(default=0.3, gt=0)
    """Apparent range of that path, m."""
    noise: float = Field(default=0.0, ge=0, le=1)
    """Noise of one sample of the beat, rms, fraction of full scale."""
    receive: PathEntry = PathEntry()
    """Receive path."""
    transmit: PathEntry = PathEntry()
    """Transmit path."""


class RailEntry(FileModel):
    """The simulated trolley."""

    length_m: float = Field(default=3.2, gt=0)
    """Usable length of the rail, m."""
    speed_m_s: float = Field(default=0.5, gt=0, le=5)
    """Speed of the trolley, m/s."""


class CameraEntry(FileModel):
    """The simulated camera; the thesis's sensor."""

    width_px: int = Field(default=782, ge=8, le=65_536)
    """Columns."""
    height_px: int = Field(default=582, ge=8, le=65_536)
    """Rows."""
    exposure_s: float = Field(default=0.002, gt=0, le=60)
    """Exposure, s."""
    focal_length_m: float = Field(default=0.008, gt=0)
    """Focal length, m."""
    pixel_pitch_m: float = Field(default=8.3e-6, gt=0)
    """Distance of neighbouring pixels, m."""
    position_m: Vector = (0.0, 0.0, 0.0)
    """Entrance pupil in rig coordinates, m."""
    depression_deg: float = Field(default=17.0, ge=-90, le=90)
    """Optical axis below horizontal, degrees."""
    black_level_counts: float = Field(default=0.0, ge=0)
    """Counts without light."""
    electrons_per_count: float = Field(default=1.0, gt=0)
    """Photo-electrons for one count."""
    read_noise_counts: float = Field(default=0.0, ge=0)
    """Read noise, counts rms."""
    saturation_counts: int = Field(default=65_535, gt=0, le=65_535)
    """Counts at which the sensor clips."""
    extinction_ratio: float = Field(default=800.0, gt=1)
    """Maximum over minimum transmittance of the polarizer, or of the mosaic's."""
    mosaic: str = "none"
    """Polarizers on the sensor's pixels, such as "90-45-135-0"; "none" for a camera behind the rig's polarizer."""


class RaysEntry(FileModel):
    """How finely bodies are followed."""

    cell_m: float = Field(default=0.1, ge=0.01, le=10)
    """Distance of the radar's rays 10 m ahead, before they are split at edges, m."""
    levels: int = Field(default=5, ge=0, le=8)
    """How often a cell between rays is split in four."""
    bounces: int = Field(default=3, ge=1, le=11)
    """Most bounces of the radar's rays."""
    points_per_m2: float = Field(default=10.0, gt=0, le=1e4)
    """Scatterers of rough ground."""
    step_m: float = Field(default=0.1, ge=0.01, le=10)
    """Way of the trolley after which the radar's rays are sent anew, m."""
    samples: int = Field(default=100, ge=1, le=100_000)
    """Rays of each of the camera's pixels."""


Tables = tuple[dict[str, Any], ...]


class SceneFile(FileModel):
    """A whole scene file."""

    name: str = "scene"
    """A name for reports."""
    seed: int = Field(default=0, ge=0)
    """Seed of all noise."""
    waveform: Waveform = Waveform(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.020, sweep_period_s=0.040)
    """The radar's ramp, nominal; the true sweep period is audio.sweep_period_samples."""
    geometry: Geometry = Geometry(antenna_height_m=1.069)
    """The radar's antennas."""
    audio: AudioSettings = AudioSettings()
    """The radar's audio port."""
    front_end: FrontEndEntry = FrontEndEntry()
    """The radar's electronics."""
    rail: RailEntry = RailEntry()
    """The trolley's rail."""
    camera: CameraEntry | None = None
    """The camera; left out for a radar-only rig."""
    sun: SunEntry = SunEntry()
    """The sun."""
    point: tuple[PointEntry, ...] = ()
    """Point scatterers."""
    reflector: tuple[ReflectorEntry, ...] = ()
    """Reflectors."""
    bush: tuple[BushEntry, ...] = ()
    """Bushes."""
    surface: tuple[SurfaceEntry, ...] = ()
    """Optical surfaces."""
    rays: RaysEntry = RaysEntry()
    """How finely bodies are followed."""
    substance: Tables = ()
    """What bodies are made of, as :mod:`polfuse_lab.simulation.scene_file` reads it."""
    solid: Tables = ()
    """Bodies, which both eyes see: instead of all points, reflectors, bushes and surfaces."""

    @model_validator(mode="after")
    def _one_kind(self) -> SceneFile:
        flat: list[str] = [name for name in ("point", "reflector", "bush", "surface") if getattr(self, name)]
        solid: list[str] = [name for name in ("solid", "substance", "rays") if name in self.model_fields_set]
        if "background_s0" in self.sun.model_fields_set:
            flat.append("sun.background_s0")
        if "sky_share" in self.sun.model_fields_set:
            solid.append("sun.sky_share")
        if flat and solid:
            raise ValueError(
                f"either bodies ({', '.join(solid)}) or targets of one eye each ({', '.join(flat)}), not both in a file"
            )
        if solid and not (self.solid and self.substance):
            raise ValueError(f"{', '.join(solid)} in a file with at least one [[substance]] and one [[solid]]")
        return self

    @model_validator(mode="after")
    def _sound(self) -> SceneFile:
        names = [entry.name for entries in (self.point, self.reflector, self.bush) for entry in entries]
        if len(set(names)) != len(names):
            raise ValueError(f"each target has a name of its own, found {names}")
        period_s = self.audio.sweep_period_samples / self.audio.sample_rate_hz
        if period_s <= self.waveform.ramp_up_s:
            raise ValueError(
                f"audio.sweep_period_samples ({period_s:g} s) is longer than waveform.ramp_up_s "
                f"({self.waveform.ramp_up_s:g} s)"
            )
        return self

    def scene(self) -> Scene:
        """The scene in the units of the numerics."""
        azimuth, elevation = math.radians(self.sun.azimuth_deg), math.radians(self.sun.elevation_deg)
        across = math.cos(elevation)
        return Scene(
            name=self.name,
            points=tuple(Point(p.name, p.position_m, p.matrix) for p in self.point),
            reflectors=tuple(
                Reflector(
                    r.name,
                    r.kind,
                    r.position_m,
                    r.edge_m,
                    math.radians(r.azimuth_deg),
                    math.radians(r.elevation_deg),
                    math.radians(r.fold_deg),
                )
                for r in self.reflector
            ),
            bushes=tuple(
                Bush(b.name, b.position_m, b.radius_m, b.scatterers, 10 ** (b.rcs_dbsm / 10), b.seed) for b in self.bush
            ),
            surfaces=tuple(Surface(s.name, s.corner_m, s.edge_u_m, s.edge_v_m, s.stokes) for s in self.surface),
            background_stokes=(self.sun.background_s0, 0.0, 0.0),
            sun_direction=(across * math.sin(azimuth), across * math.cos(azimuth), math.sin(elevation)),
            sun_counts=self.sun.counts,
            front_end=FrontEnd(
                receive=self.front_end.receive.matrix,
                # What leaks on transmit leaves the wrong antenna: the same network, crossed the other way.
                transmit=self.front_end.transmit.matrix.T,
                amplitude_at_1m=self.front_end.amplitude_at_1m,
                coupling=self.front_end.coupling,
                coupling_range_m=self.front_end.coupling_range_m,
                noise=self.front_end.noise,
            ),
            seed=self.seed,
        )


AIRBORNE = ("flight", "grid", "light", "radar")
"""Tables that only the scene files of ``polfuse simulate`` have."""


def load_scene_file(path: Path | str) -> SceneFile:
    """Read a scene file.

    Raises:
        PolfuseError: it cannot be read, is not TOML, or is a scene that is flown over.
        FileMistake: entries are wrong, each with line, field, found and allowed.
    """
    text = read_text(path)
    with contextlib.suppress(tomllib.TOMLDecodeError):
        if found := [name for name in AIRBORNE if name in tomllib.loads(text)]:
            raise PolfuseError(
                f"is a scene that is flown over (it has [{found[0]}]), not one before the rig's rail",
                where=str(path),
                advice=f"give it to 'polfuse simulate', or take {', '.join(f'[{name}]' for name in found)} out and"
                " describe the rig ([rail], [geometry])",
            )
    file = parse_model(text, SceneFile, path)
    for reflector in file.reflector:
        if reflector.fold_deg and reflector.kind != "dihedral":
            raise FileMistake(
                Path(path),
                [f"reflector {reflector.name!r}: found fold_deg on a {reflector.kind}, allowed: on a dihedral"],
            )
    return file


def load_scene(path: Path | str) -> Scene:
    """Read a scene file as a :class:`processing.scene.model.Scene`. Raises as :func:`load_scene_file`."""
    return load_scene_file(path).scene()
