"""Frames over real sockets: every pixel, every packet format, triggers, chunks, regions, resends, time stamps."""

import struct
import time

import numpy as np
import pytest
from gige_client import SCPS, Client, collect, image_of

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.gige_camera import GigeCamera, Link, Pattern, PixelFormat, Settings
from hw_mocks.gige_camera.gvsp import FramePackets, runs
from hw_mocks.gige_camera.pixel_packing import pack
from hw_mocks.world import World


def pattern(rows: int, columns: int, number: int) -> np.ndarray:
    """The documented test pattern, by its formula."""
    y, x = np.mgrid[:rows, :columns]
    return ((7 * x + 13 * y + 16 * number) % 65536).astype(np.uint16)


@pytest.mark.parametrize("packet_size", [576, 1500, 9000])
def test_frames_arrive_pixel_by_pixel(client: Client, packet_size: int) -> None:
    client.open(packet_size)
    client.start()
    blocks = client.blocks(5)
    client.stop()
    assert list(blocks)[:5] == [1, 2, 3, 4, 5]
    for number in range(1, 6):
        block = blocks[number]
        assert block.complete
        data, geometry = image_of(block)
        assert geometry == (96, 64, 0, 0)
        np.testing.assert_array_equal(data.view("<u2").reshape(64, 96), pattern(64, 96, number - 1))
        # Payload type image, Mono16; the trailer tells the rows.
        assert struct.unpack_from(">H", block.leader, 2) == (1,)
        assert struct.unpack_from(">I", block.leader, 12) == (0x01100007,)
        assert struct.unpack(">HHI", block.trailer) == (0, 1, 64)
        # IP, UDP and GVSP headers take 36 bytes of the packet size; all but the last packet are full.
        sizes = [len(block.data[k]) for k in sorted(block.data)]
        assert set(sizes[:-1]) <= {packet_size - 36}
        assert 0 < sizes[-1] <= packet_size - 36


@pytest.mark.parametrize("pixel_format", list(PixelFormat))
def test_formats(client: Client, pixel_format: PixelFormat) -> None:
    client.open()
    assert client.put("PixelFormat", int(pixel_format)) == 0
    assert client.read(client.at("PayloadSize")) == pixel_format.size(64 * 96)
    client.start()
    block = client.take()
    assert struct.unpack_from(">I", block.leader, 12) == (int(pixel_format),)
    assert block.payload == pack(pattern(64, 96, 0), pixel_format).tobytes()


def test_region_is_a_window_of_the_whole(client: Client) -> None:
    client.open()
    for name, value in (("Width", 32), ("Height", 20), ("OffsetX", 10), ("OffsetY", 6)):
        assert client.put(name, value) == 0
    # It would stick out, is odd, or is too small.
    for name, value in (("OffsetX", 66), ("Width", 88), ("OffsetY", 7), ("Height", 8)):
        assert client.put(name, value) == 0x8002
    client.start()
    # The stream's shape is locked while frames are taken; the exposure is not.
    assert client.put("Width", 16) == 0x8007
    assert client.put("ExposureTime", 500.0) == 0
    data, geometry = image_of(client.take())
    assert geometry == (32, 20, 10, 6)
    np.testing.assert_array_equal(data.view("<u2").reshape(20, 32), pattern(64, 96, 0)[6:26, 10:42])


def test_64_bit_block_ids(client: Client) -> None:
    client.open()
    assert client.write(0x960, 0x40000000) == 0
    client.start()
    packets = [client.stream.recv(65_536) for _ in range(3)]
    # Extended header: flag and type in byte 4, 64-bit block id, 32-bit packet id.
    assert packets[0][:20] == struct.pack(">HHBBHQI", 0, 0, 0x81, 0, 0, 1, 0)
    assert packets[1][:20] == struct.pack(">HHBBHQI", 0, 0, 0x83, 0, 0, 1, 1)
    # 20 bytes of header instead of 8.
    assert len(packets[1]) == 1472
    found: dict = {}
    for packet in packets:
        collect(found, packet)
    for packet in client.packets(0.5):
        if collect(found, packet):
            break
    assert found[1].payload == pattern(64, 96, 0).tobytes()


def test_chunks(client: Client) -> None:
    client.open()
    assert client.put("ChunkModeActive", 1) == 0
    assert client.put("ChunkSelector", 0x1004) == 0
    assert client.put("ChunkEnable", 0) == 0
    assert client.put("ChunkSelector", 0x0001) == 0
    assert client.put("ChunkEnable", 0) == 0
    assert client.read(client.at("ChunkEnable")) == 1  # the image itself stays
    size = client.read(client.at("PayloadSize"))
    client.start()
    block = client.take()
    assert len(block.payload) == size
    # Read from the end: content, then id and length.
    rest, chunks = block.payload, {}
    while rest:
        number, length = struct.unpack(">II", rest[-8:])
        chunks[number] = rest[-8 - length : -8]
        rest = rest[: -8 - length]
    assert sorted(chunks) == [0x0001, 0x1001, 0x1002, 0x1003]
    assert chunks[1] == pattern(64, 96, 0).tobytes()
    assert struct.unpack(">Q", chunks[0x1001]) == (block.timestamp,)
    assert struct.unpack(">Q", chunks[0x1002]) == (1,)
    assert struct.unpack(">d", chunks[0x1003]) == (1000.0,)
    # Payload type: image in extended chunk mode; the trailer tells the length of all.
    assert struct.unpack_from(">H", block.leader, 2) == (0x4001,)
    assert struct.unpack(">HHIII", block.trailer) == (0, 0x4001, 64, size, 0)


def test_frame_rate_and_time_stamps(client: Client) -> None:
    client.open()
    assert client.put("AcquisitionFrameRate", 200.0) == 0
    client.start()
    blocks = client.blocks(40)
    client.stop()
    stamps = np.array([blocks[k].timestamp for k in range(1, 41)], dtype=np.int64)
    period = 125e6 / 200 * (1 + 40e-6)
    steps = np.diff(stamps) / period
    # Exposures begin on a grid; a slow machine skips whole periods, and rounding costs a tick.
    assert np.abs(steps - np.rint(steps)).max() * period <= 1.0
    assert np.median(steps) == pytest.approx(1.0, abs=1e-5)


def test_software_trigger(client: Client) -> None:
    client.open()
    assert client.put("TriggerMode", 1) == 0
    client.start()
    assert list(client.packets(0.15)) == []
    for k in range(3):
        assert client.write(client.at("TriggerSoftware"), 1) == 0
        data, _ = image_of(client.take())
        np.testing.assert_array_equal(data.view("<u2").reshape(64, 96), pattern(64, 96, k))
    # The line is not the trigger's source.
    client.camera.line_pulse()
    assert list(client.packets(0.15)) == []
    assert client.camera.counts["triggers missed"] == 1


def test_line_trigger_and_missed_ones(client: Client) -> None:
    client.open()
    assert client.put("TriggerMode", 1) == 0
    assert client.put("TriggerSource", 1) == 0
    assert client.put("ExposureTime", 60_000.0) == 0
    client.start()
    before = client.camera.clock.ticks()
    client.camera.line_pulse()
    client.camera.line_pulse()  # during the exposure of 60 ms
    block = client.take()
    assert client.camera.clock.ticks() - block.timestamp >= 0.06 * 125e6
    assert block.timestamp >= before
    assert client.camera.counts["triggers missed"] == 1
    assert list(client.packets(0.15)) == []


@pytest.mark.parametrize(("mode", "count"), [(1, 1), (2, 3)])
def test_single_and_multi_frame(client: Client, mode: int, count: int) -> None:
    client.open()
    assert client.put("AcquisitionMode", mode) == 0
    assert client.put("AcquisitionFrameCount", 3) == 0
    for start in range(2):
        client.start()
        blocks = client.blocks(99)
        # Block ids start at 1 each time.
        assert sorted(blocks) == list(range(1, count + 1)), start
        assert not client.camera.acquiring


def test_single_frames_at_once_one_after_the_other(client: Client) -> None:
    client.open()
    assert client.put("AcquisitionMode", 1) == 0
    for k in range(30):
        client.start()
        data, _ = image_of(client.take())
        np.testing.assert_array_equal(data.view("<u2").reshape(64, 96), pattern(64, 96, k))


def test_resends_complete_frames(client: Client, faults: FaultScript) -> None:
    faults.start(FaultKind.DROP_PACKETS, amount=0.3)
    client.open(576)
    assert client.put("AcquisitionMode", 1) == 0
    client.start()
    found = client.blocks(99)
    total = -(-64 * 96 * 2 // 540)
    block = found[1]
    missing = set(range(1, total + 1)) - set(block.data)
    assert 0 < len(missing) < total
    faults.stop(FaultKind.DROP_PACKETS)
    for number in sorted(missing):
        client.send(0x40, struct.pack(">HHII", 0, 1, number, number), flags=0)
    # Leader, trailer, and whatever lies beyond the end of the frame.
    client.send(0x40, struct.pack(">HHII", 0, 1, 0, 0), flags=0)
    client.send(0x40, struct.pack(">HHII", 0, 1, total + 1, 0xFFFFFF), flags=0)
    for packet in client.packets(0.5):
        collect(found, packet)
    assert block.complete
    assert block.payload == pattern(64, 96, 0).tobytes()
    # A frame long gone: the packet that says so, and nothing else (status PACKET_UNAVAILABLE).
    client.send(0x40, struct.pack(">HHII", 0, 77, 4, 9), flags=0)
    assert list(client.packets(0.3)) == [bytes.fromhex("800c 004d 03000004")]


def test_test_packets_show_the_path_s_limit() -> None:
    link = Link(mtu=4000)
    with GigeCamera(Pattern(64, 96), World(), port=0, settings=Settings(link=link)) as camera, Client(camera) as client:
        client.open()
        for size, arrives in ((1500, True), (4000, True), (4004, False), (9000, False)):
            assert client.write(SCPS, 0xC0000000 | size) == 0
            # The bit that fires is not kept, the one that forbids fragments is.
            assert client.read(SCPS) == 0x40000000 | size
            assert [len(packet) for packet in client.packets(0.15)] == ([size - 28] if arrives else [])


def test_inter_packet_delay_is_kept(client: Client) -> None:
    client.open(576)
    assert client.put("AcquisitionMode", 1) == 0
    assert client.write(0xD08, 125_000) == 0  # 1 ms
    client.start()
    instants = []
    for packet in client.packets(0.5):
        instants.append(time.perf_counter())
        if packet[4] == 2:
            break
    # 23 data packets, 1 ms apart; they may come late, but not early.
    assert len(instants) == 25
    assert instants[-1] - instants[0] >= 0.021


def test_stream_stops_when_the_client_is_gone(client: Client) -> None:
    client.open()
    assert client.write(0x938, 500) == 0
    client.start()
    deadline = time.monotonic() + 5
    while client.camera.acquiring and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not client.camera.acquiring
    assert client.camera.controller is None


def test_user_set_and_reset(client: Client) -> None:
    client.open()
    assert client.put("Gain", 6.0) == 0
    assert client.write(client.at("UserSetLoad"), 1) == 0
    assert client.camera.registers.value("Gain") == 0.0
    assert client.put("Gain", 6.0) == 0
    client.write(client.at("DeviceReset"), 1)
    assert client.camera.controller is None
    assert client.camera.registers.value("Gain") == 0.0


def test_packets_of_a_frame_by_hand() -> None:
    data = np.arange(100, dtype=np.uint8)
    frame = FramePackets(0x0102, b"LEAD", data, b"END!", 28 + 8 + 40, extended=False)
    assert frame.count == 5
    assert [bytes(frame.packet(k)) for k in range(5)] == [
        bytes.fromhex("0000 0102 01000000") + b"LEAD",
        bytes.fromhex("0000 0102 03000001") + bytes(range(40)),
        bytes.fromhex("0000 0102 03000002") + bytes(range(40, 80)),
        bytes.fromhex("0000 0102 03000003") + bytes(range(80, 100)),
        bytes.fromhex("0000 0102 02000004") + b"END!",
    ]
    with pytest.raises(IndexError):
        frame.packet(5)
    assert runs([False, True, True, False, False]) == [(1, 1), (4, 5)]
    assert runs([True, True]) == []
