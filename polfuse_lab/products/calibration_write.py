"""Writing the stages ``"calibration"`` and ``"polarimetry"``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.products.calibration_inputs import SKY_NOISE_SD_DB, FocusedImage, TargetSpec
from polfuse_lab.products.calibration_result import CalibrationResult
from polfuse_lab.products.store import Products
from processing.polarimetry.pauli import pauli_vector, span

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def write_calibration(
    products: Products,
    focused: FocusedImage,
    scattering: Complexes,
    equivalent: Floats,
    result: CalibrationResult,
    others: list[Path],
    *,
    mode: str,
    check: TargetSpec | None,
    sky: Path | str | None,
) -> None:
    """Write what a calibration made.

    Args:
        products: the file.
        focused: the image that was calibrated.
        scattering: (channels, ny, nx) sqrt(m^2).
        equivalent: (channels, ny) noise-equivalent RCS, m^2.
        result: what was found.
        others: files that it came from besides the products' own.
        mode: ``"offset"`` or ``"thesis"``.
        check: the check target as stated.
        sky: where the noise came from.
    """
    axes = {"x_m": focused.x_m, "y_m": focused.y_m}
    settings = {
        "channels": list(focused.channels),
        "z_m": focused.z_m,
        "centre_hz": focused.centre_hz,
        "bandwidth_hz": focused.bandwidth_hz,
        "mode": mode,
        "target": result.target.spec.summary(),
        "check": None if check is None else check.summary(),
        "noise_source": result.noise_source,
        "noise_sd_db": None if sky is None else SKY_NOISE_SD_DB,
        **result.summary(),
    }
    products.write(
        "calibration",
        {"scattering": scattering.astype(np.complex64), "noise_equivalent_rcs_m2": equivalent, **axes},
        settings=settings,
        inputs=[products.path, *others],
        units={"scattering": "sqrt(m^2)", "noise_equivalent_rcs_m2": "m^2", "x_m": "m", "y_m": "m"},
    )
    write_polarimetry(products, dict(zip(focused.channels, scattering, strict=True)), axes, focused.z_m)


def write_polarimetry(
    products: Products, by_name: Mapping[str, Complexes], axes: Mapping[str, Floats], z_m: float
) -> None:
    """Write the stage "polarimetry" of an image; nothing without HH, VV and a cross-polarized channel.

    Args:
        products: the file, which holds the stage that the image is from.
        by_name: (ny, nx) sqrt(m^2) of each channel.
        axes: ``x_m`` (nx,) and ``y_m`` (ny,).
        z_m: height of the ground.
    """
    crosses = [by_name[name] for name in ("HV", "VH") if name in by_name]
    if not {"HH", "VV"} <= set(by_name) or not crosses:
        return
    k = pauli_vector(by_name["HH"], sum(crosses) / len(crosses), by_name["VV"])
    products.write(
        "polarimetry",
        {"pauli": k.astype(np.complex64), "span": span(k).astype(np.float32), **axes},
        settings={
            "z_m": z_m,
            "components": ["odd bounce", "even bounce", "cross-polarized"],
            "from": "complex amplitudes",
            "cross_channels": len(crosses),
        },
        inputs=[products.path],
        units={"pauli": "sqrt(m^2)", "span": "m^2", "x_m": "m", "y_m": "m"},
    )
