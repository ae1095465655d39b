"""Random and mutated inputs into every parser, in short; ``python -m benchmarks reliability.fuzz`` is the long run."""

from __future__ import annotations

import contextlib
import random
import time
from collections.abc import Iterator

import pytest

from benchmarks.fuzz_targets import targets
from benchmarks.fuzzing import LONGEST, TRACED_BYTES, Target, campaign, mutated

# Fixed here so that a parser that loses its target is missed.
NAMES = (
    "GRBL status",
    "Elliptec messages",
    "encoder lines",
    "Dow-Key MS driver",
    "Numato relay driver",
    "GRBL driver",
    "ELL14 driver",
    "serial line",
    "Mini-Circuits driver (HTTP)",
    "GVCP",
    "audio stream blocks",
    "loopback addresses",
    "engine: client's messages",
    "engine: engine's messages",
    "fault scripts",
    "WAV file",
    "rig file",
    "scene file",
    "scene file of bodies",
    "plan file",
    "MATLAB file",
    "session file (read)",
    "session file (recover)",
)


@pytest.fixture(scope="module")
def made() -> Iterator[dict[str, Target]]:
    with targets() as found:
        yield found


def test_every_parser_has_a_target(made: dict[str, Target]) -> None:
    assert tuple(made) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_valid_input_is_accepted(name: str, made: dict[str, Target]) -> None:
    # Otherwise mutations would only ever reach the first check.
    made[name].feed(made[name].seeds[0])


@pytest.mark.parametrize("name", NAMES)
def test_only_typed_errors_no_hang_no_growth(name: str, made: dict[str, Target]) -> None:
    target = made[name]
    outcome = campaign(target, max(round(2000 / target.cost), 2), seed=7)
    assert outcome.ok, outcome


def test_what_campaigns_have_found_stays_mended(made: dict[str, Target]) -> None:
    found = {
        "GRBL status": (b"error:9\x1e",),  # a separator that strip() takes for a space and int() does not
        "engine: client's messages": (b"\x81\xa4type\xa4Pke\x81", b"\x81\xa1x" + b"\x91" * 5000),
        "engine: engine's messages": (b"\x81\xa4type\xa4Pke\x81",),
        "audio stream blocks": (b"\xff" * 20,),  # a block of 4 billion frames
    }
    for name, inputs in found.items():
        for data in inputs:
            with contextlib.suppress(*made[name].allowed):
                made[name].feed(data)


def test_a_campaign_is_the_same_every_time_and_reaches_every_kind_of_change() -> None:
    seeds = (b"<Idle|MPos:0.000>", b"$110=30000.000")
    one, other = ([mutated(chance, seeds) for _ in range(2000)] for chance in (random.Random(3), random.Random(3)))
    assert one == other
    assert len(set(one)) > 1500
    assert max(map(len, one)) <= max(map(len, seeds)) + LONGEST
    assert any(b"nan" in data for data in one)
    assert any(b"MPos" in data and b"30000" in data for data in one)  # two seeds spliced


def bad(feed: object) -> Target:
    return Target("bad", feed, (b"seed",), (ValueError,))  # type: ignore[arg-type]


def test_a_campaign_finds_an_untyped_error_and_tells_its_input() -> None:
    def feed(data: bytes) -> None:
        if b"\xff" in data:
            raise KeyError("surprise")

    outcome = campaign(bad(feed), 5000)
    assert not outcome.ok
    assert "KeyError: 'surprise' for b'" in outcome.failure
    assert outcome.inputs < 5000


def test_a_campaign_counts_typed_errors() -> None:
    def feed(data: bytes) -> None:
        raise ValueError

    outcome = campaign(bad(feed), 300)
    assert outcome.ok
    assert outcome.refused == 300


def test_a_campaign_finds_a_slow_input() -> None:
    calls = 0

    def feed(data: bytes) -> None:
        nonlocal calls
        calls += 1
        if calls == 100:
            time.sleep(1.1)

    assert not campaign(bad(feed), 200).ok


def test_a_campaign_finds_growth() -> None:
    kept: list[bytes] = []
    outcome = campaign(bad(lambda data: kept.append(bytes(1000))), 5000)
    assert outcome.traced_bytes > TRACED_BYTES
    assert not outcome.ok
