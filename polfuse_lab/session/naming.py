"""Names of session files: taken ones are refused, and finishing never replaces a file."""

from __future__ import annotations

import os
from pathlib import Path

from polfuse_lab.errors import PolfuseError


def partial_path(path: Path) -> Path:
    """Name of a session while it is written."""
    return path.with_name(path.name + ".partial")


def unborn_path(path: Path) -> Path:
    """Name of a session until all is declared in it: what is called ``.partial`` can always be opened."""
    return path.with_name(f".{path.name}.new")


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
    """Give ``partial`` the name ``path`` (or one with a number added) without ever replacing a file.

    Raises:
        OSError: ``partial`` or its folder is gone, or nothing may be written there.
        PolfuseError: thousands of such names are taken.
    """
    target = path
    for number in range(1, 10_000):
        try:
            rename_without_replacing(partial, target)
        except FileExistsError:
            target = path.with_name(f"{path.stem}-{number}{path.suffix}")
            continue
        return target
    raise PolfuseError("every name like it is taken", where=str(path), advice=f"rename {partial.name} yourself")


def rename_without_replacing(old: Path, new: Path) -> None:
    """Rename a file. Raises FileExistsError where ``new`` is taken, and OSError as the system does."""
    try:
        os.link(old, new)
    except FileExistsError:
        raise
    except OSError:
        # A file system without hard links: nothing better than to look and then rename.
        if new.exists():
            raise FileExistsError(str(new)) from None
        os.rename(old, new)
    else:
        old.unlink()
