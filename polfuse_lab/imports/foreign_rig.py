"""The rig of a foreign recording: the user's rig file, or one made of what was told, measured and assumed.

Focusing needs to know how high the antennas stand and where they look, optics what the polarizer does: so a session of
foreign recordings carries a rig file as every other session does, whose devices are called ``imported``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import Rig, Waveform, load_rig
from polfuse_lab.rig.toml_model import model_to_toml

DEFAULT_BANDWIDTH_HZ = 80e6
"""Bandwidth assumed where none is given (thesis Table 5.1)."""
DEFAULT_CENTRE_HZ = 2.4e9
"""Centre frequency assumed where none is given (thesis Table 5.1)."""
DEFAULT_HEIGHT_M = 1.069
"""Height of the antennas assumed where none is given, that of the example rig file."""
DEFAULT_EXPOSURE_S = 0.002
"""Exposure stored where none is told; nothing is computed from it."""
DEFAULT_FOCAL_LENGTH_M = 0.008
"""Focal length assumed where no rig file tells it."""
DEFAULT_PIXEL_PITCH_M = 8.3e-6
"""Distance of pixels assumed where no rig file tells it."""
POSITION_SD_M = 0.002
"""How well a person meets a mark on the rail, m."""
ANGLE_SD_DEG = 1.0
"""How well a person meets a mark on the polarizer's ring, degrees."""
_DRIVER = "imported"
_DIFFERENT = 0.1  # of a rig file's ramp or period, by which the measured one shows another radar


@dataclass(frozen=True)
class RadarFacts:
    """What is known of the radar; None where it was not told."""

    bandwidth_hz: float | None = None
    centre_hz: float | None = None
    antenna_height_m: float | None = None
    ramp_up_s: float | None = None
    """Measured length of the up-ramp, s."""
    sweep_period_s: float | None = None
    """Measured sweep period, s."""
    sample_rate_hz: float = 48_000.0
    rail_length_m: float = 3.2
    recorded: bool = True
    """Whether there is a radar recording at all; where not, nothing needs to be said of assumptions."""


@dataclass(frozen=True)
class CameraFacts:
    """What frames tell of their camera."""

    width_px: int
    height_px: int
    pixel_format: str
    saturation_counts: int
    exposure_s: float | None = None


@dataclass(frozen=True)
class ForeignRig:
    """A rig for the session."""

    text: str
    """The rig file."""
    rig: Rig
    waveform: Waveform
    """Frequency and bandwidth of the rig, ramp and period as measured."""
    notes: tuple[str, ...]
    """What was assumed."""


def foreign_rig(path: Path | None, radar: RadarFacts, camera: CameraFacts | None) -> ForeignRig:
    """The rig of a session of foreign recordings.

    Args:
        path: the user's rig file; one is made where there is none.
        radar: what was told and measured of the radar.
        camera: what frames tell; None without frames.

    Raises:
        PolfuseError: a wrong rig file, one that contradicts what was told or measured, or impossible values.
    """
    if path is None:
        return _made(radar, camera)
    rig = load_rig(path)
    _check_told(path, rig, radar)
    if camera is not None:
        _check_camera(path, rig, camera)
    waveform = rig.waveform
    if radar.ramp_up_s is not None and radar.sweep_period_s is not None:
        waveform = waveform.model_copy(update={"ramp_up_s": radar.ramp_up_s, "sweep_period_s": radar.sweep_period_s})
    return ForeignRig(path.read_text(encoding="utf-8"), rig, waveform, ())


def radar_assumptions(bandwidth_told: bool, centre_told: bool) -> tuple[str, ...]:
    """What the user should know where a recording does not tell its radar's frequencies."""
    notes = []
    if not bandwidth_told:
        notes.append(
            f"bandwidth {DEFAULT_BANDWIDTH_HZ / 1e6:.0f} MHz is an assumption: "
            "ranges and speeds scale with 1 / bandwidth"
        )
    if not centre_told:
        notes.append(f"centre frequency {DEFAULT_CENTRE_HZ / 1e9:.1f} GHz is an assumption: Doppler scales with it")
    return tuple(notes)


def _made(radar: RadarFacts, camera: CameraFacts | None) -> ForeignRig:
    ramp, period = radar.ramp_up_s or 0.020, radar.sweep_period_s or 0.040
    content: dict[str, Any] = {
        "name": "imported recordings",
        "waveform": {
            "centre_hz": DEFAULT_CENTRE_HZ if radar.centre_hz is None else radar.centre_hz,
            "bandwidth_hz": DEFAULT_BANDWIDTH_HZ if radar.bandwidth_hz is None else radar.bandwidth_hz,
            "ramp_up_s": ramp,
            "sweep_period_s": max(period, ramp),
        },
        "geometry": {
            "antenna_height_m": DEFAULT_HEIGHT_M if radar.antenna_height_m is None else radar.antenna_height_m
        },
        "radar": {"driver": _DRIVER, "sample_rate_hz": radar.sample_rate_hz},
        "switches": {"driver": _DRIVER},
        "trolley": {"driver": _DRIVER, "length_m": radar.rail_length_m},
    }
    notes: list[str] = []
    if radar.recorded:
        notes += radar_assumptions(radar.bandwidth_hz is not None, radar.centre_hz is not None)
        if radar.antenna_height_m is None:
            notes.append(f"antennas {DEFAULT_HEIGHT_M} m above the ground are an assumption: it places the ground")
    if camera is not None:
        content["camera"] = {
            "driver": _DRIVER,
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "pixel_format": camera.pixel_format,
            "saturation_counts": camera.saturation_counts,
            "exposure_s": DEFAULT_EXPOSURE_S if camera.exposure_s is None else camera.exposure_s,
            "focal_length_m": DEFAULT_FOCAL_LENGTH_M,
            "pixel_pitch_m": DEFAULT_PIXEL_PITCH_M,
        }
        content["polarizer"] = {"driver": _DRIVER}
        notes.append(
            "lens, pixels, direction and noise of the camera and the polarizer's extinction ratio are those of the "
            "example rig file: give yours with --rig"
        )
    try:
        rig = Rig.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        raise PolfuseError(
            f"{'.'.join(map(str, first['loc']))} = {first['input']!r} is impossible ({first['msg']})", where="import",
            advice="correct the option or the recording that says so",
        ) from error  # fmt: skip
    header = "# Made while importing foreign recordings: what was told or measured, the rest as in the example.\n"
    return ForeignRig(header + model_to_toml(rig), rig, rig.waveform, tuple(notes))


def _check_told(path: Path, rig: Rig, radar: RadarFacts) -> None:
    for option, told, found in (
        ("--bandwidth-hz", radar.bandwidth_hz, rig.waveform.bandwidth_hz),
        ("--centre-hz", radar.centre_hz, rig.waveform.centre_hz),
        ("--antenna-height-m", radar.antenna_height_m, rig.geometry.antenna_height_m),
    ):
        if told is not None and not math.isclose(told, found, rel_tol=1e-9):
            raise PolfuseError(
                f"says {found:g} where {option} says {told:g}", where=str(path), advice="say it once, in the rig file"
            )
    for name, measured, nominal in (
        ("ramp_up_s", radar.ramp_up_s, rig.waveform.ramp_up_s),
        ("sweep_period_s", radar.sweep_period_s, rig.waveform.sweep_period_s),
    ):
        if measured is not None and abs(measured / nominal - 1) > _DIFFERENT:
            raise PolfuseError(
                f"waveform.{name} is {nominal:g} s, the recording's is {measured:.5f} s", where=str(path),
                advice="use the rig file of the radar that was recorded (or tell the up-ramp with --up-ramp)",
            )  # fmt: skip


def _check_camera(path: Path, rig: Rig, camera: CameraFacts) -> None:
    if rig.camera is None:
        raise PolfuseError(
            "has no [camera]", where=str(path), advice="add [camera] and [polarizer], or import without --rig"
        )
    size, found = (rig.camera.width_px, rig.camera.height_px), (camera.width_px, camera.height_px)
    if size != found:
        raise PolfuseError(
            f"its camera has {size[0]} x {size[1]} pixels, the frames {found[0]} x {found[1]}", where=str(path),
            advice="correct width_px and height_px, or give the frames of this camera",
        )  # fmt: skip
    depth = "uint8" if camera.pixel_format == "Mono8" else "uint16"
    if rig.camera.counts_dtype != depth:
        raise PolfuseError(
            f"its camera delivers {rig.camera.pixel_format}, the frames hold {depth}", where=str(path),
            advice="correct pixel_format, or give the frames as the camera took them",
        )  # fmt: skip
