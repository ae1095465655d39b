"""Read arrays, settings and provenance out of a products file, and draw one's own picture.

python examples/own_picture.py demo/products.h5
"""

import sys

import numpy as np

import polfuse_lab as pf
from polfuse_lab.products import style


def main(path: str) -> None:
    """Total power of the calibrated image over the ground."""
    products = pf.Products(path)
    print("stages:", ", ".join(products.stages()))
    print("made with:", products.provenance("calibration")["versions"])

    arrays = products.read("calibration")
    total = np.sqrt(np.sum(np.abs(arrays["scattering"]) ** 2, axis=0))

    figure = style.new_figure(title="Total power")
    axes = figure.add_subplot()
    picture = style.db_image(axes, total, arrays["x_m"], arrays["y_m"], span_db=40)
    style.metres(axes)
    style.colour_bar(picture, axes, "RCS [dBsm]", extend="min")
    print("figure:", style.save(figure, "total_power.png"))


if __name__ == "__main__":
    main(sys.argv[1])
