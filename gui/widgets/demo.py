"""Runs one widget alone, with demo data: ``python -m gui.widgets.<name> [--png FILE]``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication, QWidget

from gui import theme


def run(make: Callable[[], QWidget], width: int = 700, height: int = 420) -> int:
    """Show what ``make`` makes until it is closed, or save a picture of it. Returns the exit status."""
    parser = argparse.ArgumentParser(description="one widget of the window with demo data")
    parser.add_argument("--png", help="save a picture of it and end, without a display")
    parser.add_argument("--theme", choices=[str(name) for name in theme.THEMES], default="dark")
    given = parser.parse_args()
    if given.png:
        os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    application = QApplication(sys.argv[:1])
    theme.apply(application, theme.ThemeName(given.theme))
    widget = make()
    widget.resize(width, height)
    widget.show()
    if not given.png:
        return application.exec()
    saved: list[bool] = []

    def save() -> None:
        saved.append(widget.grab().save(given.png))
        application.quit()

    QTimer.singleShot(300, save)
    application.exec()
    return 0 if saved == [True] else 1
