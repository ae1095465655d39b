"""Methods that say what a pixel is rather than how much of something it has: classes, zones, signatures; and the
intensity with the least speckle."""

from __future__ import annotations

import numpy as np

from polfuse_lab.products.decompose_options import Found, Options, averaged, mean_matrix
from polfuse_lab.products.polarimetric_image import PolarimetricImage
from processing.polarimetry.detection.filters import whitened
from processing.polarimetry.h_a_alpha import PARAMETERS, h_a_alpha
from processing.polarimetry.matrices import matrix_of_planes, total_power
from processing.polarimetry.signatures import signature
from processing.polarimetry.wishart import wishart_classify
from processing.polarimetry.zones import NAMES, h_alpha_zones


def zones(image: PolarimetricImage, options: Options) -> Found:
    """Zones of entropy and alpha, with both."""
    found = dict(zip(PARAMETERS, h_a_alpha(averaged(image, options)), strict=True))
    zone = h_alpha_zones(found["entropy"], found["alpha"])
    planes = {"class": zone, "entropy": found["entropy"], "alpha_deg": np.degrees(found["alpha"])}
    return Found(planes, {"classes": list(NAMES)}, _few_looks(options))


def wishart(image: PolarimetricImage, options: Options) -> Found:
    """Wishart classes, found by iteration from the zones of entropy and alpha; named after the zone of their centre."""
    t = averaged(image, options)
    found = dict(zip(PARAMETERS, h_a_alpha(t), strict=True))
    made = wishart_classify(t, h_alpha_zones(found["entropy"], found["alpha"]))
    centre = dict(zip(PARAMETERS, h_a_alpha(made.centres[:, None, :])[:, 0], strict=True))
    names = [NAMES[int(zone)] for zone in h_alpha_zones(centre["entropy"], centre["alpha"])]
    settings = {
        "classes": ["undefined", *(f"{number} {name}" for number, name in enumerate(names, 1))],
        "class_pixels": made.pixels.tolist(),
        "changed": list(made.changed),
        "distance": list(made.distance),
    }
    words = f"{len(made.changed)} iterations, in the last {100 * made.changed[-1]:.1f} % of the pixels changed"
    few = _few_looks(options)
    return Found({"class": made.classes}, settings, f"{words}; {few}" if few else words)


def whitening(image: PolarimetricImage, options: Options) -> Found:
    """Whitened power, scaled to the power of the surroundings, m^2: the intensity with the least speckle."""
    clutter = averaged(image, options)
    return Found({"whitened": whitened(image.coherency(), clutter) * total_power(clutter)})


def signatures(image: PolarimetricImage, options: Options) -> Found:
    """Co- and cross-polarized signature of the mean matrix of a region (thesis Fig. 2.16), m^2."""
    mean, pixels = mean_matrix(image, options.region)
    made = signature(matrix_of_planes(mean))
    axes = {"orientation_deg": np.degrees(made.orientation_rad), "ellipticity_deg": np.degrees(made.ellipticity_rad)}
    settings = {"region": options.region, "pixels": pixels}
    return Found({"co": made.co, "cross": made.cross}, settings, f"mean of {pixels} pixels", axes)


def _few_looks(options: Options) -> str:
    if options.window > 1:
        return ""
    return "single looks have no entropy: their zone says little about the target"
