"""An exception that nobody caught, in a slot or a thread, is shown and logged; the window goes on."""

from __future__ import annotations

import logging
import logging.handlers
import sys
import threading
import traceback
from pathlib import Path
from types import TracebackType

import platformdirs
from PySide6.QtCore import QObject, Qt, Signal

LOG_BYTES, LOGS_KEPT = 1_000_000, 3


class Uncaught(QObject):
    """Takes the place of ``sys.excepthook`` and ``threading.excepthook`` while it is installed."""

    happened = Signal(str, str)
    """One sentence for the user, and the traceback; in the thread of the window."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._log = _logger()
        self._before = (sys.excepthook, threading.excepthook)

    def install(self) -> None:
        """Begin."""
        sys.excepthook = self._of_slot
        threading.excepthook = self._of_thread

    def remove(self) -> None:
        """Put back what was there."""
        sys.excepthook, threading.excepthook = self._before

    def tell_in(self, slot: object) -> None:
        """Call ``slot(sentence, details)`` for each."""
        self.happened.connect(slot, Qt.ConnectionType.QueuedConnection)

    def _of_slot(self, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if issubclass(kind, KeyboardInterrupt):
            self._before[0](kind, error, trace)
            return
        self._tell(kind, error, trace)
        # Python keeps the last error for a debugger, and with it all that its frames hold: pictures, whole pages.
        for name in ("last_type", "last_value", "last_traceback", "last_exc"):
            if hasattr(sys, name):
                delattr(sys, name)

    def _of_thread(self, arguments: threading.ExceptHookArgs) -> None:
        if arguments.exc_value is not None and not issubclass(arguments.exc_type, SystemExit):
            self._tell(arguments.exc_type, arguments.exc_value, arguments.exc_traceback)

    def _tell(self, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        details = "".join(traceback.format_exception(kind, error, trace))
        self._log.error("uncaught\n%s", details)
        sentence = f"{kind.__name__}: {error}; this is a defect of the window (a collect is not touched by it)"
        self.happened.emit(sentence, details)


def log_file() -> Path:
    """Where the window logs."""
    return Path(platformdirs.user_log_dir("polfuse-lab")) / "window.log"


def _logger() -> logging.Logger:
    logger = logging.getLogger("polfuse.window")
    logger.setLevel(logging.INFO)
    logger.propagate = False
    if not logger.handlers:
        path = log_file()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handler: logging.Handler = logging.handlers.RotatingFileHandler(
                path, maxBytes=LOG_BYTES, backupCount=LOGS_KEPT, encoding="utf-8", delay=True
            )
        except OSError:
            handler = logging.StreamHandler()
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        logger.addHandler(handler)
    return logger
