"""Looks: a dark theme, a light one for sunlight, the size of the letters; every colour of the window stands here."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import pyqtgraph as pg
from PySide6.QtGui import QColor, QFont, QPalette
from PySide6.QtWidgets import QApplication


class ThemeName(StrEnum):
    """Which looks."""

    DARK = "dark"
    LIGHT = "light"


@dataclass(frozen=True)
class Theme:
    """Colours by what they mean, as ``#rrggbb``. Text on its ground has a contrast of 7 : 1 or more (WCAG AAA)."""

    name: ThemeName
    window: str
    panel: str
    """Ground of cards, fields and plots."""
    raised: str
    """Ground of buttons and of the row under the mouse."""
    border: str
    text: str
    dim: str
    """Text that explains; still 4.5 : 1."""
    accent: str
    on_accent: str
    ok: str
    warning: str
    bad: str
    grid: str
    filled: str
    """The done part of a progress bar, on which text stands."""
    curves: tuple[str, ...]
    """Of HH, HV, VH, VV, then others; told apart by colour-blind eyes (after Okabe and Ito)."""


DARK = Theme(
    name=ThemeName.DARK,
    window="#14171c",
    panel="#1c2027",
    raised="#2a303a",
    border="#3a424e",
    text="#eceff4",
    dim="#a9b3c1",
    accent="#4ea1ff",
    on_accent="#06121f",
    ok="#3ccf7e",
    warning="#ffb938",
    bad="#ff6b60",
    grid="#39414d",
    filled="#1d5c9e",
    curves=("#56b4e9", "#e69f00", "#f0e442", "#cc79a7", "#009e73", "#d55e00"),
)
LIGHT = Theme(
    name=ThemeName.LIGHT,
    window="#f3f4f6",
    panel="#ffffff",
    raised="#e4e8ee",
    border="#b6bfcb",
    text="#101418",
    dim="#4a5460",
    accent="#0057b8",
    on_accent="#ffffff",
    ok="#087443",
    warning="#8a5200",
    bad="#b3261e",
    grid="#c9d0d9",
    filled="#9cc8f5",
    curves=("#0072b2", "#b35c00", "#6b6300", "#9b3f78", "#007a58", "#a83f00"),
)
THEMES = {theme.name: theme for theme in (DARK, LIGHT)}
SIZES_PT = (9.0, 10.5, 12.5, 15.0)
"""Letters: small, usual, large, very large."""
USUAL_PT = SIZES_PT[1]

_current = DARK


def current() -> Theme:
    """The theme that is shown."""
    return _current


def apply(application: QApplication, name: ThemeName, size_pt: float = USUAL_PT) -> Theme:
    """Give the whole application a theme and a size of letters; plots made from now on follow."""
    global _current
    _current = theme = THEMES[name]
    application.setStyle("Fusion")
    font = QFont(application.font())
    font.setPointSizeF(size_pt)
    application.setFont(font)
    application.setPalette(_palette(theme))
    application.setStyleSheet(_style_sheet(theme, size_pt))
    pg.setConfigOptions(background=theme.panel, foreground=theme.text, antialias=False, imageAxisOrder="row-major")
    return theme


def _palette(theme: Theme) -> QPalette:
    palette = QPalette()
    role = QPalette.ColorRole
    for which, colour in (
        (role.Window, theme.window),
        (role.WindowText, theme.text),
        (role.Base, theme.panel),
        (role.AlternateBase, theme.raised),
        (role.Text, theme.text),
        (role.PlaceholderText, theme.dim),
        (role.Button, theme.raised),
        (role.ButtonText, theme.text),
        (role.ToolTipBase, theme.raised),
        (role.ToolTipText, theme.text),
        (role.Highlight, theme.accent),
        (role.HighlightedText, theme.on_accent),
        (role.Link, theme.accent),
        (role.BrightText, theme.bad),
    ):
        palette.setColor(which, QColor(colour))
    for which in (role.WindowText, role.Text, role.ButtonText):
        palette.setColor(QPalette.ColorGroup.Disabled, which, QColor(theme.dim))
    return palette


def _style_sheet(theme: Theme, size_pt: float) -> str:
    pad = round(size_pt * 0.55)
    return f"""
QToolTip {{ color: {theme.text}; background: {theme.raised}; border: 1px solid {theme.border};
    padding: {pad // 2}px; }}
QComboBox, QSpinBox, QDoubleSpinBox {{ min-height: {round(size_pt * 2.7)}px; }}
QPushButton, QToolButton, QLineEdit, QPlainTextEdit, QListView, QTableView {{
    background: {theme.panel}; border: 1px solid {theme.border}; border-radius: 4px; padding: {pad}px;
    selection-background-color: {theme.accent}; selection-color: {theme.on_accent}; }}
QPushButton, QToolButton {{ background: {theme.raised}; padding: {pad}px {2 * pad}px; }}
QPushButton:hover, QToolButton:hover {{ border-color: {theme.accent}; }}
QPushButton:focus, QToolButton:focus, QLineEdit:focus, QListView:focus, QTableView:focus,
QPlainTextEdit:focus {{ border: 2px solid {theme.accent}; padding: {max(pad - 1, 0)}px; }}
QPushButton:focus, QToolButton:focus {{ padding: {max(pad - 1, 0)}px {max(2 * pad - 1, 0)}px; }}
QPushButton[role="compact"] {{ padding: {pad}px {pad // 2}px; }}
QPushButton:disabled, QToolButton:disabled {{ color: {theme.dim}; background: {theme.panel}; }}
QPushButton:checked, QToolButton:checked {{ background: {theme.accent}; color: {theme.on_accent}; }}
QPushButton[role="primary"] {{ background: {theme.accent}; color: {theme.on_accent}; font-weight: 600; }}
QPushButton[role="primary"]:disabled {{ background: {theme.raised}; color: {theme.dim}; }}
QPushButton[role="danger"] {{ background: {theme.panel}; color: {theme.bad}; border-color: {theme.bad};
    font-weight: 600; }}
QPushButton[role="danger"]:disabled {{ color: {theme.dim}; border-color: {theme.border}; }}
QLabel[role="title"] {{ font-size: {size_pt * 1.55:.1f}pt; font-weight: 600; }}
QLabel[role="heading"] {{ font-size: {size_pt * 1.15:.1f}pt; font-weight: 600; }}
QLabel[role="dim"] {{ color: {theme.dim}; }}
QLabel[role="big"] {{ font-size: {size_pt * 1.7:.1f}pt; font-weight: 600; }}
QFrame[role="card"] {{ background: {theme.panel}; border: 1px solid {theme.border}; border-radius: 6px; }}
QFrame[role="card"] QLabel {{ background: transparent; border: none; }}
QListWidget#navigation {{ background: {theme.panel}; border: none; border-right: 1px solid {theme.border};
    padding: {pad}px; }}
QListWidget#navigation::item {{ padding: 0 {pad}px; border-radius: 4px; margin: 1px 0; }}
QListWidget#navigation::item:selected {{ background: {theme.accent}; color: {theme.on_accent}; }}
QListWidget#navigation::item:hover:!selected {{ background: {theme.raised}; }}
QProgressBar {{ background: {theme.panel}; border: 1px solid {theme.border}; border-radius: 4px; text-align: center;
    min-height: {round(size_pt * 1.9)}px; }}
QProgressBar::chunk {{ background: {theme.filled}; border-radius: 3px; }}
QTabWidget::pane {{ border: 1px solid {theme.border}; background: {theme.window}; }}
QTabWidget > QWidget > QWidget {{ background: {theme.window}; }}
QTabBar::tab {{ padding: {pad}px {2 * pad}px; background: {theme.window}; border: 1px solid {theme.border};
    border-bottom: none; }}
QTabBar::tab:selected {{ background: {theme.panel}; border-top: 2px solid {theme.accent}; }}
QHeaderView::section {{ background: {theme.raised}; color: {theme.text}; border: none; padding: {pad // 2}px {pad}px; }}
QSplitter::handle {{ background: {theme.border}; }}
QStatusBar {{ background: {theme.panel}; border-top: 1px solid {theme.border}; }}
QScrollArea {{ border: none; }}
"""
