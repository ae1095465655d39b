"""Repaints of the window without a crash, hours of live view, and flat memory in both.

``python -m benchmarks.reliability_gui`` for all of it, or with ``--repaints N --hours H`` for other amounts (0: none).
Every page's pictures are given new values and painted anew, over and over, in a process of its own: a crash of the
interpreter (as some versions of Qt had it after many repaints) is seen by its exit status. The live view is shown
collect after collect, as fast as it can draw (:mod:`benchmarks.gui_live_soak`).
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from typing import Any

import numpy as np

from benchmarks.memory_watch import Sample, resident_bytes, trend
from benchmarks.rows import Row

USUAL, QUICK = 100_000, 1_000
GROWTH_BYTES = 50.0
"""Most memory that one repaint may leave behind, on average over the second half: 5 MB in 100,000."""
SAMPLE_EVERY = 20
"""Repaints from one look at the memory to the next."""
MIDDLE, END = (0.5, 0.6), (0.9, 1.0)
"""Parts of the run whose median sizes are compared: a single look may come amid a picture that is being made."""
HOURS, POSITIONS = 8.0, 61
QUICK_HOURS, QUICK_POSITIONS = 0.2, 4
LIVE_GROWTH_BYTES = 16e6
"""Most that the window's process may grow while the live view is watched after its first eighth, as in other soaks."""
WARMING = 0.125
SLOWEST = 15.0
"""How many times as fast as the collects the live view goes at least; what takes longer hangs."""


def run(quick: bool) -> list[Row]:
    """1,000 repaints and twelve minutes of live view, or 100,000 and eight hours."""
    if quick:
        return [soak(QUICK), live(QUICK_HOURS, QUICK_POSITIONS)]
    return [soak(USUAL), live(HOURS, POSITIONS)]


def soak(repaints: int) -> Row:
    """So many repaints in a process of its own."""
    python = platform.python_version()
    command = ["benchmarks.reliability_gui", "--work", str(repaints)]
    found = _child(command, 120 + 0.5 * repaints)
    if isinstance(found, str):
        return Row(f"reliability.gui: repaints on Python {python}", "", None, False, "no crash", error=found)
    sizes = np.array(found["bytes"], dtype=np.float64)
    middle, end = (float(np.median(sizes[int(a * len(sizes)) : int(b * len(sizes))])) for a, b in (MIDDLE, END))
    growth = (end - middle) / (repaints * (END[0] - MIDDLE[0]))
    # A few pages more or less are no leak; over many repaints they are nothing.
    allowed = max(GROWTH_BYTES, 4e6 / repaints)
    return Row(
        f"reliability.gui: {found['painted']} repaints on Python {python}, PySide {found['pyside']}, "
        f"{growth:+.0f} bytes each in the second half, {sizes.max() / 1e6:.0f} MB at most",
        f"{allowed:.0f} bytes a repaint",
        growth / allowed,
        found["painted"] >= repaints and growth <= allowed,
        "no crash, flat memory",
    )


def live(hours: float, positions: int) -> Row:
    """The live view of so many hours, in collects of so many positions, in a process of its own.

    The line through the resident memory is fitted to medians of five collects each, one of every tab, so that a tab
    that takes more memory than another is no slope.
    """
    target = "no crash, flat memory"
    name = f"reliability.gui: {hours:g} h of live view"
    found = _child(["benchmarks.gui_live_soak", str(hours), str(positions)], 120 + 3600 * hours / SLOWEST)
    if isinstance(found, str):
        return Row(name, "", None, False, target, error=found)
    samples = [Sample("window", 0, age_s, size) for age_s, size in found["samples"]]
    grown = trend(samples, "window", skip_s=WARMING * 3600 * found["hours"], block_s=found["round_s"])
    if grown is None:
        return Row(name, "", None, False, target, error="too short for a line through its memory")
    drawn = found["paints"] >= found["records"] / 4  # each position is seen on every tab, at least once
    sizes = f"{grown.growth_bytes / 1e6:+.1f} +- {grown.half_width * grown.seconds / 1e6:.1f} MB"
    return Row(
        f"reliability.gui: {found['hours']:.2f} h of live view in {found['seconds']:.0f} s ({found['collects']} "
        f"collects, {found['records']} records, {found['paints']} paints), {sizes} after the first eighth, "
        f"{grown.largest / 1e6:.0f} MB at most",
        f"{LIVE_GROWTH_BYTES / 1e6:.0f} MB",
        grown.growth_bytes / LIVE_GROWTH_BYTES,
        found["hours"] >= hours and drawn and grown.growth_bytes <= LIVE_GROWTH_BYTES,
        target,
    )


def _child(command: list[str], longest_s: float) -> dict[str, Any] | str:
    """What a process of a new user has measured, or what went wrong."""
    with tempfile.TemporaryDirectory() as scratch:
        environment = {**os.environ, "POLFUSE_USER_DATA": scratch, "QT_QPA_PLATFORM": "offscreen"}
        try:
            done = subprocess.run(
                [sys.executable, "-m", *command], capture_output=True, text=True, timeout=longest_s, env=environment,
                check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired as error:
            return f"no end within {error.timeout:g} s"
    if done.returncode != 0:
        words = (done.stderr.strip().splitlines() or ["no word"])[-1]
        return f"exit status {done.returncode}: {words}"
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def work(repaints: int) -> None:
    """Repaint, and tell how memory went."""
    import itertools

    import PySide6

    from gui.app import make_application
    from gui.main_window import MainWindow
    from gui.pages.live_page import LivePage
    from gui.widgets.picture_view import demo_image
    from gui.widgets.profile_view import demo_profile

    application = make_application()
    window = MainWindow()
    page = window.page("live")
    assert isinstance(page, LivePage)
    window.show()
    level, x, y = demo_image(81)
    colours = np.zeros((81, 81, 3), np.uint8)
    profiles = [demo_profile(seed) for seed in range(1, 9)]
    painted = 0
    sizes: list[int] = []
    for number in itertools.count():
        if painted >= repaints:
            break
        if painted % SAMPLE_EVERY == 0:
            sizes.append(resident_bytes(os.getpid()) or 0)
        if number % 50 == 0:
            window.show_page(window.names[number // 50 % len(window.names)] if number % 100 else "live")
            page.tabs.setCurrentIndex(number // 100 % page.tabs.count())
        profile = profiles[number % len(profiles)]
        page.profile.show_profile("HH", 0.47, profile)
        page.waterfall.add(0.47, profile)
        page.waterfall.refresh()
        for view in (*page.sar.values(), page.doppler, page.frame, *page.optics.values()):
            view.show_values(np.roll(level, number, axis=0), x, y)
        colours[number % 81] = number % 256
        page.pauli.show_colours(colours, x, y)
        page.fused.show_colours(colours, x, y)
        page.beat.show_level(0.1, 0.05)
        window.repaint()
        application.processEvents()
        painted += 1
    window.close()
    print(json.dumps({"painted": painted, "bytes": sizes, "pyside": PySide6.__version__}))


def main() -> int:
    """From the command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reliability_gui", description=__doc__)
    parser.add_argument("--repaints", type=int, default=USUAL)
    parser.add_argument("--hours", type=float, default=HOURS)
    parser.add_argument("--work", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work is not None:
        work(given.work)
        return 0
    rows = [soak(given.repaints)] if given.repaints else []
    rows += [live(given.hours, POSITIONS)] if given.hours else []
    for row in rows:
        print(("ok   " if row.ok else "FAIL ") + row.name + (f": {row.error}" if row.error else ""))
    return 0 if all(row.ok for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
