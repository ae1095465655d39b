"""Loose frames of a polarizer series, with their angles from the files' names or told one by one."""

from __future__ import annotations

import glob
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.camera.pixel_formats import pixel_format
from drivers.records import Frame
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.foreign_rig import ANGLE_SD_DEG, CameraFacts
from polfuse_lab.imports.images import SUFFIXES, ImageFile, inspect_image, read_images
from polfuse_lab.records import Exposure
from polfuse_lab.session import SessionWriter

_TOKEN = re.compile(r"_(-?\d{1,3}(?:\.\d+)?)(deg)?(?=_|$)", re.IGNORECASE)
FRAME_GAP_NS = 1_000_000_000
"""Time put between frames: files do not tell when they were taken, only their order."""


@dataclass(frozen=True)
class FrameOptions:
    """What the user says about frames."""

    angles_deg: tuple[float, ...] | None = None
    """Angle of each file, in their order; from their names where left out."""
    angle_pattern: str | None = None
    """Where the angle stands in a name, such as ``"scene_{angle}_*"``; ``*`` is anything."""
    bits: int | None = None
    """Bits of the camera, where files hold more."""
    exposure_s: float | None = None
    """Exposure of every frame, s."""
    angle_sd_deg: float = ANGLE_SD_DEG
    """How well each angle was met, degrees (standard deviation)."""


@dataclass(frozen=True)
class FrameSet:
    """Frames that were looked at and fit together; their images are read again when they are written."""

    files: tuple[ImageFile, ...]
    angles_deg: tuple[float, ...]
    """One for each file."""
    dark: tuple[ImageFile, ...]
    camera: CameraFacts
    angle_sd_deg: float
    notes: tuple[str, ...]

    @property
    def dtype(self) -> str:
        """``"uint8"`` or ``"uint16"``."""
        return pixel_format(self.camera.pixel_format).dtype.__name__

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of each frame."""
        return self.camera.height_px, self.camera.width_px

    @property
    def bytes(self) -> int:
        """Size of all images."""
        pages = sum(file.pages for file in (*self.files, *self.dark))
        return pages * self.shape[0] * self.shape[1] * (1 if self.dtype == "uint8" else 2)


def find_frames(
    names: Sequence[Path], dark: Sequence[Path], options: FrameOptions, *, mosaic: bool = False
) -> FrameSet:
    """Look at the frames of a polarizer series.

    Args:
        names: files, folders (all images in them, by name), or patterns such as ``pol_*.tif``.
        dark: the same for frames taken with the lens covered.
        options: what the user says about them.
        mosaic: whether the camera sees all angles at once, so that files have none.

    Raises:
        PolfuseError: a file cannot be used, angles are missing or ambiguous, or files do not fit together.
    """
    _check_options(options)
    paths, dark_paths = _expand(names), _expand(dark)
    if not paths:
        raise PolfuseError("no frame is given", where="import", advice="name at least three frames of the series")
    if both := set(paths) & set(dark_paths):
        raise PolfuseError("is given as a frame and as a dark frame", where=str(min(both)), advice="give it once")
    angles = (0.0,) * len(paths) if mosaic else _angles(paths, options)
    files, dark_files = [tuple(inspect_image(path) for path in some) for some in (paths, dark_paths)]
    first = files[0]
    for file in (*files, *dark_files):
        if (file.shape, file.dtype) != (first.shape, first.dtype):
            raise PolfuseError(
                f"is {file.shape[1]} x {file.shape[0]} pixels of {file.dtype}, "
                f"{first.path.name} {first.shape[1]} x {first.shape[0]} of {first.dtype}",
                where=str(file.path),
                advice="give frames of one series, from one camera with one region and depth",
            )
    known = {round(file.exposure_s, 12) for file in files if file.exposure_s is not None}
    if len(known) > 1:
        raise PolfuseError(
            f"its frames were taken with different exposures, {min(known):g} to {max(known):g} s",
            where=str(first.path.parent), advice="give a series with one exposure",
        )  # fmt: skip
    exposure = options.exposure_s if options.exposure_s is not None else min(known, default=None)
    name, saturation, notes = _depth((*files, *dark_files), options.bits)
    different = len({round(angle % 180, 3) for angle in angles})
    if not mosaic and different < 3:
        notes.append(f"{different} polarizer angle(s) do not determine the Stokes parameters: three or more do")
    camera = CameraFacts(first.shape[1], first.shape[0], name, saturation, exposure)
    return FrameSet(files, angles, dark_files, camera, options.angle_sd_deg, tuple(notes))


def write_frames(writer: SessionWriter, frames: FrameSet, *, exposure_s: float, gain_db: float, since_ns: int) -> int:
    """Write all frames, dark ones first, from host time ``since_ns`` on.

    Args:
        writer: the session.
        frames: what to write.
        exposure_s: exposure to store with each, s.
        gain_db: gain to store with each, dB.
        since_ns: host time of the first.

    Returns:
        How many were written.

    Raises:
        PolfuseError: a file has changed since it was looked at, or cannot be read now.
    """
    count = 0
    series = [(file, 0.0, True) for file in frames.dark]
    series += [(file, angle, False) for file, angle in zip(frames.files, frames.angles_deg, strict=True)]
    for file, angle_deg, dark in series:
        for image in read_images(file):
            t_ns = since_ns + count * FRAME_GAP_NS
            frame = Frame(image, count, exposure_s, gain_db, float(count), t_ns)
            sd_rad = 0.0 if dark else math.radians(frames.angle_sd_deg)
            writer.write(Exposure(frame, math.radians(angle_deg), sd_rad, dark=dark))
            count += 1
        writer.flush()
    return count


def provenance(frames: FrameSet) -> list[dict[str, Any]]:
    """Where each frame came from: JSON values."""
    angles = [*frames.angles_deg, *(None for _ in frames.dark)]
    return [
        {"name": file.path.name, "sha256": file.sha256, "pages": file.pages, "angle_deg": angle, "dark": angle is None}
        for file, angle in zip((*frames.files, *frames.dark), angles, strict=True)
    ]


def angle_of_name(path: Path, pattern: str | None = None) -> float:
    """Angle of the polarizer in a file's name, degrees.

    Without a pattern it is the number behind an underscore, ``scene_045.tif`` or ``scene_22.5deg_3.tif``; of several
    such numbers the one marked ``deg``.

    Raises:
        PolfuseError: there is none, or several that may be it.
    """
    if pattern is not None:
        left, _, right = pattern.partition("{angle}")
        expression = ".*".join(map(re.escape, left.split("*"))) + r"(-?\d+(?:\.\d+)?)"
        found = re.fullmatch(expression + ".*".join(map(re.escape, right.split("*"))), path.stem)
        if found is None:
            raise PolfuseError(
                f"its name does not follow {pattern!r}", where=str(path), advice="correct --angle-pattern"
            )
        return float(found[1])
    numbers = _TOKEN.findall(path.stem)
    marked = [text for text, mark in numbers if mark] or [text for text, _ in numbers]
    if not marked:
        raise PolfuseError(
            "its name tells no polarizer angle", where=str(path),
            advice="name it like scene_045.tif, give --angles, or give it as --dark if the lens was covered",
        )  # fmt: skip
    if len(marked) > 1:
        raise PolfuseError(
            f"its name holds several numbers that may be the angle ({', '.join(marked)})", where=str(path),
            advice=f"say which with --angle-pattern, such as '*_{{angle}}_{marked[-1]}', or give --angles",
        )  # fmt: skip
    return float(marked[0])


def _angles(paths: Sequence[Path], options: FrameOptions) -> tuple[float, ...]:
    if options.angles_deg is None:
        return tuple(_checked(angle_of_name(path, options.angle_pattern), str(path)) for path in paths)
    if len(options.angles_deg) != len(paths):
        raise PolfuseError(
            f"{len(options.angles_deg)} angles are given for {len(paths)} frames", where="import",
            advice="give --angles one angle for each file, in their order",
        )  # fmt: skip
    return tuple(_checked(angle, "--angles") for angle in options.angles_deg)


def _checked(angle_deg: float, where: str) -> float:
    if not abs(angle_deg) <= 360:
        raise PolfuseError(f"{angle_deg:g} degrees is no polarizer angle", where=where, advice="give -360 to 360")
    return angle_deg


def _check_options(options: FrameOptions) -> None:
    if options.angles_deg is not None and options.angle_pattern is not None:
        raise PolfuseError("angles and a pattern for them are given", where="import", advice="give one of them")
    if options.angle_pattern is not None and options.angle_pattern.count("{angle}") != 1:
        raise PolfuseError(
            f"the pattern {options.angle_pattern!r} does not hold {{angle}} once", where="import",
            advice="write it like 'scene_{angle}_*'")  # fmt: skip
    if options.exposure_s is not None and not 0 < options.exposure_s <= 60:
        raise PolfuseError(f"an exposure of {options.exposure_s:g} s", where="import", advice="give up to 60 s")
    if not 0 <= options.angle_sd_deg <= 90:
        raise PolfuseError(f"angles met within {options.angle_sd_deg:g} degrees", where="import", advice="give 0 to 90")


def _expand(names: Sequence[Path]) -> list[Path]:
    """Files named one by one, in folders, or by patterns; each once, in the order given."""
    found: dict[Path, None] = {}
    for name in names:
        if name.is_dir():
            inside = sorted(path for path in name.iterdir() if path.suffix.lower() in SUFFIXES)
            if not inside:
                raise PolfuseError("holds no TIFF or PNG file", where=str(name), advice="check the folder")
        elif not name.exists() and glob.has_magic(str(name)):
            inside = sorted(map(Path, glob.glob(str(name))))
            if not inside:
                raise PolfuseError("matches no file", where=str(name), advice="check the pattern")
        else:
            inside = [name]
        found.update(dict.fromkeys(inside))
    return list(found)


def _depth(files: Sequence[ImageFile], bits: int | None) -> tuple[str, int, list[str]]:
    """Pixel format, counts at which a pixel is saturated, and notes."""
    stored = 8 if files[0].dtype == "uint8" else 16
    largest = max(file.largest for file in files)
    if bits is None:
        told = {file.bits for file in files}
        bits = told.pop() if len(told) == 1 else stored
    allowed = (8,) if stored == 8 else (10, 12, 14, 16)
    if bits not in allowed:
        raise PolfuseError(
            f"its files hold {stored} bits, {bits} are said", where=str(files[0].path),
            advice=f"give --bits {' or '.join(map(str, allowed))}")  # fmt: skip
    name = f"Mono{bits}"
    full = (1 << bits) - 1
    if stored == 8 or bits == 16:
        notes = []
        if stored == 16 and largest < 1 << 14:
            likely = next(b for b in (10, 12, 14) if largest < 1 << b)
            notes.append(
                f"no count is above {largest}: where the camera has {likely} bits, say so with --bits {likely}, or "
                "saturated pixels are not recognised"
            )
        return name, full, notes
    if largest <= full:
        return name, full, []
    if all(file.lowest_bit >= 16 - bits for file in files):
        # The camera's software moved the counts up to 16 bits; they are kept as they are.
        return "Mono16", full << (16 - bits), [f"counts of {bits} bits stand in the upper bits of 16"]
    raise PolfuseError(
        f"has counts up to {largest}, more than {bits} bits hold", where=str(files[0].path), advice="correct --bits"
    )
