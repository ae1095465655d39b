"""20,000 damaged session files to ``recover``: cut, bits flipped, pages torn; only typed errors, no hang, no growth."""

from __future__ import annotations

import json
import os
import queue
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.kill_plugin import RATE_HZ, SHAPE, picture, samples
from benchmarks.rows import Row
from benchmarks.stands_radar import RIG
from drivers.records import AudioBlock, Channel, Frame, TrolleyFix
from polfuse_lab.records import Event, Exposure, Sweeps
from polfuse_lab.rig import Rig
from polfuse_lab.session import SessionConfig, SessionWriter

INPUTS, QUICK_INPUTS = 20_000, 300
WORKERS = 2
HANG_S = 8.0
"""A reader that takes longer is ended and counted as hung (``recover`` itself is more patient, and does the same)."""
GROWTH_BYTES = 32_000_000
PAGE = 4096


@dataclass
class Tally:
    """What came of all files."""

    answers: Counter[str] = field(default_factory=Counter)
    """``ok``, ``refused``, ``failed``; ``died`` and ``hung``: readers that ``recover`` would have ended."""
    failures: list[str] = field(default_factory=list)
    growth_bytes: int = 0
    slowest_s: float = 0.0
    seconds: float = 0.0


def damaged(chance: random.Random, seeds: tuple[bytes, ...]) -> bytes:
    """A session file that has been cut short, whose bits were flipped, or of which pages never reached the disk."""
    data = bytearray(chance.choice(seeds))
    match chance.randrange(6):
        case 0:
            del data[chance.randrange(len(data)) :]
        case 1 | 2:
            for _ in range(chance.choice((1, 1, 2, 8, 64))):
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        case 3:
            tail = chance.randrange(1, 16) * 512
            data[-tail:] = bytes(len(data[-tail:]))
        case 4:
            for _ in range(chance.choice((1, 2, 4))):
                start = chance.randrange(len(data) // PAGE + 1) * PAGE
                data[start : start + PAGE] = bytes(len(data[start : start + PAGE]))
        case _:
            # One page with another one's content.
            here, there = (chance.randrange(len(data) // PAGE) * PAGE for _ in range(2))
            data[here : here + PAGE] = data[there : there + PAGE]
    return bytes(data)


def run(quick: bool) -> list[Row]:
    """All files, shared among workers."""
    tally = campaign(QUICK_INPUTS if quick else INPUTS)
    total = sum(tally.answers.values())
    counts = ", ".join(f"{count} {kind}" for kind, count in sorted(tally.answers.items()))
    sound = not tally.failures and tally.growth_bytes <= GROWTH_BYTES
    words = f"{total} files in {tally.seconds:.0f} s: {counts}; slowest {tally.slowest_s:.2f} s,"
    words += f" memory +{tally.growth_bytes / 1e6:.1f} MB"
    return [
        Row(
            "reliability.recover",
            "",
            tally.growth_bytes / GROWTH_BYTES,
            sound,
            words,
            error="; ".join(tally.failures[:3]) or None,
        )
    ]


def campaign(inputs: int, *, seed: int = 1, workers: int = WORKERS) -> Tally:
    """Feed so many files; the same seed gives the same files."""
    tally, lock = Tally(), threading.Lock()
    began = time.monotonic()
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="polfuse-recover-", dir=memory) as name:
        folder = Path(name)
        seeds = _sessions(folder)
        threads = [
            threading.Thread(
                target=_feed, args=(tally, lock, folder, number, seeds, seed, range(number, inputs, workers))
            )
            for number in range(workers)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    tally.seconds = time.monotonic() - began
    return tally


def _sessions(folder: Path) -> tuple[bytes, bytes]:
    """A small session as it is left by a writer that is killed, and as it is closed."""
    waveform = Rig.model_validate(RIG).waveform
    writer = SessionWriter.create(
        folder / "seed.h5", SessionConfig("collect", waveform, RATE_HZ, audio_block_frames=2000, frame_shape=SHAPE)
    )
    for number in range(8):
        block = AudioBlock(samples(2000 * number, 2000), RATE_HZ, 2000 * number, 0.1 * number, number)
        writer.write(TrolleyFix(0.1 * number, 1e-3, False, number))
        writer.write(Sweeps(block, Channel(number % 4), number // 4))
        writer.write(Exposure(Frame(picture(number), number, 0.01, 0.0, 0.1 * number, number), 0.5))
        writer.write(Event("note", f"position {number}", number))
        writer.flush()
    killed = writer.partial.read_bytes()
    return killed, writer.close().read_bytes()


def _feed(
    tally: Tally, lock: threading.Lock, folder: Path, number: int, seeds: tuple[bytes, ...], seed: int, todo: range
) -> None:
    path = folder / f"{number}.h5.partial"
    left = iter(todo)
    warm_bytes = 0
    current: int | None = next(left, None)
    while current is not None:
        with _worker() as (process, answers):
            done = 0
            while current is not None:
                path.write_bytes(damaged(random.Random(f"{seed}/{current}"), seeds))
                began = time.monotonic()
                assert process.stdin is not None
                process.stdin.write(f"{path}\n")
                process.stdin.flush()
                try:
                    answer = answers.get(timeout=HANG_S)
                except queue.Empty:
                    kind, why, size = "hung", "", 0
                else:
                    kind, why, size = json.loads(answer) if answer else ("died", "", 0)
                done += 1
                with lock:
                    tally.answers[kind] += 1
                    tally.slowest_s = max(tally.slowest_s, time.monotonic() - began)
                    if kind == "failed":
                        tally.failures.append(f"file {current}: {why}")
                    if done == 200:
                        warm_bytes = size
                    elif done > 200 and size:
                        tally.growth_bytes = max(tally.growth_bytes, size - warm_bytes)
                current = next(left, None)
                if kind in ("hung", "died"):
                    break


@contextmanager
def _worker() -> Iterator[tuple[subprocess.Popen[str], queue.Queue[str]]]:
    root = Path(__file__).resolve().parent.parent
    command = [sys.executable, "-m", "benchmarks.recover_worker"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=root,
                               stderr=subprocess.DEVNULL)  # fmt: skip
    answers: queue.Queue[str] = queue.Queue()

    def read() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            answers.put(line)
        answers.put("")

    threading.Thread(target=read, daemon=True).start()
    try:
        yield process, answers
    finally:
        process.kill()
        process.wait(10)
