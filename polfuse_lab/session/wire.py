"""Messages between the engine and the writer's process: a MessagePack header and, for arrays, their bytes."""

from __future__ import annotations

import contextlib
import dataclasses
import struct
import sys
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.records import AudioBlock, Channel, ClockFix, Frame, Identity, PolarizerFix, SwitchState, TrolleyFix
from polfuse_lab.records import Event, Exposure, FrameFlag, Note, Observed, Record, SourceFix, SweepFlag, Sweeps
from polfuse_lab.rig import Waveform
from polfuse_lab.session.layout import SessionConfig

_PREFIX = struct.Struct("<IQ")
_PLAIN: dict[str, type[Any]] = {
    kind.__name__: kind for kind in (TrolleyFix, SwitchState, PolarizerFix, ClockFix, Note, Event)
}

Payload = bytes | memoryview
Message = tuple[dict[str, Any], Payload]


def encode(header: dict[str, Any], payload: Payload = b"") -> list[Payload]:
    """The pieces of one message, to be written one after the other."""
    head = msgspec.msgpack.encode(header)
    return [_PREFIX.pack(len(head), len(payload)) + head, payload]


def read_message(read: Callable[[int], bytes]) -> Message | None:
    """Read one message; None at the end of the stream, also in the middle of a message (the other side has died)."""
    prefix = read(_PREFIX.size)
    if len(prefix) < _PREFIX.size:
        return None
    head_size, payload_size = _PREFIX.unpack(prefix)
    head, payload = read(head_size), read(payload_size) if payload_size else b""
    if len(head) < head_size or len(payload) < payload_size:
        return None
    return msgspec.msgpack.decode(head), payload


def widen_pipe(handle: int) -> None:
    """A frame crosses a pipe of 1 MB at once, where the system lets it be so wide; the usual 64 kB take 14 turns."""
    if sys.platform.startswith("linux"):
        import fcntl

        with contextlib.suppress(OSError):
            fcntl.fcntl(handle, fcntl.F_SETPIPE_SZ, 1 << 20)


def record_message(record: Record) -> Message:
    """A record as a message."""
    if isinstance(record, Sweeps):
        block = _fields(record.block, without="samples")
        fields = {**_fields(record, without="block"), "channel": int(record.channel), "flags": int(record.flags)}
        return _with_array({"kind": "Sweeps", "fields": fields, "inner": block}, record.block.samples)
    if isinstance(record, Exposure):
        frame = _fields(record.frame, without="image")
        fields = {**_fields(record, without="frame"), "flags": int(record.flags)}
        return _with_array({"kind": "Exposure", "fields": fields, "inner": frame}, record.frame.image)
    if isinstance(record, Observed):
        return {"kind": "Observed", "record": record.record, "state": _plain_fields(record.state)}, b""
    return _plain_fields(record), b""


def _plain_fields(record: Any) -> dict[str, Any]:
    return {"kind": type(record).__name__, "fields": dataclasses.asdict(record)}


def _plain_record(header: dict[str, Any]) -> Any:
    fields = header["fields"]
    if header["kind"] == "SourceFix":
        return SourceFix(PolarizerFix(**fields["fix"]))
    return _PLAIN[header["kind"]](**fields)


def record_from(header: dict[str, Any], payload: Payload) -> Record:
    """The record of a message made by :func:`record_message`."""
    kind = header["kind"]
    if kind == "Observed":
        return Observed(_plain_record(header["state"]), header["record"])
    fields = header["fields"]
    if kind == "Sweeps":
        block = AudioBlock(samples=_array(header, payload), **header["inner"])
        fields = {**fields, "channel": Channel(fields["channel"]), "flags": SweepFlag(fields["flags"])}
        return Sweeps(block=block, **fields)
    if kind == "Exposure":
        fields = {**fields, "flags": FrameFlag(fields["flags"])}
        return Exposure(frame=Frame(image=_array(header, payload), **header["inner"]), **fields)
    record: Record = _plain_record(header)
    return record


def config_fields(config: SessionConfig) -> dict[str, Any]:
    """A session's configuration as plain values."""
    fields = {item.name: getattr(config, item.name) for item in dataclasses.fields(config)}
    fields["waveform"] = config.waveform.model_dump()
    fields["identities"] = [dataclasses.asdict(identity) for identity in config.identities]
    fields["extra"] = dict(config.extra)
    fields["storage"] = dict(config.storage)
    fields["origin"] = dict(config.origin)
    return fields


def config_from(fields: dict[str, Any]) -> SessionConfig:
    """The configuration of :func:`config_fields`."""
    shape = fields["frame_shape"]
    changed = {
        "waveform": Waveform.model_validate(fields["waveform"]),
        "identities": tuple(Identity(**identity) for identity in fields["identities"]),
        "frame_shape": None if shape is None else (shape[0], shape[1]),
    }
    return SessionConfig(**{**fields, **changed})


def _fields(item: Any, *, without: str) -> dict[str, Any]:
    return {field.name: getattr(item, field.name) for field in dataclasses.fields(item) if field.name != without}


def _with_array(header: dict[str, Any], array: NDArray[Any]) -> Message:
    array = np.ascontiguousarray(array)
    return {**header, "dtype": array.dtype.str, "shape": array.shape}, array.reshape(-1).view(np.uint8).data


def _array(header: dict[str, Any], payload: Payload) -> NDArray[Any]:
    return np.frombuffer(payload, dtype=header["dtype"]).reshape(header["shape"])
