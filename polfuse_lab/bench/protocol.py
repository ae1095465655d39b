"""What set-up mode and its clients say to each other, beside what all engines do."""

from __future__ import annotations

from typing import Literal

import msgspec

from polfuse_lab.engine.protocol import Attach, Detach, Ping, Prompt, Refused, Watch, decoded

Light = Literal["ok", "warn", "bad", "busy", "off"]
"""``ok``; ``warn``: works, and could be better; ``bad``: cannot be used; ``busy``: being opened; ``off``: closed."""


class DeviceLight(msgspec.Struct, frozen=True):
    """How one device is."""

    kind: str
    driver: str
    light: Light
    what: str = ""
    """Who answered, or what is wrong."""
    mend: str = ""
    """How to mend or better it; empty when all is well."""
    identity: str = ""
    """Who answered; empty while it is not open."""
    by_hand: bool = False
    """Whether a person does what it is asked."""


class TrolleyView(msgspec.Struct, frozen=True):
    """The trolley on its rail, m; x = 0 at the middle."""

    x_m: float
    sd_m: float
    moving: bool
    low_m: float
    high_m: float
    state: str = ""


class SwitchView(msgspec.Struct, frozen=True):
    """Where the transfer switches stand."""

    channel: str
    verified: bool


class TurnView(msgspec.Struct, frozen=True):
    """How a polarizer stands, degrees from horizontal."""

    angle_deg: float
    moving: bool


class CameraView(msgspec.Struct, frozen=True):
    """The camera."""

    exposure_s: float
    shortest_s: float | None
    """Shortest exposure that it takes; None where its exposure cannot be set."""
    longest_s: float | None
    frames: int
    """Frames taken."""
    saturated_fraction: float
    """Of the newest frame's pixels."""
    running: bool
    """Whether it takes frame after frame."""
    searching: bool = False
    """Whether it looks for an exposure."""


class BenchStatus(msgspec.Struct, frozen=True, tag=True):
    """All of set-up mode at one moment."""

    devices: list[DeviceLight]
    trolley: TrolleyView | None = None
    switches: SwitchView | None = None
    polarizer: TurnView | None = None
    source_polarizer: TurnView | None = None
    camera: CameraView | None = None
    prompts: list[Prompt] = []
    refused: list[str] = []
    """What was asked for since the last status and is not done, one sentence each."""
    warnings: list[str] = []


class BenchClosed(msgspec.Struct, frozen=True, tag=True):
    """Set-up mode is over; its last word."""

    reason: str
    unsafe: list[str] = []
    """Devices that did not confirm their safe state, one sentence each."""


class Retry(msgspec.Struct, frozen=True, tag=True):
    """Close a device and open it again."""

    kind: str


class MoveTo(msgspec.Struct, frozen=True, tag=True):
    """Move the trolley to a place, m."""

    x_m: float


class Jog(msgspec.Struct, frozen=True, tag=True):
    """Move the trolley by some metres from where it is or is going to."""

    by_m: float


class Stop(msgspec.Struct, frozen=True, tag=True):
    """Stop everything that moves, now."""


class Select(msgspec.Struct, frozen=True, tag=True):
    """Switch to a channel."""

    channel: Literal["HH", "HV", "VH", "VV"]


class Turn(msgspec.Struct, frozen=True, tag=True):
    """Turn a polarizer."""

    angle_deg: float
    kind: Literal["polarizer", "source_polarizer"] = "polarizer"


class SetExposure(msgspec.Struct, frozen=True, tag=True):
    """Expose so long from the next frame on."""

    exposure_s: float


class FindExposure(msgspec.Struct, frozen=True, tag=True):
    """Look for an exposure that does not saturate."""


class RunCamera(msgspec.Struct, frozen=True, tag=True):
    """Take frame after frame, or none."""

    running: bool


class Reply(msgspec.Struct, frozen=True, tag=True):
    """The operator has done what a prompt asks for."""

    ticket: int


class Close(msgspec.Struct, frozen=True, tag=True):
    """End set-up mode, whoever else is attached."""


Command = Retry | MoveTo | Jog | Stop | Select | Turn | SetExposure | FindExposure | RunCamera | Reply
BenchMessage = Attach | Detach | Ping | Watch | Close | Command
BenchWord = BenchStatus | BenchClosed | Refused

_client: msgspec.msgpack.Decoder[BenchMessage] = msgspec.msgpack.Decoder(BenchMessage)
_engine: msgspec.msgpack.Decoder[BenchWord] = msgspec.msgpack.Decoder(BenchWord)


def decode_client(data: bytes) -> BenchMessage:
    """A client's message. Raises as :func:`polfuse_lab.engine.protocol.decoded`."""
    return decoded(_client, data)


def decode_engine(data: bytes) -> BenchWord:
    """The engine's message. Raises as :func:`polfuse_lab.engine.protocol.decoded`."""
    return decoded(_engine, data)
