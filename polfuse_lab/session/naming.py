"""Names of session files: taken ones are refused, and finishing never replaces a file."""

from __future__ import annotations

import os
from pathlib import Path

from polfuse_lab.errors import PolfuseError


def partial_path(path: Path) -> Path:
    """Name of a session while it is written."""
    return path.with_name(path.name + ".partial")


def check_free_name(path: Path) -> None:
    """Check that a session can be written to ``path``. Raises :class:`PolfuseError` where it would touch a file."""
    partial = partial_path(path)
    if path.exists() or path.is_symlink():
        raise taken(path)
    if partial.exists():
        raise PolfuseError(
            "is left from a collect that did not end, or is being written",
            where=str(partial),
            advice=f"run 'polfuse recover {partial} -o NEW.h5' and remove it, or choose another name",
        )
    if not path.parent.is_dir():
        raise PolfuseError("the folder does not exist", where=str(path.parent), advice="make it, or check the name")


def taken(path: Path) -> PolfuseError:
    """The error for a name that is in use."""
    return PolfuseError("exists and is never overwritten", where=str(path), advice="choose another name")


def move_without_replacing(partial: Path, path: Path) -> Path:
    """Give ``partial`` the name ``path`` (or one with a number added) without ever replacing a file."""
    target = path
    for number in range(1, 10_000):
        try:
            os.link(partial, target)
        except FileExistsError:
            target = path.with_name(f"{path.stem}-{number}{path.suffix}")
            continue
        except OSError:
            # A file system without hard links: nothing better than to look and then rename.
            if target.exists():
                target = path.with_name(f"{path.stem}-{number}{path.suffix}")
                continue
            os.rename(partial, target)
            return target
        partial.unlink()
        return target
    raise PolfuseError("every name like it is taken", where=str(path), advice=f"rename {partial.name} yourself")
