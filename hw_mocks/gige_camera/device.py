"""A whole GigE Vision camera on a UDP socket."""

from __future__ import annotations

import contextlib
import ipaddress
import math
import selectors
import socket
import threading
import time
from collections import Counter

import numpy as np

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.gige_camera import bootstrap as gev
from hw_mocks.gige_camera.acquisition import LINE, SOFTWARE, Acquisition
from hw_mocks.gige_camera.bootstrap import GVCP_PORT, Bootstrap, RegisterError, Status
from hw_mocks.gige_camera.broadcast import broadcast_socket
from hw_mocks.gige_camera.clock import TickClock
from hw_mocks.gige_camera.features import CHUNKS, make_features
from hw_mocks.gige_camera.gvcp import ACK_REQUIRED, Command, GvcpServer, Peer, pending
from hw_mocks.gige_camera.registers import Registers
from hw_mocks.gige_camera.render import FrameSource, SceneView
from hw_mocks.gige_camera.sender import PacketSender
from hw_mocks.gige_camera.settings import Optics, Settings
from hw_mocks.world import World
from processing.scene.model import Scene

_CHECK_S = 0.05
_HOT_C = 95.0
_VENDOR = "PolFuse"


class GigeCamera:
    """A simulated GigE Vision 2.0 camera that looks at the scene; runs from construction to :meth:`close`.

    It answers discovery by unicast, and by broadcast on the interface of its own address only; it never broadcasts.
    Frames are sent from a thread of their own, at the link's speed.

    Faults: ``SILENCE`` (carries out commands, acknowledges none), ``GARBAGE`` (random acknowledges, random packets in
    the stream), ``PARTIAL_LINE`` (half acknowledges), ``SLOW`` (acknowledges late by ``amount`` s, announced by
    PENDING_ACK where the client enabled it), ``DISCONNECT`` (nothing in or out; comes back as after power-up),
    ``STALL`` (takes no frames), ``HEAT_ALARM`` (tells 95 or ``amount`` degrees C, takes no frames), ``DROP_PACKETS``
    (fraction ``amount``, resent ones too), ``DROP_FRAMES``, ``WRONG_FORMAT`` (leaders tell RGB8), ``OVERFLOW`` (half a
    frame is missing, and not to be had again), ``CLOCK_JUMP``. Counts are frames since construction.

    Args:
        scene: what there is to see, or any source of frames.
        world: the simulated rig.
        address: IPv4 address to live at; a loopback address, or one of a network namespace made for it.
        port: UDP port; 3956 is the only one that clients look at, 0 takes a free one.
        optics: lens, place, polarizers.
        settings: electronics.
        faults: what goes wrong, and when.

    Raises:
        ValueError: an address that is not one host's.
        OSError: the address or port cannot be had.
    """

    def __init__(
        self,
        scene: Scene | FrameSource,
        world: World,
        address: str = "127.0.0.1",
        port: int = GVCP_PORT,
        *,
        optics: Optics | None = None,
        settings: Settings | None = None,
        faults: FaultScript | None = None,
    ) -> None:
        place = ipaddress.IPv4Address(address)
        if place.is_unspecified or place.is_multicast or place == ipaddress.IPv4Address("255.255.255.255"):
            raise ValueError(f"address: found {address}, allowed: the address of one interface, such as 127.0.0.1")
        self.settings = settings or Settings()
        self.faults = faults or FaultScript()
        source = self._source(scene, world, optics or Optics())
        self._address = address
        self._power = threading.Lock()
        self._was_gone = False
        self._failure: BaseException | None = None
        self.gvcp_counts: Counter[str] = Counter()
        """Datagrams received and sent on the control channel."""
        rows, columns = source.shape
        features = make_features(
            width=columns,
            height=rows,
            exposure_us=self.settings.exposure_s * 1e6,
            frame_rate_hz=self.settings.frame_rate_hz,
            formats=self.settings.formats,
        )
        texts = {
            Bootstrap.VENDOR: _VENDOR,
            Bootstrap.MODEL: self.settings.model,
            Bootstrap.DEVICE_VERSION: "1.0",
            Bootstrap.MANUFACTURER_INFO: "simulated camera",
            Bootstrap.SERIAL: self.settings.serial,
            Bootstrap.USER_NAME: self.settings.user_name,
        }
        self.registers = Registers(
            features,
            texts,
            address=address,
            tick_hz=self.settings.tick_hz,
            packet_size=self.settings.packet_size,
            zip_first=self.settings.zip_first,
        )
        self.clock = TickClock(self.settings.tick_hz, self.settings.drift_ppm, self.faults)
        self._closing = contextlib.ExitStack()
        try:
            self._start(source, port)
        except BaseException:
            self.close()
            raise

    def _source(self, scene: Scene | FrameSource, world: World, optics: Optics) -> FrameSource:
        if not isinstance(scene, Scene):
            return scene
        return SceneView(
            scene,
            world,
            optics.pinhole(),
            self.settings.sensor,
            reference_exposure_s=self.settings.exposure_s,
            extinction_ratio=optics.extinction_ratio,
            mosaic=optics.mosaic,
            seed=self.settings.seed,
            repeat_after=self.settings.repeat_after,
        )

    def _start(self, source: FrameSource, port: int) -> None:
        settings = self.settings
        self._control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._closing.callback(self._control.close)
        self._control.bind((self._address, port))
        self._sockets = [self._control]
        if self.port == GVCP_PORT:
            hears = broadcast_socket(self._address)
            if hears is not None:
                self._closing.callback(hears.close)
                self._sockets.append(hears)
        for one in self._sockets:
            one.setblocking(False)
        self._sender = PacketSender(self.registers, self._address, settings.link, self.faults, settings.seed)
        self._closing.callback(self._sender.close)
        self._acquisition = Acquisition(self.registers, source, self._sender, self.clock, self.faults, settings.seed)
        self._closing.callback(self._acquisition.close)
        self._gvcp = GvcpServer(self.registers, self._sender.resend, self._control_ended)
        self._connect_registers()
        self._wake_receive, self._wake_send = socket.socketpair()
        self._closing.callback(self._wake_receive.close)
        self._closing.callback(self._wake_send.close)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="gige-control", daemon=True)
        self._thread.start()
        self._closing.callback(self._end_thread)

    def __enter__(self) -> GigeCamera:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Switch off. Idempotent."""
        self._closing.close()

    @property
    def address(self) -> str:
        """IPv4 address."""
        return self._address

    @property
    def port(self) -> int:
        """UDP port of the control channel."""
        return int(self._control.getsockname()[1])

    @property
    def counts(self) -> Counter[str]:
        """Frames, packets, triggers and resends so far, by name."""
        return self._sender.counts + self._acquisition.counts + self.gvcp_counts

    @property
    def controller(self) -> Peer | None:
        """Who controls the camera."""
        return self._gvcp.owner

    @property
    def acquiring(self) -> bool:
        """Whether frames are being taken."""
        return self._acquisition.running

    def line_pulse(self) -> None:
        """A rising edge on the trigger input Line1."""
        self._acquisition.trigger(LINE)

    def check(self) -> None:
        """Raise RuntimeError when a defect ended one of the camera's threads."""
        failure = self._failure or self._acquisition.failure
        if failure is not None:
            raise RuntimeError(f"the simulated camera failed with {failure!r}") from failure

    # Registers that do something.

    def _connect_registers(self) -> None:
        registers, acquisition = self.registers, self._acquisition
        at = registers.address_of
        temperature = at("DeviceTemperature")
        registers.readers |= {
            int(Bootstrap.TIMESTAMP_HIGH): lambda: self.clock.latched >> 32,
            int(Bootstrap.TIMESTAMP_LOW): lambda: self.clock.latched,
            int(Bootstrap.STREAM_SOURCE_PORT): lambda: self._sender.port,
            at("PayloadSize"): acquisition.payload_size,
            at("ChunkEnable"): lambda: int(acquisition.chunks[self._chunk()]),
            temperature: lambda: int.from_bytes(self._temperature()[:4], "big"),
            temperature + 4: lambda: int.from_bytes(self._temperature()[4:], "big"),
        }
        registers.hooks |= {
            int(Bootstrap.TIMESTAMP_CONTROL): self._time,
            int(Bootstrap.STREAM_PACKET_SIZE): self._packet_size,
            at("AcquisitionStart"): lambda _: acquisition.start(),
            at("AcquisitionStop"): lambda _: acquisition.stop(),
            at("TriggerSoftware"): lambda _: acquisition.trigger(SOFTWARE),
            at("ChunkEnable"): self._enable_chunk,
            at("UserSetLoad"): self._load_defaults,
            at("DeviceReset"): lambda _: self._power_up(),
        }
        registers.frozen = lambda: acquisition.running

    def _chunk(self) -> str:
        selected = int(self.registers.value("ChunkSelector"))
        return next(name for name, number in CHUNKS.items() if number == selected)

    def _enable_chunk(self, enable: int) -> None:
        # Clients switch all chunks off before they choose theirs; the image itself stays nevertheless.
        self._acquisition.chunks[self._chunk()] = bool(enable) or self._chunk() == "Image"

    def _temperature(self) -> bytes:
        hot = self.faults.active(FaultKind.HEAT_ALARM)
        return bytes(np.array((hot.amount or _HOT_C) if hot else 41.5, dtype=">f8").tobytes())

    def _time(self, command: int) -> None:
        # Both at once: the reading before the reset is what is remembered.
        if command & gev.LATCH_TIMESTAMP:
            self.clock.latch()
        if command & gev.RESET_TIMESTAMP:
            self.clock.reset()
        self.registers.put(Bootstrap.TIMESTAMP_CONTROL, 0)

    def _packet_size(self, value: int) -> None:
        if value & gev.FIRE_TEST_PACKET:
            self.registers.put(Bootstrap.STREAM_PACKET_SIZE, value & ~gev.FIRE_TEST_PACKET)
            self._sender.test_packet()

    def _load_defaults(self, _: int) -> None:
        if self._acquisition.running:
            raise RegisterError(Status.BUSY)
        self.registers.load_defaults()

    def _control_ended(self) -> None:
        self._acquisition.stop()
        self._sender.forget()

    def _power_up(self) -> None:
        """Everything as after switching on."""
        self._acquisition.stop()
        self._sender.forget()
        self.registers.power_up()
        self.clock.reset()
        self._gvcp.release()

    # The control channel.

    def _serve(self) -> None:
        try:
            self._serve_control()
        except BaseException as error:
            self._failure = error
            raise

    def _serve_control(self) -> None:
        with selectors.DefaultSelector() as selector:
            for one in (*self._sockets, self._wake_receive):
                selector.register(one, selectors.EVENT_READ)
            while not self._ended.is_set():
                for key, _ in selector.select(_CHECK_S):
                    if key.fileobj is self._wake_receive:
                        return
                    assert isinstance(key.fileobj, socket.socket)
                    self._receive(key.fileobj)
                self._look_after()

    def _look_after(self) -> None:
        """Faults of the line and the client's silence."""
        gone = self.faults.active(FaultKind.DISCONNECT) is not None
        if self._was_gone and not gone:
            self._power_up()
        self._was_gone = gone
        if not gone:
            self._gvcp.check_heartbeat(time.monotonic_ns())

    def _receive(self, channel: socket.socket) -> None:
        for _ in range(64):
            try:
                datagram, peer = channel.recvfrom(65_536)
            except OSError:
                return
            if self.faults.active(FaultKind.DISCONNECT):
                self._was_gone = True
                continue
            if self._was_gone:
                self._look_after()
            self.gvcp_counts["commands"] += 1
            # By broadcast a camera may be looked for, not commanded.
            if channel is not self._control and datagram[2:4] != Command.DISCOVERY.to_bytes(2, "big"):
                continue
            self._reply(datagram, peer)

    def _reply(self, datagram: bytes, peer: Peer) -> None:
        answer = self._gvcp.answer(datagram, peer, time.monotonic_ns())
        if answer is None or self.faults.active(FaultKind.SILENCE):
            return
        slow = self.faults.active(FaultKind.SLOW)
        if slow and slow.amount > 0:
            enabled = self.registers.number(Bootstrap.GVCP_CONFIGURATION) & gev.PENDING_ACK_ENABLED
            if enabled and datagram[1] & ACK_REQUIRED:
                self._put(pending(int.from_bytes(datagram[6:8], "big"), math.ceil(slow.amount * 1e3)), peer)
            self._ended.wait(slow.amount)
        if self.faults.active(FaultKind.GARBAGE):
            answer = np.random.default_rng(self.gvcp_counts["commands"]).bytes(len(answer))
        if self.faults.active(FaultKind.PARTIAL_LINE):
            answer = answer[: len(answer) // 2]
        self._put(answer, peer)

    def _put(self, answer: bytes, peer: Peer) -> None:
        with contextlib.suppress(OSError):
            self._control.sendto(answer, peer)
            self.gvcp_counts["acknowledges"] += 1

    def _end_thread(self) -> None:
        self._ended.set()
        with contextlib.suppress(OSError):
            self._wake_send.send(b"x")
        self._thread.join(timeout=10)
