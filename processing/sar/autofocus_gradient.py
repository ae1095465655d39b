"""Errors along the aperture from strong points: phase gradient, and the place of a trolley from the points' phases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.sar.autofocus_chips import Chips
from processing.sar.sharpness import image_entropy

WINDOWS_CELLS = (None, None, 32, 16, 8, 16, None, 32, None)
"""Width along the track, in resolution cells, of what is looked at around each point, round by round; None: no
limit."""

POINT_SD_CELLS = 0.5
"""How far the brightest pixel may be from its target, resolution cells (standard deviation)."""

SHIFT_SD_WAVELENGTHS = 1.0
"""How far a trolley may be from where it is thought to be, in wavelengths (standard deviation of each coefficient)."""


def phase_gradient(chips: Chips, field: Chips) -> NDArray[np.float64]:
    """Phase to turn each position by, (positions,) rad, common to all points (phase gradient autofocus).

    Each round takes the history of each point's brightest pixel over the positions. Without a window the phase is that
    of the histories' first singular vector, the maximum likelihood estimate (Jakowatz, Wahl 1993), which does not add
    up errors of single steps; with a window histories are smoothed, and the gradient ``arg sum conj(g_n) g_(n+1)`` over
    points and channels is summed up (Wahl, Eichel, Ghiglia, Jakowatz 1994), which follows large smooth errors. Works in
    the domain of positions, so that no Fourier relation between image and aperture is needed: any track, any angle.

    Returns the round's phase with the least entropy of ``field``; without its mean and its linear part along the track,
    which would only move the image.
    """
    positions = chips.terms.shape[1]
    best = np.zeros(positions)
    least = entropy_of(field, best)
    for window in WINDOWS_CELLS:
        history = _histories(chips, best[:, None, None])
        if window is None:
            flat = np.moveaxis(history, 1, 0).reshape(positions, -1)
            error = np.unwrap(np.angle(np.linalg.svd(flat, full_matrices=False)[0][:, 0]))
        else:
            smooth = _smooth(history, max(1, positions // window))
            steps = np.angle(np.sum(np.conj(smooth[:, :-1]) * smooth[:, 1:], axis=(0, 2)))
            error = np.concatenate([[0.0], np.cumsum(steps)])
        phase = without_shift(best - error, chips.antenna_m)
        entropy = entropy_of(field, phase)
        if entropy < least:
            best, least = phase, entropy
    return best


def track_of_points(
    chips: Chips, field: Chips, basis: NDArray[np.float64], axis: NDArray[np.float64], *, rounds: int = 8
) -> NDArray[np.float64]:
    """Coefficients of the positions' shift along ``axis`` from how the phases of strong points change, (m,) m.

    With the sight line u from position to point, the history of a pixel that is off its target by d, seen from
    positions that are off by s e, has the phase ``k (u . e s + u . d)``. Its steps from position to position are
    linear in the coefficients of s and in each point's d; both are solved for by weighted least squares, in rounds
    because pixels and sight lines change with the track.

    Args:
        chips: around strong points.
        field: of the image, whose entropy decides which round was best.
        basis: (positions, m) smooth functions that the shift is a sum of.
        axis: (3,) unit vector e.
        rounds: at most so many.
    """
    shift = np.zeros(basis.shape[1])
    best, least = shift, entropy_of(field, np.zeros(len(basis)))
    for _ in range(rounds):
        shift = shift + _solve(chips, basis, axis, basis @ shift)
        entropy = entropy_of(field, field.turn_of_shift(basis @ shift, axis))
        if not entropy < least - 1e-9:
            break
        best, least = shift, entropy
    return best


def entropy_of(chips: Chips, turn_rad: NDArray[np.float64]) -> float:
    """Entropy with the terms turned by (positions,) or (positions, points, pixels) rad."""
    return image_entropy(chips.image(turn_rad if turn_rad.ndim == 3 else turn_rad[:, None, None]))


def without_shift(phase_rad: NDArray[np.float64], antenna_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """A phase (positions,) without its mean and its part linear along the track's main direction."""
    along = along_track(antenna_m)
    return np.asarray(phase_rad - np.polyval(np.polyfit(along, phase_rad, 1), along))


def along_track(antenna_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(positions,) place of each position along the track's main direction, m, from its middle."""
    away = antenna_m - antenna_m.mean(axis=0)
    direction = np.linalg.svd(away, full_matrices=False)[2][0]
    return np.asarray(away @ direction)


def _brightest(chips: Chips, turn_rad: NDArray[np.float64]) -> NDArray[np.intp]:
    return np.asarray(np.argmax(np.sum(np.abs(chips.image(turn_rad)) ** 2, axis=0), axis=1))


def _histories(chips: Chips, turn_rad: NDArray[np.float64]) -> NDArray[np.complex128]:
    """(channels, positions, points) terms of each point's brightest pixel, turned."""
    points, pixel = np.arange(chips.terms.shape[2]), _brightest(chips, turn_rad)
    turned = np.exp(1j * chips.spread(turn_rad)[:, points, pixel])
    return np.asarray(chips.terms[:, :, points, pixel] * turned)


def _smooth(history: NDArray[np.complex128], length: int) -> NDArray[np.complex128]:
    """Running mean over positions, shorter at the ends."""
    padded = np.cumsum(np.pad(history, ((0, 0), (1, 0), (0, 0))), axis=1)
    n = history.shape[1]
    first = np.maximum(np.arange(n) - length // 2, 0)
    last = np.minimum(np.arange(n) + (length + 1) // 2, n)
    return np.asarray((padded[:, last] - padded[:, first]) / (last - first)[None, :, None])


def _solve(
    chips: Chips, basis: NDArray[np.float64], axis: NDArray[np.float64], shift_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    turn = chips.turn_of_shift(shift_m, axis)
    points, pixel = np.arange(chips.terms.shape[2]), _brightest(chips, turn)
    history = chips.terms[:, :, points, pixel] * np.exp(1j * turn[:, points, pixel])
    sight = chips.places_m[points, pixel] - (chips.antenna_m + shift_m[:, None] * axis)[:, None]
    sight /= np.linalg.norm(sight, axis=2, keepdims=True)
    strength = float(np.mean(np.abs(history[np.abs(history) > 0]) ** 2)) if history.any() else 1.0
    unknowns = basis.shape[1] + 2 * len(points)
    normal, right = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    for channel in history:
        for k, own in enumerate(channel.T):
            at = np.flatnonzero(own)
            if len(at) < 2:
                continue
            before, after = at[:-1], at[1:]
            product = own[after] * np.conj(own[before])
            rows = np.zeros((len(before), unknowns))
            by_shift = (sight[:, k] @ axis)[:, None] * basis
            rows[:, : basis.shape[1]] = chips.k_rad_m * (by_shift[after] - by_shift[before])
            place = basis.shape[1] + 2 * k
            rows[:, place : place + 2] = chips.k_rad_m * (sight[after, k, :2] - sight[before, k, :2])
            weight = np.abs(product) / strength
            normal += rows.T @ (weight[:, None] * rows)
            right += rows.T @ (weight * np.angle(product))
    wavelength = 4 * np.pi / chips.k_rad_m
    spreads = np.concatenate(
        [
            np.full(basis.shape[1], SHIFT_SD_WAVELENGTHS * wavelength),
            np.tile(POINT_SD_CELLS * np.array(chips.cell_m), len(points)),
        ]
    )
    normal += np.diag(1 / spreads**2)
    return np.asarray(np.linalg.solve(normal, right)[: basis.shape[1]])
