"""Does the camera find each surface's degree of linear polarization? Truth is the scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.products.checks import Check
from polfuse_lab.products.optics import pinhole_of, series_of
from polfuse_lab.products.store import Products
from processing.optics.regions import region_polarization
from processing.scene.model import Scene
from processing.scene.optical import BACKGROUND, stokes_image

MARGIN_PX = 2
"""Pixels at a surface's edge that are left out: they see two surfaces."""
LEAST_PX = 30
"""Surfaces that show fewer pixels than this are not checked."""


def optics_checks(products_path: Path | str, scene: Scene) -> list[Check]:
    """One check per visible surface, and one for what no surface covers: mean DOLP within its own two sigma.

    Raises:
        PolfuseError: there is no stage "optics".
    """
    products = Products(products_path)
    arrays, settings = products.read("optics"), products.settings("optics")
    series = series_of(settings)
    _, index = stokes_image(scene, pinhole_of(settings))
    checks = []
    for number in (*range(len(scene.surfaces)), BACKGROUND):
        mask = inner(index == number)
        if np.count_nonzero(mask) < LEAST_PX:
            continue
        name = "background" if number == BACKGROUND else scene.surfaces[number].name
        stokes = scene.background_stokes if number == BACKGROUND else scene.surfaces[number].stokes
        found = region_polarization(arrays["s0"], arrays["s1"], arrays["s2"], mask, series)
        checks.append(
            Check(
                f"dolp_{name.replace(' ', '_')}",
                found.dolp,
                float(np.hypot(stokes[1], stokes[2]) / stokes[0]),
                2 * found.dolp_sd,
                "",
                f"Mean DOLP over {found.pixels} pixels against the scene; the tolerance is twice its own uncertainty.",
            )
        )
    return checks


def inner(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The mask without the ``MARGIN_PX`` pixels along its edge."""
    from scipy.ndimage import binary_erosion

    eroded: NDArray[np.bool_] = binary_erosion(mask, np.ones((3, 3), dtype=bool), iterations=MARGIN_PX)
    return eroded
