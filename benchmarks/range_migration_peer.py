"""Range migration as textbooks have it, in NumPy and SciPy: the peer, for there is none on PyPI."""

from __future__ import annotations

import math

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, RegularGridInterpolator

from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.grid import ImageGrid


def textbook(profiles: RangeProfiles, grid: ImageGrid) -> NDArray[np.complex128]:
    """Transform along the track, Stolt interpolation by a cubic spline for each line, inverse transform, interpolation.

    Steps and factors as Carrara, Goodman, Majewski 1995, chapter 10, with the amplitude of back-projection; the period
    along the track is made long enough for the image, twice as long as the track at least.

    Args:
        profiles: one channel, equal steps along x.
        grid: plane with equal steps.
    """
    x = profiles.antenna_m[:, 0]
    step = float(x[1] - x[0])
    middle = float(x.mean())
    slant = np.hypot(grid.y_m, grid.z_m)
    bins, dr = len(profiles.range_m), profiles.range_step_m
    bulk = float(profiles.range_m[bins // 2])
    length = scipy.fft.next_fast_len(2 * bins)
    k_step = 2 * math.pi / (length * dr)
    centre = 4 * math.pi * profiles.centre_hz / SPEED_OF_LIGHT_M_S
    half = math.ceil(0.7 * 4 * math.pi * profiles.bandwidth_hz / SPEED_OF_LIGHT_M_S / k_step)
    index = np.arange(-half, half + 1)
    k = centre + k_step * index
    in_k = scipy.fft.fft(profiles.values[0], length, axis=1)[:, index]
    in_k = in_k * np.exp(1j * (k - centre) * (bulk - profiles.range_m[0]))
    reach = float(np.ptp(grid.x_m) + np.ptp(x)) + 2 * max(abs(grid.x_m[0] - middle), np.ptp(x))
    count = scipy.fft.next_fast_len(max(2 * len(x), math.ceil(reach / step)))
    both = scipy.fft.fft(in_k, count, axis=0)
    along = 2 * math.pi * np.fft.fftfreq(count, step)
    both *= np.exp(-1j * along * (x[0] - middle))[:, None]

    steepest = min(float(np.abs(along).max()), 0.95 * float(k[0]))
    low, high = math.sqrt(k[0] ** 2 - steepest**2), float(k[-1])
    depth = float(np.ptp(slant)) + 20 * profiles.resolution_m
    lines = scipy.fft.next_fast_len(math.ceil((high - low) * 1.5 * depth / (2 * math.pi)))
    across = low + (high - low) / lines * np.arange(lines)
    reference = 0.5 * float(slant.min() + slant.max())
    mapped = np.zeros((count, lines), dtype=complex)
    for line in np.flatnonzero(np.abs(along) <= steepest):
        wanted = np.hypot(across, along[line])
        inside = (wanted >= k[0]) & (wanted <= k[-1])
        value = CubicSpline(k, both[line])(wanted[inside])
        phase = reference * across[inside] - bulk * (wanted[inside] - centre)
        mapped[line, inside] = value * np.exp(1j * phase) * np.sqrt(2 * np.pi / across[inside])
    # Four times the samples in either direction, for linear interpolation to the grid.
    fine = scipy.fft.next_fast_len(2 * lines)
    shifted = scipy.fft.ifft2(mapped, (count, fine)) * (count * fine)
    dy = 2 * math.pi / ((across[1] - across[0]) * fine)
    there_x = scipy.fft.fftshift(np.fft.fftfreq(count, 1 / (count * step)))
    there_y = scipy.fft.fftshift(np.fft.fftfreq(fine, 1 / (fine * dy)))
    image = scipy.fft.fftshift(shifted)
    # The carrier across the track stays off until after interpolation.
    centre_line = float(across[lines // 2])
    image *= np.exp(-1j * (centre_line - low) * there_y)
    read = RegularGridInterpolator((there_x, there_y), image, method="cubic" if count * fine < 2e5 else "linear")
    places = np.stack(np.meshgrid(grid.x_m - middle, slant - reference), axis=-1)
    values = read(places.reshape(-1, 2)).reshape(grid.shape)
    carrier = np.exp(1j * (centre_line * (slant - reference) + math.pi / 4)) * np.sqrt(slant)
    scale = dr * 2 * math.pi / (count * step) * (across[1] - across[0]) / (2 * math.pi) ** 2 / len(x)
    return np.asarray(values * carrier[:, None] * scale)
