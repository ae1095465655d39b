"""Runs one widget alone, with demo data: ``python -m gui.widgets.demo NAME [--png FILE]``; without a name, tells them.

``python -m gui.widgets.NAME`` does the same.
"""

from __future__ import annotations

import argparse
import os
import pkgutil
import runpy
import sys
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication, QWidget

from gui import theme

NO_WIDGETS = ("demo", "turns")
"""Modules beside the widgets that show nothing."""


def names() -> list[str]:
    """Modules of widgets, each of which can be run alone."""
    return [found.name for found in pkgutil.iter_modules([str(Path(__file__).parent)]) if found.name not in NO_WIDGETS]


def main() -> int:
    """The command line."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in names():
        print("choose a widget: " + ", ".join(names()))
        return 0 if name in ("", "-h", "--help") else 2
    sys.argv = [f"gui.widgets.{name}", *sys.argv[2:]]
    runpy.run_module(f"gui.widgets.{name}", run_name="__main__")
    return 0


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


if __name__ == "__main__":
    sys.exit(main())
