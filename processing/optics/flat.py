"""What a sensor's pixels make of equal light: linearity, and the flat field with its dead pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError, undefined_is_nan
from processing.optics.mosaic import Mosaic

Floats = NDArray[np.float64]

DEAD_BELOW, HOT_ABOVE = 0.2, 5.0
"""Pixels whose response is outside these factors of the others' are not used."""


@dataclass(frozen=True)
class Linearity:
    """Light from counts above black: ``light = x (1 + c1 x + c2 x^2 ...)``, with slope 1 where there is little light.

    Raises:
        DataError: coefficients that are not finite, or with which light does not grow with counts up to ``until``.
    """

    coefficients: tuple[float, ...] = ()
    """c1, c2, ... per count, per count^2, ..."""
    until_counts: float = math.inf
    """Largest counts above black that they were found from."""
    residual: float = 0.0
    """Largest deviation of the fitted series from proportionality, relative."""

    def __post_init__(self) -> None:
        if not all(math.isfinite(c) for c in self.coefficients):
            raise DataError("a coefficient of the linearity is not finite", "measure it again")
        if self.coefficients and math.isfinite(self.until_counts):
            slope = self.slope(np.linspace(0.0, self.until_counts, 257))
            if not np.all(slope > 0):
                raise DataError(
                    f"with these coefficients light falls while counts grow to {self.until_counts:g}",
                    "measure linearity below saturation",
                )

    def light(self, counts: ArrayLike) -> Floats:
        """Light in counts, from counts above black; any shape. Negative counts are noise and stay as they are."""
        x = np.asarray(counts, dtype=np.float64)
        lit = np.maximum(x, 0.0)
        factor = np.ones_like(x)
        for order, coefficient in enumerate(self.coefficients, start=1):
            factor += coefficient * lit**order
        return x * factor

    def slope(self, counts: ArrayLike) -> Floats:
        """Derivative of :meth:`light`: by it noise grows."""
        lit = np.maximum(np.asarray(counts, dtype=np.float64), 0.0)
        slope = np.ones_like(lit)
        for order, coefficient in enumerate(self.coefficients, start=1):
            slope += (order + 1) * coefficient * lit**order
        return slope


def fit_linearity(counts: ArrayLike, exposures_s: ArrayLike, *, order: int = 2) -> Linearity:
    """Linearity from one constant light at several exposures (as in EMVA 1288): light is proportional to exposure.

    Args:
        counts: (N,) mean counts above black of unsaturated pixels.
        exposures_s: (N,) exposures, s.
        order: number of coefficients.

    Raises:
        DataError: fewer than ``order`` + 2 different exposures, or counts that are not positive.
    """
    x, t = np.asarray(counts, dtype=np.float64), np.asarray(exposures_s, dtype=np.float64)
    if x.shape != t.shape or x.ndim != 1 or len(np.unique(t)) < order + 2:
        raise DataError(
            f"{len(np.unique(t))} different exposures do not determine {order} coefficients of linearity",
            f"take frames of one constant light at {order + 2} or more exposures",
        )
    if not (np.all(np.isfinite(x)) and np.all(x > 0) and np.all(np.isfinite(t)) and np.all(t > 0)):
        raise DataError("counts or exposures are not all positive", "check the black level and leave dark frames out")
    # k t / x - c1 x - c2 x^2 ... = 1: relative deviations count alike. Scaled so that all unknowns are near 1.
    top, long = float(x.max()), float(t.max())
    if top**order == 0:
        raise DataError(f"counts up to {top:g} are no light", "check the black level and the exposure")
    design = np.stack([(t / long) * (top / x), *(-((x / top) ** n) for n in range(1, order + 1))], axis=1)
    solved, *_ = np.linalg.lstsq(design, np.ones(len(x)), rcond=None)
    found = Linearity(tuple(float(c) / top**n for n, c in enumerate(solved[1:], start=1)), top)
    line = found.light(x)
    rate = float(np.sum(line * t) / np.sum(t * t))
    return Linearity(found.coefficients, top, float(np.max(np.abs(line / (rate * t) - 1))))


@undefined_is_nan
def flat_field(light: NDArray[np.floating], mosaic: Mosaic | None = None) -> Floats:
    """Each pixel's response to equal light, over the mean of the pixels behind the same angle.

    Args:
        light: (rows, columns) mean counts above black, linear, of a uniform source.
        mosaic: polarizers on the pixels; without them all pixels are compared with one another.

    Returns:
        (rows, columns); NaN for dead and hot pixels.

    Raises:
        DataError: no image, or no light.
    """
    if light.ndim != 2:
        raise DataError(f"a flat field has shape {light.shape}", "give rows and columns")
    response = np.full(light.shape, np.nan)
    step = 1 if mosaic is None else 2
    for i in range(step):
        for k in range(step):
            part = np.asarray(light[i::step, k::step], dtype=np.float64)
            level = float(np.nanmean(part)) if np.isfinite(part).any() else math.nan
            if not level > 0:
                raise DataError("the flat field has no light", "take it of a bright uniform source")
            response[i::step, k::step] = part / level
    with np.errstate(invalid="ignore"):
        bad = ~((response > DEAD_BELOW) & (response < HOT_ABOVE))
    response[bad] = np.nan
    return response


@dataclass(frozen=True)
class Corrections:
    """What is done to mean counts above black before polarization is looked for: linearity, then the flat field."""

    linearity: Linearity = Linearity()
    flat: NDArray[np.floating] | None = None
    """(rows, columns) as :func:`flat_field` gives it."""

    def apply(self, counts: NDArray[np.floating]) -> tuple[Floats, Floats | None]:
        """Light, and by what counts were divided on average, for the noise.

        Args:
            counts: (K, rows, columns) mean counts above black.

        Returns:
            (K, rows, columns) light, NaN at dead and hot pixels, and (rows, columns) the response for
            :func:`processing.optics.stokes.stokes_planes`, or None where nothing was to be corrected.

        Raises:
            DataError: a flat field of another shape.
        """
        if not self.linearity.coefficients and self.flat is None:
            return np.asarray(counts, dtype=np.float64), None
        light = self.linearity.light(counts)
        response = 1.0 / np.maximum(np.mean(self.linearity.slope(counts), axis=0), 1e-3)
        if self.flat is not None:
            if self.flat.shape != counts.shape[1:]:
                raise DataError(
                    f"the flat field has shape {self.flat.shape}, the frames {counts.shape[1:]}",
                    "take it with the same region of the sensor",
                )
            light = light / self.flat
            response = response * np.where(np.isfinite(self.flat), self.flat, 1.0)
        return light, np.where(np.isfinite(response), response, 1.0)
