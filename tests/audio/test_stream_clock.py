"""Losses are found and stalls forgiven, from arrival times alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.radar.ring import Arrival, SampleRing
from drivers.radar.stream_clock import LOSS_THRESHOLD_S, StreamClock

RATE, BLOCK = 48_000.0, 480
START_NS = 7 * 10**15  # a computer that has run for 81 days


class Card:
    """A sound card with a known clock, delays and losses."""

    def __init__(self, clock: StreamClock, *, ppm: float = 0.0, adc: bool = False) -> None:
        self.clock, self.rate, self.adc = clock, RATE * (1 + ppm * 1e-6), adc
        self.sampled = self.received = 0

    def block(self, late_s: float = 0.0, lost: int = 0, overflow: bool = False) -> None:
        self.sampled += lost + BLOCK
        age = late_s + BLOCK / self.rate if self.adc else math.nan
        host_ns = START_NS + round((self.sampled / self.rate + late_s) * 1e9)
        self.clock.add(Arrival(self.received, BLOCK, host_ns, age, overflow))
        self.received += BLOCK

    def run_late(self, late_s: float, blocks: int) -> None:
        """Blocks that are all as late."""
        for _ in range(blocks):
            self.block(late_s)

    def run(self, blocks: int, rng: np.random.Generator | None = None) -> None:
        for _ in range(blocks):
            self.block(0.0 if rng is None else float(rng.exponential(0.003)))


def test_a_steady_stream_loses_nothing_and_knows_its_times() -> None:
    clock = StreamClock(RATE)
    Card(clock).run(1000)
    assert clock.lost == 0
    assert clock.confirmed == clock.end == 480_000
    # Frame n arrives with the least delay at n / RATE after the start.
    assert clock.arrival_ns(48_000) == pytest.approx(START_NS + 10**9, abs=2)
    assert clock.first_frame_after(START_NS + 10**9) in (48_000, 48_001)


@given(st.integers(0, 2**32), st.integers(500, 48_000))
def test_a_silent_loss_is_sized_from_the_hosts_clock_whatever_the_jitter(seed: int, lost: int) -> None:
    rng = np.random.default_rng(seed)
    clock = StreamClock(RATE)
    card = Card(clock)
    card.run(200, rng)
    card.block(float(rng.exponential(0.003)), lost=lost)
    card.run(100, rng)
    # Least of the 25 exponential delays (mean 3 ms) of the settled half: above 1.5 ms with probability exp(-12.5).
    assert clock.lost == pytest.approx(lost, abs=round(0.0015 * RATE) + 1)
    # Arrivals just before the loss may by chance be as late as those after it.
    assert 190 * BLOCK <= clock.losses[0].first <= 200 * BLOCK


@given(st.integers(1, 200), st.floats(0.01, 0.45))
def test_a_stall_that_is_caught_up_loses_nothing(before: int, stall_s: float) -> None:
    clock = StreamClock(RATE)
    card = Card(clock)
    card.run(before)
    late = stall_s
    while late > 0:
        card.block(late)
        late -= BLOCK / RATE  # the backlog arrives at once
        if late > LOSS_THRESHOLD_S:
            assert clock.confirmed < clock.end, "a record is not handed out before it is known to be whole"
    card.run(100)
    assert clock.lost == 0
    assert clock.confirmed == clock.end


@given(st.integers(0, 2**32), st.floats(0.01, 3.0))
def test_a_long_stall_amid_jitter_loses_nothing(seed: int, stall_s: float) -> None:
    rng = np.random.default_rng(seed)
    clock = StreamClock(RATE)
    card = Card(clock)
    card.run(100, rng)
    card.block(0.0085)  # late already when the stall begins
    late = stall_s
    while late > 0:
        card.block(late)
        late -= BLOCK / RATE * (1 - 1e-3)  # a quick burst, not an instant
    card.run(100, rng)
    assert clock.lost == 0


@pytest.mark.parametrize("witnessed", [False, True])
def test_a_server_that_falls_behind_and_catches_up_is_doubted_meanwhile(witnessed: bool) -> None:
    """Late by a steady 0.575 s for two seconds looks like a loss; frames asked for then are sampled after it all the
    same, and at once again when it has caught up. What the host API itself flags as lost is not doubted."""
    clock = StreamClock(RATE)
    card = Card(clock)
    card.run(200)
    for number in range(200):
        card.block(0.575, overflow=witnessed and number == 0)
    assert clock.lost == pytest.approx(0.575 * RATE, rel=0.01)
    now_ns = START_NS + round(card.sampled / RATE * 1e9) + round(0.575e9)
    sampled_at = now_ns * 1e-9 - START_NS * 1e-9
    # Nothing is lost in truth: frame n is sampled at n / RATE.
    sure = clock.frame_surely_after(now_ns)
    if witnessed:
        assert sure == clock.first_frame_after(now_ns)
    else:
        assert sure >= sampled_at * RATE - 1
        assert sure < (sampled_at + 0.02) * RATE
    for late_s in (0.45, 0.2, 0.05, 0.0):
        card.run_late(late_s, 20)
    now_ns = START_NS + round(card.sampled / RATE * 1e9)
    if not witnessed:
        assert clock.frame_surely_after(now_ns) == pytest.approx(card.sampled, abs=0.01 * RATE)


@pytest.mark.parametrize("ppm", [-300, -20, 20, 300])
def test_drift_is_no_loss(ppm: float) -> None:
    clock = StreamClock(RATE)
    card = Card(clock, ppm=ppm)
    card.run(6000)
    assert clock.lost == 0
    # A minute on, a line of the nominal rate through the newest arrivals is off by a second's drift and a little.
    assert clock.arrival_ns(card.received) == pytest.approx(START_NS + card.sampled / card.rate * 1e9, abs=1e6)


def test_clean_adc_times_size_a_loss_to_the_frame() -> None:
    clock = StreamClock(RATE)
    card = Card(clock, adc=True)
    rng = np.random.default_rng(3)
    card.run(100, rng)
    card.block(0.002, lost=960, overflow=True)
    card.run(100, rng)
    assert clock.lost == 960
    assert clock.lost_before(100 * BLOCK) == 960
    assert clock.lost_within(99 * BLOCK, 101 * BLOCK) == 960
    assert clock.lost_within(0, 99 * BLOCK) == 0
    assert clock.flagged_within(100 * BLOCK, 101 * BLOCK)


def test_a_flag_alone_counts_as_at_least_one_frame() -> None:
    clock = StreamClock(RATE)
    card = Card(clock)
    card.run(100)
    card.block(overflow=True)
    card.run(60)
    assert clock.lost == 1


def test_wrong_adc_times_do_not_invent_losses() -> None:
    clock = StreamClock(RATE)
    card = Card(clock)
    for number in range(400):
        age = 0.01 if number < 200 else 0.25  # some host APIs report such jumps
        card.sampled += BLOCK
        card.clock.add(Arrival(card.received, BLOCK, START_NS + round(card.sampled / RATE * 1e9), age, False))
        card.received += BLOCK
    assert clock.lost == 0


@given(st.lists(st.integers(1, 37), min_size=1, max_size=60))
def test_the_ring_holds_the_newest_frames(sizes: list[int]) -> None:
    ring = SampleRing(50, 2, "int16")
    everything = np.arange(sum(sizes) * 2, dtype=np.int16).reshape(-1, 2)
    first = 0
    for size in sizes:
        ring.write(everything[first : first + size], first, math.nan, False)
        first += size
        kept = min(first, 50)
        np.testing.assert_array_equal(ring.read(first - kept, kept), everything[first - kept : first])
        assert ring.oldest == first - kept
        if ring.oldest:
            assert ring.read(ring.oldest - 1, 1) is None


@given(
    losses=st.lists(st.tuples(st.integers(60, 120), st.integers(500, 20_000)), max_size=4),
    at=st.floats(0.0, 1.0),
)
def test_the_frame_of_an_instant_is_the_first_that_arrives_at_or_after_it(
    losses: list[tuple[int, int]], at: float
) -> None:
    # Whatever was lost before that instant, in the middle of it or later: the two directions agree.
    clock = StreamClock(RATE)
    card = Card(clock)
    for blocks, lost in losses:
        card.run(blocks)
        card.block(lost=lost)
    card.run(120)
    assert len(clock.losses) == len(losses)
    t_ns = START_NS + round(at * card.sampled / RATE * 1e9)
    frame = clock.first_frame_after(t_ns)
    assert clock.arrival_ns(frame) >= t_ns - 1  # times are rounded to nanoseconds
    assert frame == 0 or clock.arrival_ns(frame - 1) < t_ns + 1
