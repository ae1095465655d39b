"""What a decomposition is told and what it answers, and the averages that it works on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.polarimetric_image import PolarimetricImage
from processing.polarimetry.averaging import window_average
from processing.polarimetry.matrices import total_power
from processing.polarimetry.speckle.nonlocal_means import nonlocal_means
from processing.polarimetry.speckle.quality import estimated_looks
from processing.polarimetry.speckle.refined_lee import refined_lee
from processing.polarimetry.yamaguchi import Model

Named = dict[str, NDArray[Any]]
Region = tuple[float, float, float, float]
"""First and last x and y, m, of an image on the ground; first and last column and row of others."""

FILTERS = {"boxcar": 5, "refined-lee": 7, "nlm": 15}
"""Filters by their names on the command line, and their window's width where nothing else is said, pixels."""


@dataclass(frozen=True)
class Options:
    """What a method may be told."""

    window: int = 5
    """Width of the average, or of what the filter looks at, pixels."""
    model: Model = "rotated"
    """Of Yamaguchi's decomposition."""
    looks: float = 25.0
    """Independent looks in an average, for the bias of entropy."""
    filter: str = "boxcar"
    """One of :data:`FILTERS`."""
    filter_looks: float | None = None
    """Looks of the image before the filter; None: 1 of scattering matrices, else estimated."""
    region: Region | None = None
    """Of a signature; None: the whole image."""


@dataclass(frozen=True)
class Found:
    """What a method found."""

    planes: Named
    settings: dict[str, Any] = field(default_factory=dict)
    """To be kept beside the planes."""
    note: str = ""
    """What a reader of the numbers should know."""
    axes: Named | None = None
    """Axes of the planes where they are no image."""


@dataclass(frozen=True)
class Method:
    """A decomposition as the command knows it."""

    what: str
    compute: Callable[[PolarimetricImage, Options], Named | Found]
    window: int
    """Of the average by default; 1 for methods that look at single pixels."""
    coherent: bool = False
    """Whether it takes no average."""


def averaged(image: PolarimetricImage, options: Options) -> NDArray[Any]:
    """Coherency planes (9, rows, columns) with less speckle.

    Raises:
        DataError: a window that the filter cannot have, or looks that cannot be estimated.
    """
    planes = image.coherency()
    if options.window == 1:
        return planes
    if options.filter == "refined-lee":
        return refined_lee(planes, options.window, looks=looks_before(image, options))
    if options.filter == "nlm":
        looks = looks_before(image, options)
        return nonlocal_means(planes, looks=max(round(looks), 1), search=options.window)
    return window_average(planes, options.window)


def looks_before(image: PolarimetricImage, options: Options) -> float:
    """Equivalent looks of the image as it came. Raises DataError where they cannot be estimated."""
    if options.filter_looks is not None:
        return options.filter_looks
    return 1.0 if image.matrix == "S2" else estimated_looks(total_power(image.planes))


def mean_matrix(image: PolarimetricImage, region: Region | None) -> tuple[NDArray[np.float64], int]:
    """Mean planes (9,) of T over a region, and how many defined pixels it has.

    Raises:
        PolfuseError: there is no defined pixel.
    """
    planes = image.coherency()
    chosen = np.isfinite(planes).all(axis=0)
    if region is not None:
        first_x, last_x, first_y, last_y = region
        rows, columns = planes.shape[1:]
        x, y = image.axes.get("x_m", np.arange(columns)), image.axes.get("y_m", np.arange(rows))
        chosen &= ((y >= first_y) & (y <= last_y))[:, None] & ((x >= first_x) & (x <= last_x))
    if not chosen.any():
        raise PolfuseError(
            "has no defined pixel in the region" if region else "has no defined pixel",
            where=image.where,
            advice="give --region as FROM_X,TO_X,FROM_Y,TO_Y in metres (columns and rows of an imported image)",
        )
    return planes[:, chosen].astype(np.float64).mean(axis=1), int(chosen.sum())
