"""The camera's picture between its pixels, where the ground's pixels fall: Stokes parameters, and how a tolerance has
them interpolated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from processing.fusion.resampling import sample_spline
from processing.fusion.resampling_planner import LEAST_PX, ResamplingChoice, choose_resampling
from processing.optics.debias import debias

Floats = NDArray[np.float64]


def stokes_on_ground(
    optics: Mapping[str, NDArray[Any]], u: Floats, v: Floats, degree: int = 1
) -> tuple[Floats, Floats]:
    """S0 and debiased DOLP at camera pixels: Stokes parameters are interpolated, never DOLP.

    Args:
        optics: arrays of the stage "optics".
        u, v: column and row, any one shape; NaN where the camera does not see it.
        degree: of the splines, see :func:`processing.fusion.resampling.sample_spline`; 1 is straight lines.
    """
    masked = ~np.isfinite(optics["dolp"])
    s0, s1, s2 = (sample_spline(np.where(masked, np.nan, optics[name]), u, v, degree) for name in ("s0", "s1", "s2"))
    # Standard deviations are no picture of the scene: a spline through them may fall below zero.
    sd = sample_spline(np.where(masked, np.nan, optics["s0_sd"]), u, v, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Behind angles that are spread evenly, S1 and S2 have twice the variance of S0.
        return s0, debias(np.hypot(s1, s2), 2 * sd**2) / s0


def chosen_resampling(
    optics: Mapping[str, NDArray[Any]], u: Floats, v: Floats, tolerance_db: float
) -> ResamplingChoice:
    """What the tolerance asks for, by the part of the camera's picture that the ground lies in.

    Args:
        optics, u, v: as for :func:`stokes_on_ground`.
        tolerance_db: largest error of S0, S1 and S2 together, dB below them.

    Raises:
        DataError: a tolerance that is no negative number, or a picture that is too small or dark.
    """
    masked = ~np.isfinite(optics["dolp"])
    seen = np.isfinite(u) & np.isfinite(v)
    part = tuple(_part(place[seen], length) for place, length in zip((v, u), masked.shape, strict=True))
    planes = np.stack([np.where(masked, np.nan, optics[name])[part] for name in ("s0", "s1", "s2")])
    sd = optics["s0_sd"][part][~masked[part]].astype(np.float64)
    variance = float(np.mean(sd**2)) if sd.size else 0.0
    return choose_resampling(planes, tolerance_db, variance=[variance, 2 * variance, 2 * variance])


def told(choice: ResamplingChoice) -> dict[str, Any]:
    """The choice and what it foretells, for the product."""
    return {
        "resampling_degree": choice.degree,
        "tolerance_db": choice.tolerance_db,
        "predicted_error_db": choice.predicted_error_db,
        "tolerance_kept": choice.kept,
        "reason": choice.reason,
    }


def _part(places: Floats, length: int) -> slice:
    """Rows or columns in which these places lie, and no fewer than a spectrum needs."""
    if not places.size:
        return slice(0, length)
    first, last = int(places.min()) - LEAST_PX, int(places.max()) + LEAST_PX + 1
    return slice(max(first, 0), min(last, length))
