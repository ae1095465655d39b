"""The camera's own process: owns the driver, answers requests, puts frames into shared memory.

Requests are tuples ``(word, ...)``. Answers are ``("opened", Identity, shape)``, ``("frame", ticket, number, Frame
without its image, dtype, lost)``, ``("clock", ClockFix | None | DeviceError)`` and ``("error", ticket, DeviceError)``.
The process ends when it is told to close, or when the other end of the pipe is gone: an engine that was killed leaves
no camera behind.
"""

from __future__ import annotations

import dataclasses
import signal
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, TypeVar

import numpy as np

from drivers.camera.frame_ring import FrameRing
from drivers.contracts import Camera
from drivers.errors import DeviceError, DeviceLost
from drivers.records import Frame
from drivers.registry import driver_class

Answer = TypeVar("Answer")

EMPTY = np.zeros((0, 0), dtype=np.uint16)
"""Image of a frame whose pixels travel through shared memory."""

_IDLE_S = 0.05
_BUSY_S = 0.002


def run(pipe: Connection, driver_name: str, options: Any) -> None:
    """Body of the camera process.

    Args:
        pipe: to the process that uses the camera.
        driver_name: registry name of the driver.
        options: its ``Options``.
    """
    # Ctrl-C reaches the whole terminal; the engine decides when the camera ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    camera: Camera | None = None
    ring: FrameRing | None = None
    try:
        try:
            camera, ring = _open(pipe, driver_name, options)
        except DeviceError as error:
            pipe.send(("error", 0, error))
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


def _open(pipe: Connection, driver_name: str, options: Any) -> tuple[Camera, FrameRing]:
    """Make and open the driver, tell its identity, attach to the shared memory that the engine then makes."""
    camera: Camera | None = None
    try:
        camera = driver_class("camera", driver_name)(options)
        identity = camera.open()
        shape = camera.shape
    except Exception as error:
        if camera is not None:
            camera.close()
        if isinstance(error, DeviceError):
            raise
        raise _defect(error) from error
    try:
        pipe.send(("opened", identity, shape))
        _, name, slots = pipe.recv()
        return camera, FrameRing(shape, slots=slots, name=name)
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
            word, *arguments = pipe.recv()
            if word == "close":
                return
            if word == "clock":
                pipe.send(("clock", _attempt(camera.clock)))
                continue
            # A new trigger and a call to safety both forget the frame asked for before.
            ticket = arguments[0] if word == "trigger" else None
            failure = _attempt(camera.trigger if word == "trigger" else camera.make_safe)
            if failure is not None:
                pipe.send(("error", ticket or 0, failure))
                ticket = None
        if ticket is None:
            continue
        answer = _attempt(partial(_fetch, camera, ring, number + 1))
        if isinstance(answer, DeviceError):
            pipe.send(("error", ticket, answer))
            ticket = None
        elif answer is not None:
            number += 1
            frame, dtype, lost = answer
            pipe.send(("frame", ticket, number, frame, dtype, lost))
            ticket = None


def _fetch(camera: Camera, ring: FrameRing, number: int) -> tuple[Frame, str, int] | None:
    """Move a frame that has arrived into the ring; what is left of it, its sample type, and the count of lost ones."""
    frame = camera.poll()
    if frame is None:
        return None
    ring.put(number, frame.image)
    return dataclasses.replace(frame, image=EMPTY), frame.image.dtype.name, camera.lost_frames


def _attempt(call: Callable[[], Answer]) -> Answer | DeviceError:
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
