"""Formats of other programs, by name: what each is, and the module whose ``run(request)`` writes it.

A module is imported when its format is asked for, so that what it needs is needed by nobody else.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.store import Products


@dataclass(frozen=True)
class Request:
    """What is to be exported, and where to."""

    products: Products
    output: Path
    layer: str | None = None
    """None: the format's own choice."""
    rig: Path | None = None
    """Rig file with the place on the earth; None: that of the session that was focused."""
    matrix: str | None = None
    """Of PolSARpro's folder: S2, C3 or T3; None: as it is."""
    channels: tuple[str, ...] = ()
    """Of formats with one file for each channel; empty: all."""


@dataclass(frozen=True)
class Exported:
    """What an export made."""

    files: tuple[Path, ...]
    layer: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)
    """Further fields of the JSON object."""
    note: str = ""
    """What a user should know."""


@dataclass(frozen=True)
class Format:
    """A format of another program."""

    what: str
    module: str
    options: frozenset[str]
    """Names of the fields of :class:`Request` that it takes besides products and output."""


FORMATS: Mapping[str, Format] = {
    "geotiff": Format("a map in UTM for GIS", "polfuse_lab.exports.geotiff", frozenset({"layer", "rig"})),
    "kmz": Format("an overlay for Google Earth", "polfuse_lab.exports.kmz", frozenset({"layer", "rig"})),
    "png": Format("a picture with a world file", "polfuse_lab.exports.png", frozenset({"layer", "rig"})),
    "envi": Format("raw bands with a header", "polfuse_lab.exports.envi", frozenset({"layer"})),
    "polsarpro": Format("a folder S2, C3 or T3", "polfuse_lab.exports.polsarpro", frozenset({"matrix"})),
    "sicd": Format("complex images, one for each channel", "polfuse_lab.exports.sicd", frozenset({"rig", "channels"})),
    "cphd": Format("phase history of all channels", "polfuse_lab.exports.cphd", frozenset({"rig", "channels"})),
}
"""Every format by its name on the command line."""


def export(request: Request, to: str) -> Exported:
    """Write ``request`` in the format ``to``, one of :data:`FORMATS`.

    Raises:
        PolfuseError: an unknown format, an option that it does not take, stages that are missing, a package that is
            not installed, or no room.
    """
    if to not in FORMATS:
        raise PolfuseError(f"there is no format {to!r}", where="export", advice=f"choose from {', '.join(FORMATS)}")
    form = FORMATS[to]
    given = {name for name in ("layer", "rig", "matrix", "channels") if getattr(request, name)}
    if wrong := sorted(given - form.options):
        raise PolfuseError(
            f"{to} takes no --{wrong[0]}", where="export", advice=f"leave --{wrong[0]} out, or choose another format"
        )
    if not request.products.path.exists():
        raise PolfuseError("there is no such products file", where=str(request.products.path), advice="check the name")
    made = importlib.import_module(form.module).run(request)
    assert isinstance(made, Exported)
    return made


def written(path: Path, content: bytes) -> Path:
    """Write a file whole, or not at all. Raises PolfuseError where it cannot be written."""
    fresh = path.with_name(f"{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh.write_bytes(content)
        os.replace(fresh, path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        fresh.unlink(missing_ok=True)
    return path


def unwritable(path: Path, error: OSError) -> PolfuseError:
    """The error of a file that cannot be written."""
    return PolfuseError(
        f"cannot be written ({error.strerror or error})",
        where=str(path),
        advice="check the folder and the disk's space",
    )
