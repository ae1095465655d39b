"""A picture of a products file in a view of its kind."""

from __future__ import annotations

from gui import maps
from gui.widgets.picture_view import PictureView, Quantity
from polfuse_lab.products.pictures import Picture

COLOURS = {"level": maps.SEQUENTIAL, "fraction": maps.FRACTION, "angle": maps.CYCLIC, "counts": "gray",
           "number": "cividis", "classes": maps.FRACTION, "colours": "gray"}  # fmt: skip
DIGITS = {"fraction": 3, "counts": 0}


def view_of(picture: Picture) -> PictureView:
    """A view that shows it, with the colours, axes and limits of its kind."""
    kind = picture.kind
    quantity = Quantity(picture.title, picture.unit, COLOURS[kind], digits=DIGITS.get(kind, 1),
                        low=0.0 if kind == "counts" else None)  # fmt: skip
    view = PictureView(quantity, ground=picture.x is not None, bar=kind != "colours")
    view.item.setTitle(picture.title)
    if kind == "colours":
        view.show_colours(picture.values, picture.x, picture.y)
    else:
        values = picture.values.astype("float32")
        if kind == "classes":
            values[values < 0] = float("nan")
        view.show_values(values, picture.x, picture.y, picture.sd, limits=picture.limits)
    view.dress()
    return view
