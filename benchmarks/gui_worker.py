"""The window on live streams, in a process of its own: how often it draws, how late, and how long it is ever held up.

``python -m benchmarks.gui_worker FOLDER SECONDS`` shows each tab of the live page for so long, then switches tabs and
sizes all the time, then drags the window about with the mouse over its plots, then turns its pages; and prints one JSON
object. With ``--collect RIG PLAN SESSION`` it begins that collect in an engine of its own and watches that.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from PySide6.QtCore import QCoreApplication, QEvent, QEventLoop, QObject, QPointF, Qt, QTimer
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication, QWidget

from gui.app import make_application
from gui.garbage import Garbage
from gui.main_window import MainWindow
from gui.pages.live_page import LivePage
from polfuse_lab.live import LiveView

BEAT_MS = 5
SIZES = ((1366, 768), (1100, 700), (1024, 640), (1280, 720))
FIRST_S = 1.5
STARTING_S, SETTLING_S, ENDING_S = 90.0, 4.0, 60.0
"""For the collect's begin, until what came while the live process started has been dealt with, and for its end."""
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
    own_ms: list[float] = field(default_factory=list)
    """Processor time that the window's thread took between the same two beats."""
    waited_ms: list[float] = field(default_factory=list)
    """How long it was ready meanwhile and others had the processors; empty where the system does not tell."""
    cpu_s: float = 0.0


def schedule() -> tuple[int, int]:
    """Processor time of this thread and time that it waited for a processor, ns (Linux: schedstat)."""
    try:
        with open(f"/proc/self/task/{threading.get_native_id()}/schedstat", encoding="ascii") as told:
            own, waited, _ = told.read().split()
            return int(own), int(waited)
    except (OSError, ValueError):
        return time.thread_time_ns(), -1


class Heart(QObject):
    """Beats in the event loop, and watches what is painted."""

    def __init__(self, window: MainWindow, page: LivePage) -> None:
        super().__init__(window)
        self._page = page
        self._phase: Phase | None = None
        self._last = 0
        self._schedule = 0, -1
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
        self._last, self._schedule, self._phase = time.monotonic_ns(), schedule(), phase
        loop.exec()
        self._phase = None
        acting.stop()
        phase.seconds += time.monotonic() - began
        phase.cpu_s += time.process_time() - cpu
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
        now, (own, waited) = time.monotonic_ns(), schedule()
        if self._phase is not None:
            self._phase.beats_ms.append((now - self._last) * 1e-6)
            self._phase.own_ms.append((own - self._schedule[0]) * 1e-6)
            if waited >= 0:
                self._phase.waited_ms.append((waited - self._schedule[1]) * 1e-6)
        self._last, self._schedule = now, (own, waited)

    def _tick(self) -> None:
        if self._phase is not None:
            self._phase.ticks += 1


class Show:
    """The window, and what is done with it."""

    def __init__(self, application: QApplication) -> None:
        self.application = application
        self.window = MainWindow()
        self.garbage = Garbage(self.window)
        page = self.window.page("live")
        assert isinstance(page, LivePage)
        self.page = page
        self.window.resize(*SIZES[0])
        self.window.show()
        self.window.show_page("live")
        self.heart = Heart(self.window, page)
        for view in (page.profile, page.doppler, page.pauli, page.frame):
            self.heart.watch(view.graph.viewport())

    def phases(self, seconds: float) -> list[Phase]:
        """Each tab for so long, and then with everything that a hand can do to it."""
        first, found = Phase("first looks"), []
        for tab in TABS:
            self.page.show_tab(tab)
            # Colour tables are made and fonts loaded when a tab is seen for the first time.
            self.heart.measure(first, FIRST_S)
            found.append(self.heart.measure(Phase(tab), seconds))
        sizes, tabs, pages = itertools.cycle(SIZES), itertools.cycle(TABS), itertools.cycle(self.window.names)

        def disturb() -> None:
            self.window.resize(*next(sizes))
            self.page.show_tab(next(tabs))

        found.append(self.heart.measure(Phase("resized and switched"), seconds, disturb))
        found.append(self._dragged(seconds))
        found.append(self.heart.measure(Phase("pages turned"), seconds, lambda: self.window.show_page(next(pages))))
        return [first, *found]

    def _dragged(self, seconds: float) -> Phase:
        """Moved on the screen, with the mouse over its plots 200 times a second."""
        self.window.resize(*SIZES[0])
        self.page.show_tab("camera")
        steps = itertools.count()

        def drag() -> None:
            step = next(steps)
            self.window.move(step * 7 % 400, step * 5 % 300)

        def move_mouse() -> None:
            at = next(steps)
            plot = (self.page.frame, *self.page.optics.values())[at // 50 % 4].graph.viewport()
            place = QPointF(at * 3 % max(plot.width(), 1), at * 2 % max(plot.height(), 1))
            none = Qt.MouseButton.NoButton
            kind, keys = QEvent.Type.MouseMove, Qt.KeyboardModifier.NoModifier
            QCoreApplication.sendEvent(plot, QMouseEvent(kind, place, plot.mapToGlobal(place), none, none, keys))

        mouse = QTimer()
        mouse.timeout.connect(move_mouse)
        mouse.start(5)
        phase = self.heart.measure(Phase("dragged, mouse over it"), seconds, drag)
        mouse.stop()
        return phase

    def collect(self, rig: Path, plan: Path, session: Path) -> dict[str, Any]:
        """Begin a collect and wait until its streams are there; how it ends is put into what is returned, in time."""
        told: dict[str, Any] = {}
        engine = self.window.bench.engine
        engine.finished.connect(lambda outcome: told.update(msgspec.to_builtins(outcome)))
        engine.failed.connect(lambda sentence, details: told.update(state="failed", reason=f"{sentence} {details}"))
        engine.start(rig, plan, session)
        wanted = {"levels", "profile.HH", "camera.000.0", "sar"}
        self.until(lambda: bool(told) or wanted <= set(self.page.link.streams()), STARTING_S)
        self.until(lambda: bool(told), SETTLING_S)
        return told

    def health(self) -> dict[str, Any]:
        """What the live process tells of itself: a word that is new."""
        found: list[dict[str, Any]] = []
        link = self.page.link
        link.newest("health")

        def told() -> bool:
            item = link.newest("health")
            if item is not None:
                found.append(dict(item.values))
            return bool(found)

        self.until(told, 5.0)
        return found[0] if found else {}

    def until(self, ready: Callable[[], bool], seconds: float) -> None:
        """Let the window live until something is so, so long at most."""
        end = time.monotonic() + seconds
        while not ready() and time.monotonic() < end:
            self.application.processEvents(QEventLoop.ProcessEventsFlag.WaitForMoreEvents, 50)

    def close(self) -> None:
        """Close the window."""
        self.garbage.end()
        self.window.close()
        self.application.processEvents()


def main() -> None:
    """Show, measure, and tell."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gui_worker", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("seconds", type=float)
    parser.add_argument("--collect", type=Path, nargs=3, metavar=("RIG", "PLAN", "SESSION"))
    given = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    show = Show(make_application())
    told: dict[str, Any] = {}
    health: list[dict[str, Any]] = []
    if given.collect is None:
        show.page.link.open(LiveView(given.folder))
    else:
        told = show.collect(*given.collect)
    phases: list[Phase] = []
    if not told:
        health.append(show.health())
        phases = show.phases(given.seconds)
        health.append(show.health())
    if given.collect is not None and not told:
        show.window.bench.engine.abort()
        show.until(lambda: bool(told), ENDING_S)
    show.close()
    print(json.dumps({"phases": [asdict(phase) for phase in phases], "outcome": told, "health": health}))


if __name__ == "__main__":
    main()
