"""Records one after another without a gap: the frames hold their own number, so that a gap would show."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable

import numpy as np
import pytest
from audio_rig import Rig, finish, position_in_cycle
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.contracts import GaplessRadar
from drivers.errors import DeviceRefused
from drivers.radar.collecting import Collecting
from drivers.radar.ring import SampleRing
from drivers.radar.sound_port import SoundPort
from drivers.radar.stream_clock import StreamClock
from drivers.records import AudioBlock
from hw_mocks.scene_radar import SceneRadar

RATE = 48_000.0
BLOCK = 480


class Stream:
    """A sound card's callback, ring and clock, fed by hand in steps of 10 ms."""

    def __init__(self, capacity: int = 48_000) -> None:
        self.ring = SampleRing(capacity, 2, np.int32)
        self.clock = StreamClock(RATE)
        self.sampled = self.received = self.next_arrival = 0

    def step(self, lost: int = 0) -> None:
        """One callback; ``lost`` frames before it were sampled and never came."""
        self.sampled += lost
        numbers = np.arange(self.sampled, self.sampled + BLOCK, dtype=np.int32)
        self.sampled += BLOCK
        self.ring.write(np.stack([numbers, numbers], axis=1), round(self.sampled / RATE * 1e9), float("nan"), False)
        arrivals, self.next_arrival = self.ring.arrivals(self.next_arrival)
        for arrival in arrivals:
            self.clock.add(arrival)

    def collecting(self, frames: int, *, gapless: bool) -> Collecting:
        return Collecting(
            self.ring,
            self.clock,
            0,
            np.zeros((frames, 2), np.int32),
            sample_rate_hz=RATE,
            after_ns=None,
            margin_ns=0,
            gapless=gapless,
        )


@given(frames=st.integers(1, 3000), polls=st.lists(st.integers(1, 30), min_size=5, max_size=20))
@settings(max_examples=60, deadline=None)
def test_blocks_follow_each_other_frame_by_frame(frames: int, polls: list[int]) -> None:
    stream = Stream()
    request = stream.collecting(frames, gapless=True)
    blocks: list[AudioBlock] = []
    for steps in polls:
        for _ in range(steps):
            stream.step()
        while (block := request.take()) is not None:
            blocks.append(block)
    # Everything that has come is in them but for what is less than a block.
    assert len(blocks) == stream.sampled // frames
    for number, block in enumerate(blocks):
        np.testing.assert_array_equal(block.samples[:, 0], np.arange(number * frames, (number + 1) * frames))
        assert (block.first_frame, block.lost_frames) == (number * frames, 0)


def test_a_loss_is_counted_once_and_the_numbers_say_where() -> None:
    stream = Stream()
    request = stream.collecting(4800, gapless=True)
    blocks: list[AudioBlock] = []
    for number in range(300):
        stream.step(lost=960 if number == 105 else 0)
        while (block := request.take()) is not None:
            blocks.append(block)
    assert sum(block.lost_frames for block in blocks) == pytest.approx(960, abs=5)
    assert [number for number, block in enumerate(blocks) if block.lost_frames] == [10]
    # After it frames count what is missing: their numbers are the true ones again.
    later = blocks[20]
    assert abs(later.first_frame - int(later.samples[0, 0])) <= 5


def test_a_reader_that_is_too_slow_is_told_what_it_missed() -> None:
    stream = Stream(capacity=9600)
    request = stream.collecting(2400, gapless=True)
    for _ in range(100):
        stream.step()
    blocks = [block for _ in range(30) if (block := request.take()) is not None]
    got = sum(len(block.samples) for block in blocks)
    assert blocks[0].lost_frames > 0
    assert all((np.diff(block.samples[:, 0]) >= 1).all() for block in blocks)
    assert got + sum(block.lost_frames for block in blocks) <= stream.sampled


def test_the_simulated_port_streams(make_rig: Callable[..., Rig]) -> None:
    rig = make_rig()
    radar = SceneRadar(SceneRadar.Options(url=rig.stream.url))
    radar.open()
    try:
        assert isinstance(radar, GaplessRadar)
        assert isinstance(SoundPort(SoundPort.Options()), GaplessRadar)
        asked_ns = time.monotonic_ns()
        radar.begin_stream(3_000)
        with pytest.raises(DeviceRefused, match="under way"):
            radar.begin(100)
        blocks = [finish(radar) for _ in range(8)]
        assert blocks[0].t_host_ns >= asked_ns
        for a, b in itertools.pairwise(blocks):
            assert b.first_frame == a.first_frame + 3_000
            assert b.t_host_ns - a.t_host_ns == pytest.approx(62_500_000, abs=1_000_000)
        # The standing rig's signal repeats after a cycle: joined blocks are one piece of it, sample for sample.
        joined = np.concatenate([block.samples for block in blocks])
        cycle = rig.synthesizer.block(0, rig.synthesizer.audio.cycle_samples, time.monotonic_ns())
        assert position_in_cycle(joined, cycle) >= 0
        # One is lost, and known to be.
        rig.card.skip(480)
        end = time.monotonic() + 10
        while not (block := finish(radar)).lost_frames:
            assert time.monotonic() < end
        assert block.lost_frames == 480
        radar.cancel()
        assert radar.poll() is None
        radar.begin(100)
        assert len(finish(radar).samples) == 100
    finally:
        radar.close()


def test_a_record_that_began_early_is_whole_also_when_frames_are_lost_after_its_beginning() -> None:
    # A stream 80 ms late catches up, so that the record is collected anew; then 300 ms are lost inside of it.
    ring, clock = SampleRing(96_000, 2, np.int32), StreamClock(RATE)
    begun_ns = 10**9
    record: Collecting | None = None
    block: AudioBlock | None = None
    received = sampled = arrived = 0
    for step in range(400):
        lost = 14_400 if step == 130 else 0
        sampled += lost
        numbers = np.arange(sampled, sampled + BLOCK, dtype=np.int32)
        sampled += BLOCK
        late_ns = 80_000_000 if step < 110 else 0
        ring.write(np.stack([numbers, numbers], axis=1), round(sampled / RATE * 1e9) + late_ns, float("nan"), False)
        received += BLOCK
        arrivals, arrived = ring.arrivals(arrived)
        for arrival in arrivals:
            clock.add(arrival)
        if step == 105:
            begun_ns = round(sampled / RATE * 1e9) + late_ns
            record = Collecting(
                ring, clock, clock.first_frame_after(begun_ns), np.zeros((24_000, 2), np.int32),
                sample_rate_hz=RATE, after_ns=begun_ns, margin_ns=10_000_000, gapless=False,
            )  # fmt: skip
        if record is not None and block is None:
            block = record.take()
    assert block is not None
    # Frame n was sampled at n / RATE: nothing from before the record was asked for, and the loss is counted.
    assert block.samples[0, 0] / RATE * 1e9 >= begun_ns - 10_000_000
    assert block.lost_frames == pytest.approx(14_400, abs=96)
