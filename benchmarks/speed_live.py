"""The live view at full rate: 192 kHz audio, four channels, 60 frames a second. How late, at what cost, what it skips.

A stand-in for the engine feeds the real live process through the real feed; the clients' view reads the rings. Delays
are from the arrival of the newest sample (or frame, or record) until a reader that looks every 5 ms has it. The cost is
the live process's own processor time: it does not depend on what else the computer does, while delays do.
"""

from __future__ import annotations

import contextlib
import math
import os
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row
from benchmarks.tape_card import tape
from drivers.records import AudioBlock, Channel, Frame, SwitchState
from polfuse_lab.live import LiveView
from polfuse_lab.live.feed import LiveFeed
from polfuse_lab.records import Exposure, Sweeps

RATE = 192_000
PERIOD_S = 0.04
FRAMES_PER_S = 60.0
ROWS, COLUMNS = 582, 782
LIMIT_S = 0.150
CORE_SHARE = 1.0
"""The live process may use one core at most."""
CHANNELS = (Channel.HH, Channel.HV, Channel.VV, Channel.VH)
RECORD_SWEEPS = 8
SETTLING_WORDS = 4
"""Words on the live process's health, one a second, until what came while it started has been dealt with."""

RIG = f"""
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = {PERIOD_S}
[geometry]
antenna_height_m = 1.069
[radar]
driver = "sounddevice"
sample_rate_hz = {RATE}
[switches]
driver = "dowkey_ms"
[trolley]
driver = "grbl"
length_m = 3.2
[camera]
driver = "scene"
width_px = {COLUMNS}
height_px = {ROWS}
exposure_s = 0.002
focal_length_m = 0.008
pixel_pitch_m = 8.3e-6
position_m = [0.0, 0.0, 0.3]
[polarizer]
driver = "ell14"
"""
PLAN = f"""
sweeps_per_channel = {RECORD_SWEEPS}
[optics]
frames_per_angle = 15
"""


class _Tape:
    """A radar that lets itself be overheard: the same second of a point's echo again and again, as time goes by."""

    def __init__(self) -> None:
        self._samples = tape(RATE, PERIOD_S)
        self._begun = time.monotonic_ns()

    def _at(self, first: int, frames: int) -> NDArray[np.int16]:
        return np.take(self._samples, np.arange(first, first + frames), axis=0, mode="wrap")

    def newest(self, frames: int) -> AudioBlock | None:
        """What has arrived by now, in blocks of 480 frames as a sound card delivers them."""
        now = time.monotonic_ns()
        written = int((now - self._begun) * RATE // 1_000_000_000) // 480 * 480
        frames = min(frames, written)
        if frames <= 0:
            return None
        first = written - frames
        arrived_ns = self._begun + math.ceil(written / RATE * 1e9)
        return AudioBlock(self._at(first, frames), RATE, first, first / RATE, arrived_ns - round(frames / RATE * 1e9))

    def record(self) -> AudioBlock:
        """The record that ends now."""
        frames = round((RECORD_SWEEPS + 1.5) * PERIOD_S * RATE)
        block = self.newest(frames)
        assert block is not None
        return block


def run(quick: bool) -> list[Row]:
    """Feed, read and measure; ``quick`` for 8 s instead of 60 s."""
    seconds = 8.0 if quick else 60.0
    with tempfile.TemporaryDirectory() as folder, full_rate(Path(folder)), LiveView(Path(folder)) as view:
        return _measure(view, seconds)


@contextlib.contextmanager
def full_rate(folder: Path) -> Iterator[None]:
    """A stand-in for an engine at full rate: the live process shows its streams in ``folder``."""
    feed = LiveFeed(RIG, "rig.toml", folder, PLAN, "plan.toml")
    feed.start()
    tape = _Tape()
    feed.overhear(tape)
    ended = threading.Event()
    threads = [
        threading.Thread(target=_camera, args=(feed, ended), daemon=True),
        threading.Thread(target=_records, args=(feed, tape, ended), daemon=True),
    ]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        for thread in threads:
            thread.join(2)
        feed.close()


def _measure(view: LiveView, seconds: float) -> list[Row]:
    until_shown(view)
    health = view.newest("health")
    assert health is not None
    before, begun = health.values, time.monotonic()
    delays: dict[str, list[float]] = {"levels": [], "profile": [], "camera": [], "optics": [], "sar": []}
    seen: dict[str, int] = {}
    while time.monotonic() - begun < seconds:
        for stream in view.streams():
            kind = stream.partition(".")[0]
            if kind not in delays:
                continue
            item = view.newest(stream, after=seen.get(stream, 0))
            if item is not None:
                seen[stream] = item.number
                delays[kind].append((time.monotonic_ns() - item.t_sample_ns) * 1e-9)
        time.sleep(0.005)
    # The next word on its health is a second away at most.
    number = health.number
    _until(lambda: (item := view.newest("health")) is not None and item.number > number + 1, 10.0)
    health = view.newest("health")
    assert health is not None
    return [*(_delay_row(kind, values) for kind, values in delays.items()), *_cost_rows(before, health.values)]


def until_shown(view: LiveView) -> None:
    """Wait until everything has been shown once, programs and compiled code are loaded, and nothing waits of before."""
    wanted = ("levels", "profile.HH", "camera.000.0", "optics", "sar", "health")
    _until(lambda: all(view.newest(name) is not None for name in wanted), 120.0)
    health = view.newest("health")
    assert health is not None
    number = health.number + SETTLING_WORDS
    _until(lambda: (item := view.newest("health")) is not None and item.number >= number, 30.0)


def _camera(feed: LiveFeed, ended: threading.Event) -> None:
    rng = np.random.default_rng(2)
    angles = [math.radians(angle) for angle in (0.0, 45.0, 90.0, 135.0)]
    images = [rng.integers(500, 3000, (ROWS, COLUMNS)).astype(np.uint16) for _ in angles]
    due, number = time.monotonic(), 0
    while not ended.wait(max(due - time.monotonic(), 0.0)):
        due += 1 / FRAMES_PER_S
        which = number // 15 % 4
        number += 1
        frame = Frame(images[which], number, 0.002, 0.0, 0.0, time.monotonic_ns())
        feed.offer(Exposure(frame, angles[which]))


def _records(feed: LiveFeed, tape: _Tape, ended: threading.Event) -> None:
    """Channel after channel, position after position, as a collect goes."""
    number = 0
    length_s = (RECORD_SWEEPS + 1.5) * PERIOD_S
    while True:
        channel = CHANNELS[number % 4]
        feed.offer(SwitchState(channel.transmit, channel.receive, True, time.monotonic_ns()))
        if ended.wait(length_s):
            return
        position = number // 4 % 61
        x_m = (position - 30) * 0.0508
        # As if every pass were a new one: a position that is in the image is not added again.
        feed.offer(Sweeps(tape.record(), channel, number // 4, x_m, 0.001, RECORD_SWEEPS))
        number += 1


def _until(condition: Any, seconds: float) -> None:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("the live process shows nothing")
        time.sleep(0.02)


def _delay_row(kind: str, delays: list[float]) -> Row:
    low, median, high = (float(np.percentile(delays, percent)) for percent in (1, 50, 99))
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    return Row(
        name=f"speed.live: delay of {kind}, {1e3 * median:.0f} ms median, {1e3 * high:.0f} ms 99 % of {len(delays)} "
        f"(load {load:.1f})",
        peer="the limit of 150 ms",
        ratio=median / LIMIT_S,
        ratio_min=low / LIMIT_S,
        ratio_max=high / LIMIT_S,
        target="newest data shown within 150 ms",
        ok=median <= LIMIT_S,
    )


def _cost_rows(before: Any, after: Any) -> list[Row]:
    wall = after["uptime_s"] - before["uptime_s"]
    share = (after["cpu_seconds"] - before["cpu_seconds"]) / wall
    names = ("skipped_audio_s", "skipped_records", "skipped_frames", "dropped")
    skipped = {name: after[name] - before[name] for name in names}
    told = ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in skipped.items())
    return [
        Row(
            name="speed.live: processor time of the live process per second",
            peer="one core",
            ratio=share / CORE_SHARE,
            target="below one core at 192 kHz, 4 channels, 60 frames a second",
            ok=share <= CORE_SHARE,
        ),
        Row(
            name=f"speed.live: skipped in {wall:.0f} s ({told})",
            peer="",
            ratio=None,
            error=float(skipped["skipped_audio_s"]) / wall,
            target="what cannot be kept up with is counted",
            ok=after["restarts"] == 0,
        ),
    ]
