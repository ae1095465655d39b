import numpy as np
import pytest
from rail_data import BANDWIDTH_HZ, CENTRE_HZ, HEIGHT_M, Frequencies, ground, hann, rail

from processing.errors import DataError
from processing.sar.backprojection import backproject
from processing.sar.point_quality import point_quality, theoretical_cut
from processing.sar.resolution import point_resolution

WAVES = {"centre_hz": CENTRE_HZ, "bandwidth_hz": BANDWIDTH_HZ}


def test_theory_far_away_is_the_sinc_and_the_aperture():
    # sin(u) / u: -13.26 dB; 0.8859 c / 2B wide. Far away the 61 steps weigh as one aperture: its pattern is that of
    # Dirichlet, whose first side lobe is -13.24 dB for 61 elements.
    far = (0.0, 500.0, 0.0)
    along = theoretical_cut(rail(), far, (0.0, 1.0, 0.0), 10.0, **WAVES)
    assert along.peak_sidelobe_db == pytest.approx(-13.26, abs=0.02)
    assert along.width_m == pytest.approx(0.8859 * 299_792_458 / 160e6, rel=2e-3)
    # 10 cells hold 0.9899 of the energy of sinc^2, the main lobe 0.9028; 10 m are 5.3 cells: 0.981 of it.
    assert along.integrated_sidelobe_db == pytest.approx(10 * np.log10((0.981 - 0.9028) / 0.9028), abs=0.15)
    across = theoretical_cut(rail(), far, (1.0, 0.0, 0.0), 60.0, **WAVES)
    assert across.peak_sidelobe_db == pytest.approx(-13.24, abs=0.05)
    for place in (far, (2.0, 9.0, -1.0)):
        cell = point_resolution(rail(), place, **WAVES, window="hann")
        cut = theoretical_cut(rail(), place, (1.0, 0.0, 0.0), 5 * cell.x_m, **WAVES, window="hann")
        assert cut.width_m == pytest.approx(cell.x_m, rel=2e-3)


@pytest.mark.parametrize("window", [None, hann])
@pytest.mark.parametrize("place", [(0.0, 12.0), (2.5, 9.0)])
def test_focused_points_are_as_theory_has_them(window, place):
    amplitude = 0.6 * np.exp(1j)
    data = Frequencies([(*place, -HEIGHT_M)], rail(), [amplitude], window=window)
    grid = ground(place[0] + np.arange(-2, 2, 0.05), place[1] + np.arange(-9, 9, 0.2))
    found = point_quality(
        backproject(data.profiles(8), grid)[0], grid, (*place, -HEIGHT_M), rail(), **WAVES, amplitude=amplitude,
        window="rectangular" if window is None else "hann", reach_m=(0.9, 4.0),
    )  # fmt: skip
    # Theory takes waves as plane over the cell; they bend by 1 % of it (see test_image_quality).
    assert found.width_ratio == pytest.approx((1.0, 1.0), abs=0.015)
    assert np.abs(found.place_error_cells).max() < 0.005
    assert found.amplitude_error_db == pytest.approx(0.0, abs=0.02)
    # One degree.
    assert found.phase_error_rad == pytest.approx(0.0, abs=0.0175)
    assert found.measured.x.peak_sidelobe_db == pytest.approx(found.x.peak_sidelobe_db, abs=0.5)


def test_errors_of_amplitude_and_phase_are_told():
    place = (0.0, 12.0, -HEIGHT_M)
    data = Frequencies([place], rail(), [0.5j])
    grid = ground(np.arange(-2, 2, 0.05), 12 + np.arange(-7, 7, 0.2))
    image = backproject(data.profiles(8), grid)[0]
    found = point_quality(image, grid, place, rail(), **WAVES, amplitude=1.0, reach_m=(0.9, 3.0))
    assert found.amplitude_error_db == pytest.approx(-6.02, abs=0.02)
    assert found.phase_error_rad == pytest.approx(np.pi / 2, abs=0.0175)


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(DataError, match="at the antenna"):
        theoretical_cut(rail(3), (0.0, 0.0, 0.0), (1.0, 0, 0), 1.0, **WAVES)
    with pytest.raises(DataError, match="positive reach"):
        theoretical_cut(rail(3), (0.0, 5.0, 0.0), (1.0, 0, 0), np.nan, **WAVES)
    grid = ground(np.arange(-1, 1, 0.1), np.arange(8, 10, 0.1))
    image = np.ones(grid.shape, dtype=complex)
    with pytest.raises(DataError, match="no amplitude"):
        point_quality(image, grid, (0.0, 9.0, 0.0), rail(), **WAVES, amplitude=0.0, reach_m=(0.5, 0.5))
    with pytest.raises(DataError, match="nothing is defined"):
        point_quality(image * np.nan, grid, (0.0, 9.0, 0.0), rail(), **WAVES, reach_m=(0.5, 0.5))
