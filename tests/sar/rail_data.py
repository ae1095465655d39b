"""Point targets on the thesis's rail, from closed forms that are independent of the code under test."""

import numpy as np

from processing.radar.profiles import RangeProfiles
from processing.sar.grid import ImageGrid

C = 299_792_458.0
CENTRE_HZ, BANDWIDTH_HZ = 2.4e9, 80e6
CELL_M = C / (2 * BANDWIDTH_HZ)
STEP_M = 0.0508
HEIGHT_M = 1.069


def rail(positions=61, step=STEP_M):
    """(positions, 3): 10 ft in steps of 2 in, centred, at the origin's height."""
    x = (np.arange(positions) - (positions - 1) / 2) * step
    return np.column_stack([x, np.zeros((positions, 2))])


def distances(antenna, target):
    return np.linalg.norm(np.asarray(target, dtype=float) - antenna, axis=1)


class Frequencies:
    """Echoes at equidistant frequencies: the exact, discrete matched filter's data."""

    def __init__(self, targets, antenna, amplitudes=None, count=256, window=None):
        self.antenna = antenna
        offset = BANDWIDTH_HZ / count * (np.arange(count) + 0.5) - BANDWIDTH_HZ / 2
        self.k0 = 4 * np.pi * CENTRE_HZ / C
        self.k = self.k0 + 4 * np.pi * offset / C
        self.window = np.ones(count) if window is None else window(offset / BANDWIDTH_HZ)
        self.window = self.window / self.window.sum()
        amplitudes = np.ones(len(targets)) if amplitudes is None else amplitudes
        self.echo = sum(
            a * np.exp(-1j * self.k * distances(antenna, t)[:, None]) for a, t in zip(amplitudes, targets, strict=True)
        )

    def profiles(self, oversampling=8, first_m=-20 * CELL_M, last_m=60 * CELL_M, window="rectangular"):
        """Range profiles by direct summation: ``sum W(f) S(f) exp(+j (k - k0) r)``."""
        step = CELL_M / oversampling
        r = step * np.arange(round(first_m / step), round(last_m / step))
        values = (self.echo * self.window) @ np.exp(1j * np.outer(self.k - self.k0, r))
        return RangeProfiles(
            values[None], r, self.antenna, ("HH",), CENTRE_HZ, BANDWIDTH_HZ, window, range_compensated=True
        )

    def matched_filter(self, grid):
        """``1/P sum_n sum_f W S exp(+j k R)``: exact, no interpolation."""
        image = np.zeros(grid.shape, dtype=complex)
        for place, echo in zip(self.antenna, self.echo, strict=True):
            dx, dy = grid.x_m[None, :] - place[0], grid.y_m[:, None] - place[1]
            away = np.sqrt(dx**2 + dy**2 + (grid.z_m - place[2]) ** 2)
            # Equidistant k: a polynomial in exp(j dk R), summed by Horner's rule.
            turn, total = np.exp(1j * (self.k[1] - self.k[0]) * away), np.zeros(grid.shape, dtype=complex)
            for coefficient in (echo * self.window)[::-1]:
                total = total * turn + coefficient
            image += total * np.exp(1j * self.k[0] * away)
        return image / len(self.antenna)


def hann(part):
    return np.cos(np.pi * part) ** 2


def sinc_profiles(targets, antenna, amplitudes, *, oversampling=8, last_m=40.0, gains=None):
    """Of a continuous spectrum: ``sum a sinc((r - R) / cell) exp(-j k0 R)``, one channel for each row of amplitudes."""
    step = CELL_M / oversampling
    r = step * np.arange(-8 * oversampling, int(last_m / step))
    amplitudes = np.atleast_2d(amplitudes)
    values = np.zeros((len(amplitudes), len(antenna), len(r)), dtype=complex)
    for index, target in enumerate(targets):
        away = distances(antenna, target)[:, None]
        echo = np.sinc((r - away) / CELL_M) * np.exp(-4j * np.pi * CENTRE_HZ / C * away)
        if gains is not None:
            echo = echo * gains(antenna, target)[:, None]
        values += amplitudes[:, index, None, None] * echo
    names = ("HH", "HV", "VH", "VV")[: len(amplitudes)]
    return RangeProfiles(values, r, antenna, names, CENTRE_HZ, BANDWIDTH_HZ, "rectangular", range_compensated=True)


def ground(x, y, z=-HEIGHT_M):
    return ImageGrid(np.asarray(x, dtype=float), np.asarray(y, dtype=float), z)


def relative_db(image, truth):
    """Root mean square error over the image, dB."""
    use = np.isfinite(image) & np.isfinite(truth)
    assert use.any()
    return 20 * np.log10(np.linalg.norm((image - truth)[use]) / np.linalg.norm(truth[use]))
