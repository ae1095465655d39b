"""A map of classes in their own colours, with a legend below; the cursor tells the class by its name."""

from __future__ import annotations

import html
import sys
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QWidget

from gui.widgets.picture_view import PictureView, Quantity
from polfuse_lab.products.fused_colours import class_rgb, colour_of_class


def legend(names: Mapping[int, str]) -> QLabel:
    """The colours of classes with their names, in as many lines as they need."""
    signs = (
        f'<span style="color:{colour_of_class(number)}">■</span>&nbsp;{html.escape(name).replace(" ", "&nbsp;")}'
        for number, name in names.items()
    )
    made = QLabel("\u2003 ".join(signs))
    made.setTextFormat(Qt.TextFormat.RichText)
    made.setWordWrap(True)
    return made


class ClassView(PictureView):
    """A picture whose values are numbers of classes.

    Args:
        title: of the picture.
        names: of the classes.
        ground: axes are metres on the ground; otherwise camera pixels.
    """

    def __init__(self, title: str, names: Mapping[int, str], *, ground: bool = True, parent: QWidget | None = None):
        super().__init__(Quantity(title, ""), ground=ground, bar=False, parent=parent)
        self.names = dict(names)
        self.legend = legend(self.names)
        column = self.layout()
        assert column is not None
        column.addWidget(self.legend)

    def show_classes(
        self,
        labels: NDArray[np.integer],
        x: NDArray[np.floating] | None = None,
        y: NDArray[np.floating] | None = None,
    ) -> None:
        """Show class numbers (rows, columns); negative ones, of no class, are grey."""
        count = max(max(self.names, default=0), int(labels.max(initial=0))) + 1
        self.image.setLookupTable(np.round(255 * class_rgb(np.arange(count))).astype(np.uint8))
        values = np.where(labels < 0, np.nan, labels).astype(np.float32)
        self.show_values(values, x, y, limits=(-0.5, count - 0.5))

    def describe(self, x: float, y: float) -> str:
        """Place and name of the class."""
        where = super().describe(x, y).split("   ")[0]
        number = super().value_at(x, y)
        if number is None:
            return f"{where}   " + self.tr("no class")
        return f"{where}   {self.names.get(int(number), int(number))}"

    def value_at(self, x: float, y: float) -> float | None:
        """None: numbers of classes are no amounts that could be compared."""
        return None


def _demo() -> QWidget:
    y, x = np.mgrid[0:60, 0:80]
    labels = (np.hypot(x - 50, y - 25) < 16).astype(int) + (x + y > 95)
    labels[:12, :20] = -1
    view = ClassView("Classes", {0: "field", 1: "container", 2: "trees behind it"})
    view.show_classes(labels, np.linspace(-4.0, 4.0, 80), np.linspace(3.0, 9.0, 60))
    view.show_cursor((1.0, 5.5))
    return view


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 620, 520))
