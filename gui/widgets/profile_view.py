"""Range profiles of the channels, newest over the held maximum."""

from __future__ import annotations

import sys

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtWidgets import QWidget

from gui import maps, theme
from gui.widgets.plots import LINE_PX, Plot

CHANNELS = ("HH", "HV", "VH", "VV")
ROOM_DB = 10.0
"""Free room above and below the curves, and the step in which the scale follows them."""


class ProfileView(Plot):
    """Level in dB over range in metres, a curve for each channel that has come."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("range", "m", "level", "dBFS", parent)
        self.item.showGrid(x=True, y=True, alpha=0.25)
        self._legend = self.item.addLegend(offset=(-8, 8), labelTextColor=theme.current().text)
        self._curves: dict[str, pg.PlotDataItem] = {}
        self._scale = (0.0, 0.0)
        self._data: dict[str, tuple[float, NDArray[np.float32]]] = {}

    def show_profile(self, channel: str, step_m: float, level_db: NDArray[np.float32]) -> None:
        """Show a channel's newest profile; bin i is at ``i * step_m``."""
        if channel not in self._curves:
            self._curves[channel] = self.item.plot(name=channel, pen=_pen(channel, len(self._curves)), connect="finite")
            self.filled()
        self._data[channel] = step_m, level_db
        # A level of nothing at all (the range that the filter takes away) has no place on the scale.
        shown = np.where(level_db > maps.NOTHING_DB, level_db, np.nan)
        self._curves[channel].setData(np.arange(len(level_db)) * step_m, shown)
        self._follow()

    def dress(self) -> None:
        """Take on the colours of the theme."""
        super().dress()
        for number, (channel, curve) in enumerate(getattr(self, "_curves", {}).items()):
            curve.setPen(_pen(channel, number))
        if hasattr(self, "_legend"):
            self._legend.setLabelTextColor(theme.current().text)

    def _follow(self) -> None:
        """Keep all curves in sight; the scale moves in steps, so that it does not dance."""
        levels = np.concatenate([level_db for _, level_db in self._data.values()])
        low, high = maps.percentile_levels(np.where(levels > maps.NOTHING_DB, levels, np.nan), 0.5, 100.0)
        scale = (np.floor(low / ROOM_DB - 0.5) * ROOM_DB, np.ceil(high / ROOM_DB + 0.5) * ROOM_DB)
        before_low, before_high = self._scale
        if not (before_low < low and high < before_high and before_high - before_low < 2 * (scale[1] - scale[0])):
            self._scale = scale
            self.item.setYRange(*scale, padding=0.0)

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


def _pen(channel: str, number: int) -> object:
    colours = theme.current().curves
    order = CHANNELS.index(channel) if channel in CHANNELS else number
    return pg.mkPen(colours[order % len(colours)], width=LINE_PX)


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
