"""Whether two stops along a rail look alike: a position recorded twice, or a cart that moved while the radar was on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError

_ALIKE = 0.1  # of what neighbours differ by (power): below it two stops are one position
_ABOVE_NOISE = 10.0  # typical difference of neighbours over noise, below which nothing can be told


def difference(one: NDArray[np.complexfloating], other: NDArray[np.complexfloating], noise: float = 0.0) -> float:
    """Energy by which two profiles differ, less what noise alone makes; from 0 up.

    Args:
        one: (bins,) profile.
        other: (bins,) another one on the same axis.
        noise: sum of both profiles' noise power in one bin.
    """
    gap = np.abs(np.asarray(one, dtype=np.complex128) - np.asarray(other, dtype=np.complex128)) ** 2
    return float(max(gap.sum() - gap.size * noise, 0.0))


def neighbour_difference(profiles: NDArray[np.complexfloating], noise: NDArray[np.float64]) -> float | None:
    """What neighbouring stops typically differ by; None where that does not stand out of the noise.

    Args:
        profiles: (stops, bins), not range-compensated.
        noise: (stops,) noise power of one bin of each.

    Raises:
        DataError: shapes do not fit.
    """
    _check(profiles, noise)
    if len(profiles) < 3:
        return None
    level = np.nan_to_num(noise)
    steps = [difference(profiles[k], profiles[k + 1], level[k] + level[k + 1]) for k in range(len(profiles) - 1)]
    typical = float(np.median(steps))
    # The noise's own energy scatters by 1 / sqrt(bins): ten times its mean is far outside.
    floor = _ABOVE_NOISE * 2 * float(np.median(level)) * np.sqrt(profiles.shape[1])
    return typical if typical > floor and typical > 0 else None


def repeated(profiles: NDArray[np.complexfloating], noise: NDArray[np.float64]) -> list[int]:
    """Stops that look like the one before them although their other neighbours do not.

    From stop to stop the echoes' phases turn, except where all of them are abreast of the rail: there the scene is
    mirrored about the stop, so that the stops around the pair are alike as well. A stop is reported where the pair
    differs by less than a tenth of what the pair before, the pair behind, and the two stops around the pair differ by.

    Args:
        profiles: (stops, bins), not range-compensated.
        noise: (stops,) noise power of one bin of each; NaN where it is not known.

    Returns:
        Indices k such that stop k looks like stop k - 1; empty where neighbours do not differ by more than noise.

    Raises:
        DataError: shapes do not fit.
    """
    typical = neighbour_difference(profiles, noise)
    if typical is None:
        return []
    level = np.nan_to_num(noise)

    def apart(i: int, j: int) -> float | None:
        if i < 0 or j >= len(profiles):
            return None
        return difference(profiles[i], profiles[j], level[i] + level[j])

    found = []
    for k in range(1, len(profiles)):
        pair = difference(profiles[k - 1], profiles[k], level[k - 1] + level[k])
        around = [apart(k - 2, k - 1), apart(k, k + 1), apart(k - 2, k + 1)]
        if all(pair < _ALIKE * value for value in around if value is not None):
            found.append(k)
    return found


def _check(profiles: NDArray[np.complexfloating], noise: NDArray[np.float64]) -> None:
    if profiles.ndim != 2 or noise.shape != profiles.shape[:1]:
        raise DataError(f"profiles of shape {profiles.shape} and noise of shape {noise.shape}", "give one of each")
