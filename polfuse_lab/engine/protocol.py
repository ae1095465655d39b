"""What the engine and its clients say to each other: MessagePack over one ZeroMQ socket, versioned.

A client says :class:`Attach` first, with the protocol's version and the engine's token, and from then on gets
:class:`StatusEvent` several times a second. It must be heard from at least every ``SILENCE_S``; a client that falls
silent is forgotten, and the run goes on without it. :class:`Finished` is the last that an engine says.
"""

from __future__ import annotations

from typing import Literal, TypeVar

import msgspec

Message = TypeVar("Message")

PROTOCOL_VERSION = 1
SILENCE_S = 10.0
"""A client that has said nothing for so long is forgotten, s."""
STATUS_EVERY_S = 0.2


class Rest(msgspec.Struct, frozen=True):
    """What is left of a collect that another session began (see :mod:`polfuse_lab.session.continuation`)."""

    steps_json: str
    """The steps that are still to be carried out."""
    origin: dict[str, str]
    """Which session began it; kept in the new one."""


Mode = Literal["collect", "bench", "replay"]
"""What an engine does: carry out a plan, set a rig up, or play a session."""


class Request(msgspec.Struct, frozen=True):
    """What an engine is started for; handed over as a file in the engine's private directory.

    In set-up mode there is no plan and no output; in a replay the output is the session that is played.
    """

    rig_path: str
    rig_toml: str
    plan_path: str
    plan_toml: str
    output: str
    token: str
    transport: str
    """``"ipc"`` or ``"tcp"``."""
    rest: Rest | None = None
    """Only what is left of the plan; None: all of it."""
    version: int = PROTOCOL_VERSION
    mode: Mode = "collect"
    speed: float = 1.0
    """Of a replay."""


class Address(msgspec.Struct, frozen=True):
    """Where an engine listens; a file in its private directory, written once it does."""

    endpoint: str
    pid: int
    output: str
    version: int = PROTOCOL_VERSION
    mode: Mode = "collect"
    rig_name: str = ""
    rig_path: str = ""
    plan_name: str = ""
    since_unix_s: float = 0.0
    """When it began to listen, seconds since 1970."""
    devices: list[str] = []
    """What it holds, see :func:`polfuse_lab.engine.claims.claims`."""


class Attach(msgspec.Struct, frozen=True, tag=True):
    """First message of a client."""

    version: int
    token: str


class Abort(msgspec.Struct, frozen=True, tag=True):
    """Stop now."""

    reason: str = "aborted by the user"


class Pause(msgspec.Struct, frozen=True, tag=True):
    """Pause after the present step."""


class Resume(msgspec.Struct, frozen=True, tag=True):
    """Go on from the last checkpoint."""


class AddNote(msgspec.Struct, frozen=True, tag=True):
    """Store a remark in the session."""

    text: str


class Answer(msgspec.Struct, frozen=True, tag=True):
    """The operator has done what prompt ``ticket`` asks for."""

    ticket: int


class Watch(msgspec.Struct, frozen=True, tag=True):
    """The client reads the live streams: they are to begin."""


class SetSpeed(msgspec.Struct, frozen=True, tag=True):
    """Replay so many times as fast as recorded."""

    speed: float


class Seek(msgspec.Struct, frozen=True, tag=True):
    """Replay fast until this step of the plan, then on as before."""

    step: int


class Ping(msgspec.Struct, frozen=True, tag=True):
    """The client lives."""


class Detach(msgspec.Struct, frozen=True, tag=True):
    """The client leaves; the run goes on."""


ClientMessage = Attach | Abort | Pause | Resume | AddNote | Answer | Watch | SetSpeed | Seek | Ping | Detach


class Prompt(msgspec.Struct, frozen=True):
    """Something that the operator is to do."""

    ticket: int
    text: str


class PreviewData(msgspec.Struct, frozen=True):
    """A range profile for display; ``level_db`` is little-endian float32, bin i at i * step_m."""

    number: int
    position: int
    x_m: float
    channel: str
    step_m: float
    level_db: bytes


class StatusEvent(msgspec.Struct, frozen=True, tag=True):
    """The state of the run (fields as in :class:`polfuse_lab.scheduler.RunStatus`)."""

    state: str
    reason: str
    step: int
    steps: int
    position: int
    positions: int
    x_m: float | None
    channel: str
    eta_s: float | None
    elapsed_s: float
    sweeps: int
    frames: int
    samples_lost: int
    frames_lost: int
    disk_free_bytes: int | None
    warnings: list[str]
    prompts: list[Prompt]
    preview: PreviewData | None = None
    """The newest range profile, when it is new to this client."""


class Refused(msgspec.Struct, frozen=True, tag=True):
    """The engine will not do what was asked."""

    reason: str


class Finished(msgspec.Struct, frozen=True, tag=True):
    """The run has ended (fields as in :class:`polfuse_lab.scheduler.Outcome`)."""

    state: str
    reason: str
    session: str | None
    positions: int
    sweeps: int
    frames: int
    samples_lost: int
    frames_lost: int
    sync_rms_s: float | None
    seconds: float
    warnings: list[str]


EngineMessage = StatusEvent | Refused | Finished

encode = msgspec.msgpack.Encoder().encode
_client: msgspec.msgpack.Decoder[ClientMessage] = msgspec.msgpack.Decoder(ClientMessage)
_engine: msgspec.msgpack.Decoder[EngineMessage] = msgspec.msgpack.Decoder(EngineMessage)


def decode_client(data: bytes) -> ClientMessage:
    """A client's message. Raises as :func:`decoded`."""
    return decoded(_client, data)


def decode_engine(data: bytes) -> EngineMessage:
    """The engine's message. Raises as :func:`decoded`."""
    return decoded(_engine, data)


def decoded(decoder: msgspec.msgpack.Decoder[Message], data: bytes) -> Message:
    """A message as one of a protocol's decoders knows it. Raises :class:`msgspec.MsgspecError` for anything else."""
    try:
        return decoder.decode(data)
    except (UnicodeDecodeError, RecursionError) as error:  # what msgspec leaves as it is
        raise msgspec.DecodeError(str(error)) from None
