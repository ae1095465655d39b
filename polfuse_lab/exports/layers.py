"""What is exported: layers of a products file, as bands of one image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.figures_fusion import composite
from polfuse_lab.products.polarimetric_image import polarimetric_image
from polfuse_lab.products.store import Products

DECOMPOSITION = "decomposition_"


@dataclass(frozen=True)
class Layer:
    """Bands of one image, rows from the nearest to the furthest as in the products file."""

    name: str
    bands: tuple[str, ...]
    values: NDArray[Any]
    """(bands, rows, columns) float32, complex64, or uint8 of colours (red, green, blue, opacity)."""
    unit: str
    x_m: NDArray[np.float64]
    """(columns,) along the rail; column numbers of an imported image."""
    y_m: NDArray[np.float64]
    """(rows,) away from it; row numbers of an imported image."""
    z_m: float
    ground: bool
    """Whether x and y are metres on the ground."""
    where: str
    """The file, for messages."""
    stage: str
    """Stage that it is from."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.values.shape[1:]
        return rows, columns

    @property
    def step_m(self) -> tuple[float, float]:
        """Pixel in x and y, m. Raises PolfuseError where pixels are not evenly spaced."""
        steps = []
        for axis in (self.x_m, self.y_m):
            step = float((axis[-1] - axis[0]) / (len(axis) - 1)) if len(axis) > 1 else 1.0
            even = axis[0] + step * np.arange(len(axis))
            if step <= 0 or np.abs(even - axis).max() > 1e-6 * max(step, abs(axis[-1])):
                raise PolfuseError(
                    "has pixels that are not evenly spaced", where=self.where, advice="focus on an even grid"
                )
            steps.append(step)
        return steps[0], steps[1]

    @property
    def top_down(self) -> NDArray[Any]:
        """The values with the furthest row first, as pictures and maps have it."""
        return self.values[:, ::-1] if self.ground else self.values

    def on_the_ground(self) -> None:
        """Raise PolfuseError where the layer has no place on the ground."""
        if not self.ground:
            raise PolfuseError(
                "was imported without a place on the ground",
                where=self.where,
                advice="export it --to envi, png or polsarpro",
            )


def layer_of(products: Products, name: str) -> Layer:
    """A layer by its name.

    Args:
        products: products file.
        name: ``"scattering"`` (complex channels, calibrated if they are), ``"db"`` (their levels, dB), ``"pauli"``
            (colours), ``"detection"``, or a decomposition such as ``"freeman"``.

    Raises:
        PolfuseError: there is no such layer in the file.
    """
    if name == "scattering":
        return _scattering(products)
    if name == "db":
        return _levels(_scattering(products))
    if name == "pauli":
        return _pauli(products)
    stages = products.stages()
    stage = name if name in stages else f"{DECOMPOSITION}{name.replace('-', '_')}"
    if stage not in stages or not (stage.startswith(DECOMPOSITION) or stage == "detection"):
        there = [s.removeprefix(DECOMPOSITION) for s in stages if s.startswith(DECOMPOSITION) or s == "detection"]
        raise PolfuseError(
            f"has no layer {name!r}",
            where=str(products.path),
            advice=f"choose from {', '.join(['scattering', 'db', 'pauli', *there])}, or make it with "
            f"'polfuse decompose {products.path} --method {name}'",
        )
    return _planes(products, stage)


def _scattering(products: Products) -> Layer:
    stages = products.stages()
    stage = "calibration" if "calibration" in stages else "focus"
    if stage not in stages and "matrices" in stages:
        image = polarimetric_image(products)
        return _layer(products, "scattering", "matrices", ("HH", "HV", "VH", "VV"), image.scattering_matrices(), "")
    arrays, settings = products.read(stage), products.settings(stage)
    values = arrays["scattering" if stage == "calibration" else "image"].astype(np.complex64)
    unit = products.units(stage).get("scattering" if stage == "calibration" else "image", "")
    return _layer(products, "scattering", stage, tuple(settings["channels"]), values, unit)


def _levels(layer: Layer) -> Layer:
    amplitude = np.abs(layer.values).astype(np.float64)
    values = 20 * np.log10(np.where(amplitude > 0, amplitude, np.nan))
    unit = "dBsm" if layer.stage in ("calibration", "matrices") else "dB of full scale"
    bands = tuple(f"{name} {unit}" for name in layer.bands)
    return Layer(
        "db", bands, values.astype(np.float32), unit, layer.x_m, layer.y_m, layer.z_m, layer.ground, layer.where,
        layer.stage,
    )  # fmt: skip


def _pauli(products: Products) -> Layer:
    """Colours red |HH-VV|, green |HV|, blue |HH+VV|; undefined pixels (outside the fan) are transparent."""
    if "calibration" in products.stages() or "matrices" in products.stages():
        image = polarimetric_image(products)
        t = image.coherency()
        # |HH - VV|, |HV|, |HH + VV| of T, which averages have as well.
        powers = np.stack([2 * t[5], t[8] / 2, 2 * t[0]]).astype(np.float64)
        powers[:, ~np.isfinite(t).all(axis=0)] = np.nan
        colour, stage = composite(np.sqrt(np.where(powers < 0, 0.0, powers))), image.stage
    else:
        raise PolfuseError(
            "holds no calibrated polarimetric image for the Pauli colours",
            where=str(products.path),
            advice="calibrate it first, or export with --layer db",
        )
    return _layer(products, "pauli", stage, ("red", "green", "blue", "opacity"), as_colours(colour), "")


def _planes(products: Products, stage: str) -> Layer:
    arrays, settings = products.read(stage), products.settings(stage)
    names = [str(n) for n in settings.get("planes", ("ratio", "detected"))]
    shape = arrays[names[0]].shape
    if "orientation_deg" in arrays and "x_m" not in arrays and "ellipticity_deg" in arrays:
        raise PolfuseError(
            "holds a signature, which is no image", where=str(products.path), advice="look at its figure instead"
        )
    values = np.stack([arrays[n].astype(np.float32) for n in names])
    units = products.units(stage)
    unit = ", ".join(sorted({units[n] for n in names if n in units}))
    made = _layer(products, stage.removeprefix(DECOMPOSITION), stage, tuple(names), values, unit)
    if made.shape != shape:
        raise AssertionError(f"stage {stage} has planes of different shapes")
    return made


def _layer(products: Products, name: str, stage: str, bands: tuple[str, ...], values: NDArray[Any], unit: str) -> Layer:
    arrays = products.read(stage)
    ground = "x_m" in arrays
    rows, columns = values.shape[1:]
    x, y = (arrays["x_m"], arrays["y_m"]) if ground else (np.arange(columns), np.arange(rows))
    z = float(products.settings("focus")["z_m"]) if ground and "focus" in products.stages() else 0.0
    return Layer(
        name, bands, values, unit, np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64), z, ground,
        str(products.path), stage,
    )  # fmt: skip


def as_colours(colour: NDArray[Any]) -> NDArray[np.uint8]:
    """(4, rows, columns) red, green, blue and opacity, 0 to 255, of colours (rows, columns, 3) from 0 to 1 with NaN."""
    opaque = np.isfinite(colour).all(axis=-1)
    levels = np.rint(255 * np.clip(np.nan_to_num(colour), 0, 1)).astype(np.uint8)
    return np.stack([*np.moveaxis(levels, -1, 0), np.where(opaque, 255, 0).astype(np.uint8)])
