"""Any order of events at any moment of any plan: thousands of random runs, and each event at each moment alone.

``--quick`` does a few of each; the full campaign takes about an hour of one core.
"""

from __future__ import annotations

import re
import time
from collections import Counter

from benchmarks.rows import Row

EXAMPLES, QUICK_EXAMPLES = 5_000, 20
EVERY, QUICK_EVERY = 1, 400
SEED = 20_261_122


def run(quick: bool) -> list[Row]:
    """Random interleavings, then every moment."""
    try:
        import hypothesis  # noqa: F401
    except ImportError:
        return [Row("reliability.interleavings", "", None, True, "skipped: hypothesis is not installed")]
    return [_random(QUICK_EXAMPLES if quick else EXAMPLES), *every_moment(QUICK_EVERY if quick else EVERY)]


def _random(examples: int) -> Row:
    from hypothesis import HealthCheck, Phase, seed, settings
    from hypothesis.stateful import run_state_machine_as_test

    from benchmarks import interleavings

    interleavings.seen.clear()
    chosen = settings(
        max_examples=examples,
        stateful_step_count=25,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    began = time.monotonic()
    failure = None
    try:
        run_state_machine_as_test(seed(SEED)(interleavings.Interleavings), settings=chosen)
    except interleavings.Violated as error:
        failure = str(error)
    pairs = {(step, action) for _, step, action in interleavings.seen}
    words = (
        f"{examples} runs in {time.monotonic() - began:.0f} s, {sum(interleavings.seen.values())} events,"
        f" {len(interleavings.seen)} combinations of plan, step and event ({len(pairs)} of step and event)"
    )
    return Row("reliability.interleavings.random", "", None, failure is None, words, error=failure)


def every_moment(every: int) -> list[Row]:
    """One row for each event: done at every ``every``-th moment of every plan."""
    from benchmarks.every_moment import ACTIONS, sweep
    from benchmarks.interleaving_plans import PLANS

    rows = []
    for number, action in enumerate(ACTIONS):
        began, done, steps = time.monotonic(), 0, set[str]()
        found: Counter[str] = Counter()
        for plan in PLANS:
            for moment, step, wrong in sweep(plan, action, first=number % every, every=every):
                done += 1
                steps.add(step)
                # Numbers differ from moment to moment: one line for each kind of trouble.
                found.update(f"{plan}, {step}, e.g. moment {moment}: {re.sub(r'[0-9]+', '#', text)}" for text in wrong)
        words = f"{done} moments in {len(steps)} kinds of step, {time.monotonic() - began:.0f} s"
        error = "; ".join(text for text, _ in found.most_common(3)) or None
        rows.append(
            Row(f"reliability.interleavings.{action.replace(' ', '_')}", "", None, not found, words, error=error)
        )
    return rows
