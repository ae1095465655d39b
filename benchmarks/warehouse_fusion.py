"""The warehouse in both eyes, fused by the repository's own fusion: the data of Table 7.3."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from processing.fusion.confusion import confusion
from processing.fusion.features import fused_vector, normalized_components
from processing.fusion.overlap import Overlap, learn_density, likelier, overlap
from processing.fusion.separability import bayes_bounds, bhattacharyya_unbiased, class_statistics
from processing.fusion.supervised import learn
from processing.polarimetry.pauli import pauli_vector
from processing.sar.grid import ImageGrid
from processing.scene.both_eyes import (
    OpticalPicture,
    RadarPicture,
    bodies_from_above,
    optical_picture,
    sunlight,
)
from processing.scene.solids import SolidScene

Floats = np.ndarray

CLASSES = ("single", "double", "multiple")
KINDS = {"ground": 0, "asphalt": 0, "concrete": 0, "building": 1, "container": 1, "car": 1, "tree": 2}
"""The thesis's classes: grass and asphalt; building, containers and cars; trees (7.3)."""
PAULI, FUSED, RED_BLUE = (0, 1, 2), (0, 1, 2, 3), (0, 2, 3)
"""Components of the fused vector: Table 7.3's three columns."""
LEAST_SNR_DB = 6.0
"""As `polfuse fuse` has it."""
SUN_RAD = {"behind the camera": (0.0, math.pi / 4), "from the side": (math.pi / 2, math.pi / 4)}
"""Azimuth from the camera's and zenith angle: the thesis's Figs. 7.5 and (rather) 7.3."""


@dataclass(frozen=True, eq=False)
class Fused:
    """A scene's fused vectors with their truth."""

    scene: SolidScene
    features: Floats
    """(4, ny, nx), NaN where either eye sees nothing."""
    bodies: Floats
    """(ny, nx) class by what stands there; -1 for others."""
    mechanisms: Floats
    """(ny, nx) class by what returns ten times as much as all other mechanisms together; -1 where none does."""
    grid: ImageGrid
    radar: RadarPicture
    optics: OpticalPicture


def grid_320x150() -> ImageGrid:
    """The thesis's 48 000 pixels (7.5), 0.2 by 0.28 m."""
    return ImageGrid((np.arange(320) - 159.5) * 0.2, (np.arange(150) - 74.5) * 0.28, 0.0)


def fuse(scene: SolidScene, grid: ImageGrid, radar: RadarPicture, sun: str, normalization: str = "pixel") -> Fused:
    """Fuse a radar picture with the camera's."""
    optics = optical_picture(scene, grid, sunlight(*SUN_RAD[sun]))
    hh, hv, vh, vv = radar.channels
    k = pauli_vector(hh, (hv + vh) / 2, vv)
    usable = np.sum(np.abs(k) ** 2, axis=0) > 10 ** (LEAST_SNR_DB / 10) * radar.noise
    components = normalized_components(k, normalization=normalization, usable=usable)  # type: ignore[arg-type]
    above = bodies_from_above(scene, grid)
    kinds = np.array([KINDS.get(solid.kind, -1) for solid in scene.solids])
    strongest = np.argmax(radar.powers, axis=0)
    rest = radar.powers.sum(axis=0) - radar.powers.max(axis=0)
    return Fused(
        scene=scene,
        features=fused_vector(components, optics.dolp),
        bodies=np.where(above >= 0, kinds[above], -1),
        mechanisms=np.where(radar.powers.max(axis=0) > 10 * rest, strongest, -1),
        grid=grid,
        radar=radar,
        optics=optics,
    )


@dataclass(frozen=True)
class Pair:
    """Two classes told apart."""

    distance: float
    """Bhattacharyya's, its bias taken off."""
    lower: float
    upper: float
    """Bounds of the error."""
    error: float
    """Mean share of both classes that a likelihood classifier, learnt elsewhere, tells wrong."""
    by_shape: Overlap
    """Distance, bounds and least error where classes are mixtures of normal parts, learnt elsewhere."""
    error_by_shape: float
    """As ``error``, by the likelier of those mixtures."""
    spread_by_shape: float
    """Standard deviation of that error: squares of pixels are the draws, for pixels of one body are alike."""
    samples: int


def pair(fused: Fused, truth: Floats, components: tuple[int, ...], first: int = 0, second: int = 1) -> Pair:
    """Tell two classes apart by some components; learnt from every other square of 8 pixels, judged on the rest."""
    samples = fused.features[list(components)].reshape(len(components), -1).T
    defined, flat = np.isfinite(samples).all(axis=1), truth.ravel()
    row, column = np.indices(truth.shape)
    odd = ((row // 8 + column // 8) % 2).astype(bool).ravel()
    chosen = [defined & (flat == number) for number in (first, second)]
    statistics = [class_statistics(samples[mask], CLASSES[k]) for mask, k in zip(chosen, (first, second), strict=True)]
    distance = max(bhattacharyya_unbiased(*statistics), 0.0)
    classifier = learn([samples[mask & odd] for mask in chosen], "likelihood")
    densities = [learn_density(samples[mask & odd]) for mask in chosen]
    elsewhere = [samples[mask & ~odd] for mask in chosen]
    both = (chosen[0] | chosen[1]) & ~odd
    truly, by_shape = np.where(flat == second, 1, 0)[both], likelier(densities, samples[both])
    errors = [float(1 - np.mean(confusion(truly, told, 2).producers)) for told in (classifier(samples[both]), by_shape)]
    squares = ((row // 8) * (truth.shape[1] // 8 + 1) + column // 8).ravel()[both]
    spread = math.hypot(*(_spread((by_shape != truly)[truly == k], squares[truly == k]) for k in (0, 1))) / 2
    bounds = bayes_bounds(distance)
    return Pair(distance, *bounds, errors[0], overlap(densities, elsewhere), errors[1], spread, int(both.sum()))


def _spread(wrong: Floats, squares: Floats) -> float:
    """Standard deviation of a share of pixels, squares being the draws (a ratio's, Cochran 1977, 2.11)."""
    counts, errors = (np.bincount(squares, weights) for weights in (None, wrong.astype(float)))
    return float(np.sqrt(np.sum((errors - wrong.mean() * counts) ** 2)) / counts.sum())
