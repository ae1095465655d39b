"""A camera that runs freely at a steady rate, for measuring what taking its frames costs."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceLost
from drivers.records import ClockFix, Frame, Identity

BUFFERS = 8
CYCLE = 65_536
"""Numbers of the first pixel after which they come again."""


def number_of(image: NDArray[np.generic]) -> int:
    """Number, modulo 65,536, of the frame."""
    return int(image[0, 0])


class PacedCamera:
    """A :class:`drivers.contracts.Camera` whose frame n is n in its first pixel; it keeps the newest eight frames.

    A trigger asks for the next frame that has not been taken; frames that nobody takes in time are lost.
    """

    @dataclass(frozen=True)
    class Options:
        """Settings of the camera."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid"}

        width_px: int = 782
        height_px: int = 582
        rate_hz: float = 60.0

    def __init__(self, options: Options) -> None:
        self._options = options
        rng = np.random.default_rng(1)
        # 12 bits in 16, a different picture in each buffer.
        shape = (BUFFERS, options.height_px, options.width_px)
        self._buffers = rng.integers(0, 4096, shape, dtype=np.uint16)
        self._start_ns: int | None = None
        self._next = self._lost = 0
        self._asked = False

    def open(self) -> Identity:
        """Begin to expose."""
        self._start_ns, self._next, self._lost, self._asked = time.monotonic_ns(), 0, 0, False
        return Identity("camera", "paced", "paced camera", f"{self._options.rate_hz:g} Hz")

    def close(self) -> None:
        """Stop."""
        self._start_ns = None

    def make_safe(self) -> None:
        """Forget the frame asked for."""
        self._asked = False

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self._options.height_px, self._options.width_px

    @property
    def lost_frames(self) -> int:
        """Frames that nobody took in time."""
        return self._lost

    def trigger(self) -> None:
        """Ask for the next frame."""
        self._asked = True

    def poll(self) -> Frame | None:
        """The frame asked for, once it has been exposed."""
        if self._start_ns is None:
            raise DeviceLost("is not open", where="paced camera", advice="open it first")
        now_ns = time.monotonic_ns()
        exposed = int((now_ns - self._start_ns) * 1e-9 * self._options.rate_hz)
        if not self._asked or exposed <= self._next:
            return None
        missed = max(exposed - self._next - BUFFERS, 0)
        self._lost += missed
        number = self._next + missed
        self._next, self._asked = number + 1, False
        image = self._buffers[number % BUFFERS]
        image[0, 0] = number % 65_536
        t_s = (number + 1) / self._options.rate_hz
        t_host_ns = self._start_ns + round(t_s * 1e9)
        return Frame(image, number, 1 / self._options.rate_hz, 0.0, t_s, t_host_ns, lost_before=missed)

    def clock(self) -> ClockFix | None:
        """It has none of its own."""
        return None
