"""Work that would hold the window up, done beside it; its outcome comes back in the window's own thread."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

import shiboken6
from PySide6.QtCore import QObject, QRunnable, Qt, QThreadPool, Signal

from drivers.errors import DeviceError
from polfuse_lab.errors import PolfuseError
from processing.errors import DataError


class Task(QObject):
    """One piece of work. Keep no widget in it: it runs in another thread."""

    done = Signal(object)
    failed = Signal(str, str)
    """One sentence, and the details."""


class _Runner(QRunnable):
    def __init__(self, task: Task, work: Callable[[], Any]) -> None:
        super().__init__()
        self._task, self._work = task, work

    def run(self) -> None:
        try:
            found = self._work()
        except (PolfuseError, DataError, DeviceError, OSError) as error:
            self._tell(self._task.failed, str(error), traceback.format_exc())
        except Exception as error:
            sentence = f"{type(error).__name__}: {error}; this is a defect of the program: report it"
            self._tell(self._task.failed, sentence, traceback.format_exc())
        else:
            self._tell(self._task.done, found)

    def _tell(self, signal: Any, *values: object) -> None:
        try:
            signal.emit(*values)
        except RuntimeError:
            return  # the window has gone meanwhile, and nobody wants to know


_running: set[Task] = set()


def run(
    asker: QObject,
    work: Callable[[], Any],
    done: Callable[[Any], None],
    failed: Callable[[str, str], None],
) -> Task:
    """Do ``work`` in a thread of the pool; ``done`` or ``failed`` is called in the thread of the window.

    Neither is called where ``asker`` has been destroyed meanwhile: what they would show it on has gone with it.
    """
    task = Task()
    _running.add(task)

    def finish(then: Callable[..., None], *values: object) -> None:
        _running.discard(task)
        task.deleteLater()  # its connections hold whoever asked, where Python does not look for garbage
        if shiboken6.isValid(asker):
            then(*values)

    connection = Qt.ConnectionType.QueuedConnection
    task.done.connect(lambda found: finish(done, found), connection)
    task.failed.connect(lambda sentence, details: finish(failed, sentence, details), connection)
    QThreadPool.globalInstance().start(_Runner(task, work))
    return task
