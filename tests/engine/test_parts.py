"""The parts around the scheduler: dry run, live view, prompts, lanes, and what the engine does with bad messages."""

from __future__ import annotations

import threading
import time

import fake_devices
import msgspec
import numpy as np
import pytest
import zmq
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.records import AudioBlock, Channel
from polfuse_lab.engine import protocol, running_engines
from polfuse_lab.engine.directory import address
from polfuse_lab.live import QUEUE, LivePipeline
from polfuse_lab.plans import load_plan
from polfuse_lab.plans.dry_run import dry_run, record_frames
from polfuse_lab.plans.steps import MoveTo, RecordSweeps
from polfuse_lab.records import Sweeps
from polfuse_lab.rig import load_rig
from polfuse_lab.scheduler.lane import Lane
from polfuse_lab.scheduler.prompts import Prompts


def block(number: int, samples=None) -> Sweeps:
    samples = fake_devices.audio(6000) if samples is None else samples
    return Sweeps(AudioBlock(samples, 48_000.0, 0, 0.0, 0), Channel.HH, number)


def test_dry_run_counts_time_and_bytes(bench):
    bench.write(optics=True, settle=0.5)
    outcome = dry_run(load_rig(bench.rig), load_plan(bench.plan))
    # 3 x (move, settle, 2 x (switch, record), checkpoint), 4 x (turn, expose), and the first turn begun early.
    assert len(outcome.steps) == 3 * 7 + 8 + 1
    # 1 sweep: 2 periods of 40 ms at 48 kHz, 6 % more, and 64 samples for the edges: 4071 + 64 frames of 4 bytes.
    assert record_frames(load_rig(bench.rig), 1, 48_000.0) == 4135
    audio, images = 6 * 4135 * 4, 8 * 8 * 6 * 2
    assert audio + images < outcome.bytes < audio + images + 600_000
    # Moves of 0.5 + 0.5 + 0.5 m at 0.1 m/s, settling 3 x 0.5 s, 6 records of 86 ms, besides the exchanges.
    assert 15 + 1.5 + 6 * 0.086 < outcome.seconds < 15 + 1.5 + 6 * 0.086 + 6
    assert (outcome.limits_ok, outcome.problems) == (True, ())


def test_dry_run_of_the_thesis_rail(bench):
    bench.write()
    bench.plan.write_text("")
    outcome = dry_run(load_rig(bench.rig), load_plan(bench.plan))
    moves = [step for step in outcome.steps if isinstance(step, MoveTo)]
    # 10 ft in steps of 2 in: 61 positions from -1.524 m to +1.524 m, 4 channels at each.
    assert (len(moves), moves[0].x_m, moves[-1].x_m) == (61, pytest.approx(-1.524), pytest.approx(1.524))
    assert sum(isinstance(step, RecordSweeps) for step in outcome.steps) == 244


def test_dry_run_tells_what_cannot_be_done(bench):
    bench.write(aperture=4.0)
    bench.plan.write_text(bench.plan.read_text() + "[optics]\n")
    outcome = dry_run(load_rig(bench.rig), load_plan(bench.plan))
    assert not outcome.limits_ok
    assert len(outcome.problems) == 2
    assert "2 positions are beyond the rail's -1.6 .. 1.6 m" in outcome.problems[0]
    assert "no camera" in outcome.problems[1]


def test_live_view_never_makes_its_source_wait_and_shows_the_newest(bench, monkeypatch):
    bench.write()
    live = LivePipeline(load_rig(bench.rig))
    gate, entered, seen = threading.Event(), threading.Event(), []

    def slow(record):
        seen.append(record.position)
        entered.set()
        gate.wait(20)

    monkeypatch.setattr(live, "_compress", slow)
    live.offer(block(0))
    assert entered.wait(10)
    for number in range(1, 100):
        live.offer(block(number))
    gate.set()
    end = time.monotonic() + 10
    while len(seen) < 1 + QUEUE and time.monotonic() < end:
        time.sleep(0.01)
    live.close()
    assert seen == [0, *range(100 - QUEUE, 100)]


def test_a_record_without_sync_is_fatal_only_at_the_beginning(bench):
    bench.write()
    silent = np.zeros((6000, 2), np.int16)
    live = LivePipeline(load_rig(bench.rig))
    try:
        live._look(block(0))
        live._look(block(1, silent))
        assert live.fatal is None
        assert live.preview is not None
        assert live.warnings == ("no range profile at position 1, HH: both channels are silent",)
    finally:
        live.close()
    other = LivePipeline(load_rig(bench.rig))
    other._look(block(0, silent))
    other.close()
    assert other.fatal is not None


def test_prompts_are_answered_once():
    prompts = Prompts()
    first, second = prompts.ask("one"), prompts.ask("two")
    assert prompts.open() == [(first, "one"), (second, "two")]
    assert (prompts.answer(first), prompts.answer(first), prompts.answer(99)) == (True, False, False)
    assert (prompts.answered(first), prompts.answered(second)) == (True, False)
    prompts.withdraw(second)
    assert prompts.open() == []


def test_a_lane_keeps_the_order_and_passes_exceptions_on():
    lane, order = Lane("test"), []
    futures = [lane.submit(order.append, number) for number in range(100)]
    failing = lane.submit(int, "x")
    for future in futures:
        future.result(5)
    assert order == list(range(100))
    with pytest.raises(ValueError, match="invalid literal"):
        failing.result(5)
    assert not lane.busy
    lane.end()
    assert lane.join(5)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=200))
def test_bytes_from_anywhere_are_a_message_or_refused(content):
    for decode in (protocol.decode_client, protocol.decode_engine):
        try:
            decode(content)
        except msgspec.MsgspecError:
            continue


def test_strangers_and_garbage_do_not_disturb_the_engine(bench):
    bench.write(settle=30.0)
    with bench.start() as client:
        (directory,) = running_engines()
        known = address(directory)
        assert known is not None
        context = zmq.Context()
        stranger = context.socket(zmq.DEALER)
        stranger.setsockopt(zmq.LINGER, 0)
        stranger.connect(known.endpoint)

        def ask(content: bytes) -> object:
            stranger.send(content)
            assert stranger.poll(5000)
            return protocol.decode_engine(stranger.recv())

        try:
            assert "not understood" in ask(b"\xff garbage").reason
            assert ask(protocol.encode(protocol.Abort())).reason == "attach first"
            assert ask(protocol.encode(protocol.Attach(99, "x"))).reason == "the engine speaks protocol 1, not 99"
            assert ask(protocol.encode(protocol.Attach(1, "guess"))).reason == "wrong token"
        finally:
            stranger.close()
            context.term()
        assert client.poll(1.0).state in ("preparing", "running")
        client.abort()
        assert client.wait().state == "aborted"
