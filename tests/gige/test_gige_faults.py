"""Every fault of the simulated camera, as a client meets it."""

import struct
import time

import pytest
from gige_client import CCP, Client

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.gige_camera import GigeCamera, Pattern
from hw_mocks.world import World


def silent(client: Client, wait_s: float = 0.2) -> bool:
    client.control.settimeout(wait_s)
    try:
        client.read(0)
    except TimeoutError:
        return True
    finally:
        client.control.settimeout(2.0)
    return False


def test_silence_carries_out_but_does_not_acknowledge(client: Client, faults: FaultScript) -> None:
    client.open()
    faults.start(FaultKind.SILENCE)
    client.send(0x82, struct.pack(">II", 0xD08, 99))
    assert silent(client)
    faults.stop(FaultKind.SILENCE)
    assert client.read(0xD08) == 99


def test_disconnect_and_return_as_after_power_up(client: Client, faults: FaultScript) -> None:
    client.open()
    client.start()
    assert client.blocks(1)
    faults.start(FaultKind.DISCONNECT)
    for _ in client.packets(0.1):
        pass
    assert silent(client)
    assert list(client.packets(0.2)) == []
    faults.stop(FaultKind.DISCONNECT)
    assert client.read(CCP) == 0
    assert client.camera.controller is None
    assert not client.camera.acquiring
    client.open()
    client.start()
    assert client.take().complete


def test_slow_answers_announce_themselves_where_asked_to(client: Client, faults: FaultScript) -> None:
    faults.start(FaultKind.SLOW, amount=0.15)
    start = time.monotonic()
    client.read(0)
    assert time.monotonic() - start >= 0.15
    assert client.write(CCP, 2) == 0
    assert client.write(0x954, 4) == 0
    number = client.send(0x80, bytes(4))
    start = time.monotonic()
    # PENDING_ACK: 150 ms until the acknowledge proper.
    assert client.control.recv(100) == struct.pack(">HHHHHH", 0, 0x89, 4, number, 0, 150)
    assert time.monotonic() - start < 0.14
    assert client.control.recv(100)[:8] == struct.pack(">HHHH", 0, 0x81, 4, number)


def test_partial_and_garbled_acknowledges(client: Client, faults: FaultScript) -> None:
    faults.start(FaultKind.PARTIAL_LINE)
    number = client.send(0x80, bytes(4))
    assert client.control.recv(100) == struct.pack(">HHH", 0, 0x81, 4)
    faults.stop(FaultKind.PARTIAL_LINE)
    faults.start(FaultKind.GARBAGE)
    number = client.send(0x80, bytes(4))
    garbage = client.control.recv(100)
    assert len(garbage) == 12
    assert garbage[:8] != struct.pack(">HHHH", 0, 0x81, 4, number)
    faults.stop(FaultKind.GARBAGE)
    assert client.read(0) == 0x00020000


def test_garbage_in_the_stream(client: Client, faults: FaultScript) -> None:
    # From the second frame on.
    faults.start(FaultKind.GARBAGE, after_count=1)
    client.open()
    client.put("AcquisitionMode", 1)
    # A leader, nine packets of up to 1464 bytes for 12288 bytes, a trailer; then the same behind three random packets.
    for expected in (11, 14):
        client.send(0x82, struct.pack(">II", client.at("AcquisitionStart"), 1))
        assert len(list(client.packets(0.4))) == expected


@pytest.mark.parametrize("kind", [FaultKind.STALL, FaultKind.HEAT_ALARM])
def test_no_frames_while_it_stalls_or_is_too_hot(client: Client, faults: FaultScript, kind: FaultKind) -> None:
    client.open()
    client.start()
    assert client.blocks(1)
    faults.start(kind)
    for _ in client.packets(0.1):
        pass
    assert list(client.packets(0.2)) == []
    assert client.read(CCP) == 2
    temperature = struct.unpack(">d", client.read_memory(client.at("DeviceTemperature"), 8))[0]
    assert temperature == (95.0 if kind is FaultKind.HEAT_ALARM else 41.5)
    faults.stop(kind)
    assert client.blocks(2)


def test_too_hot_to_start(client: Client, faults: FaultScript) -> None:
    faults.start(FaultKind.HEAT_ALARM, amount=88.0)
    client.open()
    assert client.write(client.at("AcquisitionStart"), 1) == 0x8007
    assert struct.unpack(">d", client.read_memory(client.at("DeviceTemperature"), 8))[0] == 88.0


def test_dropped_frames_leave_gaps_in_block_ids(client: Client, faults: FaultScript) -> None:
    faults.start(FaultKind.DROP_FRAMES, after_count=2, for_count=3)
    client.open()
    client.put("AcquisitionMode", 2)
    client.put("AcquisitionFrameCount", 8)
    client.start()
    assert sorted(client.blocks(99)) == [1, 2, 6, 7, 8]
    assert client.camera.counts["frames dropped"] == 3


def test_dropped_packets_are_about_as_many_as_asked(client: Client, faults: FaultScript) -> None:
    faults.start(FaultKind.DROP_PACKETS, amount=0.1)
    client.open(576)
    client.put("AcquisitionMode", 2)
    client.put("AcquisitionFrameCount", 80)
    client.put("AcquisitionFrameRate", 400.0)
    client.start()
    arrived = sum(1 for _ in client.packets(0.5))
    # 25 packets a frame, 80 frames; binomial: six standard deviations of 2000 x 0.1 x 0.9.
    assert 2000 - arrived == pytest.approx(200, abs=6 * (2000 * 0.09) ** 0.5)
    assert client.camera.counts["packets dropped"] == 2000 - arrived


def test_wrong_format_and_cut_frames(client: Client, faults: FaultScript) -> None:
    faults.start(FaultKind.WRONG_FORMAT, after_count=1, for_count=1)
    faults.start(FaultKind.OVERFLOW, after_count=2, for_count=1)
    client.open()
    client.put("AcquisitionMode", 2)
    client.put("AcquisitionFrameCount", 4)
    client.start()
    blocks = client.blocks(99)
    told = [struct.unpack_from(">I", blocks[k].leader, 12)[0] for k in range(1, 5)]
    assert told == [0x01100007, 0x02180014, 0x01100007, 0x01100007]
    assert [len(blocks[k].payload) for k in range(1, 5)] == [12288, 12288, 6144, 12288]


def test_clock_jump(client: Client, faults: FaultScript) -> None:
    before = client.camera.clock.ticks()
    faults.start(FaultKind.CLOCK_JUMP, amount=100.0)
    jumped = client.camera.clock.ticks() - before
    assert 100 * 125e6 <= jumped < 102 * 125e6
    faults.stop(FaultKind.CLOCK_JUMP)
    assert client.camera.clock.ticks() - before < 2 * 125e6
    # Before zero there is nothing: a counter has no sign.
    faults.start(FaultKind.CLOCK_JUMP, amount=-1e6)
    assert client.camera.clock.ticks() == 0


@pytest.mark.parametrize("address", ["0.0.0.0", "255.255.255.255", "224.0.0.1", "localhost"])
def test_lives_at_one_address_only(address: str) -> None:
    with pytest.raises(ValueError, match=r"address|Expected|octet"):
        GigeCamera(Pattern(16, 16), World(), address, port=0)


def test_address_in_use_and_closing_twice(camera: GigeCamera) -> None:
    with pytest.raises(OSError, match="in use"):
        GigeCamera(Pattern(16, 16), World(), port=camera.port)
    other = GigeCamera(Pattern(16, 16), World(), port=0)
    other.close()
    other.close()
