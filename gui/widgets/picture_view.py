"""A picture with axes in metres or pixels: amplitudes in dB, fractions, angles, or colours that are made already."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QBrush, QColor
from PySide6.QtWidgets import QGraphicsRectItem, QMenu, QWidget

from gui import maps
from gui.models.cursor import LinkedCursor
from gui.widgets.plots import Plot

MARGIN = 0.02
"""Room around a picture, share of its sides."""
UNDEFINED = "#8a8a8a"
"""Grey of undefined pixels, as in the figures."""


@dataclass(frozen=True)
class Quantity:
    """What a picture shows."""

    name: str
    unit: str
    colours: str = maps.SEQUENTIAL
    low: float | None = None
    """Darkest value; None: by percentile."""
    high: float | None = None
    digits: int = 1


class PictureView(Plot):
    """A picture of ``(rows, columns)`` values, or ``(rows, columns, 3)`` colours, over its axes.

    Args:
        quantity: what the values are.
        ground: axes are metres on the ground, y up; otherwise camera pixels, row 0 at the top.
        axes: other names and units of both axes.
        square: both axes have the same scale.
        bar: show the colour bar.
    """

    def __init__(
        self,
        quantity: Quantity,
        *,
        ground: bool = True,
        axes: tuple[str, str, str, str] | None = None,
        square: bool = True,
        bar: bool = True,
        parent: QWidget | None = None,
    ) -> None:
        labels = axes or (("x", "m", "y", "m") if ground else ("column", "px", "row", "px"))
        super().__init__(*labels, parent=parent)
        self.quantity = quantity
        self._axes = labels
        self.ground = ground
        self._values: NDArray[np.generic] | None = None
        self._sd: NDArray[np.floating] | None = None
        self._box = QRectF()
        self._frozen = False
        self._marks: pg.ImageItem | None = None
        self._limits: tuple[float, float] | None = None
        self._given: tuple[float, float] | None = None
        self._followed: tuple[float, float] | None = None
        self._told: tuple[float, float] | None = None
        self.image = pg.ImageItem(axisOrder="row-major")
        self.image.setZValue(-10)
        self.item.addItem(self.image)
        # Grey shows through where pixels are undefined, not beside the picture.
        self._ground = QGraphicsRectItem()
        self._ground.setBrush(QBrush(QColor(UNDEFINED)))
        self._ground.setPen(pg.mkPen(None))
        self._ground.setZValue(-20)
        self.item.addItem(self._ground, ignoreBounds=True)
        view = self.item.vb
        view.setAspectLocked(square)
        view.invertY(not ground)
        self.bar = pg.ColorBarItem(
            colorMap=maps.colour_map(quantity.colours), label=f"{quantity.name} [{quantity.unit}]", interactive=True,
            width=16,
        )  # fmt: skip
        self.image.setLookupTable(maps.lookup(quantity.colours))
        self._with_bar = bar
        if bar:
            self.bar.setImageItem(self.image, insert_in=self.item)
            self.add_bar(self.bar)
        self.bar.sigLevelsChanged.connect(self._chosen)
        self._by_hand = False
        view.sigRangeChangedManually.connect(self._zoomed)
        view.sigResized.connect(lambda _: self._fit())

    def show_values(
        self,
        values: NDArray[np.floating],
        x: NDArray[np.floating] | None = None,
        y: NDArray[np.floating] | None = None,
        sd: NDArray[np.floating] | None = None,
        *,
        limits: tuple[float, float] | None = None,
        marked: NDArray[np.bool_] | None = None,
    ) -> None:
        """Show values (rows, columns); NaN is grey.

        Args:
            values: in the quantity's unit.
            x: of the columns; None: their numbers.
            y: of the rows.
            sd: standard deviation of each value, for the readout.
            limits: darkest and brightest value, unless others were chosen by hand.
            marked: pixels that are shown in red, such as saturated ones.
        """
        if self._frozen:
            return
        self._values, self._sd = values, sd
        levels = self._limits or limits
        if levels is None:
            levels = self._followed = maps.settled(self._automatic(values), self._followed)
        self.image.setImage(values, autoLevels=False, levels=levels)
        self._place(values.shape[:2], x, y)
        self._given = limits
        self._show_levels(levels)
        self._mark(marked)

    def show_colours(
        self,
        colours: NDArray[np.uint8],
        x: NDArray[np.floating] | None = None,
        y: NDArray[np.floating] | None = None,
    ) -> None:
        """Show colours (rows, columns, 3 or 4)."""
        if self._frozen:
            return
        self._values, self._sd = colours, None
        self.bar.setVisible(False)
        self.image.setImage(colours, autoLevels=False, levels=None)
        self._place(colours.shape[:2], x, y)

    def follow(self, cursor: LinkedCursor) -> None:
        """Share a cursor with other views of the same plane."""
        self.pointed.disconnect(self.show_cursor)
        self.pointed.connect(cursor.move)
        cursor.moved.connect(self.show_cursor)

    @property
    def chosen_limits(self) -> tuple[float, float] | None:
        """Darkest and brightest value as chosen by hand; None: they follow the values."""
        return self._limits

    def choose_limits(self, limits: tuple[float, float] | None) -> None:
        """Keep these limits, whatever values come; None: follow the values again."""
        self._limits = limits

    def choose_colours(self, name: str) -> None:
        """Show the values in the colours of another map, one of :data:`gui.maps.MAPS`."""
        self.bar.setColorMap(maps.colour_map(name))
        self.image.setLookupTable(maps.lookup(name))

    def fill_menu(self, menu: QMenu) -> None:
        """What a right click offers."""
        super().fill_menu(menu)
        if not self._with_bar or self._values is None or self._values.ndim != 2:
            return
        follow = menu.addAction(self.tr("Limits follow the values"), self.automatic_levels)
        follow.setEnabled(self._limits is not None)
        if self.quantity.colours != maps.CYCLIC:  # an angle in other colours would have a seam
            colours = menu.addMenu(self.tr("Colours"))
            for name in (name for name in maps.MAPS if name != maps.CYCLIC):
                colours.addAction(name, partial(self.choose_colours, name))

    def show_everything(self) -> None:
        """The whole picture, and again after each change of the window's size."""
        self._by_hand = False
        self._fit()

    def freeze(self, frozen: bool) -> None:
        """Keep what is shown, whatever comes."""
        self._frozen = frozen

    def automatic_levels(self) -> None:
        """Forget limits that were chosen by hand."""
        self._limits = None
        if self._values is not None and self._values.ndim == 2:
            levels = self._given or self._automatic(self._values.astype(np.float64))
            self.image.setLevels(levels)
            self._show_levels(levels)

    def describe(self, x: float, y: float) -> str:
        """Place and value with unit and, where it is known, uncertainty."""
        x_name, x_unit, y_name, y_unit = self._axes
        digits = 0 if x_unit == "px" else 2
        where = f"{x_name} {x:.{digits}f} {x_unit}, {y_name} {y:.{digits}f} {y_unit}"
        if self._values is None or self._box.isEmpty():
            return where
        rows, columns = self._values.shape[:2]
        column = int((x - self._box.x()) / self._box.width() * columns)
        row = int((y - self._box.y()) / self._box.height() * rows)
        if not (0 <= row < rows and 0 <= column < columns):
            return where
        if self._values.ndim == 3:
            red, green, blue = self._values[row, column, :3]
            return f"{where}   R {red} G {green} B {blue}"
        value = float(self._values[row, column])
        if not np.isfinite(value):
            return f"{where}   {self.quantity.name} " + self.tr("undefined")
        digits = self.quantity.digits
        spread = "" if self._sd is None else f" ± {float(self._sd[row, column]):.{digits}f}"
        return f"{where}   {self.quantity.name} {value:.{digits}f}{spread} {self.quantity.unit}"

    def value_at(self, x: float, y: float) -> float | None:
        """The value at a place; None where there is none, or colours."""
        if self._values is None or self._values.ndim != 2 or self._box.isEmpty():
            return None
        rows, columns = self._values.shape
        column = int((x - self._box.x()) / self._box.width() * columns)
        row = int((y - self._box.y()) / self._box.height() * rows)
        if not (self._box.contains(x, y) and 0 <= row < rows and 0 <= column < columns):
            return None
        value = float(self._values[row, column])
        return value if np.isfinite(value) else None

    def _mark(self, marked: NDArray[np.bool_] | None) -> None:
        if self._marks is None:
            if marked is None or not marked.any():
                return
            self._marks = pg.ImageItem(axisOrder="row-major")
            self._marks.setZValue(-5)
            self.item.addItem(self._marks)
        if marked is None:
            self._marks.setVisible(False)
            return
        red = np.zeros((*marked.shape, 4), np.uint8)
        red[marked] = (255, 40, 40, 255)
        self._marks.setImage(red, autoLevels=False, levels=None)
        self._marks.setRect(self._box)
        self._marks.setVisible(True)

    def _place(self, shape: tuple[int, ...], x: NDArray[np.floating] | None, y: NDArray[np.floating] | None) -> None:
        left, width = _span(x, shape[1])
        bottom, height = _span(y, shape[0])
        box = QRectF(left, bottom, width, height)
        if box != self._box:
            self._box = box
            self._ground.setRect(box)
            self._by_hand = False
            self._fit()
        self.image.setRect(box)
        self.filled()

    def _fit(self) -> None:
        """The whole picture as large as there is room, unless a part was chosen or another view leads this one."""
        led = any(self.item.vb.linkedView(axis) is not None for axis in (0, 1))
        if not (self._by_hand or led or self._box.isEmpty()):
            self.item.setRange(self._box, padding=MARGIN)

    def _zoomed(self) -> None:
        self._by_hand = True

    def _automatic(self, values: NDArray[np.floating]) -> tuple[float, float]:
        low, high = self.quantity.low, self.quantity.high
        if low is not None and high is not None:
            return low, high
        bottom, top = maps.percentile_levels(values)
        return (bottom if low is None else low, top if high is None else high)

    def _show_levels(self, levels: tuple[float, float]) -> None:
        if self._with_bar and levels != self._told:
            self._told = levels
            self.bar.blockSignals(True)
            self.bar.setLevels(levels)
            self.bar.blockSignals(False)

    def _chosen(self) -> None:
        low, high = self.bar.levels()
        self._limits = float(low), float(high)
        self._told = None


def _span(axis: NDArray[np.floating] | None, number: int) -> tuple[float, float]:
    """Start and length of the pixels of one axis, whose values are pixel centres."""
    if axis is None:
        return -0.5, float(number)
    step = float(axis[1] - axis[0]) if len(axis) > 1 else 1.0
    return float(axis[0]) - step / 2, step * number


def demo_image(size: int = 201) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
    """Speckle and two targets in dB, with an undefined corner; and its axes, m."""
    rng = np.random.default_rng(3)
    x, y = np.linspace(-6, 6, size), np.linspace(2, 20, size)
    field = rng.rayleigh(0.02, (size, size))
    for at_x, at_y, amplitude in ((-2.0, 8.0, 1.0), (3.0, 14.0, 0.5)):
        field += amplitude * np.outer(np.abs(np.sinc((y - at_y) / 1.8)), np.abs(np.sinc((x - at_x) / 0.5)))
    level: NDArray[np.float32] = (20 * np.log10(field)).astype(np.float32)
    level[np.add.outer(y, -1.2 * x) < 3.0] = np.nan
    return level, x, y


def _demo() -> QWidget:
    view = PictureView(Quantity("level", "dB", low=-45.0, high=0.0))
    view.show_values(*demo_image())
    view.show_cursor((-2.0, 8.0))
    return view


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 620, 620))
