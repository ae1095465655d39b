"""The camera's acquisition: when exposures begin, and what becomes of them."""

from __future__ import annotations

import struct
import threading
import time
from collections import Counter, deque

import numpy as np
from numpy.typing import NDArray

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.gige_camera import bootstrap as gev
from hw_mocks.gige_camera.bootstrap import Bootstrap, RegisterError, Status
from hw_mocks.gige_camera.clock import TickClock
from hw_mocks.gige_camera.features import CHUNKS
from hw_mocks.gige_camera.gvsp import IMAGE, RGB8, WITH_CHUNKS, FramePackets, Leader, chunk, trailer
from hw_mocks.gige_camera.pixel_packing import PixelFormat, pack
from hw_mocks.gige_camera.registers import Registers
from hw_mocks.gige_camera.render import Exposure, FrameSource
from hw_mocks.gige_camera.sender import PacketSender

_CHUNK_TAG = 8
_CHUNK_BYTES = {"Timestamp": 8, "FrameID": 8, "ExposureTime": 8, "Gain": 8}
_QUEUE = 4
_NAP_S = 0.05
SINGLE_FRAME, MULTI_FRAME = 1, 2
SOFTWARE, LINE = 0, 1


class Acquisition:
    """Takes frames in a thread of its own, from :meth:`start` to :meth:`stop`; ended by :meth:`close`.

    Args:
        registers: the camera's memory.
        source: where frames come from.
        sender: where they go.
        clock: for their time stamps.
        faults: ``STALL``, ``HEAT_ALARM``, ``DISCONNECT``, ``DROP_FRAMES``, ``WRONG_FORMAT``, ``OVERFLOW``.
        seed: of which frames get lost.
    """

    def __init__(
        self,
        registers: Registers,
        source: FrameSource,
        sender: PacketSender,
        clock: TickClock,
        faults: FaultScript,
        seed: int,
    ) -> None:
        self._registers, self._source, self._sender = registers, source, sender
        self._clock, self._faults = clock, faults
        self._random = np.random.default_rng([seed, 1])
        self._changed = threading.Condition()
        self._running = False
        self._closing = False
        self._session = 0
        self._triggers: deque[int] = deque()
        self._busy_until_ns = 0
        self._number = 0
        self.counts: Counter[str] = Counter()
        """Frames taken, frames dropped, triggers missed."""
        self.chunks = dict.fromkeys(CHUNKS, True)
        """Which chunks frames carry."""
        self.failure: BaseException | None = None
        """What ended the thread, if anything did."""
        self._thread = threading.Thread(target=self._run, name="gige-stream", daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether frames are being taken."""
        with self._changed:
            return self._running

    def start(self) -> None:
        """Begin to take frames; block ids start at 1. Raises RegisterError (BUSY) when the camera is too hot."""
        if self._faults.active(FaultKind.HEAT_ALARM):
            raise RegisterError(Status.BUSY)
        with self._changed:
            if not self._running:
                self._running = True
                self._session += 1
                self._triggers.clear()
                self._busy_until_ns = 0
                self._changed.notify_all()

    def stop(self) -> None:
        """Take no more frames; one that is being sent is finished."""
        with self._changed:
            self._running = False
            self._triggers.clear()
            self._changed.notify_all()

    def trigger(self, source: int) -> None:
        """A trigger came: begin an exposure, if the camera waits for one from there.

        One that comes while another exposure lasts, or faster than frames can leave, is missed.
        """
        now_ns = time.monotonic_ns()
        value = self._registers.value
        armed = value("TriggerMode") == 1 and value("TriggerSource") == source
        exposure_ns = round(value("ExposureTime") * 1e3)
        with self._changed:
            if not armed or not self._running or now_ns < self._busy_until_ns or len(self._triggers) >= _QUEUE:
                self.counts["triggers missed"] += 1
                return
            self._busy_until_ns = now_ns + exposure_ns
            self._triggers.append(now_ns)
            self._changed.notify_all()

    def close(self) -> None:
        """End the thread. Idempotent."""
        with self._changed:
            self._closing, self._running = True, False
            self._changed.notify_all()
        if self._thread is not threading.current_thread():
            self._thread.join(timeout=10)

    def payload_size(self) -> int:
        """Bytes of a frame as it is set, chunks included."""
        value = self._registers.value
        size = PixelFormat(int(value("PixelFormat"))).size(int(value("Width")) * int(value("Height")))
        if value("ChunkModeActive"):
            size = -(-size // 4) * 4 + _CHUNK_TAG
            size += sum(length + _CHUNK_TAG for name, length in _CHUNK_BYTES.items() if self.chunks[name])
        return size

    def _run(self) -> None:
        try:
            while True:
                with self._changed:
                    while not (self._running or self._closing):
                        self._changed.wait()
                    if self._closing:
                        return
                    session = self._session
                self._take_frames(session)
        except BaseException as error:
            self.failure = error
            raise

    def _going(self, session: int) -> bool:
        """Whether this acquisition still runs."""
        with self._changed:
            return self._running and self._session == session

    def _take_frames(self, session: int) -> None:
        value = self._registers.value
        mode = int(value("AcquisitionMode"))
        wanted = {SINGLE_FRAME: 1, MULTI_FRAME: int(value("AcquisitionFrameCount"))}.get(mode)
        next_ns = time.monotonic_ns()
        taken = 0
        while self._going(session) and (wanted is None or taken < wanted):
            if any(map(self._faults.active, (FaultKind.STALL, FaultKind.HEAT_ALARM))):
                self._nap(session, time.monotonic_ns() + round(_NAP_S * 1e9))
                next_ns = time.monotonic_ns()
                continue
            if value("TriggerMode"):
                start_ns = self._next_trigger(session)
                if start_ns is None:
                    next_ns = time.monotonic_ns()
                    continue
            else:
                start_ns = next_ns
            duration_s = value("ExposureTime") * 1e-6
            if not value("TriggerMode"):
                period_ns = self._period_ns(duration_s)
                # The sensor exposes while the frame before is read out; one that fell behind skips, and catches up.
                behind = time.monotonic_ns() - (start_ns + round(duration_s * 1e9))
                start_ns += max(behind // period_ns, 0) * period_ns if behind > 2 * period_ns else 0
                next_ns = start_ns + period_ns
            if not self._nap(session, start_ns + round(duration_s * 1e9)):
                return
            taken += 1
            if taken == wanted:
                # Over before the last frame leaves: who has received it may start at once again.
                self._finish(session)
            self._take(taken, start_ns, duration_s)

    def _finish(self, session: int) -> None:
        with self._changed:
            if self._session == session:
                self._running = False

    def _period_ns(self, duration_s: float) -> int:
        value = self._registers.value
        wanted_s = 1.0 / value("AcquisitionFrameRate") if value("AcquisitionFrameRateEnable") else 0.0
        return round(max(wanted_s, duration_s, 1e-3) * 1e9)

    def _next_trigger(self, session: int) -> int | None:
        """When the next trigger came, or None after a short while."""
        with self._changed:
            if not self._triggers and self._running and self._session == session:
                self._changed.wait(_NAP_S)
            return self._triggers.popleft() if self._triggers else None

    def _nap(self, session: int, until_ns: int) -> bool:
        """Wait until that instant; False when the acquisition ends before."""
        with self._changed:
            while self._running and self._session == session:
                left_s = (until_ns - time.monotonic_ns()) * 1e-9
                if left_s <= 0:
                    return True
                self._changed.wait(left_s)
            return False

    def _take(self, block: int, start_ns: int, duration_s: float) -> None:
        """Take one frame and send it."""
        value = self._registers.value
        number, self._number = self._number, self._number + 1
        width, height = int(value("Width")), int(value("Height"))
        x, y = int(value("OffsetX")), int(value("OffsetY"))
        gain_db = value("Gain")
        exposure = Exposure(
            number, start_ns, duration_s, 10 ** (gain_db / 20), slice(y, y + height), slice(x, x + width)
        )
        image = self._source.take(exposure)
        pixel_format = PixelFormat(int(value("PixelFormat")))
        data = pack(image, pixel_format)
        self.counts["frames taken"] += 1
        drop = self._faults.active(FaultKind.DROP_FRAMES, count=number)
        if drop and (drop.amount == 0 or self._random.random() < drop.amount):
            self.counts["frames dropped"] += 1
            return
        extended = bool(self._registers.number(Bootstrap.GVSP_CONFIGURATION) & gev.BLOCK_ID_64)
        # Block ids of 16 bits wrap round, and 0 means a test packet.
        block_id = block if extended else (block - 1) % 0xFFFF + 1
        ticks = self._clock.ticks(start_ns)
        kind, chunk_bytes = IMAGE, 0
        if value("ChunkModeActive"):
            kind |= WITH_CHUNKS
            data = self._with_chunks(data, ticks, block_id, duration_s, gain_db)
            chunk_bytes = data.size
        told = RGB8 if self._faults.active(FaultKind.WRONG_FORMAT, count=number) else int(pixel_format)
        if self._faults.active(FaultKind.OVERFLOW, count=number):
            data = data[: data.size // 2]
        leader = Leader(ticks, told, width, height, x, y, kind).encode()
        end = trailer(kind, height, chunk_bytes)
        packets = FramePackets(block_id, leader, data, end, self._sender.packet_size(), extended=extended)
        self._sender.send(packets, number, self._clock.tick_hz)

    def _with_chunks(
        self, data: NDArray[np.uint8], ticks: int, block_id: int, duration_s: float, gain_db: float
    ) -> NDArray[np.uint8]:
        contents = {
            "Timestamp": struct.pack(">Q", ticks),
            "FrameID": struct.pack(">Q", block_id),
            "ExposureTime": struct.pack(">d", duration_s * 1e6),
            "Gain": struct.pack(">d", gain_db),
        }
        parts = [chunk(CHUNKS["Image"], data.tobytes())]
        parts += [chunk(CHUNKS[name], content) for name, content in contents.items() if self.chunks[name]]
        return np.frombuffer(b"".join(parts), dtype=np.uint8)
