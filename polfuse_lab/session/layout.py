"""What a session file looks like inside: schema ``polfuse-session``, version 2.

Flat, every dataset declared before the first record::

    config            uint8 (n,)               JSON: rig and plan text, waveform, sample rate, identities, versions
    state             (1,)  STATE              how it ended, and what was lost
    audio             (samples, channels)      raw samples, each record beginning at a chunk's first row
    sweeps            (n,)  SWEEPS             one row for each audio record
    images            (n, rows, columns)       camera frames (only with a camera)
    frames            (n,)  FRAMES             one row for each image
    trolley, switches, polarizer, source_polarizer, clocks, notes, events

Version 2 (see :mod:`polfuse_lab.session.versions`) added ``record`` to fixes (what they were taken during), the
polarizer at the light source, and flags of frames.

Tables are stored uncompressed, so that a row is appended in place; audio and images are compressed, one chunk for one
write, since rewriting a compressed chunk leaves its old copy behind and lets the file grow many times over.
"""

from __future__ import annotations

import datetime
import json
import platform
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import h5py
import numpy as np

from drivers.records import Identity
from polfuse_lab.errors import PolfuseError
from polfuse_lab.rig import Waveform
from polfuse_lab.session import filters

SCHEMA = "polfuse-session"
VERSION = 2

TEXT_BYTES = 1000
"""Longest text in one row of a table, bytes of UTF-8; longer notes take several rows."""
STORAGE = "storage"
"""Entry of the configuration that tells the filter of audio and images, and why it was taken where it was chosen."""
STEPS = "steps"
"""Entry of the configuration's ``extra`` that holds the planned steps (see :mod:`polfuse_lab.plans.step_json`)."""
CONTINUES = "continues"
"""Entry of ``extra`` that names the session whose collect this one continues: its name and when it was started."""
PARTS = "parts"
"""Entry of ``extra`` that names the sessions from which this one was joined."""
CHUNK_FRAMES = 65_536
"""Largest audio chunk, frames."""
SAMPLE_TYPES = ("int16", "int32", "float32")
FRAME_TYPES = ("uint8", "uint16")

STATE = np.dtype(
    [
        ("state", "S32"),
        ("reason", f"S{TEXT_BYTES}"),
        ("end_unix_s", "f8"),
        ("end_host_ns", "i8"),
        ("samples_lost", "i8"),
        ("frames_lost", "i8"),
    ]
)
SWEEPS = np.dtype(
    [
        ("first_sample", "i8"),
        ("samples", "i8"),
        ("channel", "i4"),
        ("position", "i4"),
        ("x_m", "f8"),
        ("x_sd_m", "f8"),
        ("sweeps_requested", "i4"),
        ("attempt", "i4"),
        ("t_host_ns", "i8"),
        ("t_device_s", "f8"),
        ("device_frame", "i8"),
        ("lost", "i8"),
        ("flags", "u4"),
    ]
)
FRAMES = np.dtype(
    [
        ("angle_rad", "f8"),
        ("angle_sd_rad", "f8"),
        ("exposure_s", "f8"),
        ("gain_db", "f8"),
        ("frame_id", "i8"),
        ("t_host_ns", "i8"),
        ("t_device_s", "f8"),
        ("incomplete", "?"),
        ("dark", "?"),
        ("lost_before", "i4"),
        ("attempt", "i4"),
        ("source_angle_rad", "f8"),
        ("source_angle_sd_rad", "f8"),
        ("flags", "u4"),
    ]
)
_POLARIZER = np.dtype([("angle_rad", "f8"), ("sd_rad", "f8"), ("moving", "?"), ("t_host_ns", "i8"), ("record", "i4")])
TABLES: Mapping[str, np.dtype[Any]] = {
    "sweeps": SWEEPS,
    "frames": FRAMES,
    "trolley": np.dtype(
        [("x_m", "f8"), ("sd_m", "f8"), ("moving", "?"), ("t_host_ns", "i8"), ("state", "S32"), ("record", "i4")]
    ),
    "switches": np.dtype(
        [("transmit", "S4"), ("receive", "S4"), ("verified", "?"), ("t_host_ns", "i8"), ("record", "i4")]
    ),
    "polarizer": _POLARIZER,
    "source_polarizer": _POLARIZER,
    "clocks": np.dtype([("device", "S32"), ("t_device_s", "f8"), ("t_host_ns", "i8"), ("round_trip_ns", "i8")]),
    "notes": np.dtype([("text", f"S{TEXT_BYTES}"), ("t_host_ns", "i8")]),
    "events": np.dtype([("kind", "S32"), ("text", f"S{TEXT_BYTES}"), ("t_host_ns", "i8")]),
}

UNASKED = -1
"""``record`` of a fix that a step asked for, and that was not taken during a record."""

_PACKAGES = ("polfuse-lab", "numpy", "h5py", "hdf5plugin", "pyzmq", "pyserial", "sounddevice", "harvesters")


@dataclass(frozen=True)
class SessionConfig:
    """What is known before the first record; written once, as JSON, into the file.

    ``rig_toml`` and ``plan_toml`` are the files' texts as the user wrote them, None for foreign recordings.
    """

    source: str
    """``"collect"``, ``"replay"`` or ``"import:<format>"``."""
    waveform: Waveform
    sample_rate_hz: float
    """Nominal sample rate of the audio, Hz."""
    sample_dtype: str = "int16"
    """``"int16"``, ``"int32"`` or ``"float32"``: samples are stored exactly as sampled."""
    audio_channels: int = 2
    audio_block_frames: int = CHUNK_FRAMES
    """Frames of a usual audio record, which become one chunk (at most 65,536)."""
    frame_shape: tuple[int, int] | None = None
    """Rows and columns of a camera frame; None without a camera."""
    frame_dtype: str = "uint16"
    """``"uint8"`` or ``"uint16"``."""
    rig_toml: str | None = None
    plan_toml: str | None = None
    identities: tuple[Identity, ...] = ()
    """Who answered when the devices were opened."""
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Whatever else is to be kept; JSON values."""
    storage: Mapping[str, Any] = field(default_factory=lambda: {"filter": filters.USUAL})
    """``filter`` of audio and images (of :data:`polfuse_lab.session.filters.FILTERS`), and whatever else is to be told
    of it; JSON values."""
    origin: Mapping[str, Any] = field(default_factory=dict)
    """For a replay: entries of the recording's configuration that stand instead of this moment's (host, start, …)."""

    def __post_init__(self) -> None:
        if self.sample_dtype not in SAMPLE_TYPES:
            raise PolfuseError(
                f"sample type {self.sample_dtype!r} cannot be stored",
                where="session",
                advice=f"use one of {', '.join(SAMPLE_TYPES)}",
            )
        if self.frame_dtype not in FRAME_TYPES:
            raise PolfuseError(
                f"frame type {self.frame_dtype!r} cannot be stored",
                where="session",
                advice=f"use one of {', '.join(FRAME_TYPES)}",
            )

        filters.options(self.filter)

    @property
    def filter(self) -> str:
        """What audio and images are stored with."""
        return str(self.storage["filter"])

    @property
    def chunk_frames(self) -> int:
        """Frames of one audio chunk."""
        return max(1, min(self.audio_block_frames, CHUNK_FRAMES))

    @property
    def largest_block_bytes(self) -> int:
        """Bytes of the largest chunk that is written at once."""
        audio = self.chunk_frames * self.audio_channels * np.dtype(self.sample_dtype).itemsize
        if self.frame_shape is None:
            return audio
        return max(audio, self.frame_shape[0] * self.frame_shape[1] * np.dtype(self.frame_dtype).itemsize)


def declare_audio(
    file: h5py.File, channels: int, dtype: str, chunk_frames: int, stored: str = filters.USUAL
) -> h5py.Dataset:
    """Declare the empty dataset of raw samples, ``stored`` with a filter of that name."""
    return file.create_dataset(
        "audio",
        shape=(0, channels),
        maxshape=(None, channels),
        chunks=(chunk_frames, channels),
        dtype=dtype,
        **filters.options(stored),
    )


def declare_images(file: h5py.File, shape: tuple[int, int], dtype: str, stored: str = filters.USUAL) -> h5py.Dataset:
    """Declare the empty dataset of camera frames, ``stored`` with a filter of that name."""
    return file.create_dataset(
        "images",
        shape=(0, *shape),
        maxshape=(None, *shape),
        chunks=(1, *shape),
        dtype=dtype,
        **filters.options(stored),
    )


def declare_table(file: h5py.File, name: str) -> h5py.Dataset:
    """Declare an empty table, with chunks of 16 rows where rows are long."""
    dtype = TABLES[name]
    return file.create_dataset(
        name, shape=(0,), maxshape=(None,), chunks=(16 if dtype.itemsize > 500 else 256,), dtype=dtype
    )


def snapshot(config: SessionConfig) -> bytes:
    """The configuration as JSON, with the versions, the host and the clocks of this moment."""
    content = {
        "source": config.source,
        "waveform": config.waveform.model_dump(),
        "sample_rate_hz": config.sample_rate_hz,
        "sample_dtype": config.sample_dtype,
        "audio_channels": config.audio_channels,
        "frame_shape": config.frame_shape,
        "frame_dtype": config.frame_dtype,
        "rig_toml": config.rig_toml,
        "plan_toml": config.plan_toml,
        "identities": [asdict(identity) for identity in config.identities],
        "extra": dict(config.extra),
        STORAGE: dict(config.storage),
        "versions": _versions(),
        "host": {"name": platform.node(), "system": platform.platform(), "python": platform.python_version()},
        "started": datetime.datetime.now(datetime.UTC).isoformat(),
        "start_unix_s": time.time(),
        "start_host_ns": time.monotonic_ns(),
    } | dict(config.origin)
    try:
        return json.dumps(content, allow_nan=False).encode()
    except (TypeError, ValueError) as error:
        raise PolfuseError(
            f"configuration cannot be stored as JSON ({error})", where="session", advice="use plain values in 'extra'"
        ) from error


def _versions() -> dict[str, str]:
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def encode_text(text: str, limit: int = TEXT_BYTES) -> bytes:
    """UTF-8 of ``text``, cut to ``limit`` bytes at a whole character; NUL (which would end the string) left out."""
    return text.replace("\0", "").encode("utf-8", "replace")[:limit].decode("utf-8", "ignore").encode()


def split_text(text: str, limit: int = TEXT_BYTES) -> list[bytes]:
    """``text`` in pieces of at most ``limit`` bytes of UTF-8, each of whole characters; at least one piece."""
    pieces = []
    while True:
        piece = encode_text(text, limit)
        pieces.append(piece)
        text = text.replace("\0", "").encode("utf-8", "replace")[len(piece) :].decode("utf-8", "ignore")
        if not text:
            return pieces
