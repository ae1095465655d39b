"""The polarimetric image of a products file, whether it was calibrated here or imported as matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.store import Products
from processing.polarimetry.matrices import coherency_of_covariance, planes_of_vector
from processing.polarimetry.pauli import pauli_vector

CHANNELS = ("HH", "HV", "VH", "VV")


@dataclass(frozen=True)
class PolarimetricImage:
    """Scattering matrices, or their averages."""

    stage: str
    """Stage that it is from."""
    matrix: str
    """``"S2"``, ``"C3"`` or ``"T3"``."""
    planes: NDArray[Any]
    """(4, rows, columns) complex64 HH, HV, VH, VV of S2; else (9, rows, columns) float32, see
    :data:`processing.polarimetry.matrices.PLANES`."""
    axes: dict[str, NDArray[Any]]
    """``x_m`` (columns,) and ``y_m`` (rows,) of an image on the ground; empty for foreign ones without a place."""
    where: str
    """The file, for messages."""

    def coherency(self) -> NDArray[Any]:
        """T (9, rows, columns) float32, with the mean of HV and VH."""
        if self.matrix == "T3":
            return self.planes
        if self.matrix == "C3":
            return coherency_of_covariance(self.planes)
        return planes_of_vector(self.pauli().astype(np.complex64))

    def pauli(self) -> NDArray[np.complex128]:
        """Pauli vectors (3, rows, columns), sqrt(m^2). Raises as :meth:`scattering_matrices`."""
        hh, hv, vh, vv = self.scattering_matrices()
        return pauli_vector(hh, (hv.astype(np.complex128) + vh) / 2, vv)

    def scattering_matrices(self) -> NDArray[Any]:
        """HH, HV, VH, VV (4, rows, columns) complex64, sqrt(m^2).

        Raises:
            PolfuseError: there are averages only.
        """
        if self.matrix != "S2":
            raise PolfuseError(
                f"holds {self.matrix}, averages that have lost the phases of scattering matrices",
                where=self.where,
                advice="take a method for averages (freeman, yamaguchi, h-a-alpha, touzi), or give S2",
            )
        return self.planes


def polarimetric_image(products: Products) -> PolarimetricImage:
    """The image of stage "matrices" if there is one, else of stage "calibration".

    Raises:
        PolfuseError: neither is there, or channels are missing.
    """
    where = str(products.path)
    if "matrices" in products.stages():
        arrays, matrix = products.read("matrices"), str(products.settings("matrices")["matrix"])
        axes: dict[str, NDArray[Any]] = {name: arrays[name] for name in ("x_m", "y_m") if name in arrays}
        return PolarimetricImage("matrices", matrix, arrays["planes"], axes, where)
    arrays = products.read("calibration")
    by_name = dict(zip(products.settings("calibration")["channels"], arrays["scattering"], strict=True))
    # One cross-polarized channel is enough for a monostatic radar: the other is the same by reciprocity.
    for one, other in (("HV", "VH"), ("VH", "HV")):
        if one in by_name:
            by_name.setdefault(other, by_name[one])
    if missing := [name for name in CHANNELS if name not in by_name]:
        raise PolfuseError(
            f"has no channel {', '.join(missing)}", where=where, advice="collect HH, VV and HV or VH to decompose"
        )
    planes = np.stack([by_name[name] for name in CHANNELS]).astype(np.complex64)
    return PolarimetricImage("calibration", "S2", planes, {name: arrays[name] for name in ("x_m", "y_m")}, where)
