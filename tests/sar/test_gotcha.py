"""Measured data: AFRL's Gotcha collect, X band, HH, a circular flight around a car park."""

import numpy as np
import pytest
import scipy.io
from rail_data import C
from real_data import real_data
from scipy.signal.windows import taylor

from processing.radar.profiles import RangeProfiles
from processing.sar.backprojection import backproject, backproject_reference
from processing.sar.grid import ImageGrid
from processing.sar.peak_search import find_peaks
from processing.sar.quality import carrier_of, point_response


@pytest.fixture(scope="module")
def collect():
    """Range profiles, Taylor over the ramp, of two degrees; echoes were stored relative to each pulse's r0."""
    echoes, places, centres = [], [], []
    for name in ("gotcha/data_3dsar_pass1_az001_HH.mat", "gotcha/data_3dsar_pass1_az002_HH.mat"):
        data = scipy.io.loadmat(real_data(name), squeeze_me=True, struct_as_record=False)["data"]
        echoes.append(data.fp.T)
        places.append(np.stack([data.x, data.y, data.z], axis=1).astype(float))
        centres.append(np.asarray(data.r0, dtype=float))
        frequency = np.asarray(data.freq, dtype=float)
    echo, antenna, centre = np.vstack(echoes), np.vstack(places), np.concatenate(centres)
    half = len(frequency) // 2
    k = 4 * np.pi * frequency / C
    spacing = 4 * np.pi / C * (frequency[-1] - frequency[0]) / (len(frequency) - 1)
    cell = np.pi / (spacing * len(frequency)) * 2
    middle = centre.mean()
    # One common axis: every pulse's echo is referred to the mean range, then to absolute range by the carrier.
    window = taylor(len(frequency), 4, 35, norm=False)
    referred = echo * window / window.sum() * np.exp(-1j * k * (centre - middle)[:, None])
    r = middle + cell / 8 * np.arange(-1100, 1100)
    values = referred @ np.exp(1j * np.outer(k - k[half], r - middle)) * np.exp(-1j * k[half] * middle)
    return RangeProfiles(
        values[None], r, antenna, ("HH",), float(frequency[half]), float(np.ptp(frequency)), "taylor", True
    )


def grid_around(x, y, half=6.0, step=0.1):
    return ImageGrid(np.arange(x - half, x + half, step), np.arange(y - half, y + half, step), 0.0)


def test_the_car_park_focuses_to_the_theoretical_widths(collect):
    coarse = ImageGrid(np.arange(-45, 45, 0.4), np.arange(-45, 45, 0.4), 0.0)
    weights = taylor(len(collect.antenna_m), 4, 35, norm=False)
    overview = backproject(collect, coarse, weights=weights)[0]
    brightest = find_peaks(np.abs(overview), coarse, 1)[0]
    grid = grid_around(brightest.x_m, brightest.y_m)
    image = backproject(collect, grid, weights=weights)[0]
    response = point_response(
        image, grid, brightest.x_m, brightest.y_m, reach_m=(2.0, 2.0), carrier=carrier_of(collect.antenna_m, 9.6e9)
    )
    # Theory, Taylor -35 dB (1.19 times 0.886): range c / 2B over the cosine of 45 degrees of elevation, along x here;
    # two degrees of azimuth for y. A real reflector is no point: up to 15 % wider.
    elevation = np.arctan2(collect.antenna_m[:, 2], np.linalg.norm(collect.antenna_m[:, :2], axis=1)).mean()
    azimuth = np.ptp(np.arctan2(collect.antenna_m[:, 1], collect.antenna_m[:, 0]))
    across = 1.19 * 0.886 * C / 2 / collect.bandwidth_hz / np.cos(elevation)
    along = 1.19 * 0.886 * C / collect.centre_hz / 2 / azimuth / np.cos(elevation)
    assert across * 0.9 < response.x.width_m < across * 1.15
    assert along * 0.9 < response.y.width_m < along * 1.15


def test_kernel_keeps_phase_at_ten_kilometres(collect):
    # 10 km are 650,000 turns of phase: float32 anywhere in the range would destroy the image (field notes, section 9).
    grid = grid_around(0.0, 0.0, half=8.0, step=0.8)
    kernel = backproject(collect, grid, interpolator="sinc8")[0]
    plain = backproject_reference(collect, grid, interpolator="sinc8")[0]
    assert np.linalg.norm(kernel - plain) < 1e-5 * np.linalg.norm(plain)


def test_a_wrong_track_spoils_the_focus(collect):
    # The control: 2 cm of slow drift, more than a wavelength of two-way path, must be seen in sharpness.
    from dataclasses import replace

    drift = 0.02 * np.cumsum(np.random.default_rng(0).normal(size=len(collect.antenna_m)))
    drift *= 0.02 / np.std(drift)
    moved = replace(collect, antenna_m=collect.antenna_m + np.outer(drift, [0, 0, 1.0]))
    grid = ImageGrid(np.arange(-30, 30, 0.3), np.arange(-30, 30, 0.3), 0.0)
    sharp, blurred = (np.abs(backproject(data, grid)[0]) for data in (collect, moved))
    assert blurred.max() < 0.7 * sharp.max()

    def entropy(image):
        share = image**2 / np.sum(image**2)
        return -np.sum(share * np.log(share + 1e-30))

    assert entropy(blurred) > entropy(sharp) + 0.1
