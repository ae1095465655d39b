"""Pictures of polarimetry and fusion: Pauli composite, fused vector, classes, and the radar in the camera's view."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from polfuse_lab.products import style
from polfuse_lab.products.fused_colours import colour_of_class, fused_colours_figure, largest_shown
from polfuse_lab.products.optics import pinhole_of
from polfuse_lab.products.pauli_space import class_names, load_space, space_figure
from polfuse_lab.products.places import Places
from polfuse_lab.products.store import Products
from processing.optics.camera_model import Pinhole
from processing.polarimetry.pauli import display_components, lexicographic_vector, matrix_of_pauli

Floats = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]

SPAN_DB = 35.0
"""From full colour to black, dB."""
PANEL_SPAN_DB = 45.0
"""Span of the single components, dB; crosstalk of a strong target shows at its lower end."""
LABELS = {
    "even bounce": "|HH−VV| / norm",
    "cross-polarized": "|HV| / norm",
    "odd bounce": "|HH+VV| / norm",
    "DOLP": "DOLP (camera)",
}


def draw_all(products: Products, path: Path | str) -> list[Path]:
    """Draw every picture of a fused products file.

    Args:
        products: file with the stage "fusion" and those that it was made from.
        path: where the fused vector goes; the others stand beside it with suffixes ``_pauli``, ``_lexicographic``,
            ``_colours``, ``_classes``, ``_space`` and ``_overlay``.

    Returns:
        Paths, the fused vector first.
    """
    path = Path(path)
    polarimetry, fusion, settings = products.read("polarimetry"), products.read("fusion"), products.settings("fusion")
    figures = {
        "": fused_figure(fusion, settings["features"]),
        "_pauli": pauli_figure(polarimetry),
        "_lexicographic": lexicographic_figure(polarimetry),
        "_colours": fused_colours_figure(fusion),
        "_classes": class_figure(fusion, settings),
        "_space": space_figure(load_space(products)),
        "_overlay": both_figure(products),
    }
    return [
        style.save(figure, path.with_name(f"{path.stem}{suffix}{path.suffix}")) for suffix, figure in figures.items()
    ]


def both_figure(products: Products) -> Figure:
    """The radar in the camera's view; on the ground where both pictures are there already (a simulation's).

    Args:
        products: file with the stage "fusion" and what it was made from.
    """
    polarimetry, fusion, settings = products.read("polarimetry"), products.read("fusion"), products.settings("fusion")
    if settings.get("registration") == "identity":
        return ground_overlay_figure(polarimetry, fusion)
    # The fusion may have had a lens of its own.
    camera = pinhole_of(settings if settings.get("camera") else products.settings("optics"))
    flat = not settings.get("relief") and not settings.get("registration_shift_px")
    plane = float(settings["z_m"]) if flat else None
    return overlay_figure(products.read("optics"), polarimetry, fusion, camera, plane)


def pauli_rgb(k: ArrayLike, *, span_db: float = SPAN_DB) -> Floats:
    """Pauli composite, (ny, nx, 3) in [0, 1]: R, G, B = |HH-VV|, |HV|, |HH+VV|; see :func:`composite`."""
    return composite(display_components(k), span_db=span_db)


def composite(components: Floats, *, span_db: float = SPAN_DB) -> Floats:
    """Three amplitudes (3, ny, nx) as red, green and blue (ny, nx, 3) in [0, 1], in dB on one common scale.

    One scale for the three keeps the colours' meaning: equal amplitudes give grey. Undefined pixels are NaN.
    """
    top = np.nanmax(components, initial=0.0)
    if top <= 0:
        return np.where(np.isfinite(components), 0.0, np.nan).transpose(1, 2, 0)
    level = style.decibels(components, reference=float(top))
    scaled = np.clip(1 + np.where(components == 0, -np.inf, level) / span_db, 0, 1)
    return np.where(np.isfinite(components), scaled, np.nan).transpose(1, 2, 0)


def pauli_figure(polarimetry: Arrays) -> Figure:
    """The Pauli composite over the ground and its three components.

    Args:
        polarimetry: arrays of the stage "polarimetry".
    """
    names = ("|HH−VV|: even bounce", "|HV|: turned, volume", "|HH+VV|: odd bounce")
    title = "Pauli components (complex amplitudes)"
    return _components_figure(polarimetry, display_components(polarimetry["pauli"]), names, title)


def lexicographic_figure(polarimetry: Arrays) -> Figure:
    """The lexicographic composite over the ground and its components |HH|, sqrt 2 |HV| and |VV|.

    Args:
        polarimetry: arrays of the stage "polarimetry".
    """
    s = matrix_of_pauli(polarimetry["pauli"])
    components = np.abs(lexicographic_vector(s[..., 0, 0], s[..., 0, 1], s[..., 1, 1]))
    return _components_figure(polarimetry, components, ("|HH|", "√2 |HV|", "|VV|"), "Lexicographic components")


def _components_figure(polarimetry: Arrays, components: Floats, names: tuple[str, ...], title: str) -> Figure:
    x, y = polarimetry["x_m"], polarimetry["y_m"]
    figure, axes = _ground_panels(x, y, title)
    style.image(axes.flat[0], _grey(composite(components)), x, y)
    style.panel(axes.flat[0], f"as R, G, B ({SPAN_DB:.0f} dB)")
    top = float(np.ceil(np.nanmax(style.decibels(components)))) if np.any(components > 0) else 0.0
    for panel, values, name in zip(axes.flat[1:], components, names, strict=True):
        picture = style.db_image(panel, values, x, y, span_db=PANEL_SPAN_DB, top_db=top)
        style.panel(panel, name)
    style.colour_bar(picture, list(axes.flat), "dB over 1 m", extend="min")
    _ground_labels(axes)
    return figure


def fused_figure(fusion: Arrays, names: list[str]) -> Figure:
    """The four components of the fused vector on the ground; grey where one is undefined.

    Args:
        fusion: arrays of the stage "fusion".
        names: of the components, as in the stage's settings.
    """
    x, y = fusion["x_m"], fusion["y_m"]
    figure, axes = _ground_panels(x, y, "Fused vector of radar and camera")
    for panel, values, name in zip(axes.flat, fusion["features"], names, strict=True):
        camera = name == "DOLP"
        high = largest_shown(values) if camera else 1.0
        picture = style.image(panel, values, x, y, low=0.0, high=high, colours="cividis" if camera else style.FRACTION)
        figure.colorbar(picture, ax=panel, label=LABELS.get(name, name), location="bottom", shrink=0.9, pad=0.02)
        style.panel(panel, name)
    _ground_labels(axes)
    return figure


def class_figure(fusion: Arrays, settings: Mapping[str, Any]) -> Figure:
    """Map of the classes with a legend, and where they lie between DOLP and even bounce.

    Args:
        fusion: arrays of the stage "fusion".
        settings: of that stage.
    """
    x, y, labels = fusion["x_m"], fusion["y_m"], fusion["classes"].astype(np.float64)
    aspect = float(np.ptp(y)) / float(np.ptp(x))
    figure = style.new_figure(10.4, float(np.clip(5.4 * aspect + 1.3, 4.4, 6.4)), title="Classes of the fused vector")
    on_ground, in_features = figure.subplots(1, 2, width_ratios=(1.35, 1))
    count = int(fusion["classes"].max()) + 1
    colours = [colour_of_class(i) for i in range(count)]
    colour_map = ListedColormap(colours).with_extremes(bad=style.UNDEFINED)
    half_x, half_y = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    on_ground.imshow(
        np.where(labels < 0, np.nan, labels),
        origin="lower",
        extent=(x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y),
        cmap=colour_map,
        norm=BoundaryNorm(np.arange(count + 1) - 0.5, count),
        interpolation="nearest",
    )
    style.metres(on_ground)
    style.panel(on_ground, "on the ground")
    # A class too small for statistics has no summary, but its pixels are on the map.
    known = {name: settings["classes"].get(name) for name in class_names(settings, fusion["classes"])[:count]}
    handles = [
        Patch(color=colour, label=name if item is None else f"{name}: {item['mechanism']}, {item['pixels']} px")
        for colour, (name, item) in zip(colours, known.items(), strict=True)
    ]
    handles.append(Patch(color=style.UNDEFINED, label="undefined, noise or side lobes"))
    even, dolp = fusion["features"][0], fusion["features"][3]
    for label, colour in enumerate(colours):
        members = fusion["classes"] == label
        in_features.plot(even[members], dolp[members], ".", color=colour, markersize=2.5, alpha=0.4, rasterized=True)
    in_features.set_xlabel(LABELS["even bounce"])
    in_features.set_ylabel("DOLP")
    in_features.set_xlim(0, 1)
    in_features.set_ylim(bottom=0)
    in_features.grid(alpha=0.3)
    style.panel(in_features, "in the fused vector")
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def overlay_figure(optics: Arrays, polarimetry: Arrays, fusion: Arrays, camera: Pinhole, z_m: float | None) -> Figure:
    """The camera's S0 with the Pauli composite laid over the ground, as opaque as the radar return is strong.

    Args:
        optics: arrays of the stage "optics".
        polarimetry: arrays of the stage "polarimetry".
        fusion: arrays of the stage "fusion".
        camera: the camera.
        z_m: height of the ground plane, m; None where the ground is no plane, or the picture was shifted: each camera
            pixel shows the radar's that was registered nearest to it then.
    """
    x, y = polarimetry["x_m"], polarimetry["y_m"]
    colour = np.nan_to_num(pauli_rgb(polarimetry["pauli"]))
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    if z_m is None:
        i, j = Places(fusion).pixels(columns, rows)
    else:
        ground = camera.on_plane(columns, rows, z_m)
        j, i = _nearest(ground[..., 0], x), _nearest(ground[..., 1], y)
    on_grid = (j >= 0) & (i >= 0)
    seen = colour[np.maximum(i, 0), np.maximum(j, 0)]
    hue, opacity = _hue_and_opacity(seen)
    opacity = np.where(on_grid, opacity, 0.0)

    title = "Radar in the camera's view"
    figure = style.new_figure(9.2, 8.0 * camera.height_px / camera.width_px + 1.0, title=title)
    axes = figure.subplots()
    shade = np.asarray(optics["s0"], dtype=np.float64)
    picture = style.image(axes, shade, low=0.0, high=largest_shown(shade), colours="gray")
    axes.imshow(np.dstack([hue, opacity]), interpolation="nearest", origin="upper")
    style.colour_bar(picture, axes, "S0 [counts]", extend="max")
    if z_m is not None:
        _range_lines(axes, camera, x, y, z_m)
    axes.set_xlim(-0.5, camera.width_px - 0.5)
    axes.set_ylim(camera.height_px - 0.5, -0.5)
    axes.set_xlabel("column")
    axes.set_ylabel("row")
    fused = np.isfinite(fusion["features"][0])
    error = float(np.median(fusion["registration_error_px"][fused])) if fused.any() else float("nan")
    style.panel(axes, f"red |HH−VV|, green |HV|, blue |HH+VV|; registration error {error:.1f} px (median sd)")
    return figure


def ground_overlay_figure(polarimetry: Arrays, fusion: Arrays) -> Figure:
    """The camera's S0 on the ground with the Pauli composite laid over it, as opaque as the radar return is strong.

    Args:
        polarimetry: arrays of the stage "polarimetry".
        fusion: arrays of the stage "fusion".
    """
    x, y = fusion["x_m"], fusion["y_m"]
    hue, opacity = _hue_and_opacity(np.nan_to_num(pauli_rgb(polarimetry["pauli"])))
    aspect = float(np.ptp(y)) / float(np.ptp(x))
    figure = style.new_figure(
        9.2, float(np.clip(8.0 * aspect + 1.0, 3.5, 11.0)), title="Radar and camera on the ground"
    )
    axes = figure.subplots()
    shade = np.asarray(fusion["s0_on_ground"], dtype=np.float64)
    picture = style.image(axes, shade, x, y, low=0.0, high=largest_shown(shade), colours="gray")
    style.image(axes, np.dstack([hue, opacity]), x, y)
    style.colour_bar(picture, axes, "S0 [of white in the sun]", extend="max")
    style.metres(axes, x="x [m]", y="y [m]")
    style.panel(axes, "red |HH−VV|, green |HV|, blue |HH+VV|; both simulated on one ground grid")
    return figure


def _hue_and_opacity(colour: Floats) -> tuple[Floats, Floats]:
    """Full colour at its own hue, and the return's strength as opacity."""
    strength = colour.max(axis=-1)
    return colour / np.maximum(strength, 1e-9)[..., None], 0.75 * np.clip((strength - 0.3) / 0.7, 0, 1)


def _range_lines(axes: Axes, camera: Pinhole, x: NDArray[Any], y: NDArray[Any], z_m: float) -> None:
    """Lines of equal ground range, labelled in metres."""
    step = 1.0 if np.ptp(y) <= 8 else 2.0 if np.ptp(y) <= 20 else 5.0
    labelled = np.inf
    for ground_range in np.arange(np.ceil(y[0] / step) * step, y[-1] + 1e-9, step):
        along = np.linspace(x[0], x[-1], 50)
        points = np.stack([along, np.full(50, ground_range), np.full(50, z_m)], axis=-1)
        u, v, _ = camera.project(points)
        inside = camera.inside(u, v)
        if not inside.any():
            continue
        axes.plot(u[inside], v[inside], color="white", linewidth=0.6, alpha=0.55)
        last = np.flatnonzero(inside)[-1]
        if labelled - v[last] < 0.035 * camera.height_px:
            continue
        labelled = float(v[last])
        axes.text(u[last] - 3, v[last] - 3, f"{ground_range:.0f} m", color="white", fontsize="x-small", ha="right")


def _nearest(values: Floats, axis: NDArray[Any]) -> NDArray[np.int64]:
    """Index of the nearest point of a uniform axis; -1 outside it and for NaN."""
    position = np.rint((values - axis[0]) / (axis[1] - axis[0]))
    good = np.isfinite(position) & (position >= 0) & (position < len(axis))
    return np.where(good, np.nan_to_num(position), -1).astype(np.int64)


def _grey(rgb: Floats) -> Floats:
    """Undefined pixels in the house's grey."""
    return np.where(np.isfinite(rgb).all(axis=-1, keepdims=True), rgb, float(style.UNDEFINED))


def _ground_panels(x: NDArray[Any], y: NDArray[Any], title: str) -> tuple[Figure, NDArray[Any]]:
    """A figure with four ground pictures of equal scales, side by side where the ground is deeper than wide."""
    aspect = float(np.ptp(y)) / float(np.ptp(x))
    rows, columns = (1, 4) if aspect > 1.2 else (2, 2)
    width_in = 10.4
    height_in = rows * (0.79 * width_in / columns * aspect + 0.6) + 0.8
    figure = style.new_figure(width_in, float(np.clip(height_in, 3.2, 11.0)), title=title)
    return figure, figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)


def _ground_labels(axes: NDArray[Any]) -> None:
    for row in axes:
        for panel in row:
            style.metres(panel, x="", y="")
            panel.xaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))
        row[0].set_ylabel("ground range y [m]")
    for panel in axes[-1]:
        panel.set_xlabel("along the rail x [m]")
