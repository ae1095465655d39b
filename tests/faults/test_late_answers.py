"""An answer that comes too late must not be taken for the answer to the next question, and so on for ever."""

import math

import pytest

from drivers.polarizer.ell14 import Ell14
from hw_mocks.wire import serve


class Talkative:
    """A mount that answers its first ``gp`` twice, as after a question whose answer was late; then it has turned."""

    def __init__(self) -> None:
        self.asked = 0

    def handle(self, received: bytes) -> bytes:
        if received == b"0in":
            return b"0IN0E1140060920231701016800023000\r\n"
        if received != b"0gp":
            return b""
        self.asked += 1
        # 0x4600 pulses are 45 degrees of 143360 (0x23000) pulses per turn, 0x8C00 are 90.
        return {1: b"0PO00000000\r\n", 2: b"0PO00000000\r\n0PO00004600\r\n"}.get(self.asked, b"0PO00008C00\r\n")

    def due_s(self) -> float | None:
        return None


def test_the_polarizer_never_lags_behind() -> None:
    with serve(Talkative()) as wire:
        driver = Ell14(Ell14.Options(port=wire.url, timeout_s=1.0, home_at_open=False))
        driver.open()  # asks for the position once
        try:
            angles = [math.degrees(driver.poll().angle_rad) for _ in range(3)]
        finally:
            driver.close()
    assert angles[0] == 0
    assert angles[1:] == pytest.approx([90, 90])
