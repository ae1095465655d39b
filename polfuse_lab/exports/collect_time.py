"""Where the antennas were and when, as SICD and CPHD want to know it.

A rail is walked in stop and go; its slow time is therefore made: positions follow one another evenly over the time that
the collect took, in the order along the rail, each held while all channels were recorded.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.placing import session_of
from polfuse_lab.exports.wgs84 import Placement
from polfuse_lab.products.store import Products

NOMINAL_S = 1.0
"""From one position to the next where nothing is known of times."""
HIGHEST_DEGREE = 5
"""Of the polynomial of the track, which SICD's readers should bear."""


@dataclass(frozen=True)
class Collect:
    """A track in slow time."""

    start: datetime
    times_s: NDArray[np.float64]
    """(positions,) the middles of the positions' parts of the collect."""
    duration_s: float
    antenna_m: NDArray[np.float64]
    """(positions, 3) in the rig's coordinates."""
    polynomial_m: NDArray[np.float64]
    """(terms, 3) places in the rig's coordinates as polynomials of slow time, the constant first."""
    told: str
    """Where the times come from."""

    def places_m(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """(…, 3) places on the polynomial."""
        return _values(times_s, self.polynomial_m)

    def velocities_m_s(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """(…, 3) velocities on the polynomial."""
        slope = np.polynomial.polynomial.polyder(self.polynomial_m, axis=0)
        return _values(times_s, slope)

    @property
    def centre_s(self) -> float:
        """Slow time of the aperture's centre."""
        return self.duration_s / 2

    def ecef_polynomial(self, placement: Placement) -> NDArray[np.float64]:
        """:attr:`polynomial_m` in ECEF, m."""
        turned = self.polynomial_m @ placement.axes
        turned[0] += placement.origin_m
        return np.asarray(turned)


def collect_of(products: Products) -> Collect:
    """The track of stage "ranging" in slow time.

    Raises:
        PolfuseError: no such stage, or fewer than two places.
    """
    antenna = np.asarray(products.read("ranging")["antenna_m"], dtype=np.float64)
    if len(antenna) < 2 or not np.ptp(antenna, axis=0).max() > 0:
        raise PolfuseError(
            f"has {len(antenna)} positions at one place, which is no aperture",
            where=str(products.path),
            advice="export a collect along a rail",
        )
    start, duration, told = _times(products, len(antenna))
    times = (np.arange(len(antenna)) + 0.5) * duration / len(antenna)
    polynomial: NDArray[np.float64] = np.zeros((2, 3))
    for degree in range(1, min(HIGHEST_DEGREE, len(antenna) - 1) + 1):
        polynomial = np.asarray(np.polynomial.polynomial.polyfit(times, antenna, degree), dtype=np.float64)
        if np.abs(_values(times, polynomial) - antenna).max() < 1e-4:
            break
    return Collect(start, times, duration, antenna, polynomial, told)


def _values(times_s: NDArray[np.float64], polynomial: NDArray[Any]) -> NDArray[np.float64]:
    return np.asarray(np.moveaxis(np.polynomial.polynomial.polyval(times_s, polynomial), 0, -1), dtype=np.float64)


def _times(products: Products, positions: int) -> tuple[datetime, float, str]:
    session = session_of(products)
    if session is not None:
        from polfuse_lab.session import open_session

        with open_session(session) as opened:
            stamps = np.asarray(opened.sweeps["t_host_ns"], dtype=np.int64)
            if len(stamps) and np.ptp(stamps) > 0:
                begun = float(opened.config["start_unix_s"])
                begun += (int(stamps.min()) - int(opened.config["start_host_ns"])) * 1e-9
                span = float(np.ptp(stamps)) * 1e-9
                start = datetime.fromtimestamp(begun, UTC)
                return start, span * positions / max(positions - 1, 1), "of the session, spread evenly over positions"
    stamp = datetime.fromisoformat(products.provenance("ranging")["time_utc"])
    start = stamp.astimezone(UTC) - timedelta(seconds=NOMINAL_S * positions)
    return start, NOMINAL_S * positions, f"made, {NOMINAL_S:g} s for each position: the session is not there"
