"""Most likely crosstalk and imbalance of a radar from all that was measured of known targets.

The closed form of :mod:`processing.calibration.whitt` uses three targets and takes their orientation as exact. Here
every channel of every target counts by its noise, and each target may be turned about the line of sight by an angle
whose standard deviation is stated: maximum likelihood for R, T, the targets' factors and those angles at once, by
Gauss-Newton steps from the closed form. What is left over by the fit, over its noise, tells whether the targets are
what they are said to be (chi square).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.calibration.distortion import Complexes, Distortion, channel_values, matrices
from processing.calibration.whitt import factors, solve_targets
from processing.errors import DataError

Floats = NDArray[np.float64]

STEPS = 12
SMALLEST_STEP = 1e-10
"""Of the parameters, relative to HH, at which the iteration ends."""

PAIR = 6
"""R and T hold six complex numbers besides their HH elements."""


class Parameters(NamedTuple):
    """The unknowns, with any leading axes: one set for each draw of a Monte Carlo."""

    receive: Complexes
    """(..., 2, 2), ``R[0, 0] = 1``."""
    transmit: Complexes
    """(..., 2, 2), ``T[0, 0] = 1``."""
    scale: Complexes
    """(..., n) factor of each target."""
    turn_rad: Floats
    """(..., n) by which each target is turned about the line of sight, from its stated orientation, rad."""


class TargetFit(NamedTuple):
    """What the fit found."""

    distortion: Distortion
    parameters: Parameters
    covariance: Floats
    """Of (Re, Im of R01, R10, R11, T01, T10, T11, of each factor over itself, then the angles): first order, from noise
    and stated angles."""
    chi_square: float
    """Squared residuals over their noise, and squared angles over their standard deviations."""
    degrees_of_freedom: int

    @property
    def misfit(self) -> float:
        """Root of chi square over its degrees of freedom: about 1 where the model holds; 0 without any to spare."""
        return float(np.sqrt(self.chi_square / self.degrees_of_freedom)) if self.degrees_of_freedom > 0 else 0.0


def turned(scattering: ArrayLike, angle_rad: ArrayLike) -> Complexes:
    """Scattering matrices (..., 2, 2) of targets turned about the line of sight by angles (...): ``Q S Q^T``.

    A dihedral with its fold at f, turned by d, is one with its fold at f + d.
    """
    angle = np.asarray(angle_rad, dtype=np.float64)
    c, s = np.cos(angle), np.sin(angle)
    q = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
    return np.asarray(q @ np.asarray(scattering, dtype=np.complex128) @ np.swapaxes(q, -1, -2))


def fit_targets(
    measured: ArrayLike,
    noise: ArrayLike,
    expected: ArrayLike,
    turn_sd_rad: ArrayLike,
    *,
    start: Distortion | None = None,
) -> TargetFit:
    """Maximum-likelihood distortion from at least three targets.

    Args:
        measured: (n, 4) complex channel values of each target, in the order HH, HV, VH, VV.
        noise: (n, 4) noise power of each.
        expected: (n, 2, 2) S of each target in its stated orientation; only its shape matters, not its size.
        turn_sd_rad: (n,) standard deviation of its orientation about the line of sight, rad; 0 for exact.
        start: where to begin; the closed form of three targets where left out.

    Raises:
        DataError: values that are not finite, noise that is not positive, too few or too similar targets.
    """
    values, power = np.asarray(measured, dtype=np.complex128), np.asarray(noise, dtype=np.float64)
    s, sd = np.asarray(expected, dtype=np.complex128), np.asarray(turn_sd_rad, dtype=np.float64)
    count = len(values)
    if values.shape != (count, 4) or power.shape != (count, 4) or s.shape != (count, 2, 2) or sd.shape != (count,):
        raise DataError(
            f"targets have shapes {values.shape}, {power.shape}, {s.shape} and {sd.shape}",
            "give (n, 4) values and noise, (n, 2, 2) matrices and (n,) angles",
        )
    if not (np.isfinite(power).all() and (power > 0).all() and np.isfinite(sd).all() and (sd >= 0).all()):
        raise DataError(
            "the noise of a target's channels is not positive, or the error of its angle is negative or undefined",
            "record at least two sweeps for each channel, so that the noise can be measured",
        )
    first = solve_targets(matrices(values), s)
    if start is not None:
        first = first._replace(distortion=start, scale=factors(matrices(values), start.apply(s)))
    begin = Parameters(
        np.asarray(first.distortion.receive),
        np.asarray(first.distortion.transmit),
        np.asarray(first.scale),
        np.zeros(count),
    )
    found = refine(begin, values, power, s, sd, steps=STEPS)
    residual, jacobian = _linearized(found, values, power, s, sd)
    normal = jacobian.T @ jacobian
    scaling = 1 / np.sqrt(np.diag(normal))
    balanced = normal * scaling[:, None] * scaling
    if not np.linalg.cond(balanced) < 1e12 or not all(np.isfinite(part).all() for part in found):
        raise DataError(
            "the targets do not determine crosstalk and imbalance",
            "use three that differ: a trihedral, a dihedral with its fold upright and one with its fold at 45 degrees",
        )
    covariance = np.linalg.inv(balanced) * scaling[:, None] * scaling
    return TargetFit(
        Distortion(found.receive, found.transmit),
        found,
        np.asarray(covariance),
        float(residual @ residual),
        len(residual) - jacobian.shape[1],
    )


def refine(
    start: Parameters, measured: ArrayLike, noise: ArrayLike, expected: ArrayLike, turn_sd_rad: ArrayLike, *, steps: int
) -> Parameters:
    """Gauss-Newton steps from a start, for one or many measurements at once.

    Args:
        start: parameters with leading axes (...), or without any, for all.
        measured: (..., n, 4).
        noise: (n, 4) power.
        expected: (n, 2, 2).
        turn_sd_rad: (n,).
        steps: how many at most; ends where nothing changes any more.

    Returns:
        Parameters with the leading axes of ``measured``; NaN where the steps led nowhere.
    """
    values = np.asarray(measured, dtype=np.complex128)
    lead = values.shape[:-2]
    now = Parameters(*(np.broadcast_to(part, lead + _tail(part, index)).copy() for index, part in enumerate(start)))
    sd = np.asarray(turn_sd_rad, dtype=np.float64)
    for _ in range(steps):
        residual, jacobian = _linearized(now, values, noise, expected, sd)
        transposed = np.swapaxes(jacobian, -1, -2)
        normal = transposed @ jacobian
        scaling = 1 / np.sqrt(np.maximum(np.diagonal(normal, axis1=-2, axis2=-1), np.finfo(float).tiny))
        balanced = normal * scaling[..., :, None] * scaling[..., None, :]
        sound = np.isfinite(balanced).all(axis=(-1, -2), keepdims=True)
        balanced = np.where(sound, balanced, np.eye(balanced.shape[-1]))
        # A little of the unit matrix keeps a singular set from stopping all the others; the fixed point is the same.
        balanced += 1e-13 * np.eye(balanced.shape[-1])
        downhill = (transposed @ residual[..., None])[..., 0] * scaling
        change = -np.linalg.solve(balanced, downhill[..., None])[..., 0] * scaling
        now, largest = _moved(now, change, sd)
        if largest < SMALLEST_STEP:
            break
    return now


def _tail(part: NDArray[np.generic], index: int) -> tuple[int, ...]:
    return part.shape[-2:] if index < 2 else part.shape[-1:]


def _linearized(
    at: Parameters, measured: ArrayLike, noise: ArrayLike, expected: ArrayLike, turn_sd_rad: Floats
) -> tuple[Floats, Floats]:
    """Residuals (..., 9 n) over their noise, angles last, and their Jacobian (..., 9 n, 12 + 3 n).

    Factors are taken relative to themselves and angles relative to their standard deviation, so that the columns are of
    one size.
    """
    values = np.asarray(measured, dtype=np.complex128)
    count = values.shape[-2]
    s = turned(expected, at.turn_rad)
    r, t = at.receive[..., None, :, :], at.transmit[..., None, :, :]
    a = at.scale[..., None, None]
    rs, st = r @ s, s @ t
    model = channel_values(a * (rs @ t))
    # d/d(turn) of Q S Q^T: J S + S J^T with the unit turn J.
    unit = np.array([[0.0, -1.0], [1.0, 0.0]])
    by_turn = channel_values(a * (r @ (unit @ s + s @ unit.T) @ t)) * turn_sd_rad[:, None]
    columns = []
    for row, column in ((0, 1), (1, 0), (1, 1)):
        part = np.zeros(st.shape, dtype=np.complex128)
        part[..., row, :] = st[..., column, :]
        columns.append(channel_values(a * part))
    for row, column in ((0, 1), (1, 0), (1, 1)):
        part = np.zeros(rs.shape, dtype=np.complex128)
        part[..., :, column] = rs[..., :, row]
        columns.append(channel_values(a * part))
    for target in range(count):
        own = np.zeros(model.shape, dtype=np.complex128)
        own[..., target, :] = model[..., target, :]
        columns.append(own)
    # Noise power is shared by real and imaginary part.
    weight = np.sqrt(2 / np.asarray(noise, dtype=np.float64)).reshape(-1)
    lead = model.shape[:-2]
    derivative = np.stack([column.reshape(*lead, -1) * weight for column in columns], axis=-1)
    complex_part = np.concatenate(
        [
            np.concatenate([derivative.real, -derivative.imag], axis=-1),
            np.concatenate([derivative.imag, derivative.real], axis=-1),
        ],
        axis=-2,
    )
    angles = np.zeros((*lead, model.shape[-2] * 4, count), dtype=np.complex128)
    for target in range(count):
        angles[..., 4 * target : 4 * target + 4, target] = by_turn[..., target, :]
    angles *= weight[:, None]
    data = np.concatenate([complex_part, np.concatenate([angles.real, angles.imag], axis=-2)], axis=-1)
    prior = np.zeros((*lead, count, data.shape[-1]))
    prior[..., np.arange(count), data.shape[-1] - count + np.arange(count)] = 1.0
    difference = (model - values).reshape(*lead, -1) * weight
    with np.errstate(divide="ignore", invalid="ignore"):
        standard = np.where(turn_sd_rad > 0, at.turn_rad / turn_sd_rad, 0.0)
    residual = np.concatenate([difference.real, difference.imag, standard], axis=-1)
    return residual, np.concatenate([data, prior], axis=-2)


def _moved(at: Parameters, change: Floats, turn_sd_rad: Floats) -> tuple[Parameters, float]:
    """Parameters after a step, and the largest change of any."""
    count = at.scale.shape[-1]
    half = PAIR + count
    step = change[..., :half] + 1j * change[..., half : 2 * half]
    receive, transmit = at.receive.copy(), at.transmit.copy()
    for index, (row, column) in enumerate(((0, 1), (1, 0), (1, 1))):
        receive[..., row, column] += step[..., index]
        transmit[..., row, column] += step[..., 3 + index]
    turn = at.turn_rad + change[..., 2 * half :] * turn_sd_rad
    finite = np.abs(change[np.isfinite(change)])
    largest = float(finite.max()) if finite.size else 0.0
    return Parameters(receive, transmit, at.scale * (1 + step[..., PAIR:]), turn), largest
