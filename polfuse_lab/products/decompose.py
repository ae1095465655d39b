"""Decompositions of a polarimetric image: a stage ``"decomposition_<method>"`` of the products file for each method."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.polsarpro import write_config, write_plane
from polfuse_lab.products import decompose_classes
from polfuse_lab.products.decompose_options import (
    FILTERS,
    Found,
    Method,
    Named,
    Options,
    Region,
    averaged,
    looks_before,
)
from polfuse_lab.products.polarimetric_image import PolarimetricImage, polarimetric_image
from polfuse_lab.products.store import Products
from processing.polarimetry import coherent, freeman, h_a_alpha, touzi, yamaguchi
from processing.polarimetry.entropy_bias import entropy_bias
from processing.polarimetry.matrices import covariance_of_coherency, matrix_of_planes, total_power
from processing.polarimetry.pauli import equivalent_dolp
from processing.polarimetry.signatures import kennaugh_of_coherency
from processing.polarimetry.window_planner import WindowChoice, choose_window


@dataclass(frozen=True)
class DecomposeResult:
    """What was made."""

    products: Path
    stage: str
    window: int
    planes: dict[str, dict[str, float | None]]
    """Median, minimum and maximum of each plane over its defined pixels; None where there is none."""
    files: tuple[Path, ...]
    """Written to the folder."""
    note: str
    """What a reader of the numbers should know, or empty."""
    explanation: tuple[str, ...] = ()
    """Why this window, where a tolerance chose it."""


def _span(image: PolarimetricImage, options: Options) -> Named:
    return {"span": total_power(averaged(image, options))}


def _pauli(image: PolarimetricImage, options: Options) -> Named:
    t = averaged(image, options)
    return {"odd_bounce": t[0], "even_bounce": t[5], "cross_polarized": t[8]}


def _lexicographic(image: PolarimetricImage, options: Options) -> Named:
    c = covariance_of_coherency(averaged(image, options))
    return {"hh": c[0], "hv2": c[5], "vv": c[8]}


def _krogager(image: PolarimetricImage, options: Options) -> Named:
    sphere, diplane, helix, orientation = coherent.krogager(np.moveaxis(_two_by_two(image), (0, 1), (-2, -1)))
    powers = {"sphere": sphere**2, "diplane": diplane**2, "helix": helix**2}
    return {**powers, "orientation_deg": np.degrees(orientation)}


def _cameron(image: PolarimetricImage, options: Options) -> Named:
    kind, symmetry, orientation, ratio = coherent.cameron(image.scattering_matrices())
    angles = {"symmetry_deg": np.degrees(symmetry), "orientation_deg": np.degrees(orientation)}
    return {"class": kind, **angles, "ratio": ratio}


def _two_by_two(image: PolarimetricImage) -> NDArray[np.complex128]:
    hh, hv, vh, vv = image.scattering_matrices().astype(np.complex128)
    return np.array([[hh, vh], [hv, vv]])


def _freeman(image: PolarimetricImage, options: Options) -> Named:
    return dict(zip(freeman.COMPONENTS, freeman.freeman_durden(averaged(image, options)), strict=True))


def _yamaguchi(image: PolarimetricImage, options: Options) -> Named:
    powers = yamaguchi.yamaguchi(averaged(image, options), options.model)
    return dict(zip(yamaguchi.COMPONENTS, powers, strict=True))


def _h_a_alpha(image: PolarimetricImage, options: Options) -> Named:
    found = dict(zip(h_a_alpha.PARAMETERS, h_a_alpha.h_a_alpha(averaged(image, options)), strict=True))
    values = np.stack([found["lambda1"], found["lambda2"], found["lambda3"]])
    for name in ("alpha", "alpha1"):
        found[f"{name}_deg"] = np.degrees(found.pop(name))
    if options.looks >= 3:
        found["entropy_bias"] = entropy_bias(values, options.looks)
    return found


def _touzi(image: PolarimetricImage, options: Options) -> Named:
    found = touzi.touzi(averaged(image, options))
    return {f"{name}_deg": np.degrees(plane) for name, plane in zip(touzi.PARAMETERS, found, strict=True)}


def _kennaugh(image: PolarimetricImage, options: Options) -> Named:
    matrix = matrix_of_planes(averaged(image, options))
    kennaugh = kennaugh_of_coherency(matrix)
    planes = {f"k{i}{j}": kennaugh[..., i, j] for i in range(4) for j in range(i, 4)}
    return {**planes, "dolp": equivalent_dolp(matrix)}


METHODS = {
    "span": Method("total power", _span, 1),
    "pauli": Method("odd bounce, even bounce, cross-polarized", _pauli, 1),
    "lexicographic": Method("HH, 2 HV, VV", _lexicographic, 1),
    "krogager": Method("sphere, diplane, helix", _krogager, 1, coherent=True),
    "cameron": Method("classes of symmetric targets", _cameron, 1, coherent=True),
    "freeman": Method("surface, double bounce, volume (Freeman and Durden)", _freeman, 5),
    "yamaguchi": Method("surface, double bounce, volume, helix", _yamaguchi, 5),
    "h-a-alpha": Method("entropy, anisotropy, alpha (Cloude and Pottier)", _h_a_alpha, 5),
    "touzi": Method("scattering type, its phase, helicity, orientation", _touzi, 5),
    "kennaugh": Method("Kennaugh matrix and the DOLP that natural light would show", _kennaugh, 5),
    "zones": Method("zones of entropy and alpha", decompose_classes.zones, 5),
    "wishart": Method("Wishart classes, from the zones of entropy and alpha", decompose_classes.wishart, 5),
    "whitening": Method("the intensity with the least speckle", decompose_classes.whitening, 9),
    "signature": Method("co- and cross-polarized signature of a region", decompose_classes.signatures, 1),
}
"""Every method by its name on the command line."""

FILES = {
    "freeman": ("Freeman_Odd", "Freeman_Dbl", "Freeman_Vol"),
    "yamaguchi": ("Yamaguchi4_Odd", "Yamaguchi4_Dbl", "Yamaguchi4_Vol", "Yamaguchi4_Hlx"),
    "krogager": ("Krogager_Ks", "Krogager_Kd", "Krogager_Kh"),
}
"""Names of the first planes of a method in PolSARpro; others are called as in the products file, without the unit."""


def decompose(
    products_path: Path | str,
    method: str,
    *,
    window: int | None = None,
    model: yamaguchi.Model = "rotated",
    looks: float | None = None,
    folder: Path | str | None = None,
    speckle_filter: str | None = None,
    filter_looks: float | None = None,
    region: Region | None = None,
    tolerance_db: float | None = None,
) -> DecomposeResult:
    """Decompose the image of stage "matrices" or "calibration".

    Writes stage "decomposition_<method>" (``-`` as ``_``): one float32 array (rows, columns) for each plane, angles in
    degrees, powers in m^2, and ``x_m``, ``y_m`` where the image lies on the ground. Undefined pixels are NaN.

    Args:
        products_path: products file.
        method: one of :data:`METHODS`.
        window: odd width of the average, pixels; None: the method's own.
        model: variant of Yamaguchi's decomposition.
        looks: independent looks in an average, for the bias of entropy; None: one for each pixel of the window, which
            is too many where pixels are correlated, so that the bias is then a lower bound.
        folder: also write the planes there, as PolSARpro does: ``.bin``, ``.bin.hdr``, ``config.txt``.
        speckle_filter: one of :data:`~polfuse_lab.products.decompose_options.FILTERS`; None: boxcar.
        filter_looks: looks of the image before the filter; None: 1 of scattering matrices, else estimated.
        region: of the method "signature": first and last x, first and last y, m (columns and rows of an imported
            image); None: the whole image.
        tolerance_db: largest error that speckle may leave in the averaged matrices, dB; chooses the boxcar's window.

    Raises:
        PolfuseError: an unknown method or filter, a window or filter for a method that takes none, stages or channels
            that are missing, an empty region, or a folder that cannot be written.
        DataError: a window that the filter cannot have, looks that cannot be estimated, or a tolerance that is no
            negative number.
    """
    if method not in METHODS:
        raise PolfuseError(
            f"there is no method {method!r}", where="decompose", advice=f"choose from {', '.join(METHODS)}"
        )
    known = METHODS[method]
    if speckle_filter is not None and speckle_filter not in FILTERS:
        raise PolfuseError(
            f"there is no filter {speckle_filter!r}", where="decompose", advice=f"choose from {', '.join(FILTERS)}"
        )
    width = known.window
    if speckle_filter is not None and (speckle_filter != "boxcar" or width == 1):
        width = FILTERS[speckle_filter]
    width = width if window is None else window
    if (known.coherent or method == "signature") and (width != 1 or speckle_filter is not None):
        raise PolfuseError(
            f"{method} takes {'the mean of a region' if method == 'signature' else 'single scattering matrices'}, "
            "no average",
            where="decompose",
            advice="leave --window and --filter out, or take another method",
        )
    if region is not None and method != "signature":
        raise PolfuseError(f"{method} takes the whole image", where="decompose", advice="leave --region out")
    products = Products(products_path)
    image = polarimetric_image(products)
    chosen = speckle_filter or "boxcar"
    choice: WindowChoice | None = None
    if tolerance_db is not None:
        if window is not None or chosen != "boxcar" or known.coherent or method == "signature":
            raise PolfuseError(
                "a tolerance chooses the window of the boxcar average",
                where="decompose",
                advice="leave --window and --filter out, and take a method that averages",
            )
        before = looks_before(image, Options(filter_looks=filter_looks))
        choice = choose_window(image.coherency(), tolerance_db, looks=before)
        width = choice.window
    options = Options(width, model, float(width**2 if looks is None else looks), chosen, filter_looks, region)
    if chosen != "boxcar" and width > 1:
        options = replace(options, filter_looks=looks_before(image, options))
    answer = known.compute(image, options)
    answer = answer if isinstance(answer, Found) else Found(answer)
    found = {name: np.asarray(plane, dtype=np.float32) for name, plane in answer.planes.items()}
    axes = image.axes if answer.axes is None else answer.axes
    stage = f"decomposition_{method.replace('-', '_')}"
    settings = {
        "method": method,
        "window": width,
        "matrix": image.matrix,
        "from": image.stage,
        "planes": list(found),
        **({"filter": chosen, "filter_looks": options.filter_looks} if width > 1 else {}),
        **({"model": model} if method == "yamaguchi" else {}),
        **({"looks": options.looks} if method == "h-a-alpha" else {}),
        **({"classes": list(coherent.CLASSES)} if method == "cameron" else {}),
        **({} if choice is None else _told(choice, tolerance_db)),
        **answer.settings,
    }
    units = {name: unit for name in found if (unit := _unit(name))}
    units |= {name: "degrees" if name.endswith("_deg") else "m" for name in axes}
    products.write(stage, {**found, **axes}, settings=settings, inputs=[products.path], units=units)
    files = () if folder is None else tuple(_write_planes(Path(folder), method, found))
    return DecomposeResult(
        products=products.path,
        stage=stage,
        window=width,
        planes={name: _statistics(plane) for name, plane in found.items()},
        files=files,
        note=answer.note or _note(method, found, options),
        explanation=() if choice is None else tuple(choice.explain()),
    )


def _told(choice: WindowChoice, tolerance_db: float | None) -> dict[str, Any]:
    """The choice and what it foretells, for the product."""
    return {
        "tolerance_db": tolerance_db,
        "predicted_error_db": choice.predicted_error_db,
        "reason": choice.reason,
    }


def _unit(name: str) -> str:
    if name.endswith("_deg"):
        return "degrees"
    return "" if name in ("entropy", "anisotropy", "entropy_bias", "class", "ratio", "dolp") else "m^2"


def _statistics(plane: NDArray[np.float32]) -> dict[str, float | None]:
    values = plane[np.isfinite(plane)]
    if not values.size:
        return {"median": None, "min": None, "max": None}
    return {"median": float(np.median(values)), "min": float(values.min()), "max": float(values.max())}


def _write_planes(folder: Path, method: str, found: Named) -> list[Path]:
    names = list(found)
    stems = [*FILES.get(method, ()), *(n.removesuffix("_deg") for n in names[len(FILES.get(method, ())) :])]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = [write_config(folder, *found[names[0]].shape)]
        for name, stem in zip(names, stems, strict=True):
            files += write_plane(folder, stem, found[name])
    except OSError as error:
        raise PolfuseError(
            f"cannot be written ({error.strerror})", where=str(folder), advice="check the folder and the disk's space"
        ) from error
    return files


def _note(method: str, found: Named, options: Options) -> str:
    if method != "h-a-alpha":
        return ""
    if options.looks < 3:
        return "of fewer than 3 looks entropy is far too low: its values say nothing about the target"
    bias = _statistics(found["entropy_bias"])["median"]
    return "" if bias is None else (
        f"entropy is too low by {bias:.3f} (median) with {options.looks:g} looks, more if pixels are correlated"
    )  # fmt: skip
