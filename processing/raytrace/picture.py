"""What a simulation gives: Stokes or Mueller pictures with standard errors, and what was left out of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.optics import stokes_vectors
from processing.optics.debias import polarization

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LeftOut:
    """Light that was not looked for, because the picture cannot change by more than asked without it."""

    bounce: int
    """Reflections."""
    source: int
    """Number of the source, from 0."""
    error: float
    """Upper limit of its rms over the picture, of the mean S0: by 3 sigma of what was measured. Of light that no ray
    met by the rule of three (95 %), all of it in one pixel and no brighter than the brightest that any ray met."""
    met: bool = True
    """Whether any ray of the first look met it."""
    rays: int = 0
    """Rays of that look, all pixels together."""

    def words(self) -> str:
        """How sure it is that this does not matter."""
        if self.met:
            return f"below {100 * self.error:.2g} %"
        return f"not met by {self.rays} rays, below {100 * self.error:.2g} % at 95 %"


def unmet_limit(brightest: float, level: float, pixels: int, samples: int) -> float:
    """Largest rms, of the mean S0, of light that no ray met, at 95 %.

    Of n rays that all miss, the chance to meet is below 3 / n (rule of three: ``0.05 = (1 - p)^n``). All of it in one
    pixel, which is where its rms is largest, that pixel's mean is ``3 / samples`` of the value that a ray brings.

    Args:
        brightest: largest value that a ray brings, here the largest that any ray brought.
        level: mean S0 of the picture.
        pixels: of the picture.
        samples: rays of each.
    """
    return -math.log(0.05) / samples * brightest / (level * math.sqrt(pixels))


@dataclass(frozen=True)
class Picture:
    """A Monte Carlo picture.

    Radiances are the sources' units per m^2 and sr, averaged over each pixel.
    """

    mean: Floats
    """(rows, columns, 4): Stokes vectors in the camera's frame; or (rows, columns, 4, 4): Mueller matrices from the
    source's frame to the camera's, for unit strength."""
    standard_error: Floats
    """Of each mean, same shape; NaN from a single sample."""
    samples: int
    """Rays from the camera for each pixel; of a forward simulation rays from all sources."""
    rays: int
    """Rays traced, to sources too."""
    seconds: float
    left_out: tuple[LeftOut, ...] = ()

    @property
    def is_mueller(self) -> bool:
        """Whether the picture holds Mueller matrices."""
        return self.mean.ndim == 4

    @property
    def stokes(self) -> Floats:
        """(rows, columns, 4): of a Mueller picture for unpolarized light."""
        return self.mean[..., 0] if self.is_mueller else self.mean

    @property
    def dolp(self) -> Floats:
        """Degree of linear polarization (rows, columns), as it comes out; NaN in black pixels."""
        return stokes_vectors.dolp(self.stokes)

    @property
    def aop(self) -> Floats:
        """Angle of polarization (rows, columns), rad; NaN within 2 standard errors (or rounding) of no polarization."""
        stokes = self.stokes
        error = self.standard_error[..., 0] if self.is_mueller else self.standard_error
        noise = np.maximum(2 * np.hypot(error[..., 1], error[..., 2]), 1e-12 * np.abs(stokes[..., 0]))
        sure = np.hypot(stokes[..., 1], stokes[..., 2]) > noise
        return np.where(sure, stokes_vectors.aop(stokes), np.nan)

    @property
    def dolp_error(self) -> Floats:
        """Standard error of :attr:`dolp` (rows, columns), the parameters' errors taken as independent."""
        error = self.standard_error[..., 0] if self.is_mueller else self.standard_error
        covariance = error[..., :3, None] ** 2 * np.eye(3)
        with np.errstate(invalid="ignore", divide="ignore"):
            return polarization(self.stokes[..., :3], covariance)[2]

    @property
    def error(self) -> float:
        """Root mean square over pixels of the largest component's standard error, of the mean S0."""
        return relative_error(self.mean, self.standard_error)

    def received(self, transmit: ArrayLike, receive: ArrayLike) -> Floats:
        """Intensity (rows, columns) of a Mueller picture behind polarizers (thesis 4.19).

        Args:
            transmit: (4,) Stokes vector that leaves the source's polarizer.
            receive: (4,) first row of the Mueller matrix of the camera's polarizer.

        Raises:
            DataError: the picture holds Stokes vectors.
        """
        if not self.is_mueller:
            raise DataError("the picture holds Stokes vectors, no Mueller matrices", "simulate it with mueller=True")
        return np.asarray(
            np.einsum("i,rcij,j->rc", np.asarray(receive, dtype=float), self.mean, np.asarray(transmit, dtype=float))
        )

    def channels(self) -> dict[str, Floats]:
        """Intensities HH, HV, VH and VV (transmit, then receive) behind ideal polarizers (thesis 6.3)."""
        state = {"H": np.array([1.0, 1.0, 0.0, 0.0]), "V": np.array([1.0, -1.0, 0.0, 0.0])}
        return {t + r: self.received(state[t], state[r] / 2) for t in "HV" for r in "HV"}


def relative_error(mean: Floats, standard_error: Floats) -> float:
    """Root mean square over pixels of the largest component's standard error, over the picture's mean S0."""
    pixels = mean.shape[0] * mean.shape[1]
    level = float(np.mean(mean.reshape(pixels, -1)[:, 0]))
    if level <= 0:
        return 0.0 if not np.any(standard_error) else float("inf")
    return float(np.sqrt(np.max(np.mean(standard_error.reshape(pixels, -1) ** 2, axis=0)))) / level


def statistics(sums: Floats, squares: Floats, samples: int) -> tuple[Floats, Floats]:
    """Mean and its standard error from sums and sums of squares of ``samples`` values."""
    mean = sums / samples
    if samples < 2:
        return mean, np.full_like(mean, np.nan)
    # The difference of squares may round below zero where all values agree.
    variance = np.maximum(squares / samples - mean * mean, 0.0) * samples / (samples - 1)
    return mean, np.sqrt(variance / samples)
