"""Range over time: each new profile is a new line, the newest at the top."""

from __future__ import annotations

import sys

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtWidgets import QWidget

from gui import maps
from gui.widgets.plots import Plot

SETTLE_DB = 3.0
"""The scale follows the levels in steps of this, so that it does not dance."""


class WaterfallView(Plot):
    """The last profiles as a picture: range to the right, lines downwards into the past.

    Args:
        lines: how many profiles are kept.
    """

    def __init__(self, lines: int = 300, parent: QWidget | None = None) -> None:
        super().__init__("range", "m", "profiles ago", "", parent)
        self._lines_kept = lines
        self._ring: NDArray[np.float32] | None = None
        self._next = self._held = 0
        self._step_m = 1.0
        self._levels = (0.0, 0.0)
        self._limits: tuple[float, float] | None = None
        self.image = pg.ImageItem(axisOrder="row-major")
        self.image.setLookupTable(maps.lookup(maps.SEQUENTIAL))
        self.image.setZValue(-10)
        self.item.addItem(self.image)
        self.item.vb.invertY(True)
        self.bar = pg.ColorBarItem(colorMap=maps.colour_map(maps.SEQUENTIAL), label="level [dBFS]", width=16)
        self.bar.setImageItem(self.image, insert_in=self.item)
        self.add_bar(self.bar)
        self.bar.sigLevelsChanged.connect(self._chosen)

    def add(self, step_m: float, level_db: NDArray[np.float32]) -> None:
        """Add a profile; one of another length or step begins anew."""
        if self._ring is None or self._ring.shape[1] != len(level_db) or step_m != self._step_m:
            self._ring = np.full((self._lines_kept, len(level_db)), np.nan, np.float32)
            self._next = self._held = 0
            self._step_m = step_m
            self.item.setRange(QRectF(0, 0, len(level_db) * step_m, self._lines_kept), padding=0)
            self.filled()
        self._ring[self._next] = level_db
        self._next = (self._next + 1) % self._lines_kept
        self._held = min(self._held + 1, self._lines_kept)

    @property
    def most(self) -> int:
        """How many lines are kept."""
        return self._lines_kept

    @property
    def pixels(self) -> int:
        """How many pixels :meth:`refresh` draws."""
        return 0 if self._ring is None else self._ring.size

    def clear(self) -> None:
        """Forget all lines."""
        self._ring = None
        self.image.clear()

    def show_range(self, place: tuple[float, float] | None) -> None:
        """Show the range that a view beside this one points at."""
        self.show_cursor(None if place is None else (place[0], self._lines[1].value()))

    def refresh(self) -> None:
        """Draw what has been added; once for a frame of the display, however many have come."""
        if self._ring is None:
            return
        newest_first = np.concatenate([self._ring[: self._next][::-1], self._ring[self._next :][::-1]])
        if self._limits is None:
            levels = maps.level_limits(newest_first[: self._held])
            if max(abs(now - before) for now, before in zip(levels, self._levels, strict=True)) > SETTLE_DB:
                self._levels = levels
                self.bar.blockSignals(True)
                self.bar.setLevels(levels)
                self.bar.blockSignals(False)
        self.image.setImage(newest_first, autoLevels=False, levels=self._levels)
        self.image.setRect(QRectF(0, 0, self._ring.shape[1] * self._step_m, self._lines_kept))

    def describe(self, x: float, y: float) -> str:
        """Range, age and level."""
        line, bin_ = int(y), int(x / self._step_m)
        where = self.tr("range {0:.2f} m, {1} profiles ago").format(x, line)
        if self._ring is None or not (0 <= line < self._held and 0 <= bin_ < self._ring.shape[1]):
            return where
        value = float(self._ring[(self._next - 1 - line) % self._lines_kept, bin_])
        return f"{where}   {value:.1f} dBFS"

    def _chosen(self) -> None:
        low, high = self.bar.levels()
        self._levels = self._limits = float(low), float(high)


def _demo() -> QWidget:
    from gui.widgets.profile_view import demo_profile

    view = WaterfallView(lines=120)
    for line in range(120):
        profile = demo_profile(line % 5 + 1)
        view.add(0.47, np.roll(profile, line // 6))
    view.refresh()
    view.show_cursor((7.3, 20.0))
    return view


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 620, 420))
