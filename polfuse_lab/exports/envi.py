"""A layer as an ENVI image: raw little-endian bands one after the other, and a text header beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.formats import Exported, Request
from polfuse_lab.exports.layers import Layer, layer_of

TYPES = {np.dtype("uint8"): 1, np.dtype("float32"): 4, np.dtype("complex64"): 6}
"""ENVI's numbers of data types."""


def run(request: Request) -> Exported:
    """Write ``OUTPUT`` and ``OUTPUT.hdr``; the default layer is "scattering".

    The furthest row comes first; ``map info`` holds metres in the rig's coordinates (``Arbitrary``).

    Raises:
        PolfuseError: no such layer, or no room.
    """
    layer = layer_of(request.products, request.layer or "scattering")
    return Exported(tuple(write_envi(layer, request.output)), layer=layer.name)


def write_envi(layer: Layer, path: Path) -> list[Path]:
    """The files of :func:`run`. Raises PolfuseError without room."""
    header = path.with_name(f"{path.name}.hdr")
    values = layer.top_down
    bands, rows, columns = values.shape
    lines = [
        "ENVI",
        f"description = {{ {_safe(layer.name)} of {_safe(Path(layer.where).name)} }}",
        f"samples = {columns}",
        f"lines = {rows}",
        f"bands = {bands}",
        "header offset = 0",
        "file type = ENVI Standard",
        f"data type = {TYPES[values.dtype]}",
        "interleave = bsq",
        "byte order = 0",
        f"band names = {{ {', '.join(_safe(band) for band in layer.bands)} }}",
    ]
    if layer.ground:
        (dx, dy), left, top = layer.step_m, layer.x_m[0], layer.y_m[-1]
        # The place of the corner of the first pixel, which ENVI counts from 1.
        corner = ", ".join(repr(float(value)) for value in (left - dx / 2, top + dy / 2, dx, dy))
        lines.append(f"map info = {{ Arbitrary, 1, 1, {corner}, 0, units=Meters }}")
    if layer.unit:
        lines.append(f"data units = {_safe(layer.unit)}")
    if values.dtype != np.uint8:
        lines.append("data ignore value = nan")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes())
        header.write_text("\n".join(lines) + "\n", encoding="ascii", errors="replace")
    except OSError as error:
        raise PolfuseError(
            f"cannot be written ({error.strerror})", where=str(path), advice="check the folder and the disk's space"
        ) from error
    return [path, header]


def _safe(text: str) -> str:
    """Without what ends a field of the header."""
    return "".join(" " if c in "{}\n\r," else c for c in text)
