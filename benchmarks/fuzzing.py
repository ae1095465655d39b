"""Random and mutated inputs: how they are made, and what they must not do to a parser."""

from __future__ import annotations

import faulthandler
import gc
import random
import sys
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HANG_S = 120.0
"""A parser that does not return for so long ends the campaign with a traceback."""
SLOW_S = 1.0
"""No single input may take longer."""
GROWTH_BYTES = 16_000_000
"""The process may grow by so much after its warm-up (allocators keep pages)."""
TRACED_BYTES = 200_000
"""Python objects may grow by so much over :data:`TRACED_INPUTS` inputs (the standard library's caches hold some)."""
TRACED_INPUTS = 5_000
LONGEST = 1024

_NUMBERS = (b"0", b"-1", b"255", b"256", b"65536", b"4294967296", b"99999999999999999999", b"1e400", b"nan", b"-inf")
_PIECES = (*_NUMBERS, b"", b"\r", b"\n", b"\0", b"\xff", b"\x80", b":", b",", b"|", b"<", b">", b"[", b"]", b'"', b"=")


@dataclass(frozen=True)
class Target:
    """A parser under test."""

    name: str
    feed: Callable[[bytes], None]
    """Takes one input; may raise ``allowed`` and nothing else."""
    seeds: tuple[bytes, ...]
    """Valid inputs, from which mutations are made."""
    allowed: tuple[type[Exception], ...]
    cost: float = 1.0
    """Roughly how much dearer than a line of text an input is; that much fewer are tried."""


@dataclass(frozen=True)
class Outcome:
    """What a campaign against one target found."""

    inputs: int
    seconds: float
    refused: int
    """Inputs that were answered with an allowed error."""
    slowest_s: float
    growth_bytes: int
    traced_bytes: int
    failure: str
    """The first other error, and its input; empty when there was none."""

    @property
    def ok(self) -> bool:
        """Whether the parser kept all promises."""
        grown = self.growth_bytes > GROWTH_BYTES or self.traced_bytes > TRACED_BYTES
        return not self.failure and self.slowest_s <= SLOW_S and not grown


def mutated(chance: random.Random, seeds: tuple[bytes, ...]) -> bytes:
    """One input: now and then wholly random, mostly a seed with a few changes; at most :data:`LONGEST` bytes more."""
    if chance.random() < 0.1:
        return chance.randbytes(chance.choice((0, 1, 2, 8, 40, 200)))
    data = bytearray(chance.choice(seeds))
    for _ in range(chance.choice((1, 1, 1, 2, 3, 8))):
        at = chance.randrange(len(data) + 1)
        match chance.randrange(7):
            case 0 if at < len(data):
                data[at] ^= 1 << chance.randrange(8)
            case 1 if at < len(data):
                data[at] = chance.randrange(256)
            case 2:
                del data[at : at + chance.choice((1, 1, 2, 8, 64))]
            case 3:
                data[at:at] = chance.choice(_PIECES)
            case 4:
                data[at : at + chance.randrange(1, 12)] = chance.choice(_NUMBERS)
            case 5:
                other = chance.choice(seeds)
                data[at:] = other[chance.randrange(len(other) + 1) :]
            case _:
                piece = bytes(data[at : at + chance.randrange(1, 20)])
                data[at:at] = piece * chance.choice((1, 1, 2, 50, 1000))
    return bytes(data[: max(map(len, seeds)) + LONGEST])


def campaign(target: Target, inputs: int, *, seed: int = 1) -> Outcome:
    """Feed a target and watch it; the same seed gives the same inputs."""
    chance = random.Random(seed)
    refused, slowest_s, failure = 0, 0.0, ""
    warm, grown_from = max(inputs // 5, 1), 0
    began = time.perf_counter()
    done = 0
    while done < inputs and not failure:
        if done % 1000 == 0 and hasattr(sys.stderr, "fileno"):
            faulthandler.dump_traceback_later(HANG_S, exit=True)
        if done == warm:
            grown_from = _resident_bytes()
        data = mutated(chance, target.seeds)
        start = time.perf_counter()
        try:
            target.feed(data)
        except target.allowed:
            refused += 1
        except Exception as error:
            failure = f"{type(error).__name__}: {error} for {data[:200]!r}"
        slowest_s = max(slowest_s, time.perf_counter() - start)
        done += 1
    faulthandler.cancel_dump_traceback_later()
    seconds = time.perf_counter() - began
    growth = max(_resident_bytes() - grown_from, 0) if grown_from else 0
    traced = 0 if failure else _traced_growth(target, chance, min(TRACED_INPUTS, max(inputs // 5, 1)))
    return Outcome(done, seconds, refused, slowest_s, growth, traced, failure)


def _traced_growth(target: Target, chance: random.Random, inputs: int) -> int:
    """Bytes of Python objects that are left over by so many inputs."""
    tracemalloc.start()
    try:
        before = 0
        for number in range(inputs):
            if number == inputs // 5:
                gc.collect()
                before = tracemalloc.get_traced_memory()[0]
            try:
                target.feed(mutated(chance, target.seeds))
            except target.allowed:
                continue
        gc.collect()
        return max(tracemalloc.get_traced_memory()[0] - before, 0)
    finally:
        tracemalloc.stop()


def _resident_bytes() -> int:
    """Memory that the process occupies; 0 where the system does not tell."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * resource.getpagesize()
    except (ImportError, OSError):
        return 0
