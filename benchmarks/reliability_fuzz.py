"""A million random or mutated inputs to each parser: only typed errors, no hang, no growth of memory.

Inputs that cost more than a line of text are fewer by their cost (files, and those over real sockets or processes).
"""

from __future__ import annotations

import sys

from benchmarks.fuzz_targets import targets
from benchmarks.fuzzing import GROWTH_BYTES, Outcome, Target, campaign
from benchmarks.rows import Row

INPUTS = 1_000_000
QUICK_INPUTS = 5_000


def run(quick: bool) -> list[Row]:
    """Every target in turn."""
    rows = []
    with targets() as made:
        for target in made.values():
            rows.append(_row(target, campaign(target, inputs_for(target, quick=quick))))
            print(f"{rows[-1].name}: {rows[-1].target}", file=sys.stderr, flush=True)
    return rows


def inputs_for(target: Target, *, quick: bool) -> int:
    """How many inputs a target gets."""
    if target.cost <= 3:
        return QUICK_INPUTS if quick else INPUTS
    return max(round((QUICK_INPUTS if quick else INPUTS) / target.cost), 3)


def _row(target: Target, outcome: Outcome) -> Row:
    words = f"{outcome.inputs} inputs in {outcome.seconds:.0f} s, {outcome.refused} refused, slowest"
    words += f" {outcome.slowest_s * 1e3:.1f} ms, memory +{outcome.growth_bytes / 1e6:.1f} MB"
    words += f", objects +{outcome.traced_bytes} bytes"
    return Row(
        f"reliability.fuzz.{target.name}",
        "",
        outcome.growth_bytes / GROWTH_BYTES,
        outcome.ok,
        words,
        error=outcome.failure or None,
    )
