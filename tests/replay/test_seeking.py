"""Moments of a recording that are sought: later ones by hurrying on, earlier ones by a new replay."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np

from polfuse_lab.plans.steps import RecordSweeps
from polfuse_lab.records import Record, Sweeps
from polfuse_lab.replay import FASTEST, Player
from polfuse_lab.session import open_session

CRAWL = 0.02
"""Times as fast as recorded: the recordings of these tests, which take about half a second, would play for 25 s."""


class Seen:
    """A viewer that keeps what it was shown."""

    fatal: str | None = None
    warnings: tuple[str, ...] = ()

    def __init__(self) -> None:
        self.sweeps: list[Sweeps] = []

    def offer(self, record: Record) -> None:
        if isinstance(record, Sweeps):
            self.sweeps.append(record)


@contextlib.contextmanager
def played(bench) -> Iterator[tuple[Player, Seen, threading.Thread]]:
    """A replay that crawls, in a thread of its own; it is stopped at the end."""
    seen = Seen()
    with Player(bench.session, speed=CRAWL, viewer=seen) as player:
        thread = threading.Thread(target=player.run)
        thread.start()
        try:
            until(lambda: player.status().steps > 0)
            yield player, seen, thread
        finally:
            player.abort()
            thread.join(20)
            assert not thread.is_alive()


def until(reached: Callable[[], bool]) -> None:
    end = time.monotonic() + 20
    while not reached():
        assert time.monotonic() < end
        time.sleep(0.005)


def record(bench) -> tuple[list[int], int]:
    """Record three positions in two channels; the steps that record, and how many steps there are."""
    bench.write(settle=0.1)
    assert bench.run().state == "finished"
    with open_session(bench.session) as session:
        return [n for n, step in enumerate(session.steps) if isinstance(step, RecordSweeps)], len(session.steps)


def test_a_step_that_has_been_played_is_not_played_again(bench) -> None:
    records, _ = record(bench)
    with played(bench) as (player, seen, thread):
        late = records[3] + 1
        player.seek(late)
        until(lambda: player.status().step >= late)
        reached, shown = player.status().step, len(seen.sweeps)
        player.seek(records[0])
        # What it was to do in these 0.3 s, 6 ms of the recording, is less than a record takes (a sweep of 40 ms).
        time.sleep(0.3)
        assert reached <= player.status().step
        assert len(seen.sweeps) <= shown + 1
        player.clock.speed = FASTEST
        thread.join(20)
        assert player.status().state == "finished"
    with open_session(bench.session) as session:
        assert len(seen.sweeps) == len(records)
        for number, found in enumerate(seen.sweeps):
            np.testing.assert_array_equal(found.block.samples, session.audio(number))


def test_an_earlier_step_is_reached_by_playing_anew(bench) -> None:
    """As the window does it: what is shown at a step is what came before it, whichever way it was reached."""
    records, steps = record(bench)
    late, early = records[-1] + 1, records[1] + 1
    with played(bench) as (player, first, _):
        player.seek(late)
        until(lambda: player.status().step >= late)
        assert player.status().steps == steps
    with played(bench) as (player, again, _):
        player.seek(early)
        until(lambda: player.status().step >= early)
        time.sleep(0.1)
        assert player.status().step < late
    assert len(first.sweeps) == len(records)
    # Two records lie before the step that was sought; at a crawl a third is hardly begun.
    assert 2 <= len(again.sweeps) <= 3
    for one, other in zip(first.sweeps, again.sweeps, strict=False):
        assert (one.position, one.channel, one.x_m) == (other.position, other.channel, other.x_m)
        np.testing.assert_array_equal(one.block.samples, other.block.samples)
