"""Starts the window."""

from __future__ import annotations

import sys
from pathlib import Path

from PySide6.QtWidgets import QApplication

from gui import theme, translation
from gui.errors import Uncaught
from gui.garbage import Garbage
from gui.main_window import MainWindow
from polfuse_lab import remembered


def make_application() -> QApplication:
    """The application with the remembered looks; the one that runs already, if one does."""
    application = QApplication.instance()
    if not isinstance(application, QApplication):
        application = QApplication(sys.argv[:1])
        translation.install(application)
    application.setApplicationName("PolFuse Lab")
    settings = remembered.Settings.load()
    known = [str(name) for name in theme.THEMES]
    name = str(settings.get("theme", "dark"))
    points = settings.get("letters_pt", theme.USUAL_PT)
    theme.apply(
        application,
        theme.ThemeName(name if name in known else "dark"),
        float(points) if points in theme.SIZES_PT else theme.USUAL_PT,
    )
    return application


def run(opened: Path | None = None) -> int:
    """Show the window until it is closed. Returns the exit status.

    Args:
        opened: a rig, session or products file to begin with.
    """
    application = make_application()
    uncaught = Uncaught()
    uncaught.install()
    window = MainWindow()
    garbage = Garbage(window)
    uncaught.tell_in(window.error_bar.tell)
    window.settings_page.looks_changed.connect(
        lambda name, points: theme.apply(application, theme.ThemeName(name), points)
    )
    if opened is not None:
        window.open(opened)
    window.show()
    try:
        return application.exec()
    finally:
        garbage.end()
        uncaught.remove()
