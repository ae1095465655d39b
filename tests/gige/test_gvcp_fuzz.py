"""No datagram, random or mutated, breaks the control server, makes it grow, or gets an answer that is no GVCP."""

import contextlib
import random
import struct

import pytest
from gige_client import Client
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks import reliability_gige
from hw_mocks.gige_camera import GigeCamera
from hw_mocks.gige_camera.bootstrap import Status
from hw_mocks.gige_camera.gvcp import GvcpServer

PEER = ("127.0.0.1", 40000)
COMMANDS = st.sampled_from([0x02, 0x04, 0x40, 0x80, 0x82, 0x84, 0x86, 0x100, 0xC0, 0x81, 0xFFFE])
# Addresses near something, and anywhere.
ADDRESSES = st.sampled_from([0, 4, 0xF4, 0x938, 0x954, 0xA00, 0xD04, 0x10000, 0x10040, 0x200000]) | st.integers(
    0, 2**32 - 1
)
BODIES = st.binary(max_size=64) | st.lists(st.tuples(ADDRESSES, st.integers(0, 2**32 - 1)), max_size=8).map(
    lambda pairs: b"".join(struct.pack(">II", *pair) for pair in pairs)
)
DATAGRAMS = st.binary(max_size=80) | st.builds(
    lambda flags, command, lie, number, body: (
        struct.pack(">BBHHH", 0x42, flags, command, len(body) if lie is None else lie, number) + body
    ),
    st.integers(0, 255),
    COMMANDS,
    st.none() | st.integers(0, 0xFFFF),
    st.integers(0, 0xFFFF),
    BODIES,
)


def check(server: GvcpServer, datagram: bytes) -> None:
    answer = server.answer(datagram, PEER, 0)
    if answer is None:
        return
    status, ack, length, number = struct.unpack_from(">HHHH", answer)
    Status(status)
    assert len(answer) == 8 + length <= 548
    assert number == int.from_bytes(datagram[6:8], "big")
    assert ack == int.from_bytes(datagram[2:4], "big") + 1


@pytest.mark.parametrize("controls", [False, True])
@given(datagrams=st.lists(DATAGRAMS, min_size=1, max_size=20))
@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_datagrams(camera: GigeCamera, controls: bool, datagrams: list[bytes]) -> None:
    camera.registers.power_up()
    server = GvcpServer(camera.registers, lambda request: None, lambda: None)
    if controls:
        server.answer(bytes.fromhex("42010082 00080001 00000a00 00000002"), PEER, 0)
    words = len(camera.registers._words)
    for datagram in datagrams:
        check(server, datagram)
    assert len(camera.registers._words) == words


def test_random_datagrams_on_the_wire_leave_it_answering(client: Client) -> None:
    chance = random.Random(5)
    valid = bytes.fromhex("42010082 00100002 00000938 000003e8 00000d08 00000010")
    for _ in range(2000):
        mutated = bytearray(valid)
        for _ in range(chance.randrange(1, 5)):
            mutated[chance.randrange(len(mutated))] = chance.randrange(256)
        client.control.sendto(bytes(mutated[: chance.randrange(len(mutated) + 1)]), ("127.0.0.1", client.camera.port))
    client.camera.check()
    # Whatever was answered waits before our next answer; sockets' buffers may have overflowed with it.
    client.number = 0x7000
    client.control.settimeout(0.2)
    for _ in range(20):
        with contextlib.suppress(TimeoutError):
            assert client.read(0) == 0x00020000
            return
    pytest.fail("the camera no longer answers")


def test_short_version_of_the_fuzz_campaign() -> None:
    row = reliability_gige._fuzz(5_000)
    assert row.ok, row
