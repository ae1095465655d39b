"""What a radar will see before it has looked: gain of its antennas, noise-equivalent RCS and sigma zero, swath."""

from __future__ import annotations

import math

import numpy as np

from processing.errors import DataError
from processing.radar.antenna import pattern_exponent
from processing.radar.ranging import window_weights

BOLTZMANN_J_K = 1.380649e-23
STANDARD_K = 290.0
"""Temperature that noise figures refer to."""


def antenna_gain(beamwidth_rad: float) -> float:
    """Gain on the axis of a lossless antenna with the power pattern ``cos^n``: 2 (n + 1).

    From ``4 pi`` over the pattern's integral over the half space ahead.

    Raises:
        DataError: the beam width is not between 0 and pi.
    """
    return 2 * (pattern_exponent(beamwidth_rad) + 1)


def window_loss(window: str) -> float:
    """Factor by which a window over the ramp raises noise over signal: ``mean(w^2) / mean(w)^2`` (Harris 1978).

    Raises:
        DataError: unknown window.
    """
    weights = window_weights(window, (np.arange(4096) + 0.5) / 4096 - 0.5, 1e9)
    return float(np.mean(weights**2) / np.mean(weights) ** 2)


def noise_equivalent_rcs_m2(
    range_m: float,
    *,
    wavelength_m: float,
    power_w: float,
    gain: float,
    noise_figure_db: float,
    seconds: float,
    window: str = "hann",
) -> float:
    """RCS that gives a focused image the power of thermal noise, m^2.

    The radar equation in energies (thesis 2.33, with G = 4 pi A / wavelength^2):
    ``(4 pi)^3 R^4 k T F loss / (P G^2 wavelength^2 t)``, t the time over which echoes are summed coherently.

    Args:
        range_m: distance R.
        wavelength_m: of the centre frequency.
        power_w: transmitted.
        gain: of each antenna toward the target.
        noise_figure_db: of the receiver, at 290 K.
        seconds: all up-ramps of a channel that make up the image.
        window: over the ramp.

    Raises:
        DataError: a quantity that is not positive and finite, or an unknown window.
    """
    values = {"range": range_m, "wavelength": wavelength_m, "power": power_w, "gain": gain, "time": seconds}
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise DataError(f"a {name} of {value:g} has no noise-equivalent RCS", "give a positive one")
    noise = BOLTZMANN_J_K * STANDARD_K * 10 ** (noise_figure_db / 10) * window_loss(window)
    return (4 * math.pi) ** 3 * range_m**4 * noise / (power_w * gain**2 * wavelength_m**2 * seconds)


def beam_swath_m(height_m: float, depression_rad: float, beamwidth_rad: float) -> tuple[float, float]:
    """Ground range that the half-power beam covers, m: nearest and furthest (infinite where it looks above ground).

    Args:
        height_m: antennas above the ground.
        depression_rad: of their axes below horizontal.
        beamwidth_rad: half-power, full angle.

    Raises:
        DataError: no height, or a beam that looks up only.
    """
    steep, flat = depression_rad + beamwidth_rad / 2, depression_rad - beamwidth_rad / 2
    if not height_m > 0 or steep <= 0:
        raise DataError("the antennas' beam does not meet the ground", "look down, from above the ground")
    nearest = 0.0 if steep >= math.pi / 2 else height_m / math.tan(steep)
    return nearest, math.inf if flat <= 0 else height_m / math.tan(flat)
