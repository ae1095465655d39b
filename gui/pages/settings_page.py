"""Looks, size of the letters, and where sessions are written."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QFileDialog, QFormLayout, QHBoxLayout, QLineEdit, QVBoxLayout, QWidget

from gui import theme
from gui.errors import log_file
from gui.models.words import home_short, place, typed
from gui.widgets.layout import button, card, dim, heading, title
from polfuse_lab import remembered


class SettingsPage(QWidget):
    """What is remembered from one start to the next."""

    looks_changed = Signal(str, float)
    """Name of the theme, size of the letters in points."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._settings = remembered.Settings.load()
        self.themes = QComboBox()
        self.themes.addItem(self.tr("dark"), str(theme.ThemeName.DARK))
        self.themes.addItem(self.tr("light, for sunlight"), str(theme.ThemeName.LIGHT))
        self.sizes = QComboBox()
        for name, points in zip(
            (self.tr("small"), self.tr("usual"), self.tr("large"), self.tr("very large")), theme.SIZES_PT, strict=True
        ):
            self.sizes.addItem(f"{name} ({points:g} pt)", points)
        self.folder = QLineEdit(home_short(typed(str(self._settings.get("sessions_folder", "~/polfuse-sessions")))))
        self.folder.editingFinished.connect(self._keep_folder)
        self.themes.setCurrentIndex(max(self.themes.findData(self._settings.get("theme", "dark")), 0))
        self.sizes.setCurrentIndex(max(self.sizes.findData(self._settings.get("letters_pt", theme.USUAL_PT)), 0))
        self.themes.currentIndexChanged.connect(self._keep_looks)
        self.sizes.currentIndexChanged.connect(self._keep_looks)
        where = QHBoxLayout()
        where.addWidget(self.folder, 1)
        where.addWidget(button(self.tr("Browse…"), self._browse))
        form = QFormLayout()
        form.addRow(self.tr("Theme"), self.themes)
        form.addRow(self.tr("Letters"), self.sizes)
        form.addRow(self.tr("Folder for sessions"), where)
        column = QVBoxLayout(self)
        column.setContentsMargins(24, 20, 24, 16)
        column.addWidget(title(self.tr("Settings")))
        column.addWidget(card(heading(self.tr("Window")), form))
        column.addWidget(dim(self.tr("Errors are logged in {0}").format(place(log_file()))))
        if self._settings.warning:
            column.addWidget(dim(self._settings.warning))
        column.addStretch(1)

    def _keep_looks(self) -> None:
        name, points = str(self.themes.currentData()), float(self.sizes.currentData())
        self._settings.set("theme", name)
        self._settings.set("letters_pt", points)
        self._settings.save()
        self.looks_changed.emit(name, points)

    def _keep_folder(self) -> None:
        self._settings.set("sessions_folder", str(typed(self.folder.text())))
        self._settings.save()

    def _browse(self) -> None:
        name = QFileDialog.getExistingDirectory(self, self.tr("Folder for sessions"), str(typed(self.folder.text())))
        if name:
            self.folder.setText(home_short(name))
            self._keep_folder()
