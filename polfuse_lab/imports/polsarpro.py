"""PolSARpro folders (S2, C3 or T3) into a products file: stage ``"matrices"``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.formats import Imported
from polfuse_lab.polsarpro import MASK, plane_names, read_config, read_plane
from polfuse_lab.products.store import Products

STAGE = "matrices"


@dataclass(frozen=True)
class PolsarFolder:
    """What a folder holds."""

    matrix: str
    """``"S2"``, ``"C3"`` or ``"T3"``."""
    planes: NDArray[Any]
    """(4, rows, columns) complex64 HH, HV, VH, VV of S2; else (9, rows, columns) float32 as
    :data:`processing.polarimetry.matrices.PLANES`. NaN where the folder's mask of valid pixels says so."""
    files: tuple[Path, ...]
    """The files that were read."""


def read_folder(folder: Path | str) -> PolsarFolder:
    """Read a folder.

    Raises:
        PolfuseError: it is no such folder, is incomplete, holds several kinds of matrices, or a file has a wrong size.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise PolfuseError("is no folder", where=str(folder), advice="give a PolSARpro folder (S2, C3 or T3)")
    rows, columns = read_config(folder)
    kinds = [m for m in ("S2", "C3", "T3") if (folder / f"{plane_names(m)[0]}.bin").exists()]
    if len(kinds) != 1:
        found = f"holds {' and '.join(kinds)}" if kinds else "holds no s11.bin, C11.bin or T11.bin"
        raise PolfuseError(found, where=str(folder), advice="give a folder with one of S2, C3 and T3")
    names = plane_names(kinds[0])
    planes = np.stack([read_plane(folder, n, rows, columns, is_complex=kinds[0] == "S2") for n in names])
    files = [folder / "config.txt", *(folder / f"{name}.bin" for name in names)]
    mask = folder / f"{MASK}.bin"
    if mask.exists():
        files.append(mask)
        planes[:, read_plane(folder, MASK, rows, columns) == 0] = np.nan
    return PolsarFolder(kinds[0], planes, tuple(files))


def import_polsarpro(folder: Path | str, products: Path | str) -> PolsarFolder:
    """Keep a folder's matrices in a products file, stage "matrices" (``planes``; settings ``matrix``, ``planes``).

    Raises:
        PolfuseError: as :func:`read_folder`, or the products file cannot be written.
    """
    found = read_folder(folder)
    names = list(plane_names(found.matrix)) if found.matrix != "S2" else ["HH", "HV", "VH", "VV"]
    Products(products).write(
        STAGE,
        {"planes": found.planes},
        settings={"matrix": found.matrix, "planes": names, "folder": str(folder)},
        inputs=found.files,
        units={"planes": "sqrt(m^2)" if found.matrix == "S2" else "m^2"},
    )
    return found


def run(files: Sequence[Path], output: Path) -> Imported:
    """``polfuse import DIR -o PRODUCTS.h5 --as polsarpro``. Raises as :func:`import_polsarpro`."""
    if len(files) != 1:
        raise PolfuseError(f"{len(files)} folders were given", where="import", advice="give one PolSARpro folder")
    found = import_polsarpro(files[0], output)
    rows, columns = found.planes.shape[1:]
    values = {"products": str(output), "matrix": found.matrix, "rows": rows, "cols": columns}
    return Imported(values, f"{found.matrix}, {rows} rows and {columns} columns\nproducts: {output}")
