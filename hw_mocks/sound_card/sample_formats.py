"""Sample formats of sound cards, and int16 samples widened to them without changing their value."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

SampleFormat = Literal["int16", "int24", "int32", "float32"]
"""``int24`` is 24 bits in the lower three bytes of an int32, as many converters deliver it."""

PULSE_NAMES: dict[SampleFormat, str] = {
    "int16": "s16le",
    "int24": "s24-32le",
    "int32": "s32le",
    "float32": "float32le",
}


def frame_bytes(sample_format: SampleFormat) -> int:
    """Bytes of one stereo frame."""
    return 4 if sample_format == "int16" else 8


def encode(samples: NDArray[np.generic], sample_format: SampleFormat) -> bytes:
    """Bytes of samples (frames, 2), little endian. int16 samples are widened; others must have the format already.

    Raises:
        ValueError: samples of another type than the format's.
    """
    if samples.dtype == np.int16 and sample_format != "int16":
        counts = samples.astype(np.int32)
        if sample_format == "float32":
            return (samples.astype("<f4") / np.float32(32_768)).astype("<f4").tobytes()
        return (counts << (8 if sample_format == "int24" else 16)).astype("<i4").tobytes()
    expected = {"int16": "<i2", "float32": "<f4"}.get(sample_format, "<i4")
    if samples.dtype != np.dtype(expected):
        raise ValueError(f"found samples of type {samples.dtype}, allowed: int16 or {expected} for {sample_format}")
    return np.ascontiguousarray(samples, dtype=expected).tobytes()
