"""A products file's matrices as a PolSARpro folder (S2, C3 or T3)."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np

from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.formats import Exported, Request
from polfuse_lab.polsarpro import MASK, plane_names, write_config, write_plane
from polfuse_lab.products.polarimetric_image import polarimetric_image
from polfuse_lab.products.store import Products
from processing.polarimetry.matrices import covariance_of_coherency

Matrix = Literal["S2", "C3", "T3"]


def run(request: Request) -> Exported:
    """:func:`export_polsarpro` for the command line. Raises as it does, and for an unknown matrix."""
    if request.matrix not in (None, *get_args(Matrix)):
        raise PolfuseError(
            f"there is no matrix {request.matrix!r}",
            where="export",
            advice=f"choose from {', '.join(get_args(Matrix))}",
        )
    files = export_polsarpro(request.products.path, request.output, cast("Matrix | None", request.matrix))
    return Exported(tuple(files), "scattering" if request.matrix in (None, "S2") else str(request.matrix))


def export_polsarpro(products: Path | str, folder: Path | str, matrix: Matrix | None = None) -> list[Path]:
    """Write ``config.txt``, planes with ENVI headers and, if pixels are undefined, the mask of valid ones.

    What came in as one kind of matrix goes out as that kind without a bit changed. Rows are those of the array: of an
    image on the ground the first row is the nearest.

    Args:
        products: products file with stage "matrices" or "calibration".
        folder: is made if it is not there; files of the same names are replaced.
        matrix: kind; None: S2 where there are scattering matrices, else the kind that was imported.

    Returns:
        The files.

    Raises:
        PolfuseError: no such stage, scattering matrices of an image that has averages only, or no room.
    """
    image = polarimetric_image(Products(products))
    kind = matrix or image.matrix
    folder = Path(folder)
    if kind == "S2":
        planes = image.scattering_matrices()
    elif kind == image.matrix:
        planes = image.planes
    else:
        coherency = image.coherency()
        planes = coherency if kind == "T3" else covariance_of_coherency(coherency)
    defined = np.isfinite(planes).all(axis=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = [write_config(folder, *defined.shape)]
        for name, values in zip(plane_names(kind), planes, strict=True):
            files += write_plane(folder, name, np.where(defined, values, 0))
        if defined.all():
            (folder / f"{MASK}.bin").unlink(missing_ok=True)
        else:
            files += write_plane(folder, MASK, defined.astype(np.float32))
    except OSError as error:
        raise PolfuseError(
            f"cannot be written ({error.strerror})", where=str(folder), advice="check the folder and the disk's space"
        ) from error
    return files
