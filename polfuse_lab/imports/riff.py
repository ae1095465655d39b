"""Read a WAV file exactly: its samples as they are stored, or a sentence that says why not."""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError

_PCM, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_UNTIL_END = (0, 0xFFFF_FFFF)  # sizes that programs leave in a data chunk when they write to a pipe


@dataclass(frozen=True)
class Wav:
    """The content of a WAV file."""

    samples: NDArray[Any]
    """(frames, channels): int16, int32 (24-bit samples shifted left by 8, which is exact) or float32."""
    sample_rate_hz: float
    bits: int
    """Bits per sample in the file."""
    sha256: str
    """Digest of the whole file."""


def read_wav(path: Path | str) -> Wav:
    """Read an uncompressed WAV file of 16, 24 or 32 bit integers or 32 bit floating point.

    Raises:
        PolfuseError: it does not exist, cannot be read, is no WAV file, is cut short, or of another sample type.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise PolfuseError(
            f"cannot be read ({error.strerror})", where=str(path), advice="check the file's name"
        ) from error
    if not content:
        raise _bad(path, "is empty", "export or copy it again")
    if len(content) < 12 or content[:4] != b"RIFF" or content[8:12] != b"WAVE":
        raise _bad(path, "is not a WAV file", "give a RIFF/WAVE file as recorded")
    layout: tuple[int, int, int, int, int] | None = None
    at = 12
    while at + 8 <= len(content):
        name, size = content[at : at + 4], int.from_bytes(content[at + 4 : at + 8], "little")
        at += 8
        if name == b"fmt ":
            layout = _layout(path, content[at : at + size])
        elif name == b"data":
            if layout is None:
                raise _bad(path, "has samples before their format", "export it again")
            last_chunk = at + size > len(content)
            if size in _UNTIL_END and (last_chunk or size == 0):
                size = len(content) - at
            elif last_chunk:
                raise _bad(
                    path, f"is cut short: {size} bytes of samples are promised, {len(content) - at} are there",
                    "copy or record it again")  # fmt: skip
            return _samples(path, content, at, size, layout)
        at += size + size % 2
    raise _bad(path, "holds no samples" if layout else "is cut short: its format is missing", "copy or record it again")


def _layout(path: Path, chunk: bytes) -> tuple[int, int, int, int, int]:
    """Format code, channels, rate, bytes per frame, bits."""
    if len(chunk) < 16:
        raise _bad(path, "is cut short inside its format", "copy or record it again")
    code, channels, rate, _, frame, bits = struct.unpack("<HHIIHH", chunk[:16])
    if code == _EXTENSIBLE and len(chunk) >= 26:
        (code,) = struct.unpack("<H", chunk[24:26])
    if channels == 0 or rate == 0 or frame != channels * bits // 8:
        raise _bad(path, f"has an impossible format ({channels} channels, {rate} Hz, {bits} bits)", "export it again")
    if (code, bits) not in ((_PCM, 16), (_PCM, 24), (_PCM, 32), (_FLOAT, 32)):
        raise _bad(
            path, f"has samples of an unknown type (code {code}, {bits} bits)",
            "export it as 16, 24 or 32 bit PCM or 32 bit floating point, uncompressed")  # fmt: skip
    return code, channels, rate, frame, bits


def _samples(path: Path, content: bytes, at: int, size: int, layout: tuple[int, int, int, int, int]) -> Wav:
    code, channels, rate, frame, bits = layout
    frames, rest = divmod(size, frame)
    if rest:
        raise _bad(path, "is cut short inside a sample", "copy or record it again")
    if not frames:
        raise _bad(path, "holds no samples", "record it again")
    raw = content[at : at + size]
    values: NDArray[Any]
    if bits == 24:
        octets = np.zeros((frames * channels, 4), dtype=np.uint8)
        octets[:, 1:] = np.frombuffer(raw, dtype=np.uint8).reshape(-1, 3)
        values = octets.view("<i4")[:, 0]
    else:
        values = np.frombuffer(raw, dtype="<f4" if code == _FLOAT else f"<i{bits // 8}")
    # The machine's own byte order, and a copy that does not keep the whole file in memory.
    samples = values.reshape(frames, channels).astype(values.dtype.newbyteorder("="))
    return Wav(samples, float(rate), bits, hashlib.sha256(content).hexdigest())


def _bad(path: Path, what: str, advice: str) -> PolfuseError:
    return PolfuseError(what, where=str(path), advice=advice)
