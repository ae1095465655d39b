"""A stream that begins late and catches up: no record holds samples from before it was asked for."""

from __future__ import annotations

import math
import threading
import time
from typing import Any

import numpy as np
import pytest

from drivers.radar import sound_port
from drivers.radar.devices import SoundCard
from drivers.radar.sound_port import SoundPort

RATE_HZ = 48_000
BLOCK = 480
LATE_S = 0.08


class Times:
    """PortAudio's times, which this sound system does not tell."""

    currentTime = 0.0  # noqa: N815
    inputBufferAdcTime = 0.0  # noqa: N815


class Status:
    """No flags."""

    input_overflow = False


class LateStream:
    """Delivers frames that hold their own number, every block ``LATE_S`` late until :meth:`catch_up`."""

    def __init__(self, callback: Any, **_: Any) -> None:
        self._callback = callback
        self._stop = threading.Event()
        self._late_s = LATE_S
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.start_s = math.nan
        self.active = True
        self.PortAudioError = RuntimeError

    def start(self) -> None:
        self.start_s = time.monotonic()
        self._thread.start()

    def catch_up(self) -> None:
        """From now on in time: what is overdue comes in one burst."""
        self._late_s = 0.0

    def close(self, ignore_errors: bool = True) -> None:
        self.active = False
        self._stop.set()
        self._thread.join(5)

    def _run(self) -> None:
        block = 0
        while not self._stop.is_set():
            while time.monotonic() < self.start_s + (block + 1) * BLOCK / RATE_HZ + self._late_s:
                time.sleep(0.0005)
            numbers = np.arange(block * BLOCK, (block + 1) * BLOCK, dtype=np.int32)
            self._callback(np.stack([numbers, numbers], axis=1), BLOCK, Times, Status)
            block += 1


class LateSounddevice:
    """Stands in for the ``sounddevice`` module."""

    PortAudioError = RuntimeError

    def __init__(self) -> None:
        self.stream: LateStream | None = None

    def InputStream(self, **options: Any) -> LateStream:
        self.stream = LateStream(**options)
        return self.stream


def test_records_hold_nothing_from_before_they_were_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    fake = LateSounddevice()
    monkeypatch.setattr(sound_port.portaudio, "acquire", lambda environment: fake)
    monkeypatch.setattr(sound_port.portaudio, "release", lambda stuck=False: None)
    monkeypatch.setattr(sound_port, "find_device", lambda *_: SoundCard(0, "late", "", "none"))
    port = SoundPort(SoundPort.Options(sample_format="int32", guard_s=0.02))
    port.open()
    try:
        assert fake.stream is not None
        asked_s = time.monotonic()
        port.begin(4_800)
        time.sleep(0.05)
        fake.stream.catch_up()
        limit = time.monotonic() + 10
        while (block := port.poll()) is None:
            assert time.monotonic() < limit
            time.sleep(0.01)
        numbers = block.samples[:, 0]
        np.testing.assert_array_equal(np.diff(numbers), 1)
        # Frame n was sampled at start + n / rate, however late it came. One callback (10 ms) is the clock's resolution.
        sampled_s = fake.stream.start_s + numbers[0] / RATE_HZ
        assert sampled_s >= asked_s
        assert abs(block.t_host_ns * 1e-9 - sampled_s) < 0.015
        assert block.lost_frames == 0
    finally:
        port.close()
