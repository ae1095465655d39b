"""An airborne collect of point targets, for comparisons of focusing, and what is exactly in its image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.grid import ImageGrid

FREQUENCIES = 512


@dataclass(frozen=True)
class Collect:
    """Echoes at equidistant frequencies, each pulse referred to its distance from the scene's centre."""

    echo: NDArray[np.complex64]
    """(pulses, frequencies)."""
    antenna_m: NDArray[np.float64]
    """(pulses, 3)."""
    lowest_hz: float
    step_hz: float
    pixel_m: float
    size: int
    """Pixels of the image along each axis; pixel i lies at ``(i - size / 2) * pixel_m``."""

    @property
    def reference_m(self) -> NDArray[np.float64]:
        """(pulses,) distance to the scene's centre."""
        return np.asarray(np.linalg.norm(self.antenna_m, axis=1))

    @property
    def grid(self) -> ImageGrid:
        """The image's grid."""
        axis = (np.arange(self.size) - self.size / 2) * self.pixel_m
        return ImageGrid(axis, axis, 0.0)

    def profiles(self, oversampling: int) -> RangeProfiles:
        """Range profiles by one padded transform for each pulse, cropped to the scene."""
        count = self.echo.shape[1]
        length, half = oversampling * count, count // 2
        padded = np.zeros((len(self.echo), length), np.complex64)
        padded[:, : count - half] = self.echo[:, half:]
        padded[:, length - half :] = self.echo[:, :half]
        values = scipy.fft.ifft(padded, axis=1, workers=1, overwrite_x=True)
        centre = self.lowest_hz + half * self.step_hz
        turns = 2 * centre / SPEED_OF_LIGHT_M_S * self.reference_m
        carrier = (oversampling * np.exp(-2j * np.pi * (turns - np.rint(turns)))).astype(np.complex64)[:, None]
        bin_m = SPEED_OF_LIGHT_M_S / (2 * self.step_hz * length)
        reach = min(int((0.72 * self.size * self.pixel_m + 4.0) / bin_m), length // 2)
        axis = np.arange(-reach, reach) * bin_m
        kept = np.empty((1, len(values), 2 * reach), np.complex64)
        np.multiply(values[:, length - reach :], carrier, out=kept[0, :, :reach])
        np.multiply(values[:, :reach], carrier, out=kept[0, :, reach:])
        return RangeProfiles(
            kept,
            axis,
            self.antenna_m,
            ("HH",),
            centre,
            self.step_hz * count,
            "rectangular",
            True,
            start_m=self.reference_m,
        )

    def exact(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.complex128]:
        """The matched filter in float64 at some pixels, ``sum S(f) exp(+j k (R - reference))``, no interpolation."""
        axis = self.grid.x_m
        image = np.zeros((len(rows), len(columns)), dtype=complex)
        dk = 4 * np.pi * self.step_hz / SPEED_OF_LIGHT_M_S
        for place, reference, echo in zip(self.antenna_m, self.reference_m, self.echo, strict=True):
            x, y = axis[columns][None, :] - place[0], axis[rows][:, None] - place[1]
            away = np.sqrt(x**2 + y**2 + place[2] ** 2) - reference
            turn, total = np.exp(1j * dk * away), np.zeros(image.shape, dtype=complex)
            for coefficient in echo[::-1].astype(complex):
                total = total * turn + coefficient
            image += total * np.exp(4j * np.pi * self.lowest_hz / SPEED_OF_LIGHT_M_S * away)
        return image


def airborne(size: int, pulses: int, *, centre_hz: float = 15e9, bandwidth_hz: float = 0.75e9) -> Collect:
    """A flight abeam at 1 km and 30 degrees of elevation, with a square resolution cell and pixels of 3/4 of it.

    Rows of the image (y) are ground range, columns (x) lie along the flight.
    """
    cell = SPEED_OF_LIGHT_M_S / (2 * bandwidth_hz)
    length = SPEED_OF_LIGHT_M_S / centre_hz * 1000 / (2 * cell)
    antenna = np.zeros((pulses, 3))
    antenna[:, 0] = np.linspace(-length / 2, length / 2, pulses)
    antenna[:, 1] = -1000 * np.cos(np.radians(30))
    antenna[:, 2] = 500.0
    step = bandwidth_hz / FREQUENCIES
    lowest = centre_hz - bandwidth_hz / 2
    k = 4 * np.pi / SPEED_OF_LIGHT_M_S * (lowest + step * np.arange(FREQUENCIES))
    echo = np.zeros((pulses, FREQUENCIES), dtype=complex)
    rng = np.random.default_rng(3)
    reference = np.linalg.norm(antenna, axis=1)
    for target in [(0.0, 0.0), *rng.uniform(-0.42, 0.42, (11, 2)) * size * 0.75 * cell]:
        away = np.linalg.norm(antenna - [*target, 0.0], axis=1) - reference
        echo += np.exp(-1j * k * away[:, None])
    return Collect(echo.astype(np.complex64), antenna, lowest, step, 0.75 * cell, size)


def error_db(image: NDArray[np.complexfloating], truth: NDArray[np.complex128]) -> float:
    """Root mean square error relative to the truth after the best complex factor, dB."""
    factor = np.vdot(image, truth) / np.vdot(image, image)
    return float(20 * np.log10(np.linalg.norm(factor * image - truth) / np.linalg.norm(truth)))
