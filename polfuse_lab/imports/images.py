"""Read monochrome TIFF and PNG frames exactly: their counts as they are stored, or a sentence that says why not."""

from __future__ import annotations

import hashlib
import io
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from polfuse_lab.errors import PolfuseError, first_line

SUFFIXES = (".tif", ".tiff", ".png")
"""Names of image files, in lower case."""
MOST_PIXELS = 400_000_000
"""Larger frames are taken for damaged."""
_BITS_PER_SAMPLE, _EXIF, _EXPOSURE = 258, 0x8769, 33434
_LOSSY = {"jpeg", "tiff_jpeg", "webp"}
_WHOLE = {"L": "uint8", "I;16": "uint16", "I;16B": "uint16", "I;16L": "uint16", "I;16N": "uint16"}

Counts = NDArray[np.unsignedinteger[Any]]


@dataclass(frozen=True)
class ImageFile:
    """What was seen in a file."""

    path: Path
    sha256: str
    """Digest of the whole file."""
    pages: int
    shape: tuple[int, int]
    """Rows and columns of each page."""
    dtype: str
    """``"uint8"`` or ``"uint16"``."""
    bits: int
    """Bits of a sample as the file says."""
    largest: int
    """Largest count."""
    lowest_bit: int
    """Number of the lowest bit that is set anywhere, 16 in a black image."""
    exposure_s: float | None
    """Exposure as the file says."""


def inspect_image(path: Path | str) -> ImageFile:
    """Read a file through once.

    Raises:
        PolfuseError: it cannot be read, is no TIFF or PNG, is damaged or cut short, or is no monochrome image of 8 to
            16 bits without loss.
    """
    path = Path(path)
    content = _content(path)
    pages, shape, dtype, largest, seen = 0, (0, 0), "", 0, 0
    bits, exposure = 8, None
    for image, counts in _pages(path, content):
        if pages and (counts.shape, counts.dtype.name) != (shape, dtype):
            raise _bad(path, f"its page {pages + 1} has another size or depth than the first", "give single frames")
        if not pages:
            shape, dtype = (counts.shape[0], counts.shape[1]), counts.dtype.name
            bits, exposure = _bits(image, dtype), _exposure(image)
        pages += 1
        largest = max(largest, int(counts.max()))
        seen |= int(np.bitwise_or.reduce(counts, axis=None))
    lowest = (seen & -seen).bit_length() - 1 if seen else 16
    digest = hashlib.sha256(content).hexdigest()
    return ImageFile(path, digest, pages, shape, dtype, bits, largest, lowest, exposure)


def read_images(file: ImageFile) -> Iterator[Counts]:
    """The pages of a file that was inspected: (rows, columns) uint8 or uint16.

    Raises:
        PolfuseError: the file has changed, or cannot be read.
    """
    content = _content(file.path)
    if hashlib.sha256(content).hexdigest() != file.sha256:
        raise _bad(file.path, "was changed while it was imported", "import again")
    for _, counts in _pages(file.path, content):
        yield counts


def _content(path: Path) -> bytes:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise _bad(path, f"cannot be read ({error.strerror})", "check the file's name") from error
    if not content:
        raise _bad(path, "is empty", "export or copy it again")
    return content


def _pages(path: Path, content: bytes) -> Iterator[tuple[Image.Image, Counts]]:
    # Decoders answer damage with nearly every kind of exception, and with warnings about what they make up for.
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image = Image.open(io.BytesIO(content), formats=("TIFF", "PNG"))
            pages = int(getattr(image, "n_frames", 1))
    except Exception as error:
        raise _bad(path, "is not a readable TIFF or PNG file", "export or copy it again") from error
    for page in range(pages):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                image.seek(page)
                problem = _problem(image)
                counts = None if problem else _counts(image)
        except Exception as error:
            raise _bad(path, f"is damaged or cut short ({first_line(error)})", "export or copy it again") from error
        if counts is None:
            raise _bad(path, problem or "", "export raw frames as monochrome TIFF or PNG of 8 or 16 bits, without loss")
        yield image, counts


def _problem(image: Image.Image) -> str | None:
    """Why a page is no frame of counts."""
    if image.width * image.height > MOST_PIXELS:
        return f"claims {image.width} x {image.height} pixels"
    if str(image.info.get("compression", "")).lower() in _LOSSY:
        return "was compressed with loss"
    if image.mode in _WHOLE or image.mode in ("RGB", "I"):
        return None
    kinds = {"P": "coloured by a palette", "F": "in floating point", "1": "black and white only"}
    return f"is {kinds.get(image.mode, f'of the kind {image.mode}')}, not monochrome counts"


def _counts(image: Image.Image) -> Counts | None:
    """Counts of the present page; None where a colour image is no grey one."""
    values = np.asarray(image)
    if image.mode == "RGB":
        # Some programs save grey frames in three equal colours.
        if (values != values[..., :1]).any():
            raise ValueError("it is a colour picture")
        values = values[..., 0]
    elif image.mode == "I":
        if values.min() < 0 or values.max() > 65_535:
            raise ValueError("its counts do not fit 16 bits")
        values = values.astype(np.uint16)
    counts: Counts = np.ascontiguousarray(values.astype(_WHOLE.get(image.mode, values.dtype.name)))
    if counts.ndim != 2 or not counts.size:
        raise ValueError("it holds no rows and columns")
    return counts


def _bits(image: Image.Image, dtype: str) -> int:
    stored = 8 if dtype == "uint8" else 16
    said = getattr(image, "tag_v2", {}).get(_BITS_PER_SAMPLE, (stored,))
    first = said[0] if isinstance(said, tuple) and said else said
    return first if first in (10, 12, 14) and stored == 16 else stored


def _exposure(image: Image.Image) -> float | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = image.getexif()
            value = found.get_ifd(_EXIF).get(_EXPOSURE, found.get(_EXPOSURE))
            seconds = float(value) if value is not None else None
    except Exception:  # a damaged remark beside sound counts
        return None
    return seconds if seconds is not None and 0 < seconds <= 60 else None


def _bad(path: Path, what: str, advice: str) -> PolfuseError:
    return PolfuseError(what, where=str(path), advice=advice)
