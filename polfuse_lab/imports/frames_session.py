"""Loose frames of a polarizer series into a session of their own: the format ``frames``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from polfuse_lab.imports.foreign_rig import ANGLE_SD_DEG, RadarFacts, foreign_rig
from polfuse_lab.imports.formats import Imported
from polfuse_lab.imports.frames import FrameOptions, FrameSet, find_frames, provenance, write_frames
from polfuse_lab.imports.options import number_list
from polfuse_lab.rig import load_rig
from polfuse_lab.session import SessionConfig, SessionWriter


@dataclass(frozen=True)
class FramesImport:
    """What was imported."""

    session: Path
    frames: int
    """All frames, dark ones too."""
    dark_frames: int
    angles_deg: tuple[float, ...]
    """Different angles, ascending; empty for a camera that sees all of them at once."""
    pixel_format: str
    notes: tuple[str, ...]


def import_frames(
    files: Sequence[Path | str],
    session: Path | str,
    *,
    dark: Sequence[Path | str] = (),
    options: FrameOptions | None = None,
    rig: Path | None = None,
) -> FramesImport:
    """Write loose frames into a new session without radar records, with which ``polfuse optics`` works.

    Args:
        files: TIFF or PNG files, folders of them, or patterns; each page of a file is a frame.
        session: name of the session to write; must not exist.
        dark: the same, taken with the lens covered.
        options: angles, bits and exposure, where they must be told.
        rig: rig file of the camera and polarizer; one is made with the example's values where left out.

    Raises:
        PolfuseError: a file cannot be used, an angle is missing, files do not fit together or do not fit the rig file,
            or the session cannot be written.
    """
    frames = frames_for(files, dark, options or FrameOptions(), rig)
    made = foreign_rig(rig, RadarFacts(recorded=False), frames.camera)
    assert made.rig.camera is not None
    camera = made.rig.camera
    notes = (*made.notes, *frames.notes)
    config = SessionConfig(
        source="import:frames",
        waveform=made.waveform,
        sample_rate_hz=made.rig.radar.sample_rate_hz,
        frame_shape=frames.shape,
        frame_dtype=frames.dtype,
        rig_toml=made.text,
        extra={"frame_files": provenance(frames), "notes": list(notes)},
    )
    exposure = camera.exposure_s if frames.camera.exposure_s is None else frames.camera.exposure_s
    with SessionWriter.create(session, config, expected_bytes=frames.bytes) as writer:
        count = write_frames(writer, frames, exposure_s=exposure, gain_db=camera.gain_db, since_ns=time.monotonic_ns())
        written = writer.close("finished", f"imported from {len(frames.files) + len(frames.dark)} image files")
    return FramesImport(
        session=written,
        frames=count,
        dark_frames=sum(file.pages for file in frames.dark),
        angles_deg=() if camera.has_mosaic else tuple(sorted(set(frames.angles_deg))),
        pixel_format=camera.pixel_format,
        notes=notes,
    )


def frames_for(
    files: Sequence[Path | str], dark: Sequence[Path | str], options: FrameOptions, rig: Path | None
) -> FrameSet:
    """Frames as the camera of ``rig`` takes them: without angles behind a mosaic. Raises as :func:`find_frames`."""
    loaded = None if rig is None else load_rig(rig)
    mosaic = loaded is not None and loaded.has_mosaic
    return find_frames([Path(file) for file in files], [Path(file) for file in dark], options, mosaic=mosaic)


def frame_options(
    angles: str | None = None,
    angle_pattern: str | None = None,
    bits: int | None = None,
    exposure_s: float | None = None,
    angle_sd_deg: float = ANGLE_SD_DEG,
) -> FrameOptions:
    """Options as the command line gives them. Raises :class:`PolfuseError` for angles that are no numbers."""
    listed = None if angles is None else number_list(angles, "--angles")
    return FrameOptions(listed, angle_pattern, bits, exposure_s, angle_sd_deg)


def run(
    files: Sequence[Path],
    output: Path,
    *,
    rig: Path | None = None,
    dark: Sequence[Path] = (),
    angles: str | None = None,
    angle_pattern: str | None = None,
    bits: int | None = None,
    exposure_s: float | None = None,
    angle_sd_deg: float = ANGLE_SD_DEG,
) -> Imported:
    """:func:`import_frames` for the command line."""
    options = frame_options(angles, angle_pattern, bits, exposure_s, angle_sd_deg)
    done = import_frames(files, output, dark=dark, options=options, rig=rig)
    values = {
        "session": done.session,
        "frames": done.frames,
        "dark_frames": done.dark_frames,
        "angles_deg": done.angles_deg,
        "pixel_format": done.pixel_format,
        # Without a radar recording there is no sync to speak of.
        "sweeps": 0,
        "sync_channel": None,
        "sync_inverted": None,
        "sweep_period_s": None,
        "notes": done.notes,
    }
    seen = f"at {', '.join(f'{angle:g}' for angle in done.angles_deg)} degrees" if done.angles_deg else "of a mosaic"
    lines = [
        f"{done.frames - done.dark_frames} frames {seen}, {done.dark_frames} dark ones, {done.pixel_format}",
        *(f"note: {note}" for note in done.notes),
        f"session: {done.session}",
    ]
    return Imported(values, "\n".join(lines))
