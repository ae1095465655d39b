"""The soak in small: everything that a collect delivers is read back, and what is missing or wrong is found.

Expected contents are the counters themselves; slopes are those that the samples were made with.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks import counting_rig
from benchmarks.counting_rig import CountingCamera, CountingRadar
from benchmarks.memory_watch import MemoryWatch, Sample, trend
from benchmarks.soak_accelerated import soak


@pytest.fixture
def short_records(monkeypatch):
    """About a tenth of a second of audio in each record."""
    monkeypatch.setattr(counting_rig, "SWEEPS", 2)


def run(folder, seconds: float = 0.4, **options):
    with MemoryWatch(0.1) as watch:
        return soak(folder, simulated_s=seconds, positions=1, watch=watch, **options)


@pytest.mark.usefixtures("short_records")
def test_everything_is_accounted_for_and_an_interrupted_soak_goes_on(tmp_path):
    state = tmp_path / "state.json"
    first = run(tmp_path, state=state)
    assert first.sound, first.problems
    # Four channels of 3 periods of 40 ms, 6 % and 64 frames more, at 192 kHz; 60 frames a second, in four angles.
    assert first.samples == 4 * (24_423 + 64)
    assert first.frames == 4 * round(60 * first.samples / 192_000 / 4)
    second = run(tmp_path, seconds=1.0, state=state)
    assert second.sound
    assert (second.sessions, second.samples) == (2, 2 * first.samples)
    assert [path.name for path in tmp_path.iterdir()] == ["state.json"]


@pytest.mark.usefixtures("short_records")
def test_a_frame_that_never_came_is_missed(tmp_path, monkeypatch):
    poll = CountingCamera.poll

    def skipping(self):
        self.next += self.next == 5
        return poll(self)

    monkeypatch.setattr(CountingCamera, "poll", skipping)
    found = run(tmp_path)
    assert not found.sound
    assert found.problems == ["frame 5 is number 6 where 5 was expected"]


@pytest.mark.usefixtures("short_records")
def test_one_wrong_sample_is_seen(tmp_path, monkeypatch):
    poll = CountingRadar.poll

    def wrong(self):
        block = poll(self)
        if block.first_frame == 0 and len(block.samples) > counting_rig.PROBE_FRAMES:
            samples = block.samples.copy()
            samples[1000, 1] += 1
            return dataclasses.replace(block, samples=samples)
        return block

    monkeypatch.setattr(CountingRadar, "poll", wrong)
    assert run(tmp_path).problems == ["audio record 0 does not hold the numbers from 0"]


def made(slope: float, noise: float, runs: int = 3) -> list[Sample]:
    rng = np.random.default_rng(7)
    return [
        Sample("writer", run, float(t), round(1e8 + run * 5e6 + slope * t + noise * rng.normal()))
        for run in range(runs)
        for t in range(600)
    ]


def test_growth_is_told_from_levels_that_differ():
    found = trend(made(slope=1000.0, noise=2e4), "writer", skip_s=10, block_s=10)
    assert found is not None
    # Twice the 95 % interval is four standard deviations.
    assert abs(found.slope - 1000.0) < 2 * found.half_width
    assert found.significant


def test_no_growth_is_told_to_be_none():
    found = trend(made(slope=0.0, noise=2e4), "writer", skip_s=10, block_s=10)
    assert found is not None
    # Medians of 10 samples: 2e4 * 1.25 / sqrt(10) about a line over 590 s in 3 x 59 blocks, t of 1.97.
    assert found.half_width == pytest.approx(1.97 * 2e4 * 1.25 / np.sqrt(10) / np.sqrt(177 * 590**2 / 12), rel=0.2)
    assert abs(found.slope) < 3 * found.half_width


def test_too_short_a_time_tells_nothing():
    assert trend(made(slope=0.0, noise=1.0, runs=1)[:15], "writer", skip_s=10, block_s=10) is None
