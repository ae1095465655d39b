"""Random scenes behind a turning polarizer, their images displaced by known amounts: for the planner of registration.

Shapes have closed forms and textures are sums of waves, up to one and a half times the sampling frequency, each turned
by its own phase: so a scene is known at any place, and an image of it displaced by any part of a pixel is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.planner_scenes import Shape, painted, polarized, random_shapes

Floats = NDArray[np.float64]

ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
SIZES = (128, 192, 320)
LARGEST_PX = 3.0
_REACH = 3
"""Frequencies up to half of so many times the sampling frequency."""


class Waves:
    """A texture of mean 0 and variance 1 whose power falls as frequency to the ``slope``, seen by a blurred lens."""

    def __init__(self, rng: np.random.Generator, size: int, slope: float, blur_px: float) -> None:
        count = size * 3 // 2  # what is kept does not go round
        frequency = np.arange(-(_REACH * count // 2), _REACH * count // 2) / count
        self._size, self._count, self._frequency = size, count, frequency
        both = np.hypot(frequency[:, None], frequency)
        both[both == 0] = np.inf
        shape = both ** (-slope / 2) * np.exp(-2 * (np.pi * np.where(both < _REACH, both, 0) * blur_px) ** 2)
        white = rng.normal(size=shape.shape).astype(np.complex64)
        white.imag = rng.normal(size=shape.shape)
        self._waves = white * (shape / np.sqrt((shape**2).sum())).astype(np.float32)

    def at(self, down: float, right: float) -> Floats:
        """(size, size) displaced so far."""
        turned = self._waves * np.exp(-2j * np.pi * self._frequency * down)[:, None].astype(np.complex64)
        turned *= np.exp(-2j * np.pi * self._frequency * right).astype(np.complex64)
        count = self._count
        folded = turned.reshape(_REACH, count, _REACH, count).sum(axis=(0, 2), dtype=np.complex128)
        # Multiples of the sampling frequency are alike on the pixels; frequency -REACH/2 comes first.
        folded = np.roll(folded, -(_REACH * count // 2 % count), (0, 1))
        return np.asarray(np.fft.ifft2(folded).real[: self._size, : self._size] * count**2)


@dataclass(frozen=True)
class Scene:
    """Light and polarization, at any place."""

    size: int
    shapes: list[Shape]
    blur_px: float
    textures: tuple[Waves, ...]
    """Of S0, S1 / S0 and S2 / S0; none of a scene of shapes alone."""
    strength: float
    contrast: float

    def stokes(self, down: float, right: float) -> Floats:
        """(3, size, size) of the scene displaced so far; DOLP below 0.95."""
        y, x = np.mgrid[0 : self.size, 0 : self.size].astype(np.float64)
        stokes = painted(self.shapes, x - right, y - down, self.blur_px)
        if self.textures:
            first, *others = (texture.at(down, right) for texture in self.textures)
            stokes *= np.clip(1 + self.strength * first, 0.05, None)
            stokes = polarized(stokes, [self.contrast * other for other in others])
        return stokes


@dataclass(frozen=True)
class Series:
    """Images behind four angles, each displaced against the first."""

    light: Floats
    """(4, rows, columns) counts with noise."""
    bare: Floats
    """Without noise."""
    truth: Floats
    """Without noise, and none displaced."""
    variance: Floats
    """(4,) of the noise, mean over the pixels, as it follows from the counts."""
    steps: Floats
    """(4, 2) down and right, pixels."""


def random_series(seed: int, sizes: tuple[int, ...] = SIZES) -> Series:
    """A scene and a camera as :func:`benchmarks.planner_scenes.random_mosaic` has them, means of up to 16 frames.

    Shifts are of 0.015 to 3 pixels.
    """
    rng = np.random.default_rng(seed)
    size = int(rng.choice(sizes))
    kind = str(rng.choice(["texture", "shapes", "both"]))
    shapes = [] if kind == "texture" else random_shapes(rng, size, float(rng.uniform(0.05, 0.9)))
    slope, blur = float(rng.uniform(1, 4)), float(rng.uniform(0.3, 1.0))
    textures = () if kind == "shapes" else tuple(Waves(rng, size, slope, blur) for _ in range(3))
    strength = float(rng.uniform(0.03, 0.4))
    # Were the polarization's own texture as strong as the light's, images would have nothing in common.
    contrast = 0.5 * strength * float(rng.uniform() ** 1.5)
    scene = Scene(size, shapes, float(rng.uniform(0.35, 1.2)), textures, strength, contrast)
    far = 10 ** rng.uniform(-1.3, np.log10(LARGEST_PX))
    turn = rng.uniform(0, 2 * np.pi, 3)
    steps = np.zeros((4, 2))
    steps[1:] = far * np.stack([np.sin(turn), np.cos(turn)], axis=1) * rng.uniform(0.3, 1.0, (3, 1))
    level = 10 ** rng.uniform(2.3, 4.5)
    electrons, read = 10 ** rng.uniform(-0.5, 2.0), rng.uniform(0, 5)
    still = scene.stokes(0.0, 0.0)
    rows = [0.5 * np.array([1.0, np.cos(turn), np.sin(turn)]) for turn in 2 * np.radians(ANGLES_DEG)]
    truth = level * np.stack([np.tensordot(row, still, 1) for row in rows])
    moved = [level * np.tensordot(row, scene.stokes(*step), 1) for row, step in zip(rows[1:], steps[1:], strict=True)]
    bare = np.stack([truth[0], *moved])
    frames = int(rng.integers(1, 17))
    light = bare + np.sqrt((bare / electrons + read**2 + 1 / 12) / frames) * rng.normal(size=bare.shape)
    variance = (np.maximum(light, 0).mean(axis=(1, 2)) / electrons + read**2 + 1 / 12) / frames
    return Series(light, bare, truth, variance, steps)
