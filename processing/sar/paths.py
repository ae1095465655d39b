"""From the antennas over a place and back: ranges of monostatic and bistatic channels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.radar.profiles import RangeProfiles
from processing.sar.grid import Places


def channel_groups(profiles: RangeProfiles) -> list[tuple[AntennaPair, list[int]]]:
    """Channels (their indices) that share their antennas' phase centres, and so their geometry.

    Raises:
        DataError: the pairs do not fit the channels, or are not finite.
    """
    channels = len(profiles.values)
    if profiles.pairs is None:
        return [(AntennaPair(), list(range(channels)))]
    if len(profiles.pairs) != channels or not np.isfinite([(p.transmit_m, p.receive_m) for p in profiles.pairs]).all():
        raise DataError(
            f"{channels} channels need {channels} finite pairs of antennas, found {len(profiles.pairs)}",
            "give the phase centres of every channel's transmitting and receiving antenna",
        )
    groups: dict[AntennaPair, list[int]] = {}
    for channel, pair in enumerate(profiles.pairs):
        groups.setdefault(pair, []).append(channel)
    return list(groups.items())


def range_to(antenna_m: NDArray[np.float64], pair: AntennaPair, places: Places) -> NDArray[np.float64]:
    """Half the path from transmitter over places to receiver, m, the places' shape.

    Args:
        antenna_m: (3,) the platform's point.
        pair: the antennas' phase centres on it.
        places: x, y and z of the places.
    """
    there = _distance(antenna_m + np.asarray(pair.transmit_m), places)
    if pair.receive_m == pair.transmit_m:
        return there
    return 0.5 * (there + _distance(antenna_m + np.asarray(pair.receive_m), places))


def radial_velocity(
    antenna_m: NDArray[np.float64], velocity_m_s: NDArray[np.float64], pair: AntennaPair, places: Places
) -> NDArray[np.float64]:
    """Velocity at which half the path to places grows, m/s, the places' shape; arguments as in :func:`range_to`."""
    total = np.zeros(places[0].shape)
    for offset in (pair.transmit_m, pair.receive_m):
        antenna = antenna_m + np.asarray(offset)
        along = sum((axis - place) * v for axis, place, v in zip(places, antenna, velocity_m_s, strict=True))
        with np.errstate(invalid="ignore", divide="ignore"):
            total -= 0.5 * along / _distance(antenna, places)
    return total


def _distance(antenna_m: NDArray[np.float64], places: Places) -> NDArray[np.float64]:
    squares = sum((axis - place) ** 2 for axis, place in zip(places, antenna_m, strict=True))
    return np.asarray(np.sqrt(squares), dtype=np.float64)
