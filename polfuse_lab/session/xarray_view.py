"""Sessions as xarray datasets: dimensions and units as in the CF conventions, samples read when they are looked at."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError

if TYPE_CHECKING:
    from polfuse_lab.session.reader import Session

Items = NDArray[np.intp]
Part = int | slice | NDArray[np.intp]

CONVENTIONS = "CF-1.11"


class _StoredRecords(BackendArray):
    """Records of one shape as one array, (records, *shape); only what an index asks for is read."""

    def __init__(
        self, items: Items, shape: tuple[int, ...], dtype: np.dtype[Any], read: Callable[[int, Part], NDArray[Any]]
    ) -> None:
        self._items = items
        self._read_item = read
        self.shape = (len(items), *shape)
        self.dtype = dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Part, ...]) -> NDArray[Any]:
        records, part, *rest = key
        chosen = self._items[records]
        if np.ndim(chosen) == 0:
            return self._one(int(chosen), part, rest)
        if not len(chosen):
            # Nothing is read; a record of zeros tells the shape that is left.
            shape = _outer(np.broadcast_to(self.dtype.type(0), self.shape[1:]), [part, *rest]).shape
            return np.zeros((0, *shape), self.dtype)
        return np.stack([self._one(int(item), part, rest) for item in chosen])

    def _one(self, item: int, part: Part, rest: list[Part]) -> NDArray[Any]:
        values = self._read_item(item, part)
        kept: list[Part] = [] if isinstance(part, (int, np.integer)) else [slice(None)]
        return _outer(values, [*kept, *rest])


class _SampleTimes(BackendArray):
    """Time of each sample from its record's first one, s; made when it is looked at."""

    def __init__(self, samples: int, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self.shape = (samples,)
        self.dtype = np.dtype(np.float64)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Part]) -> Any:
        (part,) = key
        numbers = np.arange(*part.indices(self.shape[0])) if isinstance(part, slice) else np.asarray(part)
        return numbers / self._rate_hz


def _outer(values: NDArray[Any], parts: list[Part]) -> NDArray[Any]:
    """``values`` indexed on each axis by itself; from the last axis, so that those before keep their numbers."""
    for axis, part in reversed(list(enumerate(parts))):
        values = values[(slice(None),) * axis + (part,)]
    return values


def audio_dataset(session: Session, items: Items) -> xr.Dataset:
    """Audio records as a dataset with the variable ``audio`` (record, sample, input).

    Raises:
        PolfuseError: the records are not of one length.
    """
    rows = session.sweeps[items]
    lengths = np.unique(rows["samples"])
    if len(lengths) > 1:
        raise PolfuseError(
            f"audio records of {lengths.min()} to {lengths.max()} samples make no array",
            where=str(session.path),
            advice="select records of one length, or use the plain records of the selection",
        )
    samples = int(lengths[0]) if len(lengths) else 0
    inputs = int(session.config["audio_channels"])
    dtype = np.dtype(session.config["sample_dtype"])
    data = _StoredRecords(items, (samples, inputs), dtype, lambda item, part: _audio(session, item, part))
    times = session.sync.device("radar")
    names = np.array([Channel(int(number)).name for number in rows["channel"]], dtype="U2")
    coords: dict[str, Any] = {
        "record": ("record", items, {"long_name": "number of the audio record in the session"}),
        "sample_time": (
            "sample",
            indexing.LazilyIndexedArray(_SampleTimes(samples, session.sample_rate_hz)),
            {"long_name": "time from the record's first sample", "units": "s"},
        ),
        "channel": ("record", names, {"long_name": "polarimetric channel, transmit then receive"}),
        "position": ("record", rows["position"], {"long_name": "number of the position along the rail"}),
        "x": ("record", rows["x_m"], {"long_name": "position of the trolley along the rail", "units": "m"}),
        "x_sd": ("record", rows["x_sd_m"], {"long_name": "standard uncertainty of x", "units": "m"}),
        "attempt": ("record", rows["attempt"], {"long_name": "attempts before this one"}),
        "flags": ("record", rows["flags"], {"long_name": "see polfuse_lab.records.SweepFlag"}),
        **_time_coords(session, "record", times.host_ns[items], times.sd_s[items]),
    }
    lazy = indexing.LazilyIndexedArray(data)
    audio = (("record", "sample", "input"), lazy, {"long_name": "raw samples", "units": "1"})
    return xr.Dataset({"audio": audio}, coords, _attributes(session))


def frames_dataset(session: Session, items: Items) -> xr.Dataset:
    """Camera frames as a dataset with the variable ``image`` (frame, row, column)."""
    rows = session.frames[items]
    shape = session.config["frame_shape"] or (0, 0)
    data = _StoredRecords(
        items,
        (int(shape[0]), int(shape[1])),
        np.dtype(session.config["frame_dtype"]),
        lambda item, part: np.asarray(session.frame(item)[part]),
    )
    times = session.sync.device("camera")
    coords: dict[str, Any] = {
        "frame": ("frame", items, {"long_name": "number of the frame in the session"}),
        "angle": (
            "frame",
            np.degrees(rows["angle_rad"]),
            {"long_name": "transmission axis of the polarizer from horizontal", "units": "degree"},
        ),
        "source_angle": (
            "frame",
            np.degrees(rows["source_angle_rad"]),
            {"long_name": "transmission axis of the light source's polarizer", "units": "degree"},
        ),
        "exposure": ("frame", rows["exposure_s"], {"long_name": "exposure time", "units": "s"}),
        "gain": ("frame", rows["gain_db"], {"long_name": "gain", "units": "dB"}),
        "dark": ("frame", rows["dark"], {"long_name": "lens covered"}),
        "incomplete": ("frame", rows["incomplete"], {"long_name": "parts of the image were lost"}),
        "frame_flags": ("frame", rows["flags"], {"long_name": "see polfuse_lab.records.FrameFlag"}),
        **_time_coords(session, "frame", times.host_ns[items], times.sd_s[items], prefix="frame_"),
    }
    image = (("frame", "row", "column"), indexing.LazilyIndexedArray(data), {"long_name": "raw counts", "units": "1"})
    return xr.Dataset({"image": image}, coords, _attributes(session))


def session_dataset(session: Session) -> xr.Dataset:
    """All audio records and frames of a session in one dataset. Raises as :func:`audio_dataset`."""
    audio = audio_dataset(session, np.arange(len(session.sweeps)))
    if not len(session.frames):
        return audio
    return audio.merge(frames_dataset(session, np.arange(len(session.frames))), combine_attrs="override")


def _audio(session: Session, item: int, part: Part) -> NDArray[Any]:
    if isinstance(part, slice):
        return session.audio_part(item, part)
    if isinstance(part, (int, np.integer)):
        return np.asarray(session.audio_part(item, slice(int(part), int(part) + 1))[0])
    if not len(part):
        return session.audio_part(item, slice(0, 0))
    first = int(part.min())
    return np.asarray(session.audio_part(item, slice(first, int(part.max()) + 1))[part - first])


def _time_coords(
    session: Session, dim: str, host_ns: NDArray[np.int64], sd_s: NDArray[np.float64], prefix: str = ""
) -> dict[str, Any]:
    """Time of day (UTC) by the moment at which the session was opened, and how well records compare in time."""
    start_ns = round(float(session.config["start_unix_s"]) * 1e9) - int(session.config["start_host_ns"])
    utc = (host_ns + start_ns).astype("datetime64[ns]")
    return {
        f"{prefix}time": (dim, utc, {"long_name": "first sample, or the camera's stamp", "standard_name": "time"}),
        f"{prefix}time_sd": (dim, sd_s, {"long_name": "standard uncertainty against the other devices", "units": "s"}),
    }


def _attributes(session: Session) -> dict[str, Any]:
    waveform, version = session.waveform, session.config["versions"].get("polfuse-lab", "")
    return {
        "Conventions": CONVENTIONS,
        "title": session.path.name,
        "source": str(session.config["source"]),
        "history": f"{session.config['started']} recorded by PolFuse Lab {version}".rstrip(),
        "sample_rate_hz": session.sample_rate_hz,
        "centre_hz": waveform.centre_hz,
        "bandwidth_hz": waveform.bandwidth_hz,
    }
