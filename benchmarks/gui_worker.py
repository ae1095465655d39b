"""The window on live streams, in a process of its own: how often it draws, how late, and how long it is ever held up.

``python -m benchmarks.gui_worker FOLDER SECONDS`` shows each tab of the live page for so long, then switches pages and
sizes all the time, and prints one JSON object.
"""

from __future__ import annotations

import itertools
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

from PySide6.QtCore import QEvent, QEventLoop, QObject, Qt, QTimer
from PySide6.QtWidgets import QWidget

from gui.app import make_application
from gui.garbage import Garbage
from gui.main_window import MainWindow
from gui.pages.live_page import LivePage
from polfuse_lab.live import LiveView

BEAT_MS = 5
SIZES = ((1366, 768), (1100, 700), (1024, 640), (1280, 720))
TABS = {"ranges": "levels", "speeds": "doppler", "sar": "sar", "camera": "camera"}


@dataclass
class Phase:
    """What was measured while one thing was shown."""

    name: str
    seconds: float = 0.0
    ticks: int = 0
    """Times that the newest data were looked for and drawn."""
    paints: int = 0
    beats_ms: list[float] = field(default_factory=list)
    """Time between two beats of the heart; a block of the event loop is a long one."""
    delays_ms: list[float] = field(default_factory=list)
    """From the arrival of the newest sample that was new until the paint with it is over."""
    cpu_s: float = 0.0


class Heart(QObject):
    """Beats in the event loop, and watches what is painted."""

    def __init__(self, window: MainWindow, page: LivePage) -> None:
        super().__init__(window)
        self._page = page
        self._phase: Phase | None = None
        self._last = 0
        self._told = 0
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._beat)
        self._timer.start(BEAT_MS)
        page.link.tick.connect(self._tick)

    def measure(self, phase: Phase, seconds: float, act: Callable[[], None] | None = None) -> Phase:
        """Let the window live for so long; ``act`` is done ten times a second."""
        loop = QEventLoop()
        QTimer.singleShot(round(1000 * seconds), loop.quit)
        acting = QTimer()
        if act is not None:
            acting.timeout.connect(act)
            acting.start(100)
        began, cpu = time.monotonic(), time.process_time()
        self._last, self._phase = time.monotonic_ns(), phase
        loop.exec()
        self._phase = None
        acting.stop()
        phase.seconds, phase.cpu_s = time.monotonic() - began, time.process_time() - cpu
        return phase

    def watch(self, widget: QWidget) -> None:
        """Count the paints of a widget."""
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:  # noqa: N802 - Qt's name
        """A paint begins; its end is after it."""
        if event.type() == QEvent.Type.Paint and self._phase is not None:
            self._phase.paints += 1
            newest = self._page.link.latest_ns
            if newest > self._told:
                self._told = newest
                QTimer.singleShot(0, lambda: self._painted(newest))
        return False

    def _painted(self, newest_ns: int) -> None:
        if self._phase is not None:
            self._phase.delays_ms.append((time.monotonic_ns() - newest_ns) * 1e-6)

    def _beat(self) -> None:
        now = time.monotonic_ns()
        if self._phase is not None:
            self._phase.beats_ms.append((now - self._last) * 1e-6)
        self._last = now

    def _tick(self) -> None:
        if self._phase is not None:
            self._phase.ticks += 1


def main() -> None:
    """Show, measure, and tell."""
    folder, seconds = Path(sys.argv[1]), float(sys.argv[2])
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    application = make_application()
    window = MainWindow()
    garbage = Garbage(window)
    page = window.page("live")
    assert isinstance(page, LivePage)
    window.resize(*SIZES[0])
    window.show()
    window.show_page("live")
    window.bench.live.open(LiveView(folder))
    heart = Heart(window, page)
    for view in (page.profile, page.doppler, page.pauli, page.frame):
        heart.watch(view.graph.viewport())
    phases = []
    for tab in TABS:
        page.show_tab(tab)
        # Colour tables are made and fonts loaded when a tab is seen for the first time.
        heart.measure(Phase("first look"), 1.5)
        phases.append(heart.measure(Phase(tab), seconds))
    sizes, tabs = itertools.cycle(SIZES), itertools.cycle(TABS)

    def disturb() -> None:
        window.resize(*next(sizes))
        page.show_tab(next(tabs))

    phases.append(heart.measure(Phase("resized and switched"), seconds, disturb))
    garbage.end()
    window.close()
    application.processEvents()
    print(json.dumps([asdict(phase) for phase in phases]))


if __name__ == "__main__":
    main()
