"""The rig file: which devices there are, the waveform, where everything stands, and the camera."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, TypeAdapter, ValidationError, field_validator, model_validator

from drivers.camera.pixel_formats import pixel_format
from polfuse_lab.rig.toml_model import FileMistake, FileModel, line_of, read_model
from processing.errors import DataError
from processing.optics.mosaic import parse_mosaic

SPEED_OF_LIGHT_M_S = 299_792_458.0


class Waveform(FileModel):
    """The linear FM ramp."""

    centre_hz: float = Field(gt=0)
    """Centre frequency of the ramp, Hz."""
    bandwidth_hz: float = Field(gt=0)
    """Frequency swept in one up-ramp, Hz."""
    ramp_up_s: float = Field(gt=0)
    """Nominal length of the up-ramp, s; the true one is measured from the sync."""
    sweep_period_s: float = Field(gt=0)
    """Nominal time from one up-ramp's start to the next, s; the true one is measured from the sync."""

    @model_validator(mode="after")
    def _ordered(self) -> Waveform:
        if self.sweep_period_s < self.ramp_up_s:
            raise ValueError(f"sweep_period_s ({self.sweep_period_s}) is at least ramp_up_s ({self.ramp_up_s})")
        if self.bandwidth_hz >= 2 * self.centre_hz:
            raise ValueError("bandwidth_hz is below twice centre_hz")
        return self

    @property
    def wavelength_m(self) -> float:
        """Wavelength at the centre frequency, m (thesis 5.1)."""
        return SPEED_OF_LIGHT_M_S / self.centre_hz

    @property
    def range_resolution_m(self) -> float:
        """c / 2B, m (thesis 2.34)."""
        return SPEED_OF_LIGHT_M_S / (2 * self.bandwidth_hz)


class DeviceSection(FileModel):
    """A device: the name of its driver and the driver's own options."""

    driver: str
    """Name of an installed driver; 'polfuse doctor' lists them."""
    options: dict[str, Any] = Field(default_factory=dict)
    """The driver's own settings; each driver documents its own."""


class RadarSection(DeviceSection):
    """The radar's beat and sync on a stereo audio port."""

    sample_rate_hz: float = Field(default=48_000.0, ge=8_000, le=384_000)
    """Sample rate of the audio port, Hz; a device that would resample is refused."""


class SwitchesSection(DeviceSection):
    """The two RF transfer switches."""

    settle_s: float = Field(default=0.07, ge=0, le=0.5)
    """Time after a switch has been told to change until its contacts are quiet, s."""


class TrolleySection(DeviceSection):
    """The trolley on its rail."""

    length_m: float = Field(gt=0)
    """Usable length of the rail, m; x runs from -length_m/2 to +length_m/2."""
    speed_m_s: float = Field(default=0.1, gt=0)
    """Speed between positions, m/s (used for the dry run; the driver has its own feed)."""


class PolarizerSection(DeviceSection):
    """The linear polarizer in front of the camera."""

    extinction_ratio: float = Field(default=800.0, gt=1)
    """Maximum over minimum transmittance of the polarizer (thesis: 800:1)."""


class CameraSection(DeviceSection):
    """The camera and its optics. Its place and direction are in the rig's coordinates."""

    width_px: int = Field(gt=0, le=65_536)
    """Columns of a frame."""
    height_px: int = Field(gt=0, le=65_536)
    """Rows of a frame."""
    pixel_format: str = "Mono16"
    """GenICam pixel format."""
    exposure_s: float = Field(gt=0, le=60)
    """Exposure, s."""
    gain_db: float = Field(default=0.0, ge=0)
    """Gain, dB."""
    focal_length_m: float = Field(gt=0)
    """Focal length of the lens, m."""
    pixel_pitch_m: float = Field(gt=0)
    """Distance of neighbouring pixels on the sensor, m."""
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Entrance pupil in rig coordinates (x along the rail, y away, z up), m; origin at the aperture's centre."""
    depression_deg: float = Field(default=17.0, ge=-90, le=90)
    """Angle of the optical axis below horizontal, degrees."""
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Lens distortion k1, k2, p1, p2 (Brown and Conrady), found with a chessboard; see docs/registration.md."""
    principal_offset_px: tuple[float, float] = (0.0, 0.0)
    """Where the optical axis meets the sensor, from its middle to the right and down, pixels."""
    saturation_counts: int = Field(default=65_535, gt=0)
    """Counts at and above which a pixel is saturated."""
    black_level_counts: float = Field(default=0.0, ge=0)
    """Counts without light."""
    electrons_per_count: float = Field(default=1.0, gt=0)
    """Photo-electrons for one count (for shot noise)."""
    read_noise_counts: float = Field(default=0.0, ge=0)
    """Read noise, counts rms."""
    mosaic: str = "none"
    """Polarizers on the pixels, such as "90-45-135-0" (first 2 x 2 pixels row by row, degrees); "none" for a camera
    behind a rotating polarizer."""
    mosaic_extinction_ratio: float = Field(default=300.0, gt=1)
    """Maximum over minimum transmittance of the mosaic's polarizers."""

    @model_validator(mode="before")
    @classmethod
    def _full_scale(cls, values: Any) -> Any:
        # Where nothing is said, a pixel is saturated at its format's largest count.
        if isinstance(values, dict) and "saturation_counts" not in values:
            try:
                return {**values, "saturation_counts": pixel_format(values.get("pixel_format", "Mono16")).full_scale}
            except (ValueError, TypeError):
                return values
        return values

    @field_validator("pixel_format")
    @classmethod
    def _known_format(cls, name: str) -> str:
        return pixel_format(name).name

    @field_validator("mosaic")
    @classmethod
    def _known_mosaic(cls, name: str) -> str:
        if name == "none":
            return name
        try:
            return parse_mosaic(name).name
        except DataError as error:
            raise ValueError("'none', or the angles 0, 45, 90, 135 in any order, such as '90-45-135-0'") from error

    @model_validator(mode="after")
    def _sound(self) -> CameraSection:
        full = pixel_format(self.pixel_format).full_scale
        if self.saturation_counts > full:
            raise ValueError(f"saturation_counts ({self.saturation_counts}) is at most {full} in {self.pixel_format}")
        if self.mosaic != "none" and (self.width_px % 2 or self.height_px % 2):
            raise ValueError(f"width_px and height_px are even with a mosaic, found {self.width_px} x {self.height_px}")
        return self

    @property
    def has_mosaic(self) -> bool:
        """Whether the sensor sees all angles at once (division of focal plane)."""
        return self.mosaic != "none"

    @property
    def counts_dtype(self) -> str:
        """``"uint8"`` or ``"uint16"``: type of its frames."""
        return pixel_format(self.pixel_format).dtype.__name__


Offset = tuple[float, float, float]
"""x, y and z, m."""


class PhaseCentres(FileModel):
    """Phase centres of the four antennas, from the point whose place along the rail is recorded: x along the rail, y
    away from it, z up."""

    transmit_h_m: Offset = (0.0, 0.0, 0.0)
    """Of the horizontally polarized transmitting antenna, m."""
    transmit_v_m: Offset = (0.0, 0.0, 0.0)
    """Of the vertically polarized transmitting antenna, m."""
    receive_h_m: Offset = (0.0, 0.0, 0.0)
    """Of the horizontally polarized receiving antenna, m."""
    receive_v_m: Offset = (0.0, 0.0, 0.0)
    """Of the vertically polarized receiving antenna, m."""


class Geometry(FileModel):
    """Where the antennas are and how they look. Origin: the antennas' phase centre at the aperture's centre."""

    antenna_height_m: float = Field(gt=0)
    """Height of the antennas above the ground plane, m; the ground is z = -antenna_height_m."""
    antenna_elevation_deg: float = Field(default=17.0, ge=-90, le=90)
    """Angle of the antennas' axes below horizontal, degrees (thesis: 17)."""
    beamwidth_deg: float = Field(default=70.0, gt=0, le=180)
    """Half-power beamwidth of one antenna, degrees (thesis: 70)."""
    range_offset_m: float = 0.0
    """Range that cables and electronics add, m; subtracted from measured ranges."""
    phase_centres: PhaseCentres | None = None
    """Where each antenna sits on the trolley; left out where all of them are taken to be at the recorded place."""


class Site(FileModel):
    """Where on the earth the rig stands, for exports to maps and to formats with geographic coordinates."""

    latitude_deg: float = Field(ge=-90, le=90)
    """WGS 84 latitude of the rig's origin (antennas with the trolley at the middle of the rail), degrees north."""
    longitude_deg: float = Field(ge=-180, le=180)
    """WGS 84 longitude of the rig's origin, degrees east."""
    height_m: float = Field(default=0.0, ge=-1000, le=100_000)
    """Height of the rig's origin above the WGS 84 ellipsoid (as satellite navigation tells it), m."""
    heading_deg: float = Field(ge=-360, le=360)
    """Direction away from the rail (y), clockwise from true north, degrees: 90 looks east."""


class StorageSection(FileModel):
    """How sessions are stored."""

    filter: Literal["auto", "none", "bitshuffle-lz4", "bitshuffle-zstd"] = "bitshuffle-lz4"
    """What audio and images are made smaller with, without loss; "auto" measures on this machine and takes the cheapest
    that keeps the plan's pace and finds room ('polfuse plan --explain' tells which)."""


class Rig(FileModel):
    """A whole rig."""

    name: str = "rig"
    """A name for reports."""
    waveform: Waveform
    """The radar's ramp."""
    geometry: Geometry
    """Antenna geometry."""
    radar: RadarSection
    """Radar audio port."""
    switches: SwitchesSection
    """RF transfer switches."""
    trolley: TrolleySection
    """Trolley and rail."""
    camera: CameraSection | None = None
    """Camera; left out for radar-only rigs."""
    polarizer: PolarizerSection | None = None
    """Polarizer; left out for radar-only rigs and for a camera with a mosaic of polarizers."""
    source_polarizer: PolarizerSection | None = None
    """Polarizer in front of the light source, for the active mode (thesis 6.3); left out where there is none."""

    storage: StorageSection = StorageSection()
    """How sessions are stored."""
    site: Site | None = None
    """Where on the earth the rig stands; left out where nobody needs to know."""

    @model_validator(mode="after")
    def _optics_together(self) -> Rig:
        if self.camera is not None and self.camera.has_mosaic:
            if self.polarizer is not None:
                raise ValueError("[polarizer] is left out for a camera with a mosaic of polarizers")
        elif (self.camera is None) != (self.polarizer is None):
            raise ValueError("[camera] and [polarizer] both or neither (a camera with a mosaic needs no polarizer)")
        return self

    @property
    def has_mosaic(self) -> bool:
        """Whether the camera sees all polarizer angles at once, without a polarizer to turn."""
        return self.camera is not None and self.camera.has_mosaic

    def section(self, kind: str) -> DeviceSection | None:
        """The section of a kind of device (``"radar"``, ``"switches"``, …)."""
        section: DeviceSection | None = getattr(self, kind)
        return section


def load_rig(path: Path | str) -> Rig:
    """Read a rig file. Raises :class:`PolfuseError` with file, line, field, found and allowed.

    Options are checked against the driver's own ``Options`` where that driver is installed.
    """
    path = Path(path)
    rig = read_model(path, Rig)
    check_options(rig, path)
    return rig


def check_options(rig: Rig, path: Path) -> None:
    """Check every device's options against its driver's ``Options`` dataclass.

    Raises:
        FileMistake: an unknown driver, or an option that its driver does not take.
    """
    for kind in ("radar", "switches", "trolley", "camera", "polarizer", "source_polarizer"):
        if rig.section(kind) is not None:
            driver_options(rig, kind, path)


def driver_options(rig: Rig, kind: str, path: Path | str = "rig") -> Any:
    """The validated ``Options`` object of one device's driver.

    What the device's section says already (``length_m``, ``exposure_s``, …) is handed to a driver that has an option of
    that name, so that it is written once.

    Raises:
        FileMistake: an unknown driver, an option that it does not take, or one that contradicts the section.
    """
    from drivers import registry

    path = Path(path)
    section = rig.section(kind)
    assert section is not None
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    try:
        options = registry.driver_class(registry.driver_kind(kind), section.driver).Options
    except KeyError:
        line = line_of(text, (kind, "driver"))
        place = f"line {line}, " if line else ""
        names = ", ".join(registry.available(registry.driver_kind(kind)))
        raise FileMistake(path, [f"{place}{kind}.driver: found {section.driver!r}, allowed: {names}"]) from None
    shared = {
        field.name: getattr(section, field.name)
        for field in dataclasses.fields(options)
        if field.name in type(section).model_fields
    }
    if contradictions := [name for name in shared if not _same(section.options.get(name, shared[name]), shared[name])]:
        mistakes = []
        for name in contradictions:
            line = line_of(text, (kind, "options", name))
            place = f"line {line}, " if line else ""
            found, allowed = section.options[name], shared[name]
            mistakes.append(
                f"{place}{kind}.options.{name}: found {found!r}, allowed: {allowed!r} as {kind}.{name} says"
            )
        raise FileMistake(path, mistakes)
    try:
        return TypeAdapter(options).validate_python({**shared, **section.options})
    except ValidationError as error:
        mistakes = []
        fields = ", ".join(field.name for field in dataclasses.fields(options))
        for item in error.errors():
            location = (kind, "options", *item["loc"])
            line = line_of(text, location)
            place = f"line {line}, " if line else ""
            known = item["type"] not in ("unexpected_keyword_argument", "extra_forbidden")
            allowed = item["msg"].removeprefix("Input should be ") if known else fields
            found = "nothing" if item["type"] in ("missing", "missing_argument") else repr(item["input"])
            mistakes.append(f"{place}{'.'.join(map(str, location))}: found {found}, allowed: {allowed}")
        raise FileMistake(path, mistakes) from None


def _same(option: Any, field: Any) -> bool:
    # TOML has lists only, models have tuples.
    return bool(tuple(option) == field if isinstance(option, list) and isinstance(field, tuple) else option == field)
