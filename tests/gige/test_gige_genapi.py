"""The camera's description read by the standard's reference implementation, GenApi, over the camera's own memory."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any

import pytest

from hw_mocks.gige_camera import GigeCamera

genapi = pytest.importorskip("genicam.genapi", reason="needs the genicam package")


class MemoryPort(genapi.AbstractPort):  # type: ignore[misc, name-defined]
    """GenApi's way to the camera, without a network between."""

    def __init__(self, camera: GigeCamera) -> None:
        super().__init__()
        self.registers = camera.registers

    def read(self, address: int, length: int) -> bytes:
        return self.registers.read(address, length)

    def write(self, address: int, data: bytes) -> None:
        self.registers.write(address, bytes(data))

    def get_access_mode(self) -> int:
        return int(genapi.EAccessMode.RW)

    def is_open(self) -> bool:
        return True

    def open(self, *_: object) -> None: ...

    def close(self) -> None: ...


@pytest.fixture
def nodes(camera: GigeCamera) -> Iterator[Any]:
    made = genapi.NodeMap()
    made.load_xml_from_string(camera.registers.description.decode())
    port = MemoryPort(camera)
    made.connect(port, "Device")
    # The node map does not keep the port alive.
    yield made
    assert port is not None


def test_every_feature_can_be_read(camera: GigeCamera, nodes: Any) -> None:
    space = "{http://www.genicam.org/GenApi/Version_1_1}"
    root = ET.fromstring(camera.registers.description)
    kinds = ("Integer", "Float", "Boolean", "Enumeration", "StringReg")
    names = [node.get("Name") for kind in kinds for node in root.iter(space + kind)]
    # What chunks hold is read from frames, not from the camera.
    chunks = {"ChunkTimestamp", "ChunkFrameID", "ChunkExposureTime", "ChunkGain"}
    assert chunks <= set(names)
    assert len(names) > len(chunks) + 40
    for name in set(names) - chunks:
        assert nodes.get_node(name).value is not None, name


def test_values_and_limits(camera: GigeCamera, nodes: Any) -> None:
    assert nodes.Width.value == 96
    assert (nodes.Width.min, nodes.Width.max, nodes.Width.inc) == (16, 96, 2)
    nodes.Width.value = 32
    # The room for the offset follows: 96 - 32 columns.
    assert nodes.OffsetX.max == 64
    assert nodes.PayloadSize.value == 32 * 64 * 2
    assert nodes.ExposureTime.value == 1000.0
    nodes.ExposureTime.value = 250.5
    assert camera.registers.value("ExposureTime") == 250.5
    assert set(nodes.PixelFormat.symbolics) == {
        "Mono8", "Mono10", "Mono10p", "Mono12", "Mono12p", "Mono12Packed", "Mono16",
    }  # fmt: skip
    nodes.PixelFormat.value = "Mono12p"
    assert camera.registers.value("PixelFormat") == 0x010C0047
    assert nodes.DeviceModelName.value == "SimCam"
    assert nodes.GevTimestampTickFrequency.value == 125_000_000


def test_parts_of_a_register(camera: GigeCamera, nodes: Any) -> None:
    nodes.GevSCPSPacketSize.value = 1400
    nodes.GevSCPSDoNotFragment.value = True
    # Packet size in the lower half, do-not-fragment in bit 30 of the same word.
    assert camera.registers.number(0x0D04) == 0x40000578
    assert nodes.GevSCPSPacketSize.value == 1400


def test_commands_and_locks(camera: GigeCamera, nodes: Any) -> None:
    nodes.GevTimestampControlLatch.execute()
    assert 0 < nodes.GevTimestampValue.value <= camera.clock.ticks()
    nodes.TLParamsLocked.value = 1
    assert int(nodes.Width.get_access_mode()) == int(genapi.EAccessMode.RO)
    nodes.TLParamsLocked.value = 0
    nodes.AcquisitionStart.execute()
    assert camera.acquiring
    nodes.AcquisitionStop.execute()
    assert not camera.acquiring


def test_chunk_selection(nodes: Any) -> None:
    for name in ("Timestamp", "FrameID", "ExposureTime", "Gain"):
        nodes.ChunkSelector.value = name
        nodes.ChunkEnable.value = name == "Gain"
    nodes.ChunkSelector.value = "FrameID"
    assert nodes.ChunkEnable.value is False
    nodes.ChunkSelector.value = "Gain"
    assert nodes.ChunkEnable.value is True
