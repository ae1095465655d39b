"""The simulated radar's audio port without PortAudio: the same samples over loopback TCP."""

from __future__ import annotations

import contextlib
import json
import math
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.options import checked
from drivers.records import AudioBlock, ClockFix, Identity, Level
from hw_mocks.loopback import HOST, MAX_LINE, Address, connect
from hw_mocks.sound_card.stream_server import read_block

FULL_SCALE = 32_768.0
RECENT_BLOCKS = 256
"""Blocks kept for whoever looks at the signal: 2.5 s of them."""


@dataclass
class _Request:
    """A record being collected: pieces sampled at or after ``since_ns``."""

    since_ns: int
    frames: int
    pieces: list[NDArray[np.int16]] = field(default_factory=list)
    filled: int = 0
    first: int = 0
    t_ns: int = 0
    lost: int = 0
    gapless: bool = False
    follows: bool = False
    """Whether a record of the same request was collected right before."""
    whole: deque[AudioBlock] = field(default_factory=deque)
    """Records of a gapless request that wait to be fetched."""


class SceneRadar:
    """A :class:`drivers.contracts.Radar` that listens to a :class:`hw_mocks.sound_card.stream_server.StreamServer`."""

    @dataclass(frozen=True)
    class Options:
        """Settings of the simulated audio port."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        url: str
        """Address that 'polfuse sim' printed."""
        sample_rate_hz: Annotated[float, Ge(8_000), Le(384_000)] = 48_000.0
        """Sample rate, Hz; the simulator must run at the same."""
        timeout_s: Annotated[float, Gt(0), Le(60)] = 2.0
        """Time without any sample after which the port counts as stalled, s."""

    def __init__(self, options: Options) -> None:
        self._options = checked(options)
        self._address = Address.parse(options.url)
        self._where = f"tcp://{HOST}:{self._address.port}"
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._forget()

    def _forget(self) -> None:
        self._recent: deque[NDArray[np.int16]] = deque(maxlen=RECENT_BLOCKS)
        self._request: _Request | None = None
        self._following: int | None = None
        self._origin = 0
        self._lost = 0
        self._newest: tuple[int, int] | None = None
        self._failure: DeviceError | None = None
        self._alive_ns = time.monotonic_ns()

    def open(self) -> Identity:
        """Connect to the simulator.

        Raises:
            DeviceLost: it does not run. DeviceRefused: it runs at another rate. DeviceBadAnswer: it is something else.
        """
        if self._socket is not None:
            raise DeviceRefused("is open already", where=self._where, advice="close it first")
        self._forget()
        connection = connect(self._address, self._options.timeout_s, "sound card")
        try:
            self._greet(connection)
        except BaseException:
            connection.close()
            raise
        self._socket = connection
        self._thread = threading.Thread(target=self._listen, args=(connection,), name="scene-radar", daemon=True)
        self._thread.start()
        return Identity("radar", "scene", "simulated sound card", self._where)

    def _greet(self, connection: socket.socket) -> None:
        line = bytearray()
        try:
            connection.sendall(f"{self._address.token} listen\n".encode())
            while not line.endswith(b"\n") and len(line) < MAX_LINE:
                # Byte by byte: what follows the line belongs to the first block.
                received = connection.recv(1)
                if not received:
                    raise ConnectionError("it hung up: wrong token?")
                line += received
            rate = float(json.loads(line)["sample_rate_hz"])
        except OSError as error:
            raise DeviceLost(
                f"the simulated sound card refuses ({error})",
                where=self._where,
                advice="start 'polfuse sim' again and use the rig file that it writes",
            ) from error
        except (ValueError, KeyError, TypeError):
            raise DeviceBadAnswer(
                f"something else than the simulated sound card answered {bytes(line[:40])!r}",
                where=self._where,
                advice="use the rig file that 'polfuse sim' wrote",
            ) from None
        if rate != self._options.sample_rate_hz:
            raise DeviceRefused(
                f"the simulated sound card runs at {rate:g} Hz, not {self._options.sample_rate_hz:g} Hz",
                where=self._where,
                advice=f"set radar.sample_rate_hz = {rate:g}",
            )

    def make_safe(self) -> None:
        """Forget the record asked for."""
        self.cancel()

    def close(self) -> None:
        """Hang up. Idempotent; never raises."""
        connection, self._socket = self._socket, None
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()
        if self._thread is not None:
            self._thread.join(timeout=5)
            self._thread = None

    # -- listening ----------------------------------------------------------------------------------------------------

    def _listen(self, connection: socket.socket) -> None:
        try:
            connection.settimeout(None)
            with connection.makefile("rb") as stream:
                while True:
                    samples, first, t_ns = read_block(stream.read)
                    with self._lock:
                        self._take(samples, first, t_ns)
        except (OSError, ValueError) as error:
            self._failure = DeviceLost(
                f"the simulated sound card is gone ({error})",
                where=self._where,
                advice="start 'polfuse sim' again and use the rig file that it writes",
            )

    def _take(self, samples: NDArray[np.int16], first: int, t_ns: int) -> None:
        if self._following is None:
            self._origin = self._following = first
        missing = first - self._following
        if missing < 0:
            raise ValueError("its frame numbers run backwards")
        self._lost += missing
        self._following = first + len(samples)
        self._newest, self._alive_ns = (first - self._origin, t_ns), time.monotonic_ns()
        self._recent.append(samples)
        request = self._request
        while request is not None and len(samples) and request.filled < request.frames:
            used = self._fill(request, samples, first, t_ns, missing)
            # What is missing lies before the block's first frame.
            samples, first, missing = samples[used:], first + used, 0
            t_ns += round(used / self._options.sample_rate_hz * 1e9)
            if not request.gapless or request.filled < request.frames:
                return
            request.whole.append(self._block(request))
            request.pieces, request.filled, request.lost, request.follows = [], 0, 0, True

    def _fill(self, request: _Request, samples: NDArray[np.int16], first: int, t_ns: int, missing: int) -> int:
        """Take what a request needs from a block's beginning; return how many of its frames are done with."""
        rate = self._options.sample_rate_hz
        skip = 0
        if request.filled or request.follows:
            request.lost += missing
        if not request.filled:
            skip = 0 if request.follows else max(math.ceil((request.since_ns - t_ns) * 1e-9 * rate), 0)
            if skip >= len(samples):
                return len(samples)
            request.first = first + skip - self._origin
            request.t_ns = t_ns + round(skip / rate * 1e9)
        piece = samples[skip : skip + request.frames - request.filled]
        request.pieces.append(piece)
        request.filled += len(piece)
        return skip + len(piece)

    def _block(self, request: _Request) -> AudioBlock:
        rate = self._options.sample_rate_hz
        return AudioBlock(
            samples=np.concatenate(request.pieces),
            sample_rate_hz=rate,
            first_frame=request.first,
            t_device_s=request.first / rate,
            t_host_ns=request.t_ns,
            lost_frames=request.lost,
        )

    # -- the contract -------------------------------------------------------------------------------------------------

    @property
    def sample_rate_hz(self) -> float:
        """Nominal sample rate, Hz."""
        return self._options.sample_rate_hz

    @property
    def lost_frames(self) -> int:
        """Frames lost since the stream was opened: gaps in the simulator's frame numbers."""
        return self._lost

    def begin(self, frames: int) -> None:
        """Ask for ``frames`` contiguous frames, all sampled after this call.

        Raises:
            DeviceRefused: ``frames`` is not positive, or a record is under way. DeviceLost: the simulator is gone.
        """
        self._begin(frames, gapless=False)

    def begin_stream(self, frames: int) -> None:
        """Ask for records of ``frames`` frames, one after another without a gap, until :meth:`cancel`.

        Raises as :meth:`begin`.
        """
        self._begin(frames, gapless=True)

    def _begin(self, frames: int, *, gapless: bool) -> None:
        now_ns = time.monotonic_ns()
        self._require_running()
        if frames <= 0:
            raise DeviceRefused(f"a record of {frames} frames", where=self._where, advice="ask for one or more")
        with self._lock:
            if self._request is not None:
                raise DeviceRefused("a record is under way", where=self._where, advice="cancel it first")
            self._request = _Request(now_ns, frames, gapless=gapless)

    def poll(self) -> AudioBlock | None:
        """The record asked for once it is whole, else None.

        Raises:
            DeviceLost: the simulator is gone. DeviceTimeout: it is silent.
        """
        with self._lock:
            request = self._request
            if request is not None and request.whole:
                return request.whole.popleft()
            if request is not None and request.filled >= request.frames:
                self._request = None
                return self._block(request)
        if request is not None:
            self._require_running()
        return None

    def cancel(self) -> None:
        """Forget the record asked for."""
        with self._lock:
            self._request = None

    def level(self) -> Level:
        """Peak and rms of both channels over the last tenth of a second, as fractions of full scale."""
        block = self.newest(round(0.1 * self.sample_rate_hz))
        if block is None:
            return Level()
        recent = block.samples.astype(np.float64) / FULL_SCALE
        peak, rms = np.abs(recent).max(axis=0), np.sqrt(np.mean(recent**2, axis=0))
        return Level(peak=tuple(map(float, peak)), rms=tuple(map(float, rms)))

    def newest(self, frames: int) -> AudioBlock | None:
        """The newest samples, see :class:`drivers.contracts.OverheardRadar`."""
        with self._lock:
            blocks, missing = [], frames
            for block in reversed(self._recent):
                if missing <= 0:
                    break
                blocks.append(block[-missing:])
                missing -= len(block)
            following, alive_ns = self._following, self._alive_ns
        if not blocks or following is None:
            return None
        samples = np.concatenate(blocks[::-1])
        rate = self.sample_rate_hz
        first = following - self._origin - len(samples)
        return AudioBlock(samples, rate, first, first / rate, alive_ns - round(len(samples) / rate * 1e9))

    def clock(self) -> ClockFix | None:
        """Number of the newest block's first frame over the nominal rate, against the host time of its sampling."""
        with self._lock:
            if self._newest is None:
                return None
            first, t_ns = self._newest
        return ClockFix("radar", first / self._options.sample_rate_hz, t_ns, 1000)

    def _require_running(self) -> None:
        if self._socket is None:
            raise DeviceLost("is not open", where=self._where, advice="open it first")
        if self._failure is not None:
            raise self._failure
        if time.monotonic_ns() - self._alive_ns > self._options.timeout_s * 1e9:
            raise DeviceTimeout(
                f"no sample for {self._options.timeout_s:g} s", where=self._where, advice="start 'polfuse sim' again"
            )
