"""Bring a GenICam camera to the state that its options ask for, and say what became of each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt

from drivers.camera import features as names
from drivers.camera.features import Features
from drivers.camera.pixel_formats import PixelFormat, choose, pixel_format

Edge = Literal["RisingEdge", "FallingEdge"]


@dataclass(frozen=True)
class GenicamOptions:
    """Settings of a GenICam camera.

    What the user asks for beyond the defaults must be there, or the camera is refused. Exposure, gain and the software
    trigger are set where the camera has them; where it lacks one that is named when it is opened, or refused with
    ``strict``.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    cti: str = ""
    """GenTL producer (.cti) of the camera's vendor; "aravis" for the project's own (``make gentl``); empty for the
    simulated camera of the genicam package."""
    device: str = ""
    """Part of the camera's serial number, model or name; empty for the first one found."""
    addresses: tuple[str, ...] = ()
    """IPv4 addresses of GigE Vision cameras: these alone are asked, one by one, and nothing is broadcast. For the
    project's own producer; empty looks for cameras on every network."""
    pixel_format: str = ""
    """"Mono8" to "Mono16", packed ones too, or the same as "Polarized..."; empty for the one with the most bits."""
    exposure_s: Annotated[float, Gt(0)] = 0.002
    """Exposure, s."""
    gain_db: Annotated[float, Ge(0)] = 0.0
    """Gain, dB."""
    gain_raw: Annotated[int, Ge(-1)] = -1
    """Gain in the camera's own steps, for cameras without a gain in dB; -1 leaves it alone."""
    frame_rate_hz: Annotated[float, Ge(0)] = 0.0
    """Frame rate of a free-running camera, Hz; 0 leaves the camera's own."""
    width_px: Annotated[int, Ge(0)] = 0
    """Columns; 0 leaves the camera's own."""
    height_px: Annotated[int, Ge(0)] = 0
    """Rows; 0 leaves the camera's own."""
    offset_x_px: Annotated[int, Ge(0)] = 0
    """First column of the region; even for a mosaic of polarizers."""
    offset_y_px: Annotated[int, Ge(0)] = 0
    """First row of the region; even for a mosaic of polarizers."""
    mosaic: str = "none"
    """"none", or the polarizers on the sensor's pixels (the rig file's camera.mosaic)."""
    packet_size_bytes: Annotated[int, Ge(0)] = 0
    """Stream packets with their headers: 1500, or up to 9000 on a network with jumbo frames; 0 leaves it."""
    packet_delay_s: Annotated[float, Ge(0)] = 0.0
    """Pause between stream packets, s; 0 leaves it."""
    trigger: Literal["software", "line", "free"] = "software"
    """Software trigger, a pulse on a line, or the next wholly new frame of a free-running camera."""
    trigger_line: str = "Line1"
    """Input of the line trigger."""
    trigger_edge: Edge = "RisingEdge"
    """Edge of the line trigger's pulse."""
    chunks: bool = False
    """Let each frame tell its own time, number and exposure."""
    ptp: bool = False
    """Set the camera's clock by the network's (IEEE 1588)."""
    timeout_s: Annotated[float, Gt(0)] = 5.0
    """Time in which a frame must have arrived after its trigger and exposure, s."""
    strict: bool = False
    """Refuse a camera that lacks exposure, gain or the software trigger."""


@dataclass(frozen=True)
class Setup:
    """What the camera was set to."""

    format: PixelFormat
    format_code: int | None
    """PFNC code that frames must carry; None where the camera does not tell."""
    shape: tuple[int, int]
    exposure_s: float
    gain_db: float
    """NaN where the camera's gain has no unit."""
    free: bool
    """Whether frames come by themselves."""
    chunks: bool
    notes: tuple[str, ...]
    """The setting in words."""


def set_up(features: Features, options: GenicamOptions) -> Setup:
    """Set everything that the options ask for, each verified by reading it back.

    Raises:
        ValueError: the camera lacks or refuses something that was asked for; says what, and what is allowed.
    """
    chosen = _pixel_format(features, options)
    _region(features, options)
    for name, value in (*names.AUTOMATIC, *names.NONLINEAR):
        features.put(name, value, needed=False)
    features.put(names.EXPOSURE, options.exposure_s * 1e6)
    gain_db = _gain(features, options)
    features.put("AcquisitionMode", "Continuous", needed=False)
    trigger = _trigger(features, options)
    transport = _transport(features, options)
    chunks = _chunks(features) if options.chunks else ()
    if options.strict and features.missing:
        raise ValueError(f"the camera lacks {', '.join(features.missing)}")
    node = features.node("PixelFormat")
    shape = int(features.value("Height") or 0), int(features.value("Width") or 0)
    exposure_s = exposure_of(features, options.exposure_s)
    notes = [f"{shape[1]}x{shape[0]} {chosen.name}", trigger]
    if features.node(names.EXPOSURE) is not None:
        notes.append(f"exposure {exposure_s * 1e3:g} ms")
    if features.node(names.GAIN) is not None:
        notes.append(f"gain {gain_db:g} dB")
    notes += transport
    if options.chunks:
        notes.append(f"chunks {', '.join(chunks)}")
    return Setup(
        format=chosen,
        format_code=None if node is None else int(node.get_int_value()),
        shape=shape,
        exposure_s=exposure_s,
        gain_db=gain_db,
        free=trigger == "free running",
        chunks=bool(chunks),
        notes=tuple(notes),
    )


def exposure_of(features: Features, wanted_s: float) -> float:
    """The exposure that the camera really took, s (exposures have steps); what was wanted where it cannot be read."""
    exposure = features.value(names.EXPOSURE)
    return wanted_s if exposure is None else float(exposure) * 1e-6


def _pixel_format(features: Features, options: GenicamOptions) -> PixelFormat:
    offered = features.symbols("PixelFormat")
    chosen = pixel_format(options.pixel_format) if options.pixel_format else choose(offered)
    if chosen is None:
        raise ValueError(f"pixel_format: the camera offers {', '.join(offered) or 'none'}, none of them monochrome")
    features.put("PixelFormat", chosen.name)
    return chosen


def _region(features: Features, options: GenicamOptions) -> None:
    sizes = (("Width", options.width_px), ("Height", options.height_px))
    offsets = (("OffsetX", options.offset_x_px), ("OffsetY", options.offset_y_px))
    if options.mosaic != "none":
        for name, value in (*sizes, *offsets):
            if value % 2:
                raise ValueError(f"{name}: found {value}, allowed: even numbers for a mosaic of polarizers")
    # An offset that stands from before would forbid a large width.
    if any(value for _, value in sizes):
        for name, _ in offsets:
            features.put(name, 0, needed=False)
    for name, value in (*sizes, *offsets):
        if value:
            features.require(name, value)
            if (got := features.value(name)) != value:
                raise ValueError(f"{name}: found {value}, nearest allowed: {got}")
    if options.mosaic != "none":
        for name in ("OffsetX", "OffsetY"):
            if int(features.value(name) or 0) % 2:
                raise ValueError(f"{name} stands at {features.value(name)}: a mosaic of polarizers needs it even")


def _gain(features: Features, options: GenicamOptions) -> float:
    if options.gain_raw >= 0:
        if options.gain_db:
            raise ValueError("gain_db and gain_raw are both given, allowed: one of them")
        features.require(names.GAIN_RAW, options.gain_raw)
        gain = features.value(names.GAIN)
        return math.nan if gain is None else float(gain)
    if options.gain_db or features.node(names.GAIN) is not None:
        features.put(names.GAIN, options.gain_db)
    gain = features.value(names.GAIN)
    if gain is not None:
        return float(gain)
    return 0.0 if features.node(names.GAIN_RAW) is None else math.nan


def _trigger(features: Features, options: GenicamOptions) -> str:
    """Set the trigger; what it is in words."""
    for wanted in names.TRIGGER_STARTS:
        if wanted in features.symbols("TriggerSelector"):
            features.put("TriggerSelector", wanted)
            break
    if options.trigger == "line":
        features.require("TriggerSource", options.trigger_line)
        features.put("TriggerActivation", options.trigger_edge, needed=False)
        features.require("TriggerMode", "On")
        return f"trigger on {options.trigger_line}"
    if options.trigger == "software":
        lacking = next((name for name in ("TriggerMode", "TriggerSoftware") if features.node(name) is None), None)
        if lacking is None:
            features.put("TriggerSource", "Software", needed=False)
            if features.put("TriggerMode", "On"):
                return "software trigger"
        else:
            features.missing.append(lacking)
    features.put("TriggerMode", "Off", needed=False)
    if options.frame_rate_hz:
        features.put(names.FRAME_RATE_ENABLE, True, needed=False)
        features.require(names.FRAME_RATE, options.frame_rate_hz)
    return "free running"


def _transport(features: Features, options: GenicamOptions) -> list[str]:
    notes = []
    if options.packet_size_bytes:
        features.require(names.PACKET_SIZE, options.packet_size_bytes)
        notes.append(f"packets of {features.value(names.PACKET_SIZE)} bytes")
    if options.packet_delay_s:
        features.require(
            names.PACKET_DELAY, round(options.packet_delay_s * float(features.value(names.TICK_HZ) or 1e9))
        )
        notes.append(f"packet delay {options.packet_delay_s * 1e6:g} us")
    if options.ptp:
        features.require(names.PTP_ENABLE, True)
        notes.append(f"PTP {features.value(names.PTP_STATUS) or 'on'}")
    return notes


def _chunks(features: Features) -> tuple[str, ...]:
    """Switch on the chunks that the camera has; their symbols."""
    features.require("ChunkModeActive", True)
    offered = features.symbols("ChunkSelector")
    taken = []
    for symbols, _ in names.CHUNKS:
        symbol = next((symbol for symbol in symbols if symbol in offered), None)
        if symbol is None:
            features.missing.append(f"chunk {symbols[0]}")
            continue
        features.put("ChunkSelector", symbol)
        features.put("ChunkEnable", True)
        taken.append(symbol)
    return tuple(taken)
