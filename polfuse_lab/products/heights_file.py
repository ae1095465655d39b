"""Height maps that users bring: an archive of arrays, or a table as surveying instruments write it."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from processing.errors import DataError
from processing.fusion.height_map import HeightMap

Floats = NDArray[np.float64]

NEEDED = ("x_m", "y_m", "height_m")
SD = "sd_m"
_ADVICE = (
    "give .npz with x_m (nx,), y_m (ny,), height_m (ny, nx) and perhaps sd_m, or .csv with a line of these names and "
    "one line for each place"
)


def read_heights(path: Path | str) -> HeightMap:
    """Heights above the ground plane over x and y in rig coordinates.

    ``.npz``: arrays ``x_m`` (nx,), ``y_m`` (ny,), ``height_m`` (ny, nx), ``sd_m`` (ny, nx) if known. ``.csv``: columns
    of these names, one line for each place of the grid in any order; places without a line are unknown.

    Raises:
        PolfuseError: no such file, another format, names that are missing, or heights that are no map.
    """
    path = Path(path)
    readers = {".npz": _arrays, ".csv": _table}
    if path.suffix.lower() not in readers:
        raise PolfuseError(f"height maps cannot be '{path.suffix}'", where=str(path), advice=_ADVICE)
    try:
        return HeightMap(*readers[path.suffix.lower()](path))
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise PolfuseError(f"cannot be read as a height map ({error})", where=str(path), advice=_ADVICE) from error
    except DataError as error:
        raise PolfuseError(str(error), where=str(path), advice="look at the file") from error


def _arrays(path: Path) -> tuple[Floats, Floats, Floats, Floats | None]:
    with np.load(path, allow_pickle=False) as held:
        _demand(path, held.files)
        x, y, height = (np.asarray(held[name], dtype=np.float64) for name in NEEDED)
        return x.ravel(), y.ravel(), height, np.asarray(held[SD], dtype=np.float64) if SD in held.files else None


def _table(path: Path) -> tuple[Floats, Floats, Floats, Floats | None]:
    with path.open(encoding="utf-8-sig") as stream:
        names = [name.strip() for name in stream.readline().split(",")]
        _demand(path, names)
        lines = [line for line in stream if line.strip()]
    if not lines:
        raise ValueError("no line of a place")
    rows = np.loadtxt(lines, delimiter=",", ndmin=2)
    if rows.shape[1] != len(names):
        raise ValueError(f"{len(names)} names over {rows.shape[1]} columns")
    column = {name: rows[:, number] for number, name in enumerate(names)}
    x, i = np.unique(column["x_m"], return_inverse=True)
    y, k = np.unique(column["y_m"], return_inverse=True)
    if len(np.unique(k * len(x) + i)) < len(rows):
        raise ValueError("a place stands there twice")
    if len(rows) < 0.5 * len(x) * len(y):
        raise ValueError(f"{len(rows)} places of a grid of {len(x)} by {len(y)}: they are not on a grid")
    planes = [np.full((len(y), len(x)), np.nan) for _ in ("height", "sd")]
    for plane, name in zip(planes, ("height_m", SD), strict=True):
        if name in column:
            plane[k, i] = column[name]
    return x, y, planes[0], planes[1] if SD in column else None


def _demand(path: Path, names: list[str]) -> None:
    if missing := [name for name in NEEDED if name not in names]:
        raise PolfuseError(
            f"has no {', '.join(missing)} (found {', '.join(names) or 'nothing'})", where=str(path), advice=_ADVICE
        )
