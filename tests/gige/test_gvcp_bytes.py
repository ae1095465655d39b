"""GVCP byte for byte. Expected bytes follow GigE Vision 2.0, section 16 (header) and 28 (bootstrap registers)."""

import io
import struct
import xml.etree.ElementTree as ET
import zipfile

import pytest
from gige_client import Client

from hw_mocks.gige_camera import GigeCamera, Pattern, Settings
from hw_mocks.gige_camera.gvcp import GvcpServer, ResendRequest
from hw_mocks.gige_camera.xml import describe
from hw_mocks.world import World

ME, OTHER = ("127.0.0.1", 40000), ("127.0.0.1", 40001)


class Bench:
    """A control server without sockets: the bytes in, the bytes out."""

    def __init__(self, camera: GigeCamera) -> None:
        self.asked: list[ResendRequest] = []
        self.released = 0
        self.registers = camera.registers
        self.server = GvcpServer(camera.registers, self.asked.append, self._release)

    def _release(self) -> None:
        self.released += 1

    def __call__(self, text: str, peer: tuple[str, int] = ME, now_s: float = 0.0) -> str | None:
        answer = self.server.answer(bytes.fromhex(text), peer, round(now_s * 1e9))
        return None if answer is None else answer.hex(" ", 4)


@pytest.fixture
def bench(camera: GigeCamera) -> Bench:
    return Bench(camera)


CONTROL = "42010082 00080001 00000a00 00000002"


def test_discovery(bench: Bench) -> None:
    answer = bench.server.answer(bytes.fromhex("42110002 00001234"), ME, 0)
    assert answer is not None
    # Success, DISCOVERY_ACK, 248 bytes, the request's id; version 2.0; big-endian transmitter, UTF-8.
    assert answer[:16] == bytes.fromhex("0000 0003 00f8 1234 00020000 80000001")
    assert len(answer) == 8 + 0xF8
    assert answer[8 + 0x24 : 8 + 0x28] == bytes([127, 0, 0, 1])
    assert answer[8 + 0x48 : 8 + 0x48 + 32] == b"PolFuse".ljust(32, b"\0")
    assert answer[8 + 0x68 : 8 + 0x68 + 32] == b"SimCam".ljust(32, b"\0")
    assert answer[8 + 0xD8 : 8 + 0xD8 + 16] == b"SIM0001".ljust(16, b"\0")


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        # Read one register (version), then two (version, device mode).
        ("42010080 00040001 00000000", "00000081 00040001 00020000"),
        ("42010080 00080002 00000000 00000004", "00000081 00080002 00020000 80000001"),
        # Of three registers the second is not there: the first is told, with the status of the second.
        ("42010080 000c0003 00000000 0000ff00 00000004", "80030081 00040003 00020000"),
        # Read memory: the address comes back before the data; not there; not aligned; not a whole number of words.
        ("42010084 00080004 00000048 00000008", "00000085 000c0004 00000048 506f6c46 75736500"),
        ("42010084 00080004 00300000 00000008", "80030085 00000004"),
        ("42010084 00080004 00000002 00000004", "80050085 00000004"),
        ("42010084 00080004 00000004 00000003", "80050085 00000004"),
        ("42010084 00080004 00000004 00000000", "80020085 00000004"),
        ("42010084 00080004 00000000 00000400", "80020085 00000004"),
        # Writing without control: denied, no register written.
        ("42010082 00080005 00000938 000003e8", "80060083 00040005 00000000"),
        ("42010086 00080005 00000938 000003e8", "80060087 00040005 00000000"),
        # An unknown command; an event command, which this camera has not.
        ("42010100 00000006", "80010101 00000006"),
        ("420100c0 00000006", "800100c1 00000006"),
        # Lengths that are not true, or not whole registers.
        ("42010080 00080007 00000000", "800e0081 00000007"),
        ("42010080 00030007 000000", "80020081 00000007"),
        ("42010080 00000007", "80020081 00000007"),
        # No acknowledge asked for; the wrong key; an acknowledge; request id 0; a header that breaks off.
        ("42000080 00040008 00000000", None),
        ("41010080 00040008 00000000", None),
        ("42010081 00040008 00000000", None),
        ("42010080 00040000 00000000", None),
        ("42010080 0004", None),
        ("", None),
    ],
)
def test_answers(bench: Bench, command: str, expected: str | None) -> None:
    assert bench(command) == expected


def test_writing_with_control(bench: Bench) -> None:
    assert bench(CONTROL) == "00000083 00040001 00000001"
    # Heartbeat and packet delay in one command: two written.
    assert bench("42010082 00100002 00000938 000003e8 00000d08 00000010") == "00000083 00040002 00000002"
    assert bench("42010080 00080003 00000938 00000d08") == "00000081 00080003 000003e8 00000010"
    # The second is read-only, not aligned, not there: one was written.
    for request_id, address, status in ((4, "00000000", "8004"), (5, "00000939", "8005"), (6, "0000fffc", "8003")):
        command = f"42010082 0010{request_id:04x} 00000938 000003e9 {address} 00000000"
        assert bench(command) == f"{status}0083 0004{request_id:04x} 00000001"
    # The user's name, eight bytes of it.
    assert bench("42010086 000c0007 000000e8 7261696c 00000000") == "00000087 00040007 00000008"
    assert bench("42010084 00080008 000000e8 00000008") == "00000085 000c0008 000000e8 7261696c 00000000"
    # The description is there to be read only.
    assert bench("42010082 00080009 00200000 00000000") == "80040083 00040009 00000000"
    # Values that a feature does not take: width 1, pixel format 5, a frame rate that is not a number.
    width, pixels, rate = (bench.registers.address_of(n) for n in ("Width", "PixelFormat", "AcquisitionFrameRate"))
    assert bench(f"42010082 0008000a {width:08x} 00000001") == "80020083 0004000a 00000000"
    assert bench(f"42010082 0008000b {pixels:08x} 00000005") == "80020083 0004000b 00000000"
    assert bench(f"42010086 000c000c {rate:08x} 7ff80000 00000000") == "80020087 0004000c 00000000"
    assert bench.registers.value("Width") == 96


def test_who_controls(bench: Bench) -> None:
    assert bench(CONTROL) == "00000083 00040001 00000001"
    # The register tells it, and so do the primary application's port and address (40000, 127.0.0.1).
    assert bench("42010080 000c0002 00000a00 00000a04 00000a14", OTHER) == (
        "00000081 000c0002 00000002 00009c40 7f000001"
    )
    # Another may read, but neither write nor take over.
    assert bench("42010080 00040003 00000000", OTHER) == "00000081 00040003 00020000"
    assert bench("42010082 00080004 00000938 00000400", OTHER) == "80060083 00040004 00000000"
    assert bench("42010082 00080005 00000a00 00000002", OTHER) == "80060083 00040005 00000000"
    # After release it may.
    assert bench("42010082 00080006 00000a00 00000000") == "00000083 00040006 00000001"
    assert bench.released == 1
    assert bench("42010082 00080007 00000a00 00000002", OTHER) == "00000083 00040007 00000001"


def test_exclusive_access_shuts_others_out(bench: Bench) -> None:
    assert bench("42010082 00080001 00000a00 00000001") == "00000083 00040001 00000001"
    assert bench("42010080 00040002 00000000", OTHER) == "80060081 00000002"
    assert bench("42010084 00080003 00000000 00000004", OTHER) == "80060085 00000003"
    # Why it is denied may be read; and cameras are found whoever holds them.
    assert bench("42010080 00040004 00000a00", OTHER) == "00000081 00040004 00000001"
    assert bench("42010002 00000005", OTHER) is not None
    assert bench("42010080 00040006 00000000") == "00000081 00040006 00020000"


def test_control_changes_hands_with_the_key(bench: Bench) -> None:
    # The owner sets key 0x1234 and allows the switchover.
    bench("42010082 00100001 00000a00 00000002 0000095c 00001234")
    assert bench("42010082 00080002 00000a00 12340002", OTHER) == "80060083 00040002 00000000"
    assert bench("42010082 00080003 00000a00 00000006") == "00000083 00040003 00000001"
    assert bench("42010082 00080004 00000a00 43210002", OTHER) == "80060083 00040004 00000000"
    assert bench("42010082 00080005 00000a00 12340002", OTHER) == "00000083 00040005 00000001"
    assert bench.server.owner == OTHER
    assert bench("42010082 00080006 00000938 00000400") == "80060083 00040006 00000000"


def test_control_ends_with_the_heartbeat(bench: Bench) -> None:
    bench("42010082 00180001 00000a00 00000002 00000938 000003e8 00000d00 00009c40")
    bench("42010080 00040002 00000a00", now_s=0.9)
    bench.server.check_heartbeat(1_800_000_000)
    assert bench.server.owner == ME  # 0.9 s of silence; the limit is 1 s
    bench.server.check_heartbeat(1_950_000_000)
    assert bench.server.owner is None
    assert bench.released == 1
    # Nobody holds it, and frames go nowhere.
    assert bench("42010080 00080003 00000a00 00000d00") == "00000081 00080003 00000000 00000000"


def test_heartbeat_can_be_switched_off_and_has_a_least_value(bench: Bench) -> None:
    bench("42010082 00180001 00000a00 00000002 00000938 00000001 00000954 00000001")
    assert bench("42010080 00040002 00000938") == "00000081 00040002 000001f4"
    bench.server.check_heartbeat(10**15)
    assert bench.server.owner == ME


def test_a_repeated_command_is_carried_out_once(bench: Bench) -> None:
    pulses: list[int] = []
    trigger = bench.registers.address_of("TriggerSoftware")
    bench.registers.hooks[trigger] = pulses.append
    bench(CONTROL)
    first = bench(f"42010082 00080009 {trigger:08x} 00000001")
    assert bench(f"42010082 00080009 {trigger:08x} 00000001") == first == "00000083 00040009 00000001"
    assert pulses == [1]
    bench(f"42010082 0008000a {trigger:08x} 00000001")
    assert pulses == [1, 1]


def test_resend_requests(bench: Bench) -> None:
    bench("42010082 00100001 00000a00 00000002 00000d18 7f000001")
    assert bench("42000040 000c0002 00000007 00000003 00000005", OTHER) is None
    # With 64-bit block ids the id follows, and packet ids have 32 bits.
    assert bench("42100040 00140003 00000000 01000003 01000005 00000001 00000002", OTHER) is None
    assert bench.asked == [ResendRequest(7, 3, 5), ResendRequest((1 << 32) + 2, 0x01000003, 0x01000005)]
    # From elsewhere than the stream's host; backwards; broken off.
    bench("42000040 000c0004 00000007 00000003 00000005", ("127.0.0.9", 1))
    bench("42000040 000c0005 00000007 00000005 00000003")
    bench("42000040 00080006 00000007 00000005")
    assert len(bench.asked) == 2


def test_forced_address(bench: Bench) -> None:
    mac = bench.registers.read(8, 8)[2:].hex()

    def force(mac: str, address: str) -> str:
        return f"42010004 00380001 0000{mac} {'00' * 12} {address} {'00' * 12} ff000000 {'00' * 12} 00000000"

    assert bench(force("020000000000", "7f000001")) is None  # another camera's
    assert bench(force(mac, "7f000001")) == "00000005 00000001"  # where it is already
    assert bench(force(mac, "0a000001")) == "8fff0005 00000001"  # it cannot move


def test_description_comes_zipped_or_plain(camera: GigeCamera, client: Client) -> None:
    texts = [client.read_memory(address, 512).rstrip(b"\0").decode() for address in (0x200, 0x400)]
    blobs = []
    for text in texts:
        name, address, size = text.removeprefix("Local:").split(";")
        blobs.append((name, client.read_memory(int(address, 16), int(size, 16))))
    (zip_name, packed), (xml_name, plain) = blobs
    assert (zip_name, xml_name) == ("polfuse_camera.zip", "polfuse_camera.xml")
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        assert archive.read(archive.namelist()[0]) == plain
    assert ET.fromstring(plain).get("StandardNameSpace") == "GEV"
    plain_first = Settings(zip_first=False)
    with GigeCamera(Pattern(64, 96), World(), port=0, settings=plain_first) as other, Client(other) as second:
        assert second.read_memory(0x200, 512).startswith(b"Local:polfuse_camera.xml;200000;")


def test_every_reference_in_the_description_leads_somewhere(camera: GigeCamera) -> None:
    root = ET.fromstring(camera.registers.description)
    space = "{http://www.genicam.org/GenApi/Version_1_1}"
    names = {node.get("Name") for node in root if node.get("Name")}
    assert len(names) == sum(1 for node in root if node.get("Name"))
    links = ("pValue", "pFeature", "pPort", "pMax", "pIsLocked", "pSelected", "pVariable")
    referenced = {node.text for link in links for node in root.iter(space + link)}
    assert referenced <= names
    assert len(referenced) > 80
    # Every register is in the camera's memory.
    for node in root.iter():
        address, length = node.find(space + "Address"), node.find(space + "Length")
        if address is not None and length is not None and node.find(space + "pPort").text == "Device":  # type: ignore[union-attr]
            assert len(camera.registers.read(int(address.text or "", 16), int(length.text or ""))) == int(
                length.text or ""
            )


def test_names_are_escaped() -> None:
    assert ET.fromstring(describe([], 'A&B"', "<C>")).get("VendorName") == 'A&B"'


def test_timestamp_latch_and_reset(camera: GigeCamera, client: Client) -> None:
    client.open()
    client.write(0x944, 2)
    first = camera.clock.ticks()
    high, low = client.read(0x948), client.read(0x94C)
    latched = high << 32 | low
    # Latched before our own look, within the two seconds that a slow machine may take.
    assert first - 2 * 125_000_000 < latched <= first
    assert (client.read(0x948) << 32 | client.read(0x94C)) == latched
    client.write(0x944, 1)
    client.write(0x944, 2)
    assert (client.read(0x948) << 32 | client.read(0x94C)) < 2 * 125_000_000
    assert client.read(0x944) == 0


def test_ticks_drift_against_the_host(camera: GigeCamera) -> None:
    start = 10**10
    ticks = camera.clock.ticks(camera.clock._origin_ns + start)
    # 10 s at 125 MHz, 40 ppm fast.
    assert ticks == round(10 * 125e6 * (1 + 40e-6))
    assert struct.pack(">Q", ticks)  # fits
