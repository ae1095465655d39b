"""Polarized scenes with edges and texture, finer than the pixels, for demosaicing and registration."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Floats = NDArray[np.float64]


def fine_scene(size: int, seed: int, over: int, *, strongest: float = 0.7) -> Floats:
    """S0, S1, S2 (3, size x over, size x over) of shapes with texture before a background, blurred by half a pixel."""
    random = np.random.default_rng(seed)
    fine = size * over
    y, x = np.mgrid[0:fine, 0:fine] / over
    stokes = np.zeros((3, fine, fine))
    stokes[0] = 2e4
    texture = gaussian_filter(random.normal(size=(fine, fine)), over * 1.2)
    texture /= texture.std()
    for _ in range(size * size // 1600 + 8):
        (cx, cy), (a, b), turn = random.uniform(0, size, 2), random.uniform(5, 30, 2), random.uniform(0, np.pi)
        u = (x - cx) * np.cos(turn) + (y - cy) * np.sin(turn)
        v = -(x - cx) * np.sin(turn) + (y - cy) * np.cos(turn)
        inside = (np.abs(u) < a) & (np.abs(v) < b) if random.random() < 0.5 else (u / a) ** 2 + (v / b) ** 2 < 1
        level, dolp, aop = random.uniform(3e3, 5e4), strongest * random.uniform() ** 1.5, random.uniform(0, np.pi)
        state = np.array([1.0, dolp * np.cos(2 * aop), dolp * np.sin(2 * aop)])
        stokes[:, inside] = level * (1 + 0.1 * texture[inside]) * state[:, None]
    return np.stack([gaussian_filter(plane, over * 0.5) for plane in stokes])


def binned(fine: Floats, over: int) -> Floats:
    """Means over the pixels."""
    rows, columns = fine.shape[-2] // over, fine.shape[-1] // over
    means: Floats = fine.reshape(*fine.shape[:-2], rows, over, columns, over).mean(axis=(-3, -1))
    return means
