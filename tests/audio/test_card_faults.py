"""Every fault of the sound card over PulseAudio: what the driver says of it, how soon, and what follows."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import numpy as np
import pytest
from audio_rig import finish, need, take
from counter_source import CounterSource, numbers_of

from drivers.errors import DeviceBadAnswer, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.radar.sound_port import SoundPort
from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.sound_card import PulseSource, SoundCard

pytestmark = pytest.mark.audio
RATE = 48_000


class SweepSource(CounterSource):
    """A busy beat, and a sync of 40 ms."""

    def block(self, first: int, frames: int, t_ns: int) -> np.ndarray:
        n = first + np.arange(frames)
        return np.stack([n * 7919 % 8001 - 4000, np.where(n % 1920 < 960, 20_000, -20_000)], axis=1).astype(np.int16)


class Bench:
    """A card that counts, its faults, and a driver on it."""

    def __init__(self, rate: int = RATE, source: CounterSource | None = None) -> None:
        self.rate = rate
        self.faults = FaultScript()
        self.pulse = PulseSource(rate)
        self.card = SoundCard(source or CounterSource(rate), [self.pulse], faults=self.faults)
        self.card.start()
        self.radar = self.port()

    def port(self, **changes: object) -> SoundPort:
        settings = {"device": self.pulse.device, "environment": self.pulse.environment, "sample_rate_hz": self.rate}
        timing = {"latency_s": 0.02, "guard_s": 0.03, "block_frames": self.rate // 100}
        return SoundPort(SoundPort.Options(**{**settings, **timing, **changes}))  # type: ignore[arg-type]

    def close(self) -> None:
        self.radar.close()
        self.card.close()
        assert self.card.failure is None


@pytest.fixture
def bench() -> Iterator[Bench]:
    need("pulse")
    bench = Bench()
    yield bench
    bench.close()


def expect_whole(radar: SoundPort) -> None:
    block = take(radar, 4800)
    assert block.lost_frames == 0
    np.testing.assert_array_equal(np.diff(numbers_of(block.samples)), 1)


def expect_loss(bench: Bench, frames: int) -> None:
    """One silent gap of about ``frames`` frames in the next record of two seconds: counted, and later records whole."""
    block = finish(bench.radar)
    steps = np.diff(numbers_of(block.samples))
    assert not block.overflow, "PulseAudio says nothing"
    # The samples tell what is missing; the driver knows it from arrival times, to a few milliseconds.
    if frames:
        assert int(np.sum(steps - 1)) == frames
    assert block.lost_frames == pytest.approx(frames, abs=0.005 * bench.rate)
    expect_whole(bench.radar)


def test_frames_that_get_lost_without_a_flag(bench: Bench) -> None:
    bench.radar.open()
    bench.radar.begin(2 * RATE)
    bench.faults.start(FaultKind.OVERFLOW, after_s=0.3, amount=7200)
    expect_loss(bench, 7200)


def test_a_clock_that_stands_still_for_a_while(bench: Bench) -> None:
    # Numbers follow each other, but 0.25 s of the world are missing.
    bench.radar.open()
    bench.radar.begin(2 * RATE)
    bench.faults.start(FaultKind.CLOCK_JUMP, after_s=0.3, amount=0.25)
    block = finish(bench.radar)
    np.testing.assert_array_equal(np.diff(numbers_of(block.samples)), 1)
    assert block.lost_frames == pytest.approx(0.25 * RATE, abs=0.005 * RATE)
    expect_whole(bench.radar)


def test_a_short_stall_is_made_up_for_and_a_long_one_told_in_time(bench: Bench) -> None:
    bench.radar = bench.port(stall_timeout_s=1.0)
    bench.radar.open()
    bench.radar.begin(2 * RATE)
    bench.faults.start(FaultKind.STALL, after_s=0.3, for_s=0.4)
    block = finish(bench.radar)
    np.testing.assert_array_equal(np.diff(numbers_of(block.samples)), 1)
    assert block.lost_frames == 0
    bench.radar.begin(4 * RATE)
    bench.faults.start(FaultKind.STALL, for_s=1.6)
    start = time.monotonic()
    with pytest.raises(DeviceTimeout, match="no sample for 1 s"):
        finish(bench.radar)
    assert time.monotonic() - start < 2
    bench.radar.cancel()
    time.sleep(1.5)
    expect_whole(bench.radar)


def test_a_card_at_another_rate_than_it_says(bench: Bench) -> None:
    bench.faults.start(FaultKind.WRONG_FORMAT, amount=44_100)
    with pytest.raises(DeviceRefused, match=r"delivers 4[34]\d\d\d samples a second, not 48000"):
        bench.radar.open()
    bench.faults.stop(FaultKind.WRONG_FORMAT)
    bench.radar.open()
    expect_whole(bench.radar)
    bench.faults.start(FaultKind.WRONG_FORMAT, amount=44_100)
    time.sleep(2)
    # In 2 s, 7800 frames too few; some of them not judged yet.
    assert bench.radar.lost_frames > 2000


@pytest.mark.parametrize(
    ("fault", "amount", "words"),
    [
        (FaultKind.SILENCE, 0, "channel 0 is silent"),
        (FaultKind.SILENCE, 1, "channel 1 is silent"),
        (FaultKind.SILENCE, 2, "both channels are silent"),
        (FaultKind.GARBAGE, 0, "neither channel carries a sync"),
    ],
)
def test_dead_channels_and_garbage(fault: FaultKind, amount: float, words: str) -> None:
    need("pulse")
    bench = Bench(source=SweepSource(RATE))
    try:
        bench.radar.open()
        bench.radar.check_signal(0.040)
        bench.radar.close()
        bench.faults.start(fault, amount=amount)
        bench.radar.open()
        with pytest.raises(DeviceBadAnswer, match=words):
            bench.radar.check_signal(0.040)
    finally:
        bench.close()


def test_an_unplugged_card_and_its_return(bench: Bench) -> None:
    bench.radar.open()
    expect_whole(bench.radar)
    bench.radar.begin(10 * RATE)
    bench.faults.start(FaultKind.DISCONNECT, for_s=1.0)
    start = time.monotonic()
    with pytest.raises(DeviceLost, match="unplugged"):
        finish(bench.radar)
    assert time.monotonic() - start < 2
    with pytest.raises(DeviceLost, match="unplugged"):
        bench.radar.poll() or bench.radar.begin(1)
    bench.radar.close()
    time.sleep(1.5)
    # The same port, in the same process.
    bench.radar.open()
    expect_whole(bench.radar)


def test_another_rate_than_the_cards_is_refused(bench: Bench) -> None:
    # PulseAudio resamples without a word: the samples come at the pace asked for.
    with pytest.raises(DeviceRefused, match="polfuse_radar runs at 48000 Hz and would be resampled to 96000 Hz"):
        bench.port(sample_rate_hz=96_000, block_frames=960).open()
    bench.radar.open()
    expect_whole(bench.radar)


def stopped_server_loses_silently(stall_s: float) -> None:
    bench = Bench(192_000)
    try:
        bench.radar = bench.port(stall_timeout_s=stall_s + 5)
        bench.radar.open()
        bench.radar.begin(round((stall_s + 2) * bench.rate))
        time.sleep(0.3)
        os.kill(bench.pulse.pid, signal.SIGSTOP)
        time.sleep(stall_s)
        os.kill(bench.pulse.pid, signal.SIGCONT)
        block = finish(bench.radar, stall_s + 12)
        missing = int(np.sum(np.diff(numbers_of(block.samples)) - 1))
        assert not block.overflow, "PulseAudio says nothing"
        # The simulated card holds one second, PulseAudio itself a little.
        assert missing > (stall_s - 1.5) * bench.rate
        # The card hands on blocks of 10 ms, which after the pause lie anywhere against those before it.
        assert block.lost_frames == pytest.approx(missing, abs=0.012 * bench.rate)
    finally:
        bench.close()


def test_pulseaudios_silent_loss_is_counted() -> None:
    need("pulse")
    stopped_server_loses_silently(2.5)


@pytest.mark.slow
def test_nine_seconds_of_silent_loss_are_counted() -> None:
    need("pulse")
    stopped_server_loses_silently(9.0)
