"""Parallel lines through pairs of clock readings, with the uncertainty of every place on them.

The model of a pair: the host's time at the device's stamp is ``a_p + (1 + b) x``, with an offset for each piece ``p``
and one rate for all, and the pair misses it by

* ``c (r - r_0)/2``: what an exchange of length ``r`` took longer than the shortest one, it took on one way rather than
  the other, in the same share in all pairs (``c`` = -1 ... 1: only queries, or only answers, are late);
* ``l r/2`` times a random number: this share is not the same each time;
* up to ``r_0/2``: the shortest exchange may itself be asymmetric, which no pair can show, and less so or more at the
  end than at the beginning, which looks like a rate;
* ``s`` times a random number: whatever the round trip does not tell.

Offsets, rate and asymmetry follow from linear least squares with priors (Gelman et al., Bayesian Data Analysis, 3rd
ed., section 14.8); ``s`` and ``l`` are not known, so that the answer is averaged over a grid of them, each with the
weight that the pairs give it (the marginal likelihood). So one pair, two pairs and a thousand need no rule of their
own: few pairs leave the round trip and a usual clock's rate as what is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RATE_SD = 500e-6
"""Rates of clocks, before a pair is seen: standard deviation from 1."""
ASYMMETRY_SD = 1 / np.sqrt(3)
"""That of the asymmetry, which may be anything from -1 to 1."""
USUAL_SCATTER_S = 50e-6
"""Scatter of stamps that round trips do not tell, before a pair is seen: the middle of a log-normal distribution."""
SCATTER_SPREAD = 1.4
"""Its standard deviation in natural logarithms."""

_SCATTERS = np.geomspace(1e-8, 2e-2, 30)
_UNEVEN = np.array([0.0, 0.06, 0.12, 0.25, 0.4, 0.577, 0.8])
LATE_SHARE = 2 / 3
"""Share of the variance of what round trips do not tell that may shift all pairs alike: stamps are either late now and
then, and an exponential delay has a mean as large as its standard deviation, or scatter both ways, half as likely."""
WANDER_PAIRS = 8
"""Fewest pairs that can show that a clock's rate changes."""


@dataclass(frozen=True)
class CommonRate:
    """Lines ``y = offset[p] + excess_rate * x``, one for each piece, and how well they are known."""

    offset_s: Floats
    """(pieces,)"""
    excess_rate: float
    """Rate less 1."""
    offset_var: Floats
    """(pieces,) variance of the offset, s^2."""
    offset_rate_cov: Floats
    """(pieces,) covariance of offset and rate, s."""
    rate_var: float
    common_var: float
    """Variance of what shifts all pairs alike and so cannot be seen, s^2."""
    residual_s: Floats
    """(n,) what the pairs miss the lines by, their common asymmetry taken off."""

    def variance(self, piece: NDArray[np.intp], x: Floats) -> Floats:
        """Variance of the line at ``x``, s^2."""
        drawn = self.offset_var[piece] + 2 * x * self.offset_rate_cov[piece] + x * x * self.rate_var
        total: Floats = np.maximum(drawn, 0.0) + self.common_var
        return total


def fit_lines(x: Floats, y: Floats, trip: Floats, piece: NDArray[np.intp]) -> CommonRate:
    """Fit parallel lines by least squares, averaged over what is not known of the scatter.

    Args:
        x: (n,) device's time from the reference of its piece, s.
        y: (n,) host's time from the reference of its piece, less ``x``, s.
        trip: (n,) length of the exchange, s.
        piece: (n,) number of the piece, from 0, rising; each has at least one pair.
    """
    shortest = float(trip.min()) / 2
    longer = trip / 2 - shortest
    grid = [_Cells(x, y, longer, uneven * trip / 2, piece) for uneven in _UNEVEN]

    def joined(name: str) -> Floats:
        return np.concatenate([getattr(cells, name) for cells in grid])

    evidence = joined("log_evidence")
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    rates, asymmetries, offsets = joined("rate"), joined("asymmetry"), joined("offset")
    rate, asymmetry, offset = float(weight @ rates), float(weight @ asymmetries), weight @ offsets
    residual: Floats = y - offset[piece] - rate * x - asymmetry * longer
    offset_var = weight @ (joined("offset_var") + (offsets - offset) ** 2)
    covariance = weight @ (joined("offset_rate_cov") + (offsets - offset) * (rates - rate)[:, None])
    rate_var = float(weight @ (joined("rate_var") + (rates - rate) ** 2))
    tilt_var, middle = _tilt(x, shortest, piece)
    scatter_var = float(weight @ np.tile(_SCATTERS**2, len(_UNEVEN)))
    variance: Floats = scatter_var + float(weight @ np.repeat(_UNEVEN**2, len(_SCATTERS))) * (trip / 2) ** 2
    return CommonRate(
        offset_s=offset,
        excess_rate=rate,
        offset_var=offset_var + tilt_var * middle**2,
        offset_rate_cov=covariance - tilt_var * middle,
        rate_var=rate_var + tilt_var,
        common_var=(shortest * ASYMMETRY_SD) ** 2 + scatter_var * LATE_SHARE + _wander_var(residual, variance, piece),
        residual_s=residual,
    )


class _Cells:
    """The fits for all scatters of the grid and one unevenness. Offsets are eliminated by centring the pieces."""

    def __init__(self, x: Floats, y: Floats, longer: Floats, uneven_s: Floats, piece: NDArray[np.intp]) -> None:
        first = np.flatnonzero(np.diff(piece, prepend=-1))
        variance = _SCATTERS[:, None] ** 2 + uneven_s**2
        w = 1 / variance
        total = np.add.reduceat(w, first, axis=1)

        def centre(values: Floats) -> Floats:
            return np.asarray(np.add.reduceat(w * values, first, axis=1) / total)

        at_x, at_y, at_r = centre(x), centre(y), centre(longer)
        dx, dy, dr = x - at_x[:, piece], y - at_y[:, piece], longer - at_r[:, piece]
        xx, xr, rr = (w * dx * dx).sum(1), (w * dx * dr).sum(1), (w * dr * dr).sum(1)
        xx, rr = xx + 1 / RATE_SD**2, rr + 1 / ASYMMETRY_SD**2
        xy, ry = (w * dx * dy).sum(1), (w * dr * dy).sum(1)
        determinant = xx * rr - xr * xr
        self.rate_var, cov, var = rr / determinant, -xr / determinant, xx / determinant
        self.rate, self.asymmetry = self.rate_var * xy + cov * ry, cov * xy + var * ry
        rate, asymmetry = self.rate[:, None], self.asymmetry[:, None]
        self.offset = at_y - rate * at_x - asymmetry * at_r
        self.offset_rate_cov = -(at_x * self.rate_var[:, None] + at_r * cov[:, None])
        self.offset_var = (
            1 / total + at_x**2 * self.rate_var[:, None] + 2 * at_x * at_r * cov[:, None] + at_r**2 * var[:, None]
        )
        # From the residuals themselves: differences of large sums would lose the small ones.
        left = dy - rate * dx - asymmetry * dr
        misfit = (w * left**2).sum(1) + (self.rate / RATE_SD) ** 2 + (self.asymmetry / ASYMMETRY_SD) ** 2
        prior = (np.log(_SCATTERS / USUAL_SCATTER_S) / SCATTER_SPREAD) ** 2
        spread = np.log(variance).sum(1) + np.log(total).sum(1) + np.log(determinant)
        self.log_evidence = -0.5 * (spread + misfit + prior)


def _tilt(x: Floats, shortest_s: float, piece: NDArray[np.intp]) -> tuple[float, Floats]:
    """Variance of the rate by which a slow change of the shortest exchange's asymmetry tilts all lines; their middles.

    Were it the same all the time there would be no tilt; were its values at both ends independent, the variance of
    their difference over the time between would be twice that of one. Half of that is taken, and no more than clocks'
    rates differ.
    """
    first = np.flatnonzero(np.diff(piece, prepend=-1))
    begin, end = x[first], x[np.append(first[1:], len(x)) - 1]
    span = float(np.max(end - begin))
    rate_sd = min(shortest_s * ASYMMETRY_SD, RATE_SD * span) / span if span > 0 else 0.0
    return rate_sd**2, (begin + end) / 2


def _wander_var(residual: Floats, variance: Floats, piece: NDArray[np.intp]) -> float:
    """Variance of a clock whose rate changes, s^2: that of the residuals, where neighbours agree too often in sign."""
    n = len(residual)
    relative = np.clip(residual / np.sqrt(variance), -3, 3)
    power = np.sum(relative**2)
    if n < WANDER_PAIRS or power == 0:
        return 0.0
    same = piece[1:] == piece[:-1]
    # Of n independent values the correlation of neighbours has a standard deviation of 1 / sqrt(n).
    correlation = float(np.sum((relative[1:] * relative[:-1])[same]) / power)
    if correlation < 2 / np.sqrt(n):
        return 0.0
    return float(np.sum(residual**2 / variance) / np.sum(1 / variance))
