"""Crosstalk and imbalance from three targets of known scattering matrix, in closed form.

``M_i = a_i R S_i T`` with unknown R, T and unknown complex a_i (a target's place is never known to a fraction of the
wavelength). ``M_1^-1 M_2`` is similar to ``S_1^-1 S_2``, so its eigenvectors give T but for the scale of each, and
those of ``M_2 M_1^-1`` R likewise; a third target that mixes the eigenvectors gives the ratio of the scales.
Trihedral, dihedral with upright (or level) fold and dihedral at 45 degrees are such a set: the unit matrix and two
Pauli matrices.

The sign of V over H on receive and transmit together stays open (it turns the sign of S_hv, which the phase of a
target that shows S_hh and S_hv at once could tell): the sign that keeps the receive phase within 90 degrees is taken.
Source: Whitt, Ulaby, Polatin and Liepa, A general polarimetric radar calibration technique (IEEE TAP 39, 1991).
"""

from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from processing.calibration.distortion import Complexes, Distortion
from processing.errors import DataError

LEAST_CONTRAST = 0.1
"""Least ``|m_1 - m_2| / (|m_1| + |m_2|)`` of the eigenvalues of two targets' quotient: 1 for a trihedral and a
dihedral, 0 for two targets that look alike."""

LEAST_DETERMINANT = 1e-6
"""Of a matrix over its squared norm, for it to be inverted."""


class Solution(NamedTuple):
    """A radar's distortion, and the targets' factors."""

    distortion: Distortion
    scale: Complexes
    """(n,) a_i of ``M_i = a_i R S_i T``."""


def contrast(first: ArrayLike, second: ArrayLike) -> float:
    """How different two targets look, 0 to 1, from their matrices (2, 2) alone; NaN where the first is singular.

    R and T do not change it: ``M_1^-1 M_2`` has the eigenvalues of ``S_1^-1 S_2`` times a factor.
    """
    a, b = np.asarray(first, dtype=np.complex128), np.asarray(second, dtype=np.complex128)
    if not abs(np.linalg.det(a)) > LEAST_DETERMINANT * np.sum(np.abs(a) ** 2):
        return float("nan")
    values = np.linalg.eigvals(np.linalg.solve(a, b))
    total = float(np.sum(np.abs(values)))
    return float(abs(values[0] - values[1])) / total if total > 0 else float("nan")


def roles(expected: ArrayLike) -> tuple[int, int, int] | None:
    """Which of the known targets (n, 2, 2) give the eigenvectors (two) and which one their scales; None if none do."""
    s = np.asarray(expected, dtype=np.complex128)
    best, chosen = LEAST_CONTRAST, None
    for i, j, k in permutations(range(len(s)), 3):
        different = contrast(s[i], s[j])
        if not different > LEAST_CONTRAST:
            continue
        vectors = np.linalg.eig(np.linalg.solve(s[i], s[j]))[1]
        if abs(np.linalg.det(vectors)) < LEAST_CONTRAST:
            continue
        mixing = np.linalg.solve(s[i] @ vectors, s[k] @ vectors)
        size = float(np.linalg.norm(mixing))
        shared = 2 * np.sqrt(abs(mixing[0, 1] * mixing[1, 0])) / size if size > 0 else 0.0
        if (value := different * float(shared)) > best * (1 + 1e-9):
            best, chosen = value, (i, j, k)
    return chosen


def solve_targets(measured: ArrayLike, expected: ArrayLike) -> Solution:
    """R, T and the targets' factors from at least three measured targets.

    Args:
        measured: (n, 2, 2) M[rx, tx].
        expected: (n, 2, 2) their S; how large each is matters for ``scale`` alone.

    Raises:
        DataError: matrices that are not finite or zero, targets that do not suffice, or that look alike as measured.
    """
    m, s = np.asarray(measured, dtype=np.complex128), np.asarray(expected, dtype=np.complex128)
    if m.ndim != 3 or m.shape[1:] != (2, 2) or s.shape != m.shape:
        raise DataError(f"targets have shapes {m.shape} and {s.shape}", "give (n, 2, 2) measured and expected matrices")
    for name, values in (("measured", m), ("expected", s)):
        for index, one in enumerate(values):
            if not np.isfinite(one).all() or not np.any(one):
                raise DataError(
                    f"the {name} matrix of target {index + 1} is {'zero' if np.isfinite(one).all() else 'undefined'}",
                    "measure it again with all four channels",
                )
    chosen = roles(s)
    if chosen is None:
        raise DataError(
            "the targets do not determine crosstalk and imbalance",
            "use three that differ: a trihedral, a dihedral with its fold upright and one with its fold at 45 degrees",
        )
    i, j, k = chosen
    if not contrast(m[i], m[j]) > LEAST_CONTRAST:
        raise DataError(
            f"targets {i + 1} and {j + 1} look alike to the radar", "one of them is not what it is said to be"
        )
    known, x = np.linalg.eig(np.linalg.solve(s[i], s[j]))
    seen, v = np.linalg.eig(np.linalg.solve(m[i], m[j]))
    y = s[i] @ x
    want = known[0] / known[1]
    mixing = np.linalg.solve(y, s[k] @ x)
    candidates = []
    for order in ((0, 1), (1, 0)):
        vectors, have = v[:, order], seen[order[0]] / seen[order[1]]
        e = m[i] @ vectors
        mixed = np.linalg.solve(e, m[k] @ vectors)
        if mixed[1, 0] == 0 or mixed[0, 1] == 0:
            continue
        root = np.sqrt(mixed[0, 1] / mixed[1, 0] * mixing[1, 0] / mixing[0, 1])
        for ratio in (root, -root):
            r = e @ np.diag([ratio, 1]) @ np.linalg.inv(y)
            t = x @ np.diag([1 / ratio, 1]) @ np.linalg.inv(vectors)
            # Eigenvalues tell which vector is which, unless they differ by their sign alone: then an exchange of H and
            # V explains the targets as well, and the solution with the smaller crosstalk is the radar's.
            wrong = abs(want - 1 / want) > 0.2 and abs(have - want) > abs(have - 1 / want)
            turned = (r[1, 1] * np.conj(r[0, 0])).real < 0
            candidates.append((wrong, _leakage(r, t), turned, r, t))
    if not candidates:
        raise DataError(
            f"target {k + 1} shows no mixture of the polarizations that targets {i + 1} and {j + 1} keep apart",
            "check its orientation: a dihedral's fold stands at 45 degrees",
        )
    least = min(leak for wrong, leak, _, _, _ in candidates if not wrong)
    near = [item for item in candidates if not item[0] and item[1] <= least + 1e-6]
    _, _, _, r, t = min(near, key=lambda item: item[2])
    distortion = Distortion(r, t)
    return Solution(distortion, factors(m, distortion.apply(s)))


def factors(measured: ArrayLike, model: ArrayLike) -> Complexes:
    """Least-squares factor a of ``measured = a model``, each (..., 2, 2); (...)."""
    m, p = np.asarray(measured), np.asarray(model)
    return np.asarray(np.sum(np.conj(p) * m, axis=(-1, -2)) / np.sum(np.abs(p) ** 2, axis=(-1, -2)))


def _leakage(receive: Complexes, transmit: Complexes) -> float:
    """Power off the diagonals over that on them; infinite for an empty diagonal."""
    total = 0.0
    for matrix in (receive, transmit):
        straight = abs(matrix[0, 0] * matrix[1, 1])
        total += abs(matrix[0, 1] * matrix[1, 0]) / straight if straight > 0 else float("inf")
    return float(total)
