"""Four antennas in four places: what that does to the phases between channels, and how well it is corrected.

Each channel has its own pair of antennas, so a target's path differs from channel to channel, and the difference
depends on where the target stands. Focusing with the rig file's phase centres follows each path. Where they are left
out (the thesis takes all antennas to be in one place), a calibration target takes off the difference at its own
place, and what is left elsewhere is a phase between the channels that a scatterer does not have.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.sar.paths import range_to

Floats = NDArray[np.float64]


def path_phases(
    antenna_m: ArrayLike,
    pairs: Sequence[AntennaPair],
    places_m: ArrayLike,
    wavelength_m: float,
    weights: ArrayLike | None = None,
) -> Floats:
    """Phase of each channel over that of an antenna at the recorded place, as an image that ignores the pairs shows it.

    The image sums the positions, so this is the phase of the mean of ``exp(-j 4 pi (R_pair - R) / lambda)`` over them.

    Args:
        antenna_m: (positions, 3) recorded places, m.
        pairs: phase centres of each channel.
        places_m: (targets, 3), m.
        wavelength_m: m.
        weights: (positions,) with which the image sums them; equal where left out.

    Returns:
        (channels, targets) rad, in (-pi, pi].

    Raises:
        DataError: a wavelength that is not positive, or no position.
    """
    antennas = np.atleast_2d(np.asarray(antenna_m, dtype=np.float64))
    places = np.atleast_2d(np.asarray(places_m, dtype=np.float64))
    if not wavelength_m > 0 or antennas.shape[1:] != (3,) or not len(antennas):
        raise DataError(f"{len(antennas)} positions and a wavelength of {wavelength_m} m", "give both")
    share = np.ones(len(antennas)) if weights is None else np.asarray(weights, dtype=np.float64)
    axes = (places[:, 0], places[:, 1], places[:, 2])
    found = np.empty((len(pairs), len(places)))
    for channel, pair in enumerate(pairs):
        sums = np.zeros(len(places), dtype=np.complex128)
        for antenna, weight in zip(antennas, share, strict=True):
            longer = range_to(antenna, pair, axes) - range_to(antenna, AntennaPair(), axes)
            sums += weight * np.exp(-4j * np.pi * longer / wavelength_m)
        found[channel] = np.angle(sums)
    return found


def ignored_phase(
    antenna_m: ArrayLike,
    pairs: Sequence[AntennaPair],
    places_m: ArrayLike,
    calibrated_at_m: ArrayLike,
    wavelength_m: float,
) -> Floats:
    """Phase error of each channel over the first one when phase centres are ignored but a target was calibrated on.

    Args:
        antenna_m, pairs, places_m, wavelength_m: as in :func:`path_phases`.
        calibrated_at_m: (3,) place of the calibration target, whose phases were set right.

    Returns:
        (channels, targets) rad, in (-pi, pi]; 0 for the first channel and at the calibration target.
    """
    reference = np.asarray(calibrated_at_m, dtype=np.float64).reshape(1, 3)
    places = np.concatenate([reference, np.atleast_2d(np.asarray(places_m, dtype=np.float64))])
    phases = path_phases(antenna_m, pairs, places, wavelength_m)
    over_first = phases - phases[:1]
    return np.asarray(np.angle(np.exp(1j * (over_first[:, 1:] - over_first[:, :1]))))


def offset_phase_sd(
    antenna_m: ArrayLike,
    pairs: Sequence[AntennaPair],
    places_m: ArrayLike,
    calibrated_at_m: ArrayLike,
    wavelength_m: float,
    offset_sd_m: float,
) -> Floats:
    """Standard deviation of the phases between channels that comes from how well the phase centres are known.

    First order in independent errors of each coordinate of each antenna; an antenna that two channels share moves both.

    Args:
        antenna_m, pairs, places_m, calibrated_at_m, wavelength_m: as in :func:`ignored_phase`.
        offset_sd_m: standard deviation of each coordinate of each phase centre, m.

    Returns:
        (channels, targets) rad, over the first channel.
    """
    step = 1e-4
    variance = np.zeros((len(pairs), len(np.atleast_2d(np.asarray(places_m)))))
    base = ignored_phase(antenna_m, pairs, places_m, calibrated_at_m, wavelength_m)
    for side in ("transmit_m", "receive_m"):
        for centre in sorted({getattr(pair, side) for pair in pairs}):
            for axis in range(3):
                moved = tuple(value + step * (index == axis) for index, value in enumerate(centre))
                shifted = [
                    AntennaPair(**{**vars(pair), side: moved}) if getattr(pair, side) == centre else pair
                    for pair in pairs
                ]
                change = ignored_phase(antenna_m, shifted, places_m, calibrated_at_m, wavelength_m) - base
                variance += (np.angle(np.exp(1j * change)) / step * offset_sd_m) ** 2
    return np.sqrt(variance)
