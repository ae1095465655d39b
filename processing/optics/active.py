"""The active mode: polarizers before the light source and before the camera, as transmit and receive of a radar.

Thesis 6.3: I_HH, I_HV, I_VH, I_VV, named source then sensor. They are received powers: the Pauli picture of them,
|I_HH - I_VV|, I_HV, I_HH + I_VV (thesis 6.11), is of powers too and not that of complex amplitudes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.optics.analyser import CONDITION_LIMIT, condition_number, measurement_matrix
from processing.optics.series import SensorNoise
from processing.optics.stokes import SHADOW_SNR, Flag

Floats = NDArray[np.float64]

CHANNELS = ("HH", "HV", "VH", "VV")
"""Order of the channels, source then sensor."""

CROSS_TOLERANCE_RAD = math.radians(3.0)
"""With horizontal and vertical polarizers only, how far they may stand from these angles: 3 degrees leak 0.3 %."""


@dataclass(frozen=True)
class ActiveImage:
    """Intensities of the active mode, float64 planes (rows, columns), NaN where undefined; see ``flags``."""

    intensities: Floats
    """(4, rows, columns) counts behind ideal polarizers, in the order of :data:`CHANNELS`."""
    sds: Floats
    """(4, rows, columns) their standard deviations from random noise, counts."""
    dolp: Floats
    """(HH + VH - HV - VV) / (HH + HV + VH + VV), thesis 6.8: S1 / S0 under unpolarized light. Signed, not debiased."""
    dolp_sd: Floats
    """Its standard deviation from random noise."""
    flags: NDArray[np.uint8]
    """:class:`processing.optics.stokes.Flag`: saturated, shadow, incomplete."""

    @property
    def pauli(self) -> Floats:
        """(3, rows, columns) |I_HH - I_VV|, mean of I_HV and I_VH, I_HH + I_VV, counts: red, green, blue."""
        hh, hv, vh, vv = self.intensities
        return np.stack([np.abs(hh - vv), (hv + vh) / 2, hh + vv])


def channel_weights(
    source_rad: ArrayLike,
    sensor_rad: ArrayLike,
    *,
    source_extinction: float = math.inf,
    sensor_extinction: float = math.inf,
) -> Floats:
    """Weights that make the four channels, behind ideal polarizers, of the intensities at J x K pairs of angles.

    With angles spread over 180 degrees the linear part of the Mueller matrix is solved for by least squares; with
    horizontal and vertical ones only, that part of it which they see. Either way leakage of the polarizers is undone.

    Args:
        source_rad: (J,) transmission axes before the source, from horizontal, radians.
        sensor_rad: (K,) transmission axes before the camera, radians.
        source_extinction: maximum over minimum transmittance of the source's polarizer.
        sensor_extinction: the same of the camera's.

    Returns:
        (4, J, K) in the order of :data:`CHANNELS`.

    Raises:
        DataError: angles that do not determine both horizontal and vertical.
    """
    source = _one_side(source_rad, source_extinction, "source")
    sensor = _one_side(sensor_rad, sensor_extinction, "sensor")
    return np.stack([np.outer(source[i], sensor[k]) for i in (0, 1) for k in (0, 1)])


def active_image(
    light: NDArray[np.floating],
    saturated: NDArray[np.bool_],
    weights: Floats,
    frames: NDArray[np.integer],
    noise: SensorNoise,
    *,
    ambient: NDArray[np.floating] | None = None,
    ambient_frames: NDArray[np.integer] | None = None,
    dark_frames: int = 0,
) -> ActiveImage:
    """The four channels with their errors.

    Args:
        light: (J, K, rows, columns) mean counts above black.
        saturated: (rows, columns).
        weights: (4, J, K) from :func:`channel_weights`.
        frames: (J, K) frames averaged in each.
        noise: of one pixel in one frame.
        ambient: (K, rows, columns) mean counts above black with the source off; subtracted.
        ambient_frames: (K,) frames averaged in each of these.
        dark_frames: dark frames subtracted from all.

    Raises:
        DataError: shapes that do not fit each other.
    """
    count = weights.shape[1:]
    if light.shape != (*count, *saturated.shape) or frames.shape != count:
        raise DataError(
            f"intensities have shape {light.shape}", f"give {(*count, *saturated.shape)} and frames {count}"
        )
    values = np.asarray(light, dtype=np.float64)
    intensities = np.tensordot(weights, values, axes=2)
    variance = noise.variance(values) / frames[..., None, None]
    total_weights = weights[0] + weights[1] + weights[2] + weights[3]
    signed_weights = weights[0] - weights[1] + weights[2] - weights[3]
    wanted = np.stack([*weights, total_weights, signed_weights])
    spread = np.tensordot(wanted**2, variance, axes=2)
    both = np.tensordot(total_weights * signed_weights, variance, axes=2)
    in_all = wanted.sum(axis=(1, 2))
    if ambient is not None:
        if ambient_frames is None or ambient.shape != values.shape[1:] or ambient_frames.shape != count[1:]:
            raise DataError(f"ambient light has shape {ambient.shape}", f"give {values.shape[1:]} and its frames")
        by_sensor = wanted.sum(axis=1)
        intensities = intensities - np.tensordot(by_sensor[:4], ambient, axes=1)
        of_ambient = noise.variance(ambient) / ambient_frames[:, None, None]
        spread = spread + np.tensordot(by_sensor**2, of_ambient, axes=1)
        both = both + np.tensordot(by_sensor[4] * by_sensor[5], of_ambient, axes=1)
    elif dark_frames:
        # Ambient light holds the same dark image, and takes it off again.
        spread = spread + (in_all**2)[:, None, None] * noise.floor / dark_frames
        both = both + in_all[4] * in_all[5] * noise.floor / dark_frames
    sum_, signed = intensities.sum(axis=0), intensities[0] - intensities[1] + intensities[2] - intensities[3]
    undefined = ~np.isfinite(sum_)
    shadow = ~saturated & ~undefined & ~(sum_ > SHADOW_SNR * np.sqrt(spread[4]))
    with np.errstate(divide="ignore", invalid="ignore"):
        dolp = signed / sum_
        dolp_sd = np.sqrt(np.maximum(spread[5] + dolp**2 * spread[4] - 2 * dolp * both, 0.0)) / np.abs(sum_)
    flags = np.zeros(saturated.shape, dtype=np.uint8)
    for where, flag in ((saturated, Flag.SATURATED), (shadow, Flag.SHADOW), (undefined, Flag.INCOMPLETE)):
        flags[where] |= flag.value
    lost = saturated | undefined
    sds = np.sqrt(spread[:4])
    intensities[:, lost] = sds[:, lost] = np.nan
    dolp[lost | shadow] = dolp_sd[lost | shadow] = np.nan
    return ActiveImage(intensities, sds, dolp, dolp_sd, flags)


def _one_side(angles_rad: ArrayLike, extinction: float, side: str) -> Floats:
    """(2, N) weights that make intensity behind ideal horizontal and vertical polarizers of that behind N angles."""
    matrix = measurement_matrix(angles_rad, extinction)
    wanted = np.array([[0.5, 0.5, 0.0], [0.5, -0.5, 0.0]])
    if condition_number(matrix) > CONDITION_LIMIT:
        doubled = 2 * np.atleast_1d(np.asarray(angles_rad, dtype=np.float64))
        crossed = np.all(np.abs(np.sin(doubled)) <= math.sin(2 * CROSS_TOLERANCE_RAD))
        matrix, wanted = matrix[:, :2], wanted[:, :2]
        if not doubled.size or not crossed or np.ptp(np.cos(doubled)) < 1:
            degrees = ", ".join(f"{math.degrees(angle / 2):.4g}" for angle in doubled)
            raise DataError(
                f"the {side}'s polarizer at {degrees} degrees does not tell horizontal from vertical",
                "take 0 and 90 degrees, or three or more angles spread over 180 degrees",
            )
    solved: Floats = wanted @ np.linalg.pinv(matrix)
    return solved
