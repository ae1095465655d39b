"""Range compensation tilts main lobes: peaks are found without it, and their amplitude is that of the target."""

from __future__ import annotations

import numpy as np
import pytest

from processing.calibration.offset import locate_target
from processing.sar.grid import ImageGrid
from processing.sar.peak_search import find_peaks
from processing.sar.quality import point_response, range_gain

GRID = ImageGrid(np.arange(-3.0, 3.01, 0.1), np.arange(4.0, 14.01, 0.2), -1.07)
X, Y, AMPLITUDE = 0.63, 8.37, 0.7
SD_X, SD_Y = 0.25, 1.62
"""Of a Gaussian main lobe, m; 1.62 m is that of 80 MHz with a Hann window (-3 dB width 2.7 m)."""


def compensated() -> np.ndarray:
    """A point of amplitude 0.7 (sqrt of its RCS) whose echo falls as 1/R^2, after compensation pixel by pixel."""
    lobe = np.exp(-(((GRID.x_m - X) / SD_X) ** 2) / 2 - (((GRID.y_m[:, None] - Y) / SD_Y) ** 2) / 2)
    gain = range_gain(GRID.x_m, GRID.y_m[:, None], GRID.z_m)
    return (AMPLITUDE / range_gain(X, Y, GRID.z_m) * lobe * gain).astype(np.complex128)


def test_peaks_stand_where_the_target_stands() -> None:
    # Expected: the values that the image was made from. The interpolator of eight taps is good to some 1e-4, which on
    # the flat top of a lobe of standard deviation s is a place within s sqrt(2e-4).
    (peak,) = find_peaks(compensated(), GRID, 1, range_compensated=True)
    assert peak.x_m == pytest.approx(X, abs=SD_X * np.sqrt(2e-4))
    assert peak.y_m == pytest.approx(Y, abs=1.5 * SD_Y * np.sqrt(2e-4))
    # The gain is read at the place found: 2 dy / R.
    assert abs(peak.value) == pytest.approx(AMPLITUDE, rel=3 * SD_Y * np.sqrt(2e-4) / 8.4)
    response = point_response(compensated(), GRID, X, Y, reach_m=(1.0, 3.0), range_compensated=True)
    # -3 dB width of a Gaussian: 2 sd sqrt(ln 2).
    assert response.x.width_m == pytest.approx(2 * SD_X * np.sqrt(np.log(2)), rel=2e-3)
    assert response.y.width_m == pytest.approx(2 * SD_Y * np.sqrt(np.log(2)), rel=2e-3)


def test_without_it_the_peak_is_pulled_outward() -> None:
    # d/dy of -y^2/2s^2 + ln R^2 vanishes at about 2 s^2 / R = 0.62 m beyond the target.
    (peak,) = find_peaks(compensated(), GRID, 1)
    assert peak.y_m - Y == pytest.approx(2 * SD_Y**2 / 8.5, rel=0.1)


def test_calibration_targets_are_found_without_the_gain() -> None:
    gain = range_gain(GRID.x_m, GRID.y_m[:, None], GRID.z_m)
    image = np.stack([compensated(), -0.5j * compensated()])
    found = locate_target(image, GRID.x_m, GRID.y_m, (X + 0.2, Y - 0.4), radius_m=1.0, gain=gain)
    assert found.x_m == pytest.approx(X, abs=1e-6)
    assert found.y_m == pytest.approx(Y, abs=1e-6)
    # The gain is taken as linear from the brightest pixel to the peak, at most half a pixel (0.1 m): 1e-4 at 8.5 m.
    assert found.power == pytest.approx(AMPLITUDE**2, rel=5e-4)
    assert found.values[1] / found.values[0] == pytest.approx(-0.5j, rel=1e-12)
    assert abs(found.values[0]) ** 2 == pytest.approx(found.power, rel=1e-12)
