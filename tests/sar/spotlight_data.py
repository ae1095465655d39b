"""Phase histories of point targets seen by an aircraft, from the closed form of each echo at each frequency."""

import numpy as np

from processing.radar.profiles import RangeProfiles
from processing.sar.grid import ImageGrid

C = 299_792_458.0


def flight(pulses, *, range_m=8e3, height_m=3e3, length_m=None, resolution_m=0.2, centre_hz=15e9, squint_rad=0.0):
    """(pulses, 3) straight track whose aperture resolves ``resolution_m`` across range at the origin."""
    length = range_m * C / centre_hz / (2 * resolution_m) if length_m is None else length_m
    along = np.linspace(-0.5, 0.5, pulses) * length
    ground = np.sqrt(range_m**2 - height_m**2)
    x = along + ground * np.sin(squint_rad)
    return np.column_stack([x, np.full(pulses, -ground * np.cos(squint_rad)), np.full(pulses, height_m)])


def scattered(count, span_m, seed=0):
    """(count, 3) places within a square on the ground."""
    return np.column_stack([np.random.default_rng(seed).uniform(-0.45, 0.45, (count, 2)) * span_m, np.zeros(count)])


def square(pixels, step_m=0.16, z_m=0.0):
    axis = (np.arange(pixels) - pixels / 2) * step_m
    return ImageGrid(axis, axis, z_m)


def echoes(targets, transmit, receive, frequency, reference):
    """(pulses, frequencies) ``sum exp(-j 4 pi f (R - reference) / c)``, R half the path."""
    total = np.zeros((len(transmit), len(frequency)), dtype=complex)
    for target in targets:
        away = 0.5 * (np.linalg.norm(target - transmit, axis=1) + np.linalg.norm(target - receive, axis=1))
        total += np.exp(-4j * np.pi / C * frequency * (away - reference)[:, None])
    return total


def profiles(targets, antenna, span_m, *, oversampling=4, centre_hz=15e9, bandwidth_hz=750e6, pairs=None):
    """Range profiles of equidistant frequencies, each around its own distance to the origin."""
    cell = C / 2 / bandwidth_hz
    count = 2 * int(0.8 * span_m / cell) + 64
    spacing = bandwidth_hz / count
    frequency = centre_hz + spacing * (np.arange(count) - count // 2)
    middle = np.linalg.norm(antenna, axis=1)
    bins, half = count * oversampling, count // 2
    values = []
    for pair in pairs or (None,):
        offsets = (np.zeros(3), np.zeros(3)) if pair is None else (np.array(pair.transmit_m), np.array(pair.receive_m))
        echo = echoes(targets, antenna + offsets[0], antenna + offsets[1], frequency, middle)
        padded = np.zeros((len(antenna), bins), dtype=complex)
        padded[:, : count - half], padded[:, bins - half :] = echo[:, half:], echo[:, :half]
        line = np.fft.fftshift(np.fft.ifft(padded, axis=1), axes=1) * oversampling
        values.append(line * np.exp(-4j * np.pi * centre_hz / C * middle)[:, None])
    step = C / 2 / (spacing * bins)
    names = ("HH", "HV", "VH", "VV")[: len(values)]
    return RangeProfiles(
        np.array(values), step * np.arange(bins), antenna, names, centre_hz, bandwidth_hz, "rectangular", True,
        start_m=middle - step * (bins // 2), pairs=pairs,
    )  # fmt: skip
