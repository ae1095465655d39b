"""What a GenTL buffer holds: the image, the camera's time stamp, the chunks.

Buffers are read raw: harvesters' own unpacking knows no polarization mosaics, and a format code that it does not know
raises KeyError and loses the buffer for good.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from drivers.camera import features as names
from drivers.camera.features import Features
from drivers.camera.genicam_setup import Setup
from drivers.camera.pixel_formats import Counts, unpack


def image_of(buffer: Any, setup: Setup) -> Counts:
    """Counts of a buffer's image, copied.

    Args:
        buffer: raw GenTL buffer, complete.
        setup: what the camera was set to.

    Returns:
        (rows, columns) uint8 or uint16.

    Raises:
        ValueError: the frame is not what was agreed; says how it came ("in pixel format ...", "as 20x10 ...").
    """
    code = _optional(buffer, "pixel_format")
    if setup.format_code is not None and code not in (None, 0, setup.format_code):
        raise ValueError(f"in pixel format 0x{code:08X}, expected 0x{setup.format_code:08X} ({setup.format.name})")
    shape = int(buffer.height), int(buffer.width)
    if shape != setup.shape:
        raise ValueError(f"as {shape[1]}x{shape[0]} pixels, expected {setup.shape[1]}x{setup.shape[0]}")
    filled = _optional(buffer, "size_filled") or None
    offset = int(_optional(buffer, "image_offset") or 0)
    data = np.frombuffer(buffer.raw_buffer, dtype=np.uint8)[offset:filled]
    try:
        return unpack(data, setup.format, shape, line_padding=int(_optional(buffer, "padding_x") or 0))
    except ValueError as error:
        raise ValueError(f"that cannot be unpacked ({error})") from error


def timestamp_s(buffer: Any) -> float:
    """The camera's own stamp of a frame, s; NaN where the producer has none."""
    with suppress(Exception):
        return float(buffer.timestamp_ns) * 1e-9
    with suppress(Exception):
        return float(buffer.timestamp) / float(buffer.parent.parent.timestamp_frequency)
    return float("nan")


def chunks_of(features: Features) -> dict[str, float]:
    """What the frame fetched last tells of itself: ``time_s`` and ``exposure_s``, without what it does not tell."""
    told: dict[str, float] = {}
    with suppress(Exception):
        ticks = features.readable(names.CHUNK_TIME)
        if ticks is not None:
            told["time_s"] = float(ticks) / float(features.value(names.TICK_HZ) or 1e9)
    with suppress(Exception):
        exposure_us = features.readable(names.CHUNK_EXPOSURE)
        if exposure_us is not None:
            told["exposure_s"] = float(exposure_us) * 1e-6
    return told


def _optional(buffer: Any, name: str) -> Any:
    """What a producer tells of a buffer; None where it does not."""
    with suppress(Exception):
        return getattr(buffer, name)
    return None
