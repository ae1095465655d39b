"""Repaints of the window without a crash, and with flat memory: ``python -m benchmarks.reliability_gui --repaints N``.

Every page's pictures are given new values and painted anew, over and over, in a process of its own: a crash of the
interpreter (as some versions of Qt had it after many repaints) is seen by its exit status.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile

from benchmarks.memory_watch import resident_bytes
from benchmarks.rows import Row

USUAL, QUICK = 100_000, 1_000
GROWTH_BYTES = 50.0
"""Most memory that one repaint may leave behind, on average over the second half: 5 MB in 100,000."""
SETTLING = 0.5


def run(quick: bool) -> list[Row]:
    """1,000 repaints, or 100,000."""
    return [soak(QUICK if quick else USUAL)]


def soak(repaints: int) -> Row:
    """So many repaints in a process of its own."""
    python = platform.python_version()
    with tempfile.TemporaryDirectory() as scratch:
        environment = {**os.environ, "POLFUSE_USER_DATA": scratch, "QT_QPA_PLATFORM": "offscreen"}
        try:
            done = subprocess.run(
                [sys.executable, "-m", "benchmarks.reliability_gui", "--work", str(repaints)],
                capture_output=True, text=True, timeout=120 + 0.5 * repaints, env=environment, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired as error:
            told = f"no end within {error.timeout:g} s"
            return Row(f"reliability.gui: repaints on Python {python}", "", None, False, "no crash", error=told)
    if done.returncode != 0:
        words = (done.stderr.strip().splitlines() or ["no word"])[-1]
        told = f"exit status {done.returncode}: {words}"
        return Row(f"reliability.gui: repaints on Python {python}", "", None, False, "no crash", error=told)
    found = json.loads(done.stdout.splitlines()[-1])
    growth = (found["end_bytes"] - found["middle_bytes"]) / (repaints * (1 - SETTLING))
    # A few pages more or less are no leak; over many repaints they are nothing.
    allowed = max(GROWTH_BYTES, 4e6 / repaints)
    return Row(
        f"reliability.gui: {found['painted']} repaints on Python {python}, PySide {found['pyside']}, "
        f"{growth:+.0f} bytes each in the second half",
        f"{allowed:.0f} bytes a repaint",
        growth / allowed,
        found["painted"] >= repaints and growth <= allowed,
        "no crash, flat memory",
    )


def work(repaints: int) -> None:
    """Repaint, and tell how memory went."""
    import itertools

    import numpy as np
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
    painted = middle = 0
    for number in itertools.count():
        if painted >= repaints:
            break
        if painted >= SETTLING * repaints and not middle:
            middle = resident_bytes(os.getpid()) or 0
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
    end = resident_bytes(os.getpid()) or 0
    window.close()
    print(json.dumps({"painted": painted, "middle_bytes": middle, "end_bytes": end, "pyside": PySide6.__version__}))


def main() -> int:
    """From the command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reliability_gui", description=__doc__)
    parser.add_argument("--repaints", type=int, default=USUAL)
    parser.add_argument("--work", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work is not None:
        work(given.work)
        return 0
    row = soak(given.repaints)
    print(("ok   " if row.ok else "FAIL ") + row.name + (f": {row.error}" if row.error else ""))
    return 0 if row.ok else 1


if __name__ == "__main__":
    sys.exit(main())
