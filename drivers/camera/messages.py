"""What a camera's process and its user say to each other: typed messages, encoded as MessagePack, over a pipe.

MessagePack, not JSON: a time stamp may be NaN. Nothing here can run code when it is read, whoever wrote it.
"""

from __future__ import annotations

import dataclasses
from multiprocessing.connection import Connection
from typing import Any

import msgspec
import numpy as np

from drivers import errors
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceRefused
from drivers.records import ClockFix, Frame, Identity

EMPTY = np.zeros((0, 0), dtype=np.uint16)
"""Image of a frame whose pixels travel through shared memory."""

_NO_MESSAGE = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
"""What msgspec raises for bytes that are no message."""


class Message(msgspec.Struct, tag=True):
    """Any message."""


class Open(Message):
    """Make and open this driver."""

    driver: str
    options: dict[str, Any]


class Opened(Message):
    """It is open; who answered, and rows and columns of its frames."""

    identity: Identity
    shape: tuple[int, int]


class Memory(Message):
    """Put frames into this block of shared memory."""

    name: str
    slots: int


class Trigger(Message):
    """Take one frame."""

    ticket: int


class SetExposure(Message):
    """Expose so long from now on."""

    ticket: int
    seconds: float


class TellClock(Message):
    """Tell the camera's time."""

    ticket: int


class TellLimits(Message):
    """Tell the shortest and the longest exposure."""

    ticket: int


class Safe(Message):
    """Come to the safe state."""


class Close(Message):
    """Close the driver and end."""


class FrameTaken(Message):
    """The frame of a ticket lies in the shared memory; ``lost`` counts all frames lost so far."""

    ticket: int
    number: int
    dtype: str
    lost: int
    frame_id: int
    exposure_s: float
    gain_db: float
    t_device_s: float
    t_host_ns: int
    incomplete: bool
    lost_before: int

    @classmethod
    def of(cls, frame: Frame, *, ticket: int, number: int, lost: int) -> FrameTaken:
        """All of a frame but its image."""
        rest = {field.name: getattr(frame, field.name) for field in dataclasses.fields(frame) if field.name != "image"}
        return cls(ticket=ticket, number=number, dtype=frame.image.dtype.name, lost=lost, **rest)

    def frame(self, image: Any) -> Frame:
        """The frame with its image."""
        rest = {field.name: getattr(self, field.name) for field in dataclasses.fields(Frame) if field.name != "image"}
        return Frame(image=image, **rest)


class ClockTold(Message):
    """The camera's time, None where it has no clock."""

    ticket: int
    fix: ClockFix | None


class NumbersTold(Message):
    """What was asked for in numbers: an exposure, or limits."""

    ticket: int
    numbers: tuple[float, ...]


class Failed(Message):
    """A request failed; ticket 0 is the driver as a whole."""

    ticket: int
    kind: str
    what: str
    where: str
    advice: str

    @classmethod
    def of(cls, ticket: int, error: DeviceError) -> Failed:
        """What an error says."""
        known = next((base.__name__ for base in type(error).__mro__ if base.__name__ in _KINDS), "DeviceError")
        return cls(ticket, known, error.what, error.where, error.advice)

    def error(self) -> DeviceError:
        """The error, as it was raised."""
        return _KINDS.get(self.kind, DeviceError)(self.what, where=self.where, advice=self.advice)


_KINDS: dict[str, type[DeviceError]] = {
    kind.__name__: kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, DeviceError)
}

Request = Open | Memory | Trigger | SetExposure | TellClock | TellLimits | Safe | Close
"""What the user of a camera says."""
Answer = Opened | FrameTaken | ClockTold | NumbersTold | Failed
"""What the camera's process says."""

_encoder = msgspec.msgpack.Encoder(enc_hook=str)
_requests: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(Request)
_answers: msgspec.msgpack.Decoder[Any] = msgspec.msgpack.Decoder(Answer)


def say(pipe: Connection, message: Request | Answer) -> None:
    """Send a message. Raises OSError when the other end is gone."""
    pipe.send_bytes(_encoder.encode(message))


def hear_request(pipe: Connection) -> Request:
    """The next request. Raises EOFError or OSError when the other end is gone or talks nonsense."""
    try:
        request: Request = _requests.decode(pipe.recv_bytes())
    except _NO_MESSAGE as error:
        raise EOFError(str(error)) from error
    return request


def hear_answer(pipe: Connection) -> Answer:
    """The next answer.

    Raises:
        EOFError, OSError: the other end is gone.
        DeviceBadAnswer: what came is no answer.
    """
    try:
        answer: Answer = _answers.decode(pipe.recv_bytes())
    except _NO_MESSAGE as error:
        raise DeviceBadAnswer(
            f"said what is no message ({error})", where="camera process", advice="open the camera again"
        ) from error
    return answer


def pack_options(options: Any) -> dict[str, Any]:
    """A driver's ``Options`` as plain values (what is no plain value becomes its text, as paths do).

    Raises:
        DeviceRefused: it is no dataclass object.
    """
    if not dataclasses.is_dataclass(options) or isinstance(options, type):
        raise DeviceRefused(
            f"options are {type(options).__name__}, not the driver's Options",
            where="camera process",
            advice="give the driver's own Options object",
        )
    return dataclasses.asdict(options)


def unpack_options(kind: type[Any], values: dict[str, Any]) -> Any:
    """The ``Options`` object again. Raises :class:`msgspec.ValidationError` when the values do not fit."""

    def rebuild(wanted: type[Any], value: Any) -> Any:
        return wanted(value)

    return msgspec.convert(values, kind, dec_hook=rebuild)
