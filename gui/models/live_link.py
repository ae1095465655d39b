"""The live streams of a running engine, looked at as often as the screen is drawn."""

from __future__ import annotations

import time

from PySide6.QtCore import QObject, Qt, QTimer, Signal

from polfuse_lab.live import LiveView, Shown

GLANCE_S = 1.0
FRAME_MS = 25
"""40 updates a second, for the sake of 30."""


class LiveLink(QObject):
    """Tells of what is new; whatever is not asked for is not read.

    :attr:`tick` comes once for each frame of the display; a page then asks :meth:`newest` for what it shows.
    """

    tick = Signal()
    opened = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._view: LiveView | None = None
        self._seen: dict[str, int] = {}
        self._held: set[str] = set()
        self._histories: set[str] = set()
        self._glanced: dict[str, float] = {}
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.setInterval(FRAME_MS)
        self._timer.timeout.connect(self._tick)
        self.latest_ns = 0
        """Host time of the newest sample that has been handed out."""

    @property
    def running(self) -> bool:
        """Whether there is an engine to look at."""
        return self._view is not None

    def open(self, view: LiveView) -> None:
        """Look at another engine."""
        self.close()
        self._view = view
        self.latest_ns = 0
        self._timer.start()
        self.opened.emit()

    def close(self) -> None:
        """Look no more."""
        self._timer.stop()
        self._seen.clear()
        self._held.clear()
        view, self._view = self._view, None
        if view is not None:
            view.close()

    def streams(self) -> tuple[str, ...]:
        """Streams that there are, or were until the engine went."""
        return tuple(sorted(self._held))

    def newest(self, stream: str) -> Shown | None:
        """The newest item of a stream if it has not been handed out yet."""
        if self._view is None:
            return None
        found = self._view.newest(stream, after=self._seen.get(stream, 0))
        if found is not None:
            self._note(stream, found)
        return found

    def glance(self, stream: str) -> Shown | None:
        """The newest item of a stream whoever has had it already, at most once a second."""
        now = time.monotonic()
        if self._view is None or now - self._glanced.get(stream, 0.0) < GLANCE_S:
            return None
        self._glanced[stream] = now
        return self._view.newest(stream)

    def since(self, stream: str, most: int) -> list[Shown]:
        """Items of a stream that have not been handed out yet, the last ``most`` of them."""
        if self._view is None:
            return []
        self._histories.add(stream)
        found = self._view.since(stream, self._seen.get(stream, 0), most=most)
        if found:
            self._note(stream, found[-1])
        return found

    def forget(self) -> None:
        """Hand the newest of everything out anew: a page has come to the front. Whoever shows a history has it."""
        self._seen = {stream: seen for stream, seen in self._seen.items() if stream in self._histories}

    def tell_again(self, stream: str) -> None:
        """Hand out a history anew from its beginning: who showed it has forgotten it."""
        self._seen.pop(stream, None)

    def age_s(self) -> float | None:
        """How old the newest sample that was handed out is, s."""
        return (time.monotonic_ns() - self.latest_ns) * 1e-9 if self.latest_ns else None

    def _note(self, stream: str, found: Shown) -> None:
        self._seen[stream] = found.number
        self.latest_ns = max(self.latest_ns, found.t_sample_ns)

    def _tick(self) -> None:
        if self._view is not None:
            # Once it has been read, the last item of a stream stays when the engine has gone.
            for stream in set(self._view.streams()) - self._held:
                if self._view.newest(stream) is not None:
                    self._held.add(stream)
        self.tick.emit()
