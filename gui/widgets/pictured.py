"""A picture of a products file in a view of its kind."""

from __future__ import annotations

import math
import sys

import numpy as np
import pyqtgraph as pg
from PySide6.QtWidgets import QWidget

from gui import maps
from gui.widgets.class_view import ClassView
from gui.widgets.picture_view import PictureView, Quantity
from gui.widgets.plots import CURSOR
from polfuse_lab.products.pictures import Picture, Track

COLOURS = {"level": maps.SEQUENTIAL, "fraction": maps.FRACTION, "angle": maps.CYCLIC, "counts": "gray",
           "light": "gray", "number": "cividis", "colours": "gray"}  # fmt: skip
DIGITS = {"fraction": 3, "counts": 0, "light": 3}
LETTERS = "#ffffff"
BEHIND = "#000000a0"
"""Ground of words in a picture."""


def view_of(picture: Picture) -> PictureView:
    """A view that shows it, with the colours, axes and limits of its kind."""
    kind = picture.kind
    view: PictureView
    if kind == "classes":
        view = classes = ClassView(picture.title, picture.legend, ground=picture.x is not None)
        classes.show_classes(picture.values, picture.x, picture.y)
    else:
        quantity = Quantity(picture.title, picture.unit, COLOURS[kind], digits=DIGITS.get(kind, 1),
                            low=0.0 if kind in ("counts", "light") else None)  # fmt: skip
        view = PictureView(quantity, ground=picture.x is not None, bar=kind != "colours")
        if kind == "colours":
            view.show_colours(picture.values, picture.x, picture.y)
        else:
            values = picture.values.astype("float32")
            view.show_values(values, picture.x, picture.y, picture.sd, limits=picture.limits)
    view.item.setTitle(picture.title)
    for track in picture.tracks:
        _draw(view, track)
    view.dress()
    return view


def _draw(view: PictureView, track: Track) -> None:
    """The way of something that moved, with an arrow at its end and its velocity."""
    x, y = float(track.x[-1]), float(track.y[-1])
    across, up = x - float(track.x[0]), y - float(track.y[0])
    # Arrows lie on the screen, where angles turn clockwise and zero points to the left.
    turn = 180 + math.degrees(math.atan2(-up if view.ground else up, across))
    words = pg.TextItem(track.words, color=LETTERS, fill=pg.mkBrush(BEHIND), anchor=(0.5, 1.4))
    words.setPos(x, y)
    for item in (
        pg.PlotCurveItem(track.x, track.y, pen=pg.mkPen(CURSOR, width=2)),
        pg.ArrowItem(pos=(x, y), angle=turn, headLen=14, pen=None, brush=CURSOR),
        words,
    ):
        view.item.addItem(item, ignoreBounds=True)


def _demo() -> QWidget:
    from gui.widgets.picture_view import demo_image

    level, x, y = demo_image()
    track = Track(np.array([-1.0, 0.5, 2.0]), np.array([10.0, 10.8, 12.0]), "vx +1.50, vy +1.00 m/s")
    return view_of(Picture("focus.HH", "Focused HH", "level", level, "dB", x, y, limits=(-45.0, 0.0), tracks=(track,)))


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 620, 620))
