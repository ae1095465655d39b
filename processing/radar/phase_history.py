"""Echoes sampled at equidistant frequencies, as airborne and stepped-frequency radars deliver them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.radar.ranging import window_weights

BLOCK_PULSES = 64
"""Pulses that are transformed at a time."""


@dataclass(frozen=True)
class PhaseHistory:
    """Echoes ``a exp(-j 4 pi f (R - reference) / c)`` of a point at range R, for each pulse and frequency f."""

    echoes: NDArray[np.complexfloating]
    """(channels, pulses, frequencies)."""
    first_hz: float
    """Lowest frequency."""
    step_hz: float
    """From one frequency to the next, > 0."""
    antenna_m: NDArray[np.float64]
    """(pulses, 3) place of the antennas, float64."""
    reference_m: NDArray[np.float64]
    """(pulses,) range that phases are counted from."""
    channels: tuple[str, ...]

    @property
    def bandwidth_hz(self) -> float:
        """Frequencies times their step."""
        return self.step_hz * int(self.echoes.shape[2])

    @property
    def unambiguous_m(self) -> float:
        """c / 2 step: targets further apart in range than this cannot be told from nearer ones."""
        return SPEED_OF_LIGHT_M_S / (2 * self.step_hz)


def history_profiles(history: PhaseHistory, *, window: str = "taylor", oversampling: int = 8) -> RangeProfiles:
    """Range profiles of a phase history, each of the unambiguous range around its own reference.

    Args:
        history: what was recorded.
        window: over frequency: ``"hann"``, ``"taylor"`` or ``"rectangular"``.
        oversampling: range bins in one resolution cell c / 2B, at least 1.

    Returns:
        Profiles with ``start_m``; amplitudes are those of the echoes (not compensated for range). The centre frequency
        is that of sample ``frequencies // 2``.

    Raises:
        DataError: shapes disagree, values are not finite, or window or oversampling are wrong.
    """
    echoes = np.asarray(history.echoes)
    if echoes.ndim != 3 or echoes.shape[2] < 2 or not echoes.size:
        raise DataError(
            f"a phase history has shape {echoes.shape}", "give (channels, pulses, frequencies), two frequencies or more"
        )
    channels, pulses, count = echoes.shape
    if len(history.channels) != channels:
        raise DataError(f"{channels} channels have {len(history.channels)} names", "name every channel once")
    antenna = np.asarray(history.antenna_m, dtype=np.float64)
    reference = np.asarray(history.reference_m, dtype=np.float64)
    if antenna.shape != (pulses, 3) or reference.shape != (pulses,):
        raise DataError(
            f"{pulses} pulses do not fit {antenna.shape} places and {reference.shape} references",
            "give one place and one reference range for each",
        )
    if not (history.first_hz > 0 and history.step_hz > 0):
        raise DataError(
            f"frequencies from {history.first_hz:g} Hz in steps of {history.step_hz:g} Hz",
            "give positive, increasing frequencies",
        )
    if oversampling < 1:
        raise DataError(f"{oversampling:g} range bins per cell lose information", "give an oversampling of 1 or more")
    half = count // 2
    centre = history.first_hz + half * history.step_hz
    weights = window_weights(window, (np.arange(count) + 0.5) / count - 0.5, 1e9)
    weights = weights / weights.sum()
    bins = count * oversampling
    step = history.unambiguous_m / bins
    turned = np.exp(-4j * np.pi * centre / SPEED_OF_LIGHT_M_S * reference)
    values = np.empty((channels, pulses, bins), dtype=np.complex64)
    # Single precision leaves -130 dB of rounding; in blocks, so that nothing but the result is as large as it is.
    padded = np.zeros((min(pulses, BLOCK_PULSES), bins), dtype=np.complex64)
    for channel in range(channels):
        for first in range(0, pulses, BLOCK_PULSES):
            block = slice(first, min(first + BLOCK_PULSES, pulses))
            held = padded[: block.stop - first]
            weighted = echoes[channel, block] * (weights * turned[block, None])
            held[:, : count - half], held[:, bins - half :] = weighted[:, half:], weighted[:, :half]
            line = scipy.fft.ifft(held, axis=1, norm="forward")
            values[channel, block, : bins // 2] = line[:, bins - bins // 2 :]
            values[channel, block, bins // 2 :] = line[:, : bins - bins // 2]
    return RangeProfiles(
        values=values,
        range_m=step * np.arange(bins),
        antenna_m=antenna,
        channels=history.channels,
        centre_hz=centre,
        bandwidth_hz=history.bandwidth_hz,
        window=window,
        range_compensated=False,
        start_m=reference - step * (bins // 2),
    )
