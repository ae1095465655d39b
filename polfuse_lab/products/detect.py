"""Targets in a polarimetric image at a constant rate of false alarms: stage "detection" of the products file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import ndimage

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products import style
from polfuse_lab.products.polarimetric_image import PolarimetricImage, polarimetric_image
from polfuse_lab.products.store import Products
from processing.polarimetry import targets
from processing.polarimetry.detection.cfar import Kind, Ring, cfar, ring_average
from processing.polarimetry.detection.filters import matched, whitened
from processing.polarimetry.matrices import total_power
from processing.polarimetry.pauli import pauli_of_matrix
from processing.polarimetry.speckle.quality import estimated_looks

POWERS = ("span", "whitened", "matched")
"""What is compared with its surroundings: total power, whitening filter, matched filter."""
TARGETS = {
    "trihedral": targets.trihedral(),
    "dihedral": targets.dihedral(),
    "dihedral_45": targets.dihedral(np.pi / 4),
    "dipole_h": targets.dipole(0.0),
    "dipole_v": targets.dipole(np.pi / 2),
    "left_helix": targets.helix("left"),
    "right_helix": targets.helix("right"),
}
"""Targets of the matched filter."""
MOST = 1000
"""Detections that are listed, the strongest first; the stage marks all."""


@dataclass(frozen=True)
class Detection:
    """Neighbouring pixels above their thresholds, by the strongest of them."""

    x_m: float | None
    """Along the rail; None in an imported image."""
    y_m: float | None
    """Away from the rail; None in an imported image."""
    row: int
    column: int
    over_threshold_db: float
    pixels: int


@dataclass(frozen=True)
class DetectResult:
    """What was found."""

    products: Path
    detections: tuple[Detection, ...]
    """At most :data:`MOST`, the strongest first."""
    count: int
    """Of all."""
    pixels: int
    """Above their thresholds."""
    expected_false_pixels: float
    """The set rate times the pixels that have a threshold."""
    looks: float
    note: str


def detect(
    products_path: Path | str,
    *,
    power: str = "whitened",
    target: str = "trihedral",
    kind: Kind = "ca",
    false_alarm: float = 1e-6,
    ring: Ring | None = None,
    looks: float | None = None,
) -> DetectResult:
    """Detect targets in the image of stage "matrices" or "calibration".

    Writes stage "detection": ``ratio`` (rows, columns) float32, pixel over threshold, NaN where there is none;
    ``detected`` uint8; ``x_m`` and ``y_m`` of an image on the ground. The clutter of the whitening and the matched
    filter is the mean matrix of each pixel's ring.

    Args:
        products_path: products file.
        power: one of :data:`POWERS`.
        target: of the matched filter, one of :data:`TARGETS`.
        kind: ``"ca"`` or ``"os"``, see :mod:`processing.polarimetry.detection.cfar`.
        false_alarm: probability that a pixel of clutter is detected.
        ring: where clutter is looked at.
        looks: equivalent looks of the power; None: of scattering matrices 1 (whitened 3), else estimated in the image.

    Raises:
        PolfuseError: an unknown power or target, or stages or channels that are missing.
        DataError: a rate, ring or number of looks that cannot be.
    """
    if power not in POWERS or target not in TARGETS:
        wrong, allowed = (power, POWERS) if power not in POWERS else (target, tuple(TARGETS))
        raise PolfuseError(f"there is no {wrong!r}", where="detect", advice=f"choose from {', '.join(allowed)}")
    ring = Ring() if ring is None else ring
    products = Products(products_path)
    image = polarimetric_image(products)
    intensity = _power(image, power, target, ring)
    note = ""
    if looks is None:
        looks = (3.0 if power == "whitened" else 1.0) if image.matrix == "S2" else estimated_looks(intensity)
        if image.matrix == "S2" and power == "span":
            note = "the span has 1 to 3 looks: with 1, false alarms are rarer than set"
        elif image.matrix != "S2":
            note = f"{looks:.1f} looks were estimated in the image; give --looks where they are known"
    ratio = cfar(intensity, false_alarm=false_alarm, looks=looks, ring=ring, kind=kind)
    detected = ratio > 1
    detections, count = _grouped(ratio, detected, image.axes)
    settings: dict[str, Any] = {
        "power": power,
        **({"target": target} if power == "matched" else {}),
        "kind": kind,
        "false_alarm": false_alarm,
        "outer": ring.outer,
        "guard": ring.guard,
        "looks": looks,
        "from": image.stage,
        "matrix": image.matrix,
        "detections": count,
    }
    arrays: dict[str, NDArray[Any]] = {
        "ratio": ratio.astype(np.float32),
        "detected": detected.astype(np.uint8),
        **image.axes,
    }
    products.write(
        "detection", arrays, settings=settings, inputs=[products.path], units=dict.fromkeys(image.axes, "m")
    )  # fmt: skip
    return DetectResult(
        products=products.path,
        detections=detections,
        count=count,
        pixels=int(detected.sum()),
        expected_false_pixels=false_alarm * float(np.isfinite(ratio).sum()),
        looks=looks,
        note=note,
    )


def detection_figure(products: Products) -> Figure:
    """How far pixels are above or below their thresholds, with the detections ringed."""
    arrays, settings = products.read("detection"), products.settings("detection")
    what = f"matched to {settings['target']}" if settings["power"] == "matched" else settings["power"]
    kind = str(settings["kind"]).upper()
    title = f"{what}, {kind}-CFAR at {settings['false_alarm']:g}: {settings['detections']} detections"
    figure = style.new_figure(7.0, 5.4, title=title)
    axes = figure.add_subplot()
    with np.errstate(divide="ignore", invalid="ignore"):
        level = 10 * np.log10(arrays["ratio"])
    ground = "x_m" in arrays
    x, y = (arrays["x_m"], arrays["y_m"]) if ground else (None, None)
    picture = style.image(axes, np.maximum(level, -60), x, y, low=-30, high=10, colours=style.SEQUENTIAL)
    style.colour_bar(picture, axes, "dB above the threshold", extend="both")
    if ground:
        style.metres(axes)
    else:
        axes.set(xlabel="column", ylabel="row")
    found, _ = _grouped(arrays["ratio"], arrays["detected"] > 0, {n: arrays[n] for n in ("x_m", "y_m") if ground})
    places = [(d.x_m, d.y_m) if ground else (d.column, d.row) for d in found]
    if places:
        axes.plot(*zip(*places, strict=True), "o", fillstyle="none", color="#56B4E9", markersize=7)
    return figure


def _power(image: PolarimetricImage, power: str, target: str, ring: Ring) -> NDArray[np.float64]:
    planes = image.coherency()
    if power == "span":
        return total_power(planes)
    clutter = ring_average(planes, ring)
    if power == "whitened":
        return whitened(planes, clutter)
    return matched(planes, clutter, pauli_of_matrix(TARGETS[target]))


def _grouped(
    ratio: NDArray[Any], detected: NDArray[np.bool_], axes: dict[str, NDArray[Any]]
) -> tuple[tuple[Detection, ...], int]:
    labels, count = ndimage.label(detected, structure=np.ones((3, 3)))
    if not count:
        return (), 0
    numbers = np.arange(1, count + 1)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    peaks = np.array(ndimage.maximum_position(np.nan_to_num(ratio), labels, numbers))
    levels = 10 * np.log10(ratio[tuple(peaks.T)].astype(np.float64))
    found = []
    for n in np.argsort(-levels, kind="stable")[:MOST]:
        row, column = (int(value) for value in peaks[n])
        x = float(axes["x_m"][column]) if axes else None
        y = float(axes["y_m"][row]) if axes else None
        found.append(Detection(x, y, row, column, float(levels[n]), int(sizes[n])))
    return tuple(found), int(count)
