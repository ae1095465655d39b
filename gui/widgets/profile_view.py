"""Range profiles of the channels, newest over the held maximum."""

from __future__ import annotations

import sys

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtWidgets import QWidget

from gui import theme
from gui.widgets.plots import LINE_PX, Plot

CHANNELS = ("HH", "HV", "VH", "VV")


class ProfileView(Plot):
    """Level in dB over range in metres, a curve for each channel that has come."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("range", "m", "level", "dBFS", parent)
        self.item.showGrid(x=True, y=True, alpha=0.25)
        self.item.addLegend(offset=(-8, 8), labelTextColor=theme.current().text)
        self._curves: dict[str, pg.PlotDataItem] = {}
        self._data: dict[str, tuple[float, NDArray[np.float32]]] = {}

    def show_profile(self, channel: str, step_m: float, level_db: NDArray[np.float32]) -> None:
        """Show a channel's newest profile; bin i is at ``i * step_m``."""
        if channel not in self._curves:
            order = CHANNELS.index(channel) if channel in CHANNELS else len(self._curves)
            colours = theme.current().curves
            pen = pg.mkPen(colours[order % len(colours)], width=LINE_PX)
            self._curves[channel] = self.item.plot(name=channel, pen=pen, connect="finite")
        self._data[channel] = step_m, level_db
        self._curves[channel].setData(np.arange(len(level_db)) * step_m, level_db)

    def show_range(self, place: tuple[float, float] | None) -> None:
        """Show the range that a view beside this one points at."""
        self.show_cursor(None if place is None else (place[0], self._lines[1].value()))

    def describe(self, x: float, y: float) -> str:
        """Range, and the level of each channel there."""
        parts = [self.tr("range {0:.2f} m").format(x)]
        for channel, (step_m, level_db) in self._data.items():
            bin_ = round(x / step_m)
            if 0 <= bin_ < len(level_db):
                parts.append(f"{channel} {level_db[bin_]:.1f} dBFS")
        return "   ".join(parts)


def demo_profile(seed: int, reach_m: float = 60.0, step_m: float = 0.47) -> NDArray[np.float32]:
    """Noise and three targets, dBFS."""
    rng = np.random.default_rng(seed)
    x = np.arange(0, reach_m, step_m)
    field = rng.rayleigh(1e-4, x.size)
    for at, size in ((7.3, 0.05), (18.0, 0.01 * seed), (41.5, 0.002)):
        field += size * np.abs(np.sinc((x - at) / 1.9))
    level: NDArray[np.float32] = (20 * np.log10(field)).astype(np.float32)
    return level


def _demo() -> QWidget:
    view = ProfileView()
    for number, channel in enumerate(CHANNELS, start=1):
        view.show_profile(channel, 0.47, demo_profile(number))
    return view


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo))
