"""The camera's features by their names of the standard features naming convention (SFNC), each with its register.

One table, from which both the register file and the GenICam description are made.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

from hw_mocks.gige_camera.bootstrap import (
    CONTROL,
    LATCH_TIMESTAMP,
    RESET_TIMESTAMP,
    SWITCHOVER_ENABLED,
    Bootstrap,
)
from hw_mocks.gige_camera.pixel_packing import PixelFormat

BASE = 0x10000
"""Address of the first register that is the camera's own."""

CHUNKS = {"Image": 0x0001, "Timestamp": 0x1001, "FrameID": 0x1002, "ExposureTime": 0x1003, "Gain": 0x1004}
"""Chunks and their ids."""


@dataclass(frozen=True, eq=False)
class Feature:
    """A feature and the register behind it.

    ``kind`` is ``"integer"``, ``"float"``, ``"boolean"``, ``"enumeration"``, ``"command"`` or ``"string"``. Limits that
    are text are formulas over other features' names.
    """

    name: str
    kind: str
    category: str
    tip: str
    default: float | str = 0
    low: float = 0
    high: float | str = 0xFFFFFFFF
    step: int = 1
    unit: str = ""
    writable: bool = True
    symbols: Mapping[str, int] = field(default_factory=dict)
    address: int = 0
    """Set for bootstrap registers; the camera's own get theirs in turn."""
    size: int = 0
    """Bytes of the register; by kind if left out."""
    bits: tuple[int, int] | None = None
    """Lowest and highest bit (from the least significant) where the feature is a part of its register."""
    frozen: bool = False
    """Cannot be written while the camera acquires."""
    chunk: str = ""
    """Name of the chunk that holds it; it has no register."""
    command_value: int = 1

    @property
    def length(self) -> int:
        """Bytes of the register."""
        return self.size or (8 if self.kind == "float" else 4)

    @property
    def own(self) -> bool:
        """Whether its register is the camera's own, not the standard's."""
        return self.address >= BASE

    def encode(self, value: float) -> bytes:
        """The register's content for a value."""
        if self.kind == "float":
            return struct.pack(">d", value)
        return int(value).to_bytes(self.length, "big")

    def decode(self, content: bytes) -> float:
        """The value of a register's content."""
        if self.kind == "float":
            return float(struct.unpack(">d", content)[0])
        return int.from_bytes(content, "big")


def make_features(
    *, width: int, height: int, exposure_us: float, frame_rate_hz: float, formats: tuple[PixelFormat, ...]
) -> tuple[Feature, ...]:
    """The table for a sensor of so many columns and rows; the first of ``formats`` is set at power-up."""
    own = [
        *_image_features(width, height, formats),
        *_acquisition_features(exposure_us, frame_rate_hz),
        *_chunk_features(),
        *_other_features(),
    ]
    placed, address = [], BASE
    for feature in own:
        placed.append(feature if feature.chunk else _at(feature, address))
        address += 0 if feature.chunk else feature.length
    return (*_device_features(), *placed, *_transport_features())


def _at(feature: Feature, address: int) -> Feature:
    return Feature(**{**feature.__dict__, "address": address})


def _image_features(width: int, height: int, formats: tuple[PixelFormat, ...]) -> list[Feature]:
    group = "ImageFormatControl"

    def whole(name: str, tip: str, value: int, low: int, high: int | str, step: int) -> Feature:
        return Feature(name, "integer", group, tip, value, low, high, step, frozen=True)

    return [
        Feature("SensorWidth", "integer", group, "Columns of the sensor", width, writable=False),
        Feature("SensorHeight", "integer", group, "Rows of the sensor", height, writable=False),
        Feature("WidthMax", "integer", group, "Largest width of a frame", width, writable=False),
        Feature("HeightMax", "integer", group, "Largest height of a frame", height, writable=False),
        whole("Width", "Columns of a frame", width, min(16, width), "WidthMax - OffsetX", 2),
        whole("Height", "Rows of a frame", height, min(16, height), "HeightMax - OffsetY", 2),
        # Steps of two keep the phase of a polarization mosaic.
        whole("OffsetX", "First column of a frame", 0, 0, "WidthMax - Width", 2),
        whole("OffsetY", "First row of a frame", 0, 0, "HeightMax - Height", 2),
        Feature(
            "PixelFormat",
            "enumeration",
            group,
            "How pixels are packed",
            int(formats[0]),
            symbols={entry.name: int(entry) for entry in formats},
            frozen=True,
        ),
    ]


def _acquisition_features(exposure_us: float, frame_rate_hz: float) -> list[Feature]:
    group = "AcquisitionControl"
    modes = {"Continuous": 0, "SingleFrame": 1, "MultiFrame": 2}
    return [
        Feature("AcquisitionMode", "enumeration", group, "How many frames one start takes", 0, symbols=modes),
        Feature("AcquisitionFrameCount", "integer", group, "Frames in mode MultiFrame", 1, 1, 65_535),
        Feature("AcquisitionStart", "command", group, "Begin to take frames"),
        Feature("AcquisitionStop", "command", group, "Stop taking frames"),
        Feature("AcquisitionFrameRateEnable", "boolean", group, "Whether AcquisitionFrameRate holds", 1),
        Feature("AcquisitionFrameRate", "float", group, "Frames per second", frame_rate_hz, 0.1, 1000.0, unit="Hz"),
        Feature("ExposureMode", "enumeration", group, "What sets the exposure", 1, symbols={"Timed": 1}),
        Feature("ExposureTime", "float", group, "Exposure", exposure_us, 10.0, 10e6, unit="us"),
        Feature("TriggerSelector", "enumeration", group, "What a trigger starts", 0, symbols={"FrameStart": 0}),
        Feature("TriggerMode", "enumeration", group, "Whether frames wait", 0, symbols={"Off": 0, "On": 1}),
        Feature("TriggerSource", "enumeration", group, "What triggers", 0, symbols={"Software": 0, "Line1": 1}),
        Feature("TriggerSoftware", "command", group, "Trigger now"),
    ]


def _chunk_features() -> list[Feature]:
    group = "ChunkDataControl"
    chunk = {"writable": False}
    return [
        Feature("ChunkModeActive", "boolean", group, "Whether frames carry chunks", 0, frozen=True),
        Feature("ChunkSelector", "enumeration", group, "Which chunk", 0x1001, symbols=CHUNKS),
        Feature("ChunkEnable", "boolean", group, "Whether frames carry the selected chunk", 1, frozen=True),
        Feature("ChunkTimestamp", "integer", group, "Start of exposure, ticks", chunk="Timestamp", size=8, **chunk),  # type: ignore[arg-type]
        Feature("ChunkFrameID", "integer", group, "Number of the frame", chunk="FrameID", size=8, **chunk),  # type: ignore[arg-type]
        Feature("ChunkExposureTime", "float", group, "Exposure", unit="us", chunk="ExposureTime", **chunk),  # type: ignore[arg-type]
        Feature("ChunkGain", "float", group, "Gain", unit="dB", chunk="Gain", **chunk),  # type: ignore[arg-type]
    ]


def _other_features() -> list[Feature]:
    sets = {"Default": 0}
    return [
        Feature("Gain", "float", "AnalogControl", "Gain", 0.0, 0.0, 36.0, unit="dB"),
        Feature("DeviceTemperature", "float", "DeviceControl", "Temperature", 41.5, writable=False, unit="C"),
        Feature("DeviceReset", "command", "DeviceControl", "Switch off and on again"),
        Feature("PayloadSize", "integer", "TransportLayerControl", "Bytes of a frame", writable=False),
        Feature("TLParamsLocked", "integer", "TransportLayerControl", "Set while a client streams", 0, 0, 1),
        Feature("UserSetSelector", "enumeration", "UserSetControl", "Which set", 0, symbols=sets),
        Feature("UserSetLoad", "command", "UserSetControl", "Set everything as at power-up"),
    ]


def _device_features() -> list[Feature]:
    group = "DeviceControl"

    def text(name: str, tip: str, address: Bootstrap, size: int, *, writable: bool = False) -> Feature:
        return Feature(name, "string", group, tip, address=address, size=size, writable=writable)

    return [
        text("DeviceVendorName", "Who made it", Bootstrap.VENDOR, 32),
        text("DeviceModelName", "Which model", Bootstrap.MODEL, 32),
        text("DeviceManufacturerInfo", "More about it", Bootstrap.MANUFACTURER_INFO, 48),
        text("DeviceVersion", "Version", Bootstrap.DEVICE_VERSION, 32),
        text("DeviceSerialNumber", "Serial number", Bootstrap.SERIAL, 16),
        text("DeviceUserID", "Name given by the user", Bootstrap.USER_NAME, 16, writable=True),
    ]


def _transport_features() -> list[Feature]:
    group = "TransportLayerControl"

    def part(name: str, kind: str, tip: str, address: Bootstrap, low: int, high: int, *more: int) -> Feature:
        least, most = more if more else (0, (1 << (high - low + 1)) - 1)
        return Feature(name, kind, group, tip, low=least, high=most, address=address, bits=(low, high))

    def fixed(name: str, tip: str, address: Bootstrap, size: int = 4, unit: str = "") -> Feature:
        return Feature(name, "integer", group, tip, address=address, size=size, unit=unit, writable=False)

    def command(name: str, tip: str, value: int) -> Feature:
        return Feature(name, "command", group, tip, address=Bootstrap.TIMESTAMP_CONTROL, command_value=value)

    privileges = {"OpenAccess": 0, "ExclusiveAccess": 1, "ControlAccess": CONTROL}
    privileges["ControlAccessSwitchoverActive"] = CONTROL | SWITCHOVER_ENABLED
    return [
        Feature(
            "GevSCPSPacketSize",
            "integer",
            group,
            "Bytes of a stream packet with its IP and UDP headers",
            low=576,
            high=65_532,
            step=4,
            unit="B",
            address=Bootstrap.STREAM_PACKET_SIZE,
            bits=(0, 15),
        ),
        part("GevSCPSDoNotFragment", "boolean", "Forbid fragments", Bootstrap.STREAM_PACKET_SIZE, 30, 30),
        part("GevSCPSFireTestPacket", "boolean", "Send a test packet", Bootstrap.STREAM_PACKET_SIZE, 31, 31),
        Feature("GevSCPD", "integer", group, "Ticks between packets", address=Bootstrap.STREAM_PACKET_DELAY),
        part("GevSCPHostPort", "integer", "Port that frames go to", Bootstrap.STREAM_PORT, 0, 15),
        Feature("GevSCDA", "integer", group, "Address that frames go to", address=Bootstrap.STREAM_IP),
        fixed("GevSCSP", "Port that frames come from", Bootstrap.STREAM_SOURCE_PORT),
        Feature("GevCCP", "enumeration", group, "Control", symbols=privileges, address=Bootstrap.CONTROL_PRIVILEGE),
        Feature(
            "GevHeartbeatTimeout",
            "integer",
            group,
            "Silence after which control is lost",
            low=500,
            unit="ms",
            address=Bootstrap.HEARTBEAT_TIMEOUT_MS,
        ),
        fixed("GevCurrentIPAddress", "Address of the camera", Bootstrap.CURRENT_IP),
        fixed("GevMACAddress", "Hardware address", Bootstrap.MAC_HIGH, 8),
        fixed("GevTimestampTickFrequency", "Ticks per second", Bootstrap.TICK_HZ_HIGH, 8, "Hz"),
        command("GevTimestampControlLatch", "Remember the clock's reading", LATCH_TIMESTAMP),
        command("GevTimestampControlReset", "Set the clock to zero", RESET_TIMESTAMP),
        fixed("GevTimestampValue", "The reading remembered", Bootstrap.TIMESTAMP_HIGH, 8),
    ]
