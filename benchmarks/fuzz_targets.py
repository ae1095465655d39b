"""Every parser that reads what comes from outside: lines, datagrams, messages and files."""

from __future__ import annotations

import contextlib
import io
import os
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import serial

from benchmarks.fuzz_files import file_targets
from benchmarks.fuzzing import LONGEST, Target
from benchmarks.serial_handlers.protocol_fuzz import Serial
from drivers.errors import DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.polarizer import elliptec
from drivers.polarizer.ell14 import Ell14
from drivers.switches.dowkey_ms import DowKeyMs
from drivers.switches.minicircuits_rc import MiniCircuitsRc
from drivers.switches.numato_relay import NumatoRelay
from drivers.transport import SerialLine
from drivers.trolley.encoder_protocol import EncoderLine, format_line, parse_line
from drivers.trolley.encoder_track import EncoderTrack, Jump, Scale
from drivers.trolley.grbl import GrblTrolley
from drivers.trolley.grbl_protocol import explain, parse_report, parse_setting
from hw_mocks.faults import parse_fault
from hw_mocks.gige_camera import GigeCamera, Pattern
from hw_mocks.gige_camera.gvcp import GvcpServer
from hw_mocks.grbl import Grbl
from hw_mocks.loopback import Address
from hw_mocks.numato import RelayModule
from hw_mocks.rotator import Rotator
from hw_mocks.sound_card.stream_server import HEADER, read_block
from hw_mocks.switch_box import SwitchBox
from hw_mocks.world import World
from polfuse_lab.engine import protocol

_IN_MEMORY_S = 1e-4
"""Time-out of a driver whose device answers at once or never."""
_GRBL = (
    b"<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>",
    b"<Run|MPos:2.260,0.000,0.000|FS:432,0|Pn:RHS|Ov:100,100,100>",
    b"<Hold:1|WPos:-12.500,0.000,0.000|FS:0,0|WCO:1.000,0.000,0.000>",
    b"$110=30000.000",
    b"ALARM:3",
    b"error:9",
)
_ELL14 = (b"0PO00004600", b"0GS09", b"0IN0E1140SIM120230101016800023000", b"FPOFFFFFFFF")
_GVCP = (
    "42110002 00000001",
    "42010080 00080002 00000000 00000a00",
    "42010082 00100003 00000a00 00000002 00000938 000003e8",
    "42010084 00080004 00000200 00000200",
    "42010086 00100005 000000e8 7261696c 00000000 00000000",
    "42000040 000c0006 00000007 00000003 00000005",
)
_ENCODER = tuple(
    format_line(EncoderLine(number, 10_000 * number, 40 * number, 7 if number > 2 else None)).encode()
    for number in range(6)
)
_HTTP = tuple(
    b"HTTP/1.0 200 OK\r\nContent-Type: text/plain\r\nContent-Length: %d\r\n\r\n%s" % (len(body), body)
    for body in (b"0", b"3", b"SWPORT=5")
)


def _grbl(data: bytes) -> None:
    line = data.decode("latin-1")
    explain(line)
    parse_setting(line)
    parse_report(line, (1.0, 0.0, 0.0), "fuzz")


def _elliptec(data: bytes) -> None:
    message = data.decode("latin-1")
    elliptec.status(message)
    elliptec.position(message)
    elliptec.information(message)


def _encoder() -> Callable[[bytes], None]:
    """Lines of an encoder, and the track that they draw; it begins anew when it has refused one."""
    scale = Scale(10_000.0, 0.002, 0.002, 0.5, 32, 5.0)
    tracks = [EncoderTrack(scale, 0.0)]

    def feed(data: bytes) -> None:
        line = parse_line(data.decode("latin-1"))
        if line is None:
            return
        try:
            tracks[0].add(line, time.monotonic_ns())
            tracks[0].position()
        except Jump:
            tracks[0] = EncoderTrack(scale, 0.0)
            raise

    return feed


def _stream(data: bytes) -> None:
    read_block(io.BytesIO(data).read)


def _world_address(data: bytes) -> None:
    Address.parse(data.decode("latin-1"))


def _fault(data: bytes) -> None:
    parse_fault(data.decode("latin-1"))


def _client_message(data: bytes) -> None:
    protocol.decode_client(data)


def _engine_message(data: bytes) -> None:
    protocol.decode_engine(data)


def _patiently(call: Callable[[], object]) -> None:
    """Call until it succeeds: on a busy computer even an answer that is there at once can be too late."""
    for left in range(99, -1, -1):
        try:
            call()
            return
        except DeviceTimeout:
            if not left:
                raise


class _Conversation:
    """A real driver against a simulated device in memory; what the device says first is mutated on its way."""

    def __init__(self, name: str, device: Any) -> None:
        if "benchmarks.serial_handlers" not in serial.protocol_handler_packages:
            serial.protocol_handler_packages.append("benchmarks.serial_handlers")
        self.url = f"fuzz://{name}"
        self._device = device
        self._input: bytes | None = None
        self._said: list[bytes] = []
        Serial.peers[name] = self._answer

    def _answer(self, data: bytes) -> bytes:
        answer: bytes = self._device.handle(data)
        self._said.append(answer)
        given, self._input = self._input, None
        return answer if given is None else given

    def target(self, name: str, driver: Any, ask: Callable[[], object], more: tuple[bytes, ...]) -> Target:
        """Answer the first question of ``ask`` with the input; seeds are what the device says, and ``more``."""
        _patiently(driver.open)
        self._said.clear()
        _patiently(ask)
        said = tuple(answer for answer in self._said if answer)

        def feed(data: bytes) -> None:
            self._said.clear()
            self._input = data
            try:
                ask()
            except (DeviceLost, DeviceRefused):
                # It refuses everything from now on, as it should; the next input is for a driver that does not.
                driver.close()
                self._input = None
                _patiently(driver.open)
                raise

        return Target(name, feed, (*said, *more), (DeviceError,), 3)


def _conversations(folder: Path) -> Iterator[Target]:
    world = World()
    dowkey = _Conversation("dowkey", SwitchBox(world))
    switches = DowKeyMs(DowKeyMs.Options(port=dowkey.url, timeout_s=_IN_MEMORY_S, cycles_folder=str(folder)))
    more: tuple[bytes, ...] = (b"2\r\n", b"255\r\n", b"-3,SWITCH NUMBER OUT OF RANGE\r\n", b"1\r2\n")
    yield dowkey.target("Dow-Key MS driver", switches, switches.state, more)

    numato = _Conversation("numato", RelayModule(world))
    relays = NumatoRelay(NumatoRelay.Options(port=numato.url, timeout_s=_IN_MEMORY_S, cycles_folder=str(folder)))
    yield numato.target("Numato relay driver", relays, relays.state, (b"relay read 0\n\ron\n\r>", b">"))

    grbl = _Conversation("grbl", Grbl(world, length_m=1.0))
    options = GrblTrolley.Options(port=grbl.url, length_m=1.0, timeout_s=_IN_MEMORY_S, poll_interval_s=1e-9)
    trolley = GrblTrolley(options)
    # Without alarms and restarts, after which the driver must be opened again: that takes a while.
    more = (*(line + b"\r\n" for line in _GRBL if b"ALARM" not in line), b"ok\r\n", b"[MSG:Caution: Unlocked]\r\n")
    yield grbl.target("GRBL driver", trolley, trolley.poll, more)

    mount = _Conversation("ell14", Rotator(world))
    polarizer = Ell14(Ell14.Options(port=mount.url, timeout_s=_IN_MEMORY_S, home_at_open=False))
    # Without GS09 (busy), for which the driver waits 50 ms.
    more = tuple(message + b"\r\n" for message in _ELL14 if message != b"0GS09")
    yield mount.target("ELL14 driver", polarizer, polarizer.poll, more)


class _HttpBox:
    """Answers every connection on loopback with the present input and hangs up."""

    def __init__(self) -> None:
        self.input = b""
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._server.getsockname()[1]
        threading.Thread(target=self._serve, name="fuzz-http", daemon=True).start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._server.accept()
                with connection, contextlib.suppress(OSError):
                    connection.settimeout(1.0)
                    connection.recv(4096)
                    connection.sendall(self.input)

    def close(self) -> None:
        """Stop answering."""
        with contextlib.suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()


def _mini_circuits(box: _HttpBox, folder: Path) -> Target:
    options = MiniCircuitsRc.Options(host="127.0.0.1", port=box.port, timeout_s=1.0, cycles_folder=str(folder))
    switches = MiniCircuitsRc(options)
    box.input = _HTTP[0]  # "0" to every question: no alarm, 0 degrees, all switches at 0
    switches.open()

    def feed(data: bytes) -> None:
        box.input = data
        switches.state()

    return Target("Mini-Circuits driver (HTTP)", feed, _HTTP, (DeviceError,), 20)


def _line(port: str) -> Target:
    """The transport below every serial driver."""
    given = [b""]
    Serial.peers["line"] = lambda data: given[0]
    line = SerialLine(port, baud=9600, name="fuzz", timeout_s=_IN_MEMORY_S)
    line.open()

    def feed(data: bytes) -> None:
        given[0] = data
        line.drain()
        line.write(b"?")
        for _ in range(LONGEST + 1000):
            if line.try_line() is None:
                return
        raise AssertionError("more lines than bytes")

    return Target("serial line", feed, tuple(text + b"\r\n" for text in (*_GRBL, *_ELL14)), (DeviceError,), 2)


@contextlib.contextmanager
def targets() -> Iterator[dict[str, Target]]:
    """All targets by their names, with what they need."""
    with (
        tempfile.TemporaryDirectory(prefix="polfuse-fuzz-", dir=_fast_folder()) as name,
        contextlib.closing(_HttpBox()) as box,
        GigeCamera(Pattern(64, 96), World(), port=0) as camera,
    ):
        folder = Path(name)
        server = GvcpServer(camera.registers, lambda request: None, lambda: None)
        peer = ("127.0.0.1", 40_000)

        def gvcp(data: bytes) -> None:
            server.answer(data, peer, time.monotonic_ns())

        status = protocol.encode(protocol.Finished("finished", "", None, 1, 1, 1, 0, 0, None, 1.0, []))
        steering = tuple(
            protocol.encode(message)
            for message in (protocol.Attach(1, "token"), protocol.AddNote("wind"), protocol.Answer(3), protocol.Ping())
        )
        block = HEADER.pack(480, 10**9, 4) + bytes(16)
        made = (
            Target("GRBL status", _grbl, _GRBL, (DeviceError,)),
            Target("Elliptec messages", _elliptec, _ELL14, ()),
            Target("encoder lines", _encoder(), _ENCODER, (Jump,)),
            *_conversations(folder),
            _line("fuzz://line"),
            _mini_circuits(box, folder),
            Target("GVCP", gvcp, tuple(map(bytes.fromhex, _GVCP)), ()),
            Target("audio stream blocks", _stream, (block,), (OSError, ValueError)),
            Target("loopback addresses", _world_address, (Address(4711, "abc123").url.encode(),), (DeviceError,)),
            Target("engine: client's messages", _client_message, steering, (msgspec.DecodeError,)),
            Target("engine: engine's messages", _engine_message, (status,), (msgspec.DecodeError,)),
            Target("fault scripts", _fault, (b"trolley:silence:after=5s:for=2s:amount=0.5",), (ValueError,)),
            *file_targets(folder),
        )
        yield {target.name: target for target in made}


def _fast_folder() -> str | None:
    """A folder in memory where there is one: millions of small files wear a disk."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
