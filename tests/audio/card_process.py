"""A simulated sound card in a process of its own, as ``polfuse sim`` has it: its threads do not delay the driver's."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PROGRAM = """
import json, sys
from counter_source import CounterSource
from hw_mocks.sound_card import PulseSource, SoundCard

source = CounterSource(float(sys.argv[1]), clock_drift_ppm=float(sys.argv[2]))
pulse = PulseSource(source.audio.sample_rate_hz)
card = SoundCard(source, [pulse])
card.start()
print(json.dumps({"pid": pulse.pid, "device": pulse.device, "environment": pulse.environment}), flush=True)
sys.stdin.read()
card.close()
assert card.failure is None
"""


@contextmanager
def card_process(rate_hz: float = 48_000.0, *, drift_ppm: float = 0.0) -> Iterator[dict[str, object]]:
    """Runs the card; gives its server's ``pid``, its ``device`` and ``environment``."""
    here = Path(__file__).parent
    path = f"import sys; sys.path[:0] = {[str(here), str(here.parents[1])]!r}\n"
    process = subprocess.Popen(
        [sys.executable, "-c", path + PROGRAM, str(rate_hz), str(drift_ppm)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield json.loads(process.stdout.readline())
    finally:
        process.stdin.close()
        code = process.wait(timeout=20)
        process.stdout.close()
    assert code == 0
