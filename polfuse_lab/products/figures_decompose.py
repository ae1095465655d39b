"""Pictures of decompositions: composites of powers, the plane of entropy and alpha with its zones, signatures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from polfuse_lab.products import style
from polfuse_lab.products.store import Products
from processing.polarimetry.signatures import Signature
from processing.polarimetry.zones import ALPHAS_DEG, ENTROPIES

Arrays = dict[str, NDArray[Any]]

SPAN_DB = 30.0
"""From the brightest to the darkest colour of a power, dB."""
COMPOSITES = {
    "freeman": ("double_bounce", "volume", "surface"),
    "yamaguchi": ("double_bounce", "volume", "surface"),
    "pauli": ("even_bounce", "cross_polarized", "odd_bounce"),
    "lexicographic": ("hh", "hv2", "vv"),
    "krogager": ("diplane", "helix", "sphere"),
}
"""Planes shown as red, green and blue."""
RANGES = {
    "entropy": (0.0, 1.0), "anisotropy": (0.0, 1.0), "alpha_deg": (0.0, 90.0), "alpha1_deg": (0.0, 90.0),
    "alpha_s_deg": (0.0, 90.0), "dolp": (0.0, 1.0), "ratio": (0.0, 1.0), "symmetry_deg": (0.0, 45.0),
}  # fmt: skip
"""Scales that a plane's meaning gives; angles with a sign are shown over +-45, +-90 or +-180 degrees."""
SIGNED = {"tau_deg": 45.0, "psi_deg": 45.0, "phi_s_deg": 180.0, "orientation_deg": 90.0}
SHOWN = {
    "h-a-alpha": ("entropy", "anisotropy", "alpha_deg"),
    "touzi": ("alpha_s_deg", "phi_s_deg", "tau_deg", "psi_deg"),
    "kennaugh": ("k00", "dolp"),
    "cameron": ("symmetry_deg", "orientation_deg"),
    "zones": ("entropy", "alpha_deg"),
    "wishart": (),
}
"""Planes in a picture, where not all are."""
ZONES = tuple(
    ((low, high), (alpha, alpha))
    for low, high, alphas in zip((0.0, *ENTROPIES), (*ENTROPIES, 1.0), ALPHAS_DEG, strict=True)
    for alpha in alphas
) + tuple(((h, h), (0.0, 90.0)) for h in ENTROPIES)
"""Borders of the zones in the plane of entropy and alpha (degrees), as lines."""
ZONE_NAMES = (
    (0.25, 20, "surface"), (0.25, 45, "dipole"), (0.25, 68, "double\nbounce"), (0.7, 20, "rough\nsurface"),
    (0.7, 45, "vegetation"), (0.7, 68, "double bounce,\nbranches"), (0.95, 47.5, "volume"),
    (0.95, 72, "branches,\ncrowns"),
)  # fmt: skip


def draw_all(products: Products, stage: str, path: Path | str) -> list[Path]:
    """Draw the pictures of a stage "decomposition_...": ``path``, and ``_plane`` beside it for entropy and alpha."""
    path = Path(path)
    arrays, settings = products.read(stage), products.settings(stage)
    if settings["method"] == "signature":
        return [style.save(signature_figure(_signature(arrays), title=_region_words(settings)), path)]
    figures = {"": planes_figure(arrays, settings)}
    if settings["method"] in ("h-a-alpha", "zones") and np.isfinite(arrays["entropy"]).any():
        figures["_plane"] = plane_figure(arrays)
    return [style.save(figure, path.with_name(f"{path.stem}{end}{path.suffix}")) for end, figure in figures.items()]


def planes_figure(arrays: Arrays, settings: dict[str, Any]) -> Figure:
    """A composite or class map, and the planes of a method.

    Args:
        arrays: of the stage.
        settings: of the stage.
    """
    method = str(settings["method"])
    names = [str(n) for n in SHOWN.get(method, settings["planes"])]
    extra = method in COMPOSITES or "classes" in settings
    count = len(names) + extra
    columns = 1 if count == 1 else 2
    lines = -(-count // columns)
    rows, cols = arrays[str(settings["planes"][0])].shape
    aspect = _aspect(arrays, rows / cols)
    width = 4.6 * columns if count > 1 or not extra else 7.0
    kind = "average" if settings.get("filter", "boxcar") == "boxcar" else settings["filter"]
    title = f"{method}, {settings['window']} x {settings['window']} {kind}" if settings["window"] > 1 else method
    figure = style.new_figure(width, 0.9 + lines * float(np.clip(3.3 * aspect + 0.3, 1.4, 6.0)), title=title)
    axes = list(figure.subplots(lines, columns, squeeze=False).ravel())
    for unused in axes[count:]:
        unused.set_visible(False)
    if method in COMPOSITES:
        red, green, blue = COMPOSITES[method]
        _show(axes[0], arrays, _composite(np.stack([arrays[n] for n in (red, green, blue)])))
        style.panel(axes[0], f"R {_words(red)}, G {_words(green)}, B {_words(blue)}")
    elif "classes" in settings:
        _classes(figure, axes[0], arrays, [str(n) for n in settings["classes"]])
    top = _top([arrays[n] for n in names if not _scale(n)])
    for panel, name in zip(axes[extra:], names, strict=False):
        _plane(panel, arrays, name, top)
    for number, panel in enumerate(axes[:count]):
        if number % columns:
            panel.set_ylabel("")
    return figure


def plane_figure(arrays: Arrays) -> Figure:
    """How many pixels have which entropy and alpha, with the zones and the border of what can be.

    Args:
        arrays: of the stage of H/A/alpha.
    """
    entropy, alpha = arrays["entropy"].ravel(), arrays["alpha_deg"].ravel()
    sound = np.isfinite(entropy) & np.isfinite(alpha)
    figure = style.new_figure(6.4, 4.8, title="Entropy and alpha")
    axes = figure.add_subplot()
    counts, _, _ = np.histogram2d(alpha[sound], entropy[sound], bins=(180, 200), range=((0, 90), (0, 1)))
    shown = np.ma.masked_equal(counts, 0)
    picture = axes.imshow(
        shown, origin="lower", extent=(0, 1, 0, 90), aspect="auto", cmap=style.FRACTION,
        norm=LogNorm(1, max(counts.max(), 2)),
    )  # fmt: skip
    for horizontal, vertical in ZONES:
        axes.plot(horizontal, vertical, color="black", linewidth=0.9)
    for x, y, text in ZONE_NAMES:
        axes.text(
            x, y, text, ha="center", va="center", fontsize="small",
            bbox={"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 1.0},
        )  # fmt: skip
    for h, a in _borders():
        axes.plot(h, a, color=style.CLASS_COLOURS[5], linewidth=1.4)
    axes.set(xlabel="entropy", ylabel="alpha [degrees]", xlim=(0, 1), ylim=(0, 90))
    figure.colorbar(picture, ax=axes, label="pixels")
    return figure


def signature_figure(signature: Signature, *, title: str = "Polarimetric signature") -> Figure:
    """Co- and cross-polarized power over orientation and ellipticity, as surfaces (thesis Fig. 2.16), of its maximum.

    Args:
        signature: see :func:`processing.polarimetry.signatures.signature`.
        title: what was measured.
    """
    figure = style.new_figure(9.0, 4.4, title=title)
    psi, chi = np.meshgrid(np.degrees(signature.orientation_rad), np.degrees(signature.ellipticity_rad))
    largest = max(float(signature.co.max()), float(signature.cross.max())) or 1.0
    for number, (name, power) in enumerate((("co-polarized", signature.co), ("cross-polarized", signature.cross)), 1):
        axes: Any = figure.add_subplot(1, 2, number, projection="3d")
        axes.plot_surface(
            psi, chi, power / largest, cmap=style.FRACTION, vmin=0, vmax=1, rcount=46, ccount=91, linewidth=0
        )
        axes.set(
            xlabel="orientation [°]", ylabel="ellipticity [°]", zlim=(0, 1), xticks=[-90, -45, 0, 45, 90],
            yticks=[-45, 0, 45], zlabel="power over the largest", title=name,
        )  # fmt: skip
        axes.view_init(28, -60)
        axes.set_box_aspect(None, zoom=0.86)
    return figure


def _signature(arrays: Arrays) -> Signature:
    orientation, ellipticity = (np.radians(arrays[f"{name}_deg"]) for name in ("orientation", "ellipticity"))
    return Signature(orientation, ellipticity, arrays["co"], arrays["cross"])


def _region_words(settings: dict[str, Any]) -> str:
    if settings["region"] is None:
        return f"Polarimetric signature, mean of all {settings['pixels']} pixels"
    x0, x1, y0, y1 = settings["region"]
    return f"Polarimetric signature, mean of {settings['pixels']} pixels: x {x0:g} to {x1:g}, y {y0:g} to {y1:g}"


def _borders(points: int = 200) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Least and greatest alpha (degrees) that an entropy allows (Cloude and Pottier 1997)."""
    m = np.linspace(1e-9, 1, points)
    low = np.stack([np.ones_like(m), m, m])
    first = np.linspace(1e-9, 0.5, points // 2)
    left = np.stack([np.zeros_like(first), np.ones_like(first), 2 * first])
    second = np.linspace(0.5, 1, points // 2)
    right = np.stack([2 * second - 1, np.ones_like(second), np.ones_like(second)])
    curves = []
    for values, along in ((low, 0), (np.concatenate([left, right], axis=1), 0)):
        p = values / values.sum(axis=0)
        h = -np.sum(np.where(p > 0, p * np.log(np.where(p > 0, p, 1)), 0), axis=0) / np.log(3)
        curves.append((h, 90 * (1 - p[along])))
    return curves


def _composite(powers: NDArray[Any]) -> NDArray[np.float64]:
    """Powers (3, rows, columns) as colours (rows, columns, 3), in dB on one scale below the 99th percentile."""
    bright = _top(list(powers))
    with np.errstate(divide="ignore"):
        level = 10 * np.log10(np.maximum(powers.astype(np.float64), 0)) - bright
    return np.where(np.isfinite(powers), np.clip(1 + level / SPAN_DB, 0, 1), np.nan).transpose(1, 2, 0)


def _top(planes: list[NDArray[Any]]) -> float:
    """What is shown brightest, dB: a percentile, for single bright points would leave all else dark."""
    values = np.concatenate([np.asarray(p[np.isfinite(p) & (p > 0)], dtype=np.float64) for p in planes] or [np.ones(1)])
    return float(np.ceil(10 * np.log10(np.percentile(values, 99)))) if values.size else 0.0


def _scale(name: str) -> tuple[float, float] | None:
    if name in RANGES:
        return RANGES[name]
    return (-SIGNED[name], SIGNED[name]) if name in SIGNED else None


def _plane(panel: Axes, arrays: Arrays, name: str, top: float) -> None:
    scale = _scale(name)
    if scale is None:
        with np.errstate(divide="ignore"):
            level = 10 * np.log10(np.maximum(arrays[name].astype(np.float64), 0))
        level = np.where(np.isneginf(level), top - 2 * SPAN_DB, level)
        picture = _show(panel, arrays, level, low=top - SPAN_DB, high=top, colours=style.SEQUENTIAL)
        style.colour_bar(picture, panel, "dBsm", extend="both")
    else:
        # Opposite helices are not alike, as the ends of the other angles are.
        colours = style.FRACTION if name in RANGES else style.DIVERGING if name == "tau_deg" else style.CYCLIC
        picture = _show(panel, arrays, arrays[name], low=scale[0], high=scale[1], colours=colours)
        style.colour_bar(picture, panel, "degrees" if name.endswith("_deg") else "")
    style.panel(panel, _words(name))


def _show(panel: Axes, arrays: Arrays, values: NDArray[Any], **options: Any) -> Any:
    if "x_m" in arrays:
        picture = style.image(panel, values, arrays["x_m"], arrays["y_m"], **options)
        style.metres(panel)
        return picture
    picture = style.image(panel, values, **options)
    panel.set(xlabel="column", ylabel="row")
    return picture


def _classes(figure: Figure, panel: Axes, arrays: Arrays, names: list[str]) -> None:
    colours = [style.UNDEFINED, *style.CLASS_COLOURS[:7], "#8B4513", "#FFFFFF", "#999999"][: len(names)]
    kinds = arrays["class"]
    extent: dict[str, Any] = {}
    if "x_m" in arrays:
        x, y = arrays["x_m"], arrays["y_m"]
        extent = {"extent": (x[0], x[-1], y[0], y[-1]), "origin": "lower"}
        style.metres(panel)
    else:
        panel.set_ylabel("row")
    panel.imshow(
        kinds, cmap=ListedColormap(colours), norm=BoundaryNorm(np.arange(len(names) + 1) - 0.5, len(names)),
        interpolation="nearest", **extent,
    )  # fmt: skip
    style.panel(panel, "class")
    present = [n for n in range(len(names)) if (kinds == n).any()]
    handles = [Patch(facecolor=colours[n], edgecolor="0.5", label=names[n]) for n in present]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=4 if figure.get_figwidth() > 8 else 3,
        fontsize="small",
        frameon=False,
    )


def _aspect(arrays: Arrays, of_pixels: float) -> float:
    if "x_m" not in arrays:
        return of_pixels
    return float(np.ptp(arrays["y_m"]) / max(np.ptp(arrays["x_m"]), 1e-9))


def _words(name: str) -> str:
    return {"hv2": "2 HV", "hh": "HH", "vv": "VV"}.get(name, name.removesuffix("_deg").replace("_", " "))
