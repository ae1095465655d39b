"""Uncertainty budgets: how far each result may be off, and which cause has the largest share.

A model turns deviations of all causes into results. First order: the derivative with respect to each cause times its
standard deviation is its contribution, and independent causes add in quadrature (the thesis's 5.16 with the angles,
not the direction cosines, as what is independent). Monte Carlo: all causes are drawn at once, so that curved
dependences and skewed results show (the thesis's trihedral with 5 degrees: 2.56 dB first order, 3.05 dB drawn).
Source: JCGM 100 (GUM) sections 4, 5 and G; JCGM 101 for the Monte Carlo.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from processing.errors import DataError

Floats = NDArray[np.float64]

COVERAGE_FACTOR = 2.0
"""Expanded uncertainties are twice the standard uncertainty: 95.45 % for a normal distribution."""

STEP = 0.05
"""Of a standard deviation, by which each cause is moved for its derivative."""
MOST_LOST = 0.01
"""Share of draws without a result that is left out; with more there is no standard deviation."""

Model = Callable[[Floats], Floats]
"""(draws, inputs) deviations, in the inputs' units, to (draws, outputs) results."""


@dataclass(frozen=True)
class Cause:
    """A cause of error: one or more independent inputs that share a line of the budget."""

    name: str
    sd: tuple[float, ...]
    """Standard deviation of each of its inputs."""
    unit: str
    """Of the inputs, such as "deg", "m" or "dB"."""
    basis: Literal["A", "B"] = "B"
    """"A": from repeated measurements; "B": stated."""
    shape: Literal["normal", "uniform"] = "normal"
    """Of the distribution it is drawn from; a uniform one is ``sqrt(3) sd`` wide to both sides."""
    stated: float | None = None
    """What the line of the budget shows as the cause's size, where that is not the largest ``sd``."""

    @property
    def size(self) -> float:
        """What the line shows as its size, in ``unit``."""
        return max(self.sd, default=0.0) if self.stated is None else self.stated


@dataclass(frozen=True)
class Contribution:
    """One line of a budget."""

    cause: str
    sd: float
    """Size of the cause, in ``unit``."""
    unit: str
    basis: str
    contributions: dict[str, float]
    """Standard uncertainty of each result that comes from this cause, in the result's unit."""


@dataclass(frozen=True)
class Budget:
    """Uncertainties of all results."""

    results: tuple[str, ...]
    values: dict[str, float]
    lines: tuple[Contribution, ...]
    first_order_sd: dict[str, float]
    """Root of the sum of the squared contributions."""
    drawn_sd: dict[str, float]
    """Standard deviation of the Monte Carlo."""
    interval: dict[str, tuple[float, float]]
    """Deviations from the value between which 95 % of the draws lie."""
    draws: int

    def sd(self, result: str) -> float:
        """Standard uncertainty: the larger one of first order and Monte Carlo."""
        return max(self.first_order_sd[result], self.drawn_sd[result])

    def expanded(self, result: str) -> float:
        """Expanded uncertainty, 95 %: twice the standard uncertainty, or the further end of the drawn interval."""
        low, high = self.interval[result]
        return max(COVERAGE_FACTOR * self.sd(result), abs(low), abs(high))

    def table(self) -> list[dict[str, Any]]:
        """Lines for products, JSON and reports: cause, size, unit, basis, and the share in each result."""
        return [
            {"cause": line.cause, "sd": line.sd, "unit": line.unit, "basis": line.basis, **line.contributions}
            for line in self.lines
        ]


def uncertainty_budget(
    model: Model,
    causes: Sequence[Cause],
    results: Sequence[str],
    *,
    draws: int = 1000,
    seed: int = 0,
    angles: Sequence[str] = (),
) -> Budget:
    """Budget of a model's results.

    Args:
        model: all inputs of all causes, in their order, to all results.
        causes: the causes of error; those of size 0 keep a line that says so.
        results: names of the results.
        draws: of the Monte Carlo.
        seed: of its random numbers.
        angles: results that are angles in degrees, whose differences are taken modulo 360.

    Raises:
        DataError: a negative or undefined standard deviation, or a model without a result at the measured values.
    """
    for cause in causes:
        if not all(np.isfinite(sd) and sd >= 0 for sd in cause.sd):
            raise DataError(
                f"the uncertainty of {cause.name} is {cause.sd}", "give finite numbers that are not negative"
            )
    sds = np.array([sd for cause in causes for sd in cause.sd], dtype=np.float64)
    steps = STEP * np.concatenate([np.zeros((1, len(sds))), np.diag(sds), -np.diag(sds)])
    names, turning = tuple(results), np.array([name in angles for name in results])
    found = np.asarray(model(steps), dtype=np.float64)
    centre = found[0]
    if found.shape != (len(steps), len(names)) or not np.isfinite(centre).all():
        bad = [name for name, value in zip(names, centre, strict=False) if not np.isfinite(value)]
        raise DataError(
            f"{', '.join(bad) or 'the model'} has no value as measured",
            "check the targets and the noise of each channel",
        )
    up, down = found[1 : 1 + len(sds)], found[1 + len(sds) :]
    change = 0.5 / STEP * _wrapped(up - down, turning)
    lines, first = [], np.zeros(len(names))
    begin = 0
    for cause in causes:
        own = change[begin : begin + len(cause.sd)]
        begin += len(cause.sd)
        share = np.sqrt(np.sum(own**2, axis=0))
        first = np.hypot(first, share)
        lines.append(
            Contribution(cause.name, cause.size, cause.unit, cause.basis, dict(zip(names, share.tolist(), strict=True)))
        )
    random = np.random.default_rng(seed)
    unit = random.standard_normal((draws, len(sds)))
    flat = np.array([cause.shape == "uniform" for cause in causes for _ in cause.sd], dtype=bool)
    unit[:, flat] = random.uniform(-np.sqrt(3), np.sqrt(3), (draws, int(flat.sum())))
    drawn = _wrapped(np.asarray(model(unit * sds), dtype=np.float64) - centre, turning)
    lost = np.isnan(drawn).mean(axis=0)
    # A model that is undefined in many draws (a target turned out of sight) has no standard deviation.
    with np.errstate(invalid="ignore"):
        sd = np.where(lost > MOST_LOST, np.inf, np.nanstd(drawn, axis=0))
    low, high = np.nanpercentile(drawn, [2.5, 97.5], axis=0)
    return Budget(
        names,
        dict(zip(names, centre.tolist(), strict=True)),
        tuple(lines),
        dict(zip(names, first.tolist(), strict=True)),
        dict(zip(names, sd.tolist(), strict=True)),
        {name: (float(low[i]), float(high[i])) for i, name in enumerate(names)},
        draws,
    )


def mean_sd(values: ArrayLike) -> float:
    """Standard uncertainty of the mean of n repeated measurements, with Student's factor for small n.

    ``s / sqrt(n)`` times the ratio of Student's to the normal 95.45 % quantile for n - 1 degrees of freedom, so that
    twice the result covers 95.45 % whatever n is (JCGM 100, G.6.4). NaN for fewer than two.
    """
    numbers = np.asarray(values, dtype=np.float64)
    if numbers.size < 2:
        return float("nan")
    return float(np.std(numbers, ddof=1) / np.sqrt(numbers.size)) * student_factor(numbers.size - 1)


def student_factor(degrees_of_freedom: int) -> float:
    """By which a standard deviation from so many degrees of freedom is enlarged for twice it to cover 95.45 %."""
    return float(student.ppf(0.5 + 0.9545 / 2, degrees_of_freedom)) / COVERAGE_FACTOR


def _wrapped(difference: Floats, turning: NDArray[np.bool_]) -> Floats:
    finite = np.where(np.isfinite(difference), difference, np.nan)
    return np.asarray(np.where(turning, np.mod(finite + 180.0, 360.0) - 180.0, finite))
