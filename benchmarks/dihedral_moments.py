"""A strip dihedral by the method of moments: the truth that high-frequency approximations are held against."""

from __future__ import annotations

import numpy as np
from scipy.special import hankel2


def dihedral_by_moments(width: float, range_m: float, tilt_rad: float, cells: int = 12) -> complex:
    """Field that a line source (E along the fold) sees of a strip dihedral, over what it sends to the fold.

    Electric-field integral equation, pulses and point matching (Harrington 1968): exact but for its cells, all edges
    and all bounces in it. The fold is endless; ``|A|^2 4 / k`` is the scattering width at long range.

    Args:
        width: of each face, wavelengths.
        range_m: distance of the line source from the fold, wavelengths.
        tilt_rad: of the line of sight from the bisector, across the fold.
        cells: in a wavelength.
    """
    k, n = 2 * np.pi, int(width * cells)
    s = (np.arange(n) + 0.5) / n * width / np.sqrt(2)
    points = np.concatenate([np.stack([s, s], 1), np.stack([s, -s], 1)])
    cell = width / n
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(distance, 1.0)
    matrix = hankel2(0, k * distance) * cell
    np.fill_diagonal(matrix, cell * (1 - 2j / np.pi * (np.log(k * cell / 4) + np.euler_gamma - 1)))
    away = np.linalg.norm(points - range_m * np.array([np.cos(tilt_rad), np.sin(tilt_rad)]), axis=1)
    current = np.linalg.solve(matrix * k / 4, hankel2(0, k * away) / hankel2(0, k * range_m))
    return complex(-(k / 4) * np.sum(current * hankel2(0, k * away)) * cell / hankel2(0, k * range_m))
