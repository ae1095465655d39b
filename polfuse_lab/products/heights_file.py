"""Height maps for the registration: the files that focusing takes, over the plane that a picture was focused on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus_grids import read_heights
from processing.fusion.height_map import HeightMap

Floats = NDArray[np.float64]

SD = "sd_m"
"""Array of an archive that tells how well each height is known, m (one standard deviation)."""


def height_map(path: Path | str, z_m: float) -> HeightMap:
    """The ground of a file over the plane z = z_m.

    Args:
        path: as :func:`polfuse_lab.products.focus_grids.read_heights` takes them; an archive may hold ``sd_m`` too.
        z_m: of the plane, m in rig coordinates.

    Raises:
        PolfuseError: no such file, or one that holds no map.
    """
    path = Path(path)
    grid = read_heights(path)
    try:
        height = np.asarray(grid.height_m, dtype=np.float64) - z_m
        return HeightMap(np.asarray(grid.x_m, np.float64), np.asarray(grid.y_m, np.float64), height, _sd(path))
    except Exception as error:
        # Damaged archives raise nearly every kind of exception.
        raise PolfuseError(f"holds no map of heights ({error})", where=str(path), advice="look at the file") from error


def _sd(path: Path) -> Floats | None:
    if path.suffix != ".npz":
        return None
    with np.load(path, allow_pickle=False) as held:
        return np.asarray(held[SD], dtype=np.float64) if SD in held.files else None
