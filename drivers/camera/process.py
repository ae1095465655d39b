"""Any camera driver in a process of its own, behind the same contract.

A driver that holds the interpreter's lock, hangs or crashes then disturbs nobody: frames come through shared memory,
requests and answers through a pipe, and a watchdog turns a camera process that died or hangs into
:class:`drivers.errors.DeviceLost`. Opening again starts a fresh process, which is how some producers recover.
"""

from __future__ import annotations

import dataclasses
import itertools
import multiprocessing
import time
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from drivers.camera import child
from drivers.camera.frame_ring import FrameRing
from drivers.errors import DeviceError, DeviceLost, DeviceTimeout
from drivers.records import ClockFix, Frame, Identity

_SLOTS = 4
_CLOCK_S = 1.0


class CameraProcess:
    """Contract :class:`drivers.contracts.Camera` for a driver that runs elsewhere. Used by one thread at a time.

    Args:
        driver_name: registry name of the driver, such as ``"harvesters"``.
        options: the driver's ``Options``.
        open_timeout_s: time for the process to start and the driver to open, s.
        watchdog_s: silence after which the process counts as hung, s. It must exceed the longest time for which one
            call of the driver may block.
        close_timeout_s: time for the driver to close before its process is ended, s.
    """

    def __init__(
        self,
        driver_name: str,
        options: Any,
        *,
        open_timeout_s: float = 10.0,
        watchdog_s: float = 1.5,
        close_timeout_s: float = 3.0,
    ) -> None:
        self._driver_name = driver_name
        self._options = options
        self._open_timeout_s = open_timeout_s
        self._watchdog_s = watchdog_s
        self._close_timeout_s = close_timeout_s
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._ring: FrameRing | None = None
        self._tickets = itertools.count(1)
        self._ticket: int | None = None
        self._frame: Frame | None = None
        self._clock: list[ClockFix | DeviceError | None] = []
        self._error: DeviceError | None = None
        self._lost = 0

    @property
    def pid(self) -> int | None:
        """Process id of the camera's process, None while closed."""
        return self._process.pid if self._process is not None else None

    def open(self) -> Identity:
        """Start the process and open the driver in it.

        Raises:
            DeviceError: whatever the driver raised, as it raised it.
            DeviceTimeout: it did not answer in time.
            DeviceLost: its process ended.
        """
        self.close()
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=child.run, args=(theirs, self._driver_name, self._options), name="camera", daemon=True
        )
        try:
            try:
                self._process.start()
            finally:
                # Only the camera process may hold its end, so that its death is seen as the end of the pipe.
                theirs.close()
            identity, shape = self._receive_opened()
            self._ring = FrameRing(shape, slots=_SLOTS)
            self._send("memory", self._ring.name, _SLOTS)
        except BaseException:
            self.close()
            raise
        self._lost = 0
        return dataclasses.replace(identity, detail=f"{identity.detail} (in a process of its own)".strip())

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame."""
        if self._ring is None:
            raise self._closed()
        return self._ring.shape

    @property
    def lost_frames(self) -> int:
        """Frames lost since the camera was opened, as of its last frame."""
        return self._lost

    def trigger(self) -> None:
        """Ask for one frame whose exposure begins after this call; a frame asked for before is forgotten."""
        self._check_alive()
        self._frame = self._error = None
        self._ticket = next(self._tickets)
        self._send("trigger", self._ticket)

    def poll(self) -> Frame | None:
        """The frame asked for once it has arrived, else None.

        Raises:
            DeviceError: whatever the driver raised.
            DeviceLost: the camera's process died or hangs.
        """
        self._receive()
        if self._error is not None:
            error, self._error, self._ticket = self._error, None, None
            raise error
        if self._frame is not None:
            frame, self._frame, self._ticket = self._frame, None, None
            return frame
        self._check_alive()
        return None

    def clock(self) -> ClockFix | None:
        """One pair of the camera's clock and the host's, or None where the camera has none."""
        self._check_alive()
        self._clock.clear()
        self._send("clock")
        deadline = time.monotonic() + _CLOCK_S
        assert self._pipe is not None
        while not self._clock:
            self._receive()
            if self._clock:
                break
            self._check_alive()
            if time.monotonic() > deadline:
                raise DeviceTimeout(
                    f"did not tell its time within {_CLOCK_S:g} s", where=self._where, advice="try again"
                )
            with suppress(OSError):
                self._pipe.poll(0.01)
        answer = self._clock[0]
        if isinstance(answer, DeviceError):
            raise answer
        return answer

    def make_safe(self) -> None:
        """Forget the frame asked for. Never raises."""
        self._ticket = self._frame = self._error = None
        with suppress(DeviceError):
            self._send("make_safe")

    def close(self) -> None:
        """Close the driver and end its process, by force if it must be; remove the shared memory. Never raises."""
        process, pipe, ring = self._process, self._pipe, self._ring
        self._process = self._pipe = self._ring = None
        self._ticket = self._frame = self._error = None
        if pipe is not None:
            with suppress(OSError, ValueError):
                pipe.send(("close",))
        if process is not None and process.pid is not None:
            hung = ring is not None and ring.silence_s() > self._watchdog_s
            for wait_s, more in ((0.2 if hung else self._close_timeout_s, process.terminate), (0.5, process.kill)):
                process.join(wait_s)
                if process.exitcode is not None:
                    break
                more()
            process.join(2.0)
            with suppress(ValueError):
                process.close()
        if pipe is not None:
            pipe.close()
        if ring is not None:
            ring.close()

    @property
    def _where(self) -> str:
        return f"camera process ({self._driver_name})"

    def _receive_opened(self) -> tuple[Identity, tuple[int, int]]:
        assert self._pipe is not None
        if not self._pipe.poll(self._open_timeout_s):
            raise DeviceTimeout(
                f"did not open within {self._open_timeout_s:g} s",
                where=self._where,
                advice="check cable and power, and that no other program uses the camera",
            )
        try:
            word, *values = self._pipe.recv()
        except (EOFError, OSError):
            raise self._died() from None
        if word == "error":
            raise values[1]
        return values[0], values[1]

    def _send(self, *message: Any) -> None:
        if self._pipe is None:
            raise self._closed()
        try:
            self._pipe.send(message)
        except (OSError, ValueError):
            raise self._died() from None

    def _receive(self) -> None:
        """Take in all that the camera process has said; answers to requests given up are dropped."""
        if self._pipe is None or self._ring is None:
            raise self._closed()
        try:
            while self._pipe.poll(0):
                word, *values = self._pipe.recv()
                if word == "clock":
                    self._clock.append(values[0])
                elif word == "frame":
                    ticket, number, frame, dtype, self._lost = values
                    if ticket == self._ticket:
                        self._frame = dataclasses.replace(frame, image=self._ring.get(number, dtype))
                elif values[0] in (0, self._ticket):
                    self._error = values[1]
        except (EOFError, OSError):
            raise self._died() from None

    def _check_alive(self) -> None:
        if self._process is None or self._ring is None:
            raise self._closed()
        if not self._process.is_alive():
            raise self._died()
        silence_s = self._ring.silence_s()
        if silence_s > self._watchdog_s:
            raise DeviceLost(
                f"gave no sign of life for {silence_s:.1f} s",
                where=self._where,
                advice="check cable and power, then open it again (that starts a fresh process)",
            )

    def _died(self) -> DeviceLost:
        code = None
        if self._process is not None and self._process.pid is not None:
            self._process.join(0.2)
            code = self._process.exitcode
        how = "ended" if code is None else f"ended with status {code}"
        return DeviceLost(f"the process {how}", where=self._where, advice="open it again (that starts a fresh process)")

    def _closed(self) -> DeviceLost:
        return DeviceLost("is not open", where=self._where, advice="open it first")
