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
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from drivers.camera import child, messages
from drivers.camera.frame_ring import FrameRing
from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceTimeout
from drivers.records import ClockFix, Frame, Identity

_SLOTS = 4
_ANSWER_S = 1.0


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
        self._waiting: int | None = None
        self._answer: messages.ClockTold | messages.NumbersTold | DeviceError | None = None
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
        self._process = context.Process(target=child.run, args=(theirs,), name="camera", daemon=True)
        try:
            try:
                self._process.start()
            finally:
                # Only the camera process may hold its end, so that its death is seen as the end of the pipe.
                theirs.close()
            self._send(messages.Open(self._driver_name, messages.pack_options(self._options)))
            opened = self._receive_opened()
            self._ring = FrameRing(opened.shape, slots=_SLOTS)
            self._send(messages.Memory(self._ring.name, _SLOTS))
        except BaseException:
            self.close()
            raise
        self._lost = 0
        identity = opened.identity
        return dataclasses.replace(identity, detail=f"{identity.detail} (in a process of its own)".strip())

    def reconnect(self) -> Identity:
        """End the camera's process, however it is, and open the camera in a fresh one. Raises as :meth:`open`."""
        return self.open()

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
        self._send(messages.Trigger(self._ticket))

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
        answer = self._ask(messages.TellClock, "did not tell its time")
        return answer.fix if isinstance(answer, messages.ClockTold) else None

    def exposure_limits(self) -> tuple[float, float]:
        """Shortest and longest exposure, s. Raises :class:`DeviceRefused` when its driver cannot set the exposure."""
        low, high = self._numbers(messages.TellLimits, 2, "did not tell its shortest and longest exposure")
        return low, high

    def set_exposure(self, seconds: float) -> float:
        """Expose so long from the next trigger on; what the camera made of it, s. Raises as the driver does."""
        (exposure_s,) = self._numbers(partial(messages.SetExposure, seconds=seconds), 1, "did not take its exposure")
        return exposure_s

    def _numbers(self, make: Callable[[int], messages.Request], count: int, failure: str) -> tuple[float, ...]:
        answer = self._ask(make, failure)
        if not isinstance(answer, messages.NumbersTold) or len(answer.numbers) != count:
            raise DeviceBadAnswer(failure, where=self._where, advice="open it again")
        return answer.numbers

    def _ask(self, make: Callable[[int], messages.Request], failure: str) -> messages.ClockTold | messages.NumbersTold:
        """Ask, and wait for the answer. Raises what the driver raised, DeviceTimeout or DeviceLost."""
        self._check_alive()
        self._answer = None
        self._waiting = next(self._tickets)
        self._send(make(self._waiting))
        deadline = time.monotonic() + _ANSWER_S
        assert self._pipe is not None
        try:
            while self._answer is None:
                with suppress(OSError):
                    self._pipe.poll(0.01)
                self._receive()
                if self._answer is not None:
                    break
                self._check_alive()
                if time.monotonic() > deadline:
                    raise DeviceTimeout(f"{failure} within {_ANSWER_S:g} s", where=self._where, advice="try again")
            answer = self._answer
        finally:
            self._waiting = self._answer = None
        if isinstance(answer, DeviceError):
            raise answer
        return answer

    def make_safe(self) -> None:
        """Forget the frame asked for. Never raises."""
        self._ticket = self._frame = self._error = None
        with suppress(DeviceError):
            self._send(messages.Safe())

    def close(self) -> None:
        """Close the driver and end its process, by force if it must be; remove the shared memory. Never raises."""
        process, pipe, ring = self._process, self._pipe, self._ring
        self._process = self._pipe = self._ring = None
        self._ticket = self._frame = self._error = None
        if pipe is not None:
            with suppress(OSError, ValueError):
                messages.say(pipe, messages.Close())
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

    def _receive_opened(self) -> messages.Opened:
        assert self._pipe is not None
        if not self._pipe.poll(self._open_timeout_s):
            raise DeviceTimeout(
                f"did not open within {self._open_timeout_s:g} s",
                where=self._where,
                advice="check cable and power, and that no other program uses the camera",
            )
        try:
            answer = messages.hear_answer(self._pipe)
        except (EOFError, OSError):
            raise self._died() from None
        if isinstance(answer, messages.Failed):
            raise answer.error()
        if not isinstance(answer, messages.Opened):
            raise DeviceBadAnswer("did not say that it is open", where=self._where, advice="open it again")
        return answer

    def _send(self, message: messages.Request) -> None:
        if self._pipe is None:
            raise self._closed()
        try:
            messages.say(self._pipe, message)
        except (OSError, ValueError):
            raise self._died() from None

    def _receive(self) -> None:
        """Take in all that the camera process has said; answers to requests given up are dropped."""
        if self._pipe is None or self._ring is None:
            raise self._closed()
        try:
            while self._pipe.poll(0):
                self._take(messages.hear_answer(self._pipe))
        except (EOFError, OSError):
            raise self._died() from None

    def _take(self, answer: messages.Answer) -> None:
        assert self._ring is not None
        match answer:
            case messages.ClockTold() | messages.NumbersTold():
                if answer.ticket == self._waiting:
                    self._answer = answer
            case messages.FrameTaken():
                self._lost = answer.lost
                if answer.ticket == self._ticket:
                    self._frame = answer.frame(self._ring.get(answer.number, answer.dtype))
            case messages.Failed():
                if answer.ticket == self._waiting:
                    self._answer = answer.error()
                elif answer.ticket in (0, self._ticket):
                    self._error = answer.error()

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
