"""The camera's own process: owns the driver, answers requests, puts frames into shared memory.

What is said is in :mod:`drivers.camera.messages`. The process ends when it is told to close, or when the other end of
the pipe is gone: an engine that was killed leaves no camera behind.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from typing import TypeVar

from drivers.camera import messages
from drivers.camera.frame_ring import FrameRing
from drivers.contracts import Camera, ExposureControl
from drivers.errors import DeviceError, DeviceLost, DeviceRefused
from drivers.registry import driver_class

Result = TypeVar("Result")

_IDLE_S = 0.05
_BUSY_S = 0.002


def run(pipe: Connection) -> None:
    """Body of the camera process.

    Args:
        pipe: to the process that uses the camera.
    """
    # Ctrl-C reaches the whole terminal; the engine decides when the camera ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    camera: Camera | None = None
    ring: FrameRing | None = None
    try:
        try:
            camera, ring = _open(pipe)
        except DeviceError as error:
            messages.say(pipe, messages.Failed.of(0, error))
            return
        _serve(pipe, camera, ring)
    except (EOFError, OSError):
        # The engine is gone: nobody else will remove the shared memory.
        if ring is not None:
            ring.unlink()
    finally:
        if camera is not None:
            camera.close()
        if ring is not None:
            ring.close()
        pipe.close()


def _open(pipe: Connection) -> tuple[Camera, FrameRing]:
    """Make and open the driver, tell its identity, attach to the shared memory that the engine then makes."""
    request = messages.hear_request(pipe)
    if not isinstance(request, messages.Open):
        raise EOFError("the first request is not to open")
    camera: Camera | None = None
    try:
        driver = driver_class("camera", request.driver)
        camera = driver(messages.unpack_options(driver.Options, request.options))
        identity = camera.open()
        shape = camera.shape
    except Exception as error:
        if camera is not None:
            camera.close()
        if isinstance(error, DeviceError):
            raise
        raise _defect(error) from error
    try:
        messages.say(pipe, messages.Opened(identity, shape))
        memory = messages.hear_request(pipe)
        if not isinstance(memory, messages.Memory):
            raise EOFError("no memory came")
        return camera, FrameRing(shape, slots=memory.slots, name=memory.name)
    except BaseException:
        camera.close()
        raise


def _serve(pipe: Connection, camera: Camera, ring: FrameRing) -> None:
    """Answer requests until told to close. Raises EOFError or OSError when the engine is gone."""
    ticket: int | None = None
    number = 0
    while True:
        ring.beat()
        if pipe.poll(_IDLE_S if ticket is None else _BUSY_S):
            match messages.hear_request(pipe):
                case messages.Close():
                    return
                case messages.Trigger(ticket=asked):
                    # A new trigger forgets the frame asked for before.
                    ticket = asked if _told(pipe, asked, _attempt(camera.trigger)) else None
                case messages.Safe():
                    ticket = None
                    _told(pipe, 0, _attempt(camera.make_safe))
                case messages.TellClock(ticket=asked):
                    fix = _attempt(camera.clock)
                    if _told(pipe, asked, fix):
                        messages.say(pipe, messages.ClockTold(asked, fix))  # type: ignore[arg-type]
                case messages.TellLimits(ticket=asked):
                    limits = _attempt(partial(_limits, camera))
                    if _told(pipe, asked, limits):
                        messages.say(pipe, messages.NumbersTold(asked, limits))  # type: ignore[arg-type]
                case messages.SetExposure(ticket=asked, seconds=seconds):
                    set_to = _attempt(partial(_set_exposure, camera, seconds))
                    if _told(pipe, asked, set_to):
                        messages.say(pipe, messages.NumbersTold(asked, (set_to,)))  # type: ignore[arg-type]
        if ticket is None:
            continue
        answer = _attempt(partial(_fetch, camera, ring, ticket, number + 1))
        if not _told(pipe, ticket, answer):
            ticket = None
        elif isinstance(answer, messages.FrameTaken):
            number += 1
            messages.say(pipe, answer)
            ticket = None


def _told(pipe: Connection, ticket: int, outcome: object) -> bool:
    """Whether a request succeeded; when not, its error is sent."""
    if isinstance(outcome, DeviceError):
        messages.say(pipe, messages.Failed.of(ticket, outcome))
        return False
    return True


def _fetch(camera: Camera, ring: FrameRing, ticket: int, number: int) -> messages.FrameTaken | None:
    """Move a frame that has arrived into the ring; what is left of it."""
    frame = camera.poll()
    if frame is None:
        return None
    ring.put(number, frame.image)
    return messages.FrameTaken.of(frame, ticket=ticket, number=number, lost=camera.lost_frames)


def _limits(camera: Camera) -> tuple[float, float]:
    return _adjustable(camera).exposure_limits()


def _set_exposure(camera: Camera, seconds: float) -> float:
    return _adjustable(camera).set_exposure(seconds)


def _adjustable(camera: Camera) -> ExposureControl:
    if not isinstance(camera, ExposureControl):
        raise DeviceRefused(
            "its driver cannot set the exposure", where="camera", advice="leave automatic exposure out of the plan"
        )
    return camera


def _attempt(call: Callable[[], Result]) -> Result | DeviceError:
    """Result of a driver's method, or why it failed. A driver's own OSError must not look like a broken pipe."""
    try:
        return call()
    except DeviceError as error:
        return error
    except Exception as error:
        return _defect(error)


def _defect(error: Exception) -> DeviceError:
    return DeviceLost(
        f"the driver failed with {type(error).__name__}: {error}",
        where="camera process",
        advice="check the camera's options, then open it again",
    )
