"""PolSARpro's folders: ``config.txt`` and raw float32 planes ``NAME.bin`` with ENVI headers ``NAME.bin.hdr``.

S2 folders hold ``s11 s12 s21 s22`` (complex), T3 and C3 folders nine real planes. PolSARpro has no NaN: undefined
pixels are zero, and ``mask_valid_pixels.bin`` (1 or 0) tells which are defined.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from processing.polarimetry.matrices import PLANES

MASK = "mask_valid_pixels"
S2_NAMES = ("s11", "s21", "s12", "s22")
"""Files of HH, HV, VH and VV. PolSARpro's s21 is received with V and transmitted with H: this program's HV."""


def plane_names(matrix: str) -> tuple[str, ...]:
    """Files of a folder without ``.bin``, for S2, C3 or T3."""
    return S2_NAMES if matrix == "S2" else tuple(f"{matrix[0]}{name}" for name in PLANES)


def write_config(folder: Path, rows: int, columns: int) -> Path:
    """``config.txt`` of a folder of full polarimetry. Raises OSError."""
    entries = (("Nrow", rows), ("Ncol", columns), ("PolarCase", "monostatic"), ("PolarType", "full"))
    path = folder / "config.txt"
    path.write_text("\n---------\n".join(f"{name}\n{value}" for name, value in entries) + "\n", encoding="ascii")
    return path


def read_config(folder: Path) -> tuple[int, int]:
    """Rows and columns that ``config.txt`` tells.

    Raises:
        PolfuseError: it is missing or says something else.
    """
    path = folder / "config.txt"
    try:
        words = path.read_text(encoding="latin-1").split()
    except OSError as error:
        raise PolfuseError(
            f"cannot be read ({error.strerror})", where=str(path), advice="give a PolSARpro folder (S2, C3 or T3)"
        ) from error
    found = []
    for name in ("Nrow", "Ncol"):
        try:
            value = int(words[words.index(name) + 1])
        except (ValueError, IndexError) as error:
            raise PolfuseError(f"tells no number for {name}", where=str(path), advice="correct it") from error
        if not 1 <= value <= 1_000_000:
            raise PolfuseError(f"says {name} = {value}", where=str(path), advice="correct it (1 to 1000000)")
        found.append(value)
    return found[0], found[1]


def write_plane(folder: Path, name: str, values: NDArray[np.generic]) -> list[Path]:
    """One plane (rows, columns) as ``name.bin`` (little-endian float32, or complex of two) with its ENVI header.

    Raises:
        OSError: the folder cannot be written.
    """
    kind = np.dtype("<c8" if np.iscomplexobj(values) else "<f4")
    path = folder / f"{name}.bin"
    path.write_bytes(np.ascontiguousarray(values, dtype=kind).tobytes())
    header = folder / f"{name}.bin.hdr"
    rows, columns = values.shape
    header.write_text(
        f"ENVI\ndescription = {{{name}}}\nsamples = {columns}\nlines = {rows}\nbands = 1\nheader offset = 0\n"
        f"file type = ENVI Standard\ndata type = {6 if kind.kind == 'c' else 4}\ninterleave = bsq\nbyte order = 0\n"
        f"band names = {{\n{name} }}\n",
        encoding="ascii",
    )
    return [path, header]


def read_plane(folder: Path, name: str, rows: int, columns: int, *, is_complex: bool = False) -> NDArray[np.generic]:
    """The plane (rows, columns) of ``name.bin``, float32 or complex64; its header's byte order counts if there is one.

    Raises:
        PolfuseError: it is missing, or holds another number of bytes.
    """
    path = folder / f"{name}.bin"
    kind = np.dtype("c8" if is_complex else "f4").newbyteorder(_byte_order(path.with_name(f"{name}.bin.hdr")))
    try:
        content = path.read_bytes()
    except OSError as error:
        raise PolfuseError(
            f"cannot be read ({error.strerror})", where=str(path), advice="complete the folder, or check its name"
        ) from error
    if len(content) != rows * columns * kind.itemsize:
        raise PolfuseError(
            f"holds {len(content)} bytes where {rows} x {columns} pixels take {rows * columns * kind.itemsize}",
            where=str(path),
            advice="copy it again, or correct config.txt",
        )
    return np.frombuffer(content, dtype=kind).reshape(rows, columns).astype(kind.newbyteorder("="))


def _byte_order(header: Path) -> Literal["<", ">"]:
    """``"<"`` or ``">"`` as an ENVI header says; little-endian without one."""
    try:
        text = header.read_text(encoding="latin-1")
    except OSError:
        return "<"
    for line in text.splitlines():
        name, _, value = line.partition("=")
        if name.strip().lower() == "byte order":
            return ">" if value.strip() == "1" else "<"
    return "<"
