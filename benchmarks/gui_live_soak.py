"""Hours of live view in minutes: collect after collect on a stand-in for the live process, in a process of its own.

``python -m benchmarks.gui_live_soak HOURS POSITIONS`` shows the records of so many hours, at the rate of the example
plan, one after another: each is put on a board, found by the window's link, drawn and painted, and the next comes as
soon as that is over. Each collect has ``POSITIONS`` positions, a board and a view of its own, as an engine's, and
another tab of the live page. Prints one JSON object.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import PySide6
from PySide6.QtCore import QEvent, QObject

from benchmarks.memory_watch import resident_bytes
from gui.app import make_application
from gui.main_window import MainWindow
from gui.models import live_link
from gui.pages.live_page import LivePage
from gui.widgets.picture_view import demo_image
from gui.widgets.profile_view import CHANNELS, demo_profile
from gui.widgets.status_strip import demo_status
from polfuse_lab.live import Board, LiveView
from polfuse_lab.live.listening import WATERFALL_ROWS
from polfuse_lab.plans import load_plan
from polfuse_lab.plans.dry_run import dry_run
from polfuse_lab.rig import load_rig
from polfuse_lab.rig.examples import write_examples

TABS = ("ranges", "speeds", "sar", "camera", "fused")
STEP_M = 0.47
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
ROWS, COLUMNS = 291, 391
"""Of a frame of 582 x 782 pixels at display size."""


def record_seconds(folder: Path) -> float:
    """How long one record of the example plan takes, with what it takes to come to the next, s."""
    paths = write_examples(folder)
    told = dry_run(load_rig(paths["rig"]), load_plan(paths["plan"]))
    return told.seconds / told.records


class StandIn:
    """Puts on a board what a live process would; of arrays that are there already, since the window is looked at."""

    def __init__(self) -> None:
        self._profiles = [demo_profile(seed) for seed in range(1, 9)]
        self._range_m = np.arange(len(self._profiles[0])) * STEP_M
        self._speed_m_s = np.linspace(-1.5, 1.5, 32)
        self._level_db, self._x_m, self._y_m = demo_image(121)
        colours = np.random.default_rng(1).integers(0, 256, (121, 121, 3))
        self._rgb = colours.astype(np.uint8)
        light = np.random.default_rng(2).uniform(500, 3000, (ROWS, COLUMNS))
        self._light = light.astype(np.float32)
        self._share = np.linspace(0, 1, ROWS * COLUMNS, dtype=np.float32).reshape(ROWS, COLUMNS)

    def show(self, board: Board, number: int) -> None:
        """What there is to see after record ``number`` of a collect; images come with each position's last channel."""
        channel = CHANNELS[number % len(CHANNELS)]
        profile = self._profiles[number % len(self._profiles)]
        now = time.monotonic_ns()
        level = 0.05 + 0.04 * math.sin(number / 7)
        values = {"beat_peak": level, "beat_rms": level / 2, "sync_peak": 0.7, "sync_rms": 0.6, "sync_channel": 1,
                  "period_s": 0.04}  # fmt: skip
        board.put("levels", {}, t_sample_ns=now, values=values, slots=64)
        step = {"range_step_m": STEP_M}
        board.put(f"waterfall.{channel}", {"level_db": profile}, t_sample_ns=now, values=step, slots=WATERFALL_ROWS)
        board.put(f"profile.{channel}", {"range_m": self._range_m, "level_db": profile}, t_sample_ns=now)
        speeds = np.tile(np.roll(profile, number), (len(self._speed_m_s), 1))
        arrays = {"range_m": self._range_m, "speed_m_s": self._speed_m_s, "level_db": speeds}
        board.put(f"doppler.{channel}", arrays, t_sample_ns=now, slots=3)
        if number % len(CHANNELS) == len(CHANNELS) - 1:
            self._show_images(board, number // len(CHANNELS), now)

    def _show_images(self, board: Board, position: int, now: int) -> None:
        axes = {"x_m": self._x_m, "y_m": self._y_m}
        picture = np.roll(self._level_db, position, axis=1)
        scale = {"channels": list(CHANNELS), "low_db": -40.0 - position % 7, "high_db": 0.0}
        arrays = {**axes, "level_db": np.stack([picture] * len(CHANNELS))}
        board.put("sar", arrays, t_sample_ns=now, values=scale, slots=2)
        colours = {**axes, "rgb": np.roll(self._rgb, position, axis=0)}
        board.put("pauli", colours, t_sample_ns=now, slots=2)
        error = {"registration_error_px": 2.0 + position % 3}
        board.put("fusion", colours, t_sample_ns=now, values=error, slots=2)
        angle = ANGLES_DEG[position % len(ANGLES_DEG)]
        light, share = np.roll(self._light, position, axis=1), np.roll(self._share, position, axis=0)
        seen = {"angle_deg": angle, "saturated_fraction": float(np.mean(share > 0.999))}
        frame = {"image": light, "saturated": np.where(share > 0.999, share, np.float32(0))}
        board.put(f"camera.{angle:05.1f}", frame, t_sample_ns=now, values=seen)
        small = np.full_like(share, 0.01)
        optics = {"s0": light, "dolp": share, "aop_rad": share, "dolp_sd": small, "aop_sd_rad": small}
        board.put("optics", optics, t_sample_ns=now)


class Tally(QObject):
    """Counts what the live page's plots paint, and how often it looked for what is new."""

    def __init__(self, page: LivePage) -> None:
        super().__init__(page)
        self.paints = self.looks = 0
        plots = (page.profile, page.waterfall, page.doppler, *page.sar.values(), page.pauli, page.frame,
                 *page.optics.values(), page.fused)  # fmt: skip
        for plot in plots:
            plot.graph.viewport().installEventFilter(self)
        page.link.tick.connect(self._look)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:  # noqa: N802 - Qt's name
        """Count a paint."""
        self.paints += event.type() == QEvent.Type.Paint
        return False

    def _look(self) -> None:
        self.looks += 1


def main() -> None:
    """Show, and tell how memory went: ``samples`` are seconds of the collects' time, and bytes."""
    hours, positions = float(sys.argv[1]), int(sys.argv[2])
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    live_link.FRAME_MS = 0  # the window looks whenever it has drawn what came before
    application = make_application()
    window = MainWindow()
    page = window.page("live")
    assert isinstance(page, LivePage)
    window.show()
    tally, stand_in = Tally(page), StandIn()
    samples: list[tuple[float, int]] = []
    records, begun = 0, time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        record_s = record_seconds(Path(scratch) / "rig")
        collect_s = record_s * positions * len(CHANNELS)
        rounds = math.ceil(3600 * hours / (collect_s * len(TABS)))
        for collect in range(rounds * len(TABS)):
            folder = Path(scratch) / f"engine-{collect}"
            folder.mkdir()
            board = Board(folder)
            window.show_page("collect")
            window.show_page("live")
            page.show_tab(TABS[collect % len(TABS)])
            window.bench.live.open(LiveView(folder))
            for number in range(positions * len(CHANNELS)):
                stand_in.show(board, number)
                window.strip.show_status(demo_status(step=number, position=number // len(CHANNELS)))
                application.processEvents()
                records += 1
                if number % len(CHANNELS) == 0:
                    samples.append((records * record_s, resident_bytes(os.getpid()) or 0))
            # The window keeps the last pictures of an engine that has gone.
            board.close()
            shutil.rmtree(folder)
        window.close()
        application.processEvents()
    print(json.dumps({
        "hours": records * record_s / 3600, "collects": rounds * len(TABS), "records": records, "paints": tally.paints,
        "looks": tally.looks, "seconds": time.monotonic() - begun, "round_s": collect_s * len(TABS),
        "samples": samples, "pyside": PySide6.__version__,
    }))  # fmt: skip


if __name__ == "__main__":
    main()
