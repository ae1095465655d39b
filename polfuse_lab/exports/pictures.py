"""Layers as colours: what maps and pictures show."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, PngImagePlugin

from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.layers import Layer, as_colours, layer_of
from polfuse_lab.products import style
from polfuse_lab.products.figures_decompose import COMPOSITES
from polfuse_lab.products.figures_fusion import composite
from polfuse_lab.products.provenance import versions
from polfuse_lab.products.store import Products

SPAN_DB = 50.0
"""From the brightest to the darkest colour of one channel, dB."""


def picture_of(products: Products, name: str | None) -> Layer:
    """A layer as colours with opacity (uint8); undefined pixels are transparent.

    Args:
        products: products file.
        name: of a layer; None: "pauli" where there is a polarimetric image, else "db" (its first channel).

    Raises:
        PolfuseError: no such layer, or one that has no colours.
    """
    if name is None:
        stages = products.stages()
        name = "pauli" if "calibration" in stages or "matrices" in stages else "db"
    layer = layer_of(products, "db" if name == "scattering" else name)
    if layer.values.dtype == np.uint8:
        return layer
    if layer.name in COMPOSITES:
        powers = np.stack([layer.values[layer.bands.index(band)] for band in COMPOSITES[layer.name]])
        colour = composite(np.sqrt(np.where(powers < 0, 0.0, powers)).astype(np.float64))
        return _coloured(layer, colour)
    values = layer.values[0].astype(np.float64)
    if layer.name != "db":
        if not np.isfinite(values).any():
            raise PolfuseError(
                f"layer {layer.name!r} is undefined everywhere", where=layer.where, advice="choose another layer"
            )
        low, high = (float(v) for v in np.nanpercentile(values, [1, 99]))
        colours = style.colour_map(style.FRACTION)
    else:
        high = float(np.ceil(np.nanmax(values))) if np.isfinite(values).any() else 0.0
        low, colours = high - SPAN_DB, style.colour_map(style.SEQUENTIAL)
    share = np.clip((values - low) / max(high - low, 1e-12), 0, 1)
    colour = np.asarray(colours(np.nan_to_num(share)))[..., :3]
    colour[~np.isfinite(values)] = np.nan
    return _coloured(layer, colour)


def png_bytes(values: NDArray[np.uint8], told: dict[str, Any] | None = None) -> bytes:
    """A PNG of colours with opacity (4, rows, columns), with texts; the same input gives the same bytes."""
    info = PngImagePlugin.PngInfo()
    for key, value in (told or {}).items():
        info.add_itxt(key, value if isinstance(value, str) else json.dumps(value))
    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(np.moveaxis(values, 0, -1)), "RGBA").save(stream, "PNG", pnginfo=info)
    return stream.getvalue()


def provenance_words(products: Products, layer: Layer) -> dict[str, Any]:
    """What a picture should be able to tell of itself."""
    return {
        "Title": f"{layer.name} of {products.path.name}",
        "Software": f"polfuse-lab {versions().get('polfuse-lab', '')}".strip(),
        "Provenance": products.provenance(layer.stage),
    }


def _coloured(layer: Layer, colour: NDArray[Any]) -> Layer:
    return Layer(
        layer.name, ("red", "green", "blue", "opacity"), as_colours(colour), "", layer.x_m, layer.y_m, layer.z_m,
        layer.ground, layer.where, layer.stage,
    )  # fmt: skip
