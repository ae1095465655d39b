"""One colour bar for several pictures beside each other."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import pyqtgraph as pg
from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QWidget

from gui import maps, theme
from gui.widgets.picture_view import PictureView, Quantity

WIDTH_PX = 88


class ColourBar(pg.GraphicsLayoutWidget):  # type: ignore[misc]
    """The bar of all ``views``, which show one quantity and have no bars of their own."""

    def __init__(self, quantity: Quantity, views: Sequence[PictureView], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._views = tuple(views)
        self.bar = pg.ColorBarItem(
            colorMap=maps.colour_map(quantity.colours), label=f"{quantity.name} [{quantity.unit}]", interactive=True,
            width=16,
        )  # fmt: skip
        self.ci.setContentsMargins(0, 24, 0, 24)
        self.ci.addItem(self.bar)
        self.bar.setImageItem([view.image for view in self._views])
        self.bar.sigLevelsChanged.connect(self._chosen)
        self.setFixedWidth(WIDTH_PX)
        self._dress()

    def show_limits(self, limits: tuple[float, float]) -> None:
        """Show the limits that the pictures have."""
        if self._views[0].chosen_limits is None:
            self.bar.blockSignals(True)
            self.bar.setLevels(limits)
            self.bar.blockSignals(False)

    def changeEvent(self, event: QEvent) -> None:  # noqa: N802 - Qt's name
        """Another theme was chosen."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "bar"):
            self._dress()

    def _dress(self) -> None:
        shown = theme.current()
        self.setBackground(shown.panel)
        self.bar.axis.setPen(shown.dim)
        self.bar.axis.setTextPen(shown.text)

    def _chosen(self) -> None:
        low, high = self.bar.levels()
        for view in self._views:
            view.choose_limits((float(low), float(high)))


def _demo() -> QWidget:
    from PySide6.QtWidgets import QHBoxLayout

    from gui.widgets.picture_view import demo_image

    widget = QWidget()
    row = QHBoxLayout(widget)
    quantity = Quantity("level", "dB")
    views = [PictureView(quantity, bar=False) for _ in range(2)]
    for view in views:
        view.show_values(*demo_image(), limits=(-45.0, 0.0))
        row.addWidget(view, 1)
    bar = ColourBar(quantity, views)
    bar.show_limits((-45.0, 0.0))
    row.addWidget(bar)
    return widget


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 760, 460))
