"""Formats of foreign recordings, by name: what each is, which options it takes, and the module that reads it.

To add one, write a module with ``run(files, output, **options) -> Imported`` and name it in :data:`FORMATS`; an option
that no other format has is added to the command (``polfuse_lab/cli/import_.py``), with the default None
("not given"): what an option is by default stands in ``run``. The module is imported when its format is asked for.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from polfuse_lab.errors import PolfuseError


@dataclass(frozen=True)
class Imported:
    """What an import made, in the words of the command line."""

    values: Mapping[str, Any]
    """Fields of the JSON object."""
    text: str
    """The same for people."""


@dataclass(frozen=True)
class Format:
    """A format of foreign recordings."""

    what: str
    """What it is, a few words for ``--help``."""
    module: str
    """Module whose ``run`` reads it."""
    options: frozenset[str] = frozenset()
    """Names of the options that its ``run`` takes besides the files and the output."""


_RADAR = frozenset({"bandwidth_hz", "centre_hz", "sweep_period_s", "up_ramp"})
_FRAMES = frozenset({"rig", "dark", "angles", "angle_pattern", "bits", "exposure_s", "angle_sd_deg"})

FORMATS: Mapping[str, Format] = {
    "wav": Format(
        "stereo WAV files of a ranging radar, beat and sync",
        "polfuse_lab.imports.wav",
        _RADAR | {"channel"},
    ),
    "sar-wav": Format(
        "stereo WAV files of a rail radar that was switched off from mark to mark, one for each channel",
        "polfuse_lab.imports.sar_wav_command",
        _RADAR
        | _FRAMES
        | {"channel", "channels", "step_m", "positions", "drop", "repeats", "antenna_height_m", "frames"},
    ),
    "gotcha": Format(
        "MATLAB files of AFRL's Gotcha collect, or a folder of them",
        "polfuse_lab.imports.gotcha",
    ),
    "frames": Format(
        "TIFF or PNG frames of a polarizer series",
        "polfuse_lab.imports.frames_session",
        _FRAMES,
    ),
    "polsarpro": Format(
        "a PolSARpro folder (S2, C3 or T3), into a products file",
        "polfuse_lab.imports.polsarpro",
    ),
}
"""Every format that ``polfuse import --as`` knows."""


def run_import(name: str, files: Sequence[Path], output: Path, options: Mapping[str, Any]) -> Imported:
    """Import ``files`` as format ``name``.

    Args:
        name: one of :data:`FORMATS`.
        files: recordings, or a folder of them.
        output: file to write.
        options: the options that the user gave, by name; what is left out has the format's own default.

    Raises:
        PolfuseError: there is no such format, it takes no such option, or its files cannot be used.
    """
    known = FORMATS.get(name)
    if known is None:
        raise PolfuseError(f"there is no format {name!r}", where="import", advice=f"choose from {', '.join(FORMATS)}")
    if foreign := sorted(set(options) - known.options):
        raise PolfuseError(
            f"{', '.join(map(option_name, foreign))} means nothing to the format {name}", where="import",
            advice=f"leave it out, or choose another format; {name} takes "
            f"{', '.join(map(option_name, sorted(known.options))) or 'no options'}",
        )  # fmt: skip
    done: Imported = importlib.import_module(known.module).run(files, output, **options)
    return done


def option_name(name: str) -> str:
    """An option as it is written on the command line."""
    return f"--{name.replace('_', '-')}"
