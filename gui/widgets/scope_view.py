"""The radar's two signals as they come: beat and sync over the last two sweeps."""

from __future__ import annotations

import sys

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtWidgets import QWidget

from gui import theme
from gui.widgets.plots import Plot


class ScopeView(Plot):
    """Fractions of full scale over time in ms."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("time", "ms", "of full scale", "", parent)
        self.item.setYRange(-1, 1, padding=0.05)
        self._legend = self.item.addLegend(offset=(-4, 4), labelTextColor=theme.current().text)
        self._curves = {name: self.item.plot(name=name) for name in ("sync", "beat")}
        self._signals: dict[str, NDArray[np.floating]] = {}
        self._t_ms: NDArray[np.floating] = np.zeros(0)
        self.dress()

    def show_signals(self, t_s: NDArray[np.floating], beat: NDArray[np.floating], sync: NDArray[np.floating]) -> None:
        """Show both signals, (n,) each."""
        self._t_ms = np.asarray(t_s) * 1e3
        self._signals = {"beat": beat, "sync": sync}
        for name, signal in self._signals.items():
            self._curves[name].setData(self._t_ms, signal)
        self.filled()

    def dress(self) -> None:
        """Take on the colours of the theme."""
        super().dress()
        colours = theme.current().curves
        for name, curve in getattr(self, "_curves", {}).items():
            curve.setPen(pg.mkPen(colours[0 if name == "beat" else 1], width=1))
        if hasattr(self, "_legend"):
            self._legend.setLabelTextColor(theme.current().text)

    def describe(self, x: float, y: float) -> str:
        """Time and both signals."""
        where = self.tr("{0:.2f} ms").format(x)
        if not len(self._t_ms):
            return where
        at = int(np.clip(np.searchsorted(self._t_ms, x), 0, len(self._t_ms) - 1))
        return "   ".join([where, *(f"{name} {signal[at]:+.3f}" for name, signal in self._signals.items())])


def _demo() -> QWidget:
    view = ScopeView()
    t_s = np.arange(3840) / 48_000
    up = (t_s % 0.04) < 0.02
    view.show_signals(t_s, 0.2 * np.sin(2 * np.pi * 230 * t_s), np.where(up, 0.7, -0.7))
    view.show_cursor((30.0, 0.0))
    return view


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 420, 240))
