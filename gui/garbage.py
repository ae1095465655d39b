"""Garbage is looked for by the window's own thread, between two events, and never among what is there to stay.

Python looks for unreachable cycles in whatever thread happens to allocate. Widgets, timers and pictures in such a cycle
would then be destroyed by a thread of the background, which ends the program (Qt's objects belong to their thread).
And among all that a window is made of it looks for more than a tenth of a second, in which nothing else is done.
"""

from __future__ import annotations

import gc

from PySide6.QtCore import QObject, QTimer

EVERY_MS = 100


class Garbage(QObject):
    """Looks for garbage from now on instead of Python, as often as Python would. Made once, after the window."""

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._most = gc.get_threshold()
        gc.disable()
        gc.collect()
        self._froze = gc.get_freeze_count() == 0
        gc.freeze()
        self._timer = QTimer(self)
        self._timer.setInterval(EVERY_MS)
        self._timer.timeout.connect(self.look)
        self._timer.start()

    def look(self) -> None:
        """Look among the youngest objects, and among older ones each time that enough of these have grown old."""
        counts = gc.get_count()
        oldest = max((age for age, most in enumerate(self._most) if counts[age] > most > 0), default=None)
        if oldest is not None:
            gc.collect(oldest)

    def end(self) -> None:
        """Leave it to Python again. Idempotent."""
        self._timer.stop()
        if self._froze:
            gc.unfreeze()
        gc.enable()
