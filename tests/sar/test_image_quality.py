import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rail_data import BANDWIDTH_HZ, CELL_M, CENTRE_HZ, HEIGHT_M, C, Frequencies, ground, hann, rail, sinc_profiles

from processing.errors import DataError
from processing.sar.aperture import alias_free_angle_rad, aperture_window, grating_lobe_warning, widest_angle_rad
from processing.sar.backprojection import backproject
from processing.sar.peak_search import find_peaks
from processing.sar.quality import (
    carrier_of,
    complex_correlation,
    measure_cut,
    point_response,
    value_between,
)
from processing.sar.resolution import point_resolution

WAVELENGTH = C / CENTRE_HZ
WAVES = {"centre_hz": CENTRE_HZ, "bandwidth_hz": BANDWIDTH_HZ}


def test_unweighted_range_response_is_the_sinc():
    # |sinc|: -3 dB width 0.8859 cells (sin(u) = u / sqrt 2 at u = 1.3916), first side lobe -13.26 dB.
    profiles = sinc_profiles([(0.0, 25.0, 0.0)], rail(1), [[1.0]], last_m=60.0)
    grid = ground(np.arange(-2, 2, 0.25), np.arange(5, 45, 0.25), z=0.0)
    response = point_response(
        backproject(profiles, grid, interpolator="sinc16")[0], grid, 0.0, 25.0, reach_m=(1.0, 10 * CELL_M)
    )
    # On the y axis (x = 0) ground range is range.
    image = backproject(profiles, ground([0.0], grid.y_m, z=0.0), interpolator="sinc16")[0, :, 0]
    fine = ground([0.0], 25 + np.arange(-2000, 2001) * 0.005, z=0.0)
    cut = measure_cut(np.abs(backproject(profiles, fine, interpolator="sinc16")[0, :, 0]), 0.005)
    assert cut.width_m == pytest.approx(0.8859 * CELL_M, rel=2e-3)
    assert cut.peak_sidelobe_db == pytest.approx(-13.26, abs=0.02)
    assert response.y.width_m == pytest.approx(cut.width_m, rel=5e-3)
    assert response.y.peak_sidelobe_db == pytest.approx(-13.26, abs=0.1)
    assert np.isfinite(image).all()
    # Energy of sinc^2 between its first nulls is 0.9028 of all; within +-10 cells 0.9899 of all is seen.
    assert response.y.integrated_sidelobe_db == pytest.approx(10 * np.log10((0.9899 - 0.9028) / 0.9028), abs=0.1)


@pytest.mark.parametrize("window", [None, hann])
@pytest.mark.parametrize("place", [(0.0, 12.0), (2.5, 9.0), (-3.0, 16.0)])
def test_measured_widths_are_the_theoretical_ones(window, place):
    data = Frequencies([(*place, -HEIGHT_M)], rail(), window=window)
    grid = ground(place[0] + np.arange(-2, 2, 0.05), place[1] + np.arange(-8, 8, 0.15))
    image = backproject(data.profiles(8, last_m=30 * CELL_M), grid)[0]
    carrier = carrier_of(rail(), CENTRE_HZ)
    response = point_response(image, grid, *place, reach_m=(0.8, 3.5), carrier=carrier)
    expected = point_resolution(
        rail(), (*place, -HEIGHT_M), **WAVES, window="rectangular" if window is None else "hann"
    )
    # The theory takes the waves as plane over the cell; they bend by (half cell)^2 / 8 R or 1 % of a cell.
    assert response.x.width_m == pytest.approx(expected.x_m, rel=0.01)
    assert response.y.width_m == pytest.approx(expected.y_m, rel=0.015)
    # 0.3 % of the cells; what that means in phase is 2 k times it.
    assert response.peak.x_m == pytest.approx(place[0], abs=0.003 * expected.x_m)
    assert response.peak.y_m == pytest.approx(place[1], abs=0.003 * expected.y_m)
    assert abs(response.peak.value) == pytest.approx(1.0, abs=1e-3)
    sight = np.array([*place, -HEIGHT_M]) - rail()
    slope = 4 * np.pi / WAVELENGTH * (sight / np.linalg.norm(sight, axis=1)[:, None]).mean(axis=0)
    off = slope[0] * (response.peak.x_m - place[0]) + slope[1] * (response.peak.y_m - place[1])
    assert response.peak.phase_rad == pytest.approx(off, abs=0.01)


def test_theoretical_resolution_tends_to_the_textbook_forms():
    # Far away and narrow: 0.8859 c / 2B along range, 0.8859 wavelength R / 2 L across (thesis 2.34, 2.35 times 0.886);
    # an aperture of P steps d weighs as one of length P d.
    far = point_resolution(rail(), (0.0, 500.0, 0.0), **WAVES)
    assert far.slant_m == pytest.approx(0.8859 * CELL_M, rel=1e-3)
    assert far.y_m == pytest.approx(far.slant_m, rel=1e-3)
    assert far.x_m == pytest.approx(0.8859 * WAVELENGTH * 500 / (2 * 61 * 0.0508), rel=1e-3)
    # The ground: range cell over the cosine of the depression.
    low = point_resolution(rail(1), (0.0, 10.0, -10.0), **WAVES)
    assert low.y_m == pytest.approx(np.sqrt(2) * far.slant_m, rel=1e-3)
    assert low.x_m == np.inf
    # Hann: 1.4406 / 0.8859 broader than unweighted (Harris 1978).
    hanned = point_resolution(rail(), (0.0, 500.0, 0.0), **WAVES, window="hann")
    assert hanned.slant_m == pytest.approx(1.4406 * CELL_M, rel=1e-3)
    # The thesis's Table 5.1: 2.05 m is wavelength R / 2 L at 100 m with 10 ft.
    table = WAVELENGTH * 100 / (2 * 3.048)
    assert table == pytest.approx(2.05, abs=0.005)
    with pytest.raises(DataError, match="antenna"):
        point_resolution(rail(3), (0.0, 0.0, 0.0), **WAVES)


def test_windows_along_the_aperture_lower_side_lobes_as_designed():
    # Far away the cut along the rail is the window's transform: -13.26, -31.5 (Hann), -35 dB (Taylor). A circle around
    # the rail's middle keeps the range envelope out of it.
    lobes = {}
    angle = np.linspace(-0.12, 0.12, 4001)
    antenna = rail()
    for name in ("rectangular", "hann", "taylor"):
        weights = aperture_window(name, 61)
        pattern = np.abs(np.exp(4j * np.pi / WAVELENGTH * np.outer(np.sin(angle), antenna[:, 0])) @ weights)
        lobes[name] = measure_cut(pattern / weights.sum(), 1.0).peak_sidelobe_db
    assert lobes["rectangular"] == pytest.approx(-13.26, abs=0.05)
    assert lobes["hann"] == pytest.approx(-31.5, abs=0.3)
    assert lobes["taylor"] == pytest.approx(-35.0, abs=0.5)


def test_values_between_pixels_are_those_of_a_finer_image():
    profiles = sinc_profiles([(0.4, 9.0, -1.0)], rail(), [[1.0]])
    x, y = np.arange(-1, 2, 0.05), np.arange(6, 12, 0.2)
    coarse = backproject(profiles, ground(x, y, z=-1.0))[0]
    rows, columns = np.array([10.5, 14.25, 20.7]), np.array([20.3, 28.0, 33.9])
    carrier = carrier_of(rail(), CENTRE_HZ)
    for row, column in zip(rows, columns, strict=True):
        wanted = ground([x[0] + 0.05 * column], [y[0] + 0.2 * row], z=-1.0)
        exact = backproject(profiles, wanted)[0, 0, 0]
        turns = carrier.turns(ground(x, y, z=-1.0), row, column)
        assert value_between(coarse, row, column, turns=turns) == pytest.approx(exact, abs=2e-3)
        # Rows are 0.2 m apart, three turns of phase: pixels alone tell the magnitude only.
        assert abs(value_between(coarse, row, column)) == pytest.approx(abs(exact), abs=2e-3)
    np.testing.assert_allclose(value_between(coarse, 10.0, 20.0), coarse[10, 20], rtol=1e-12)
    assert np.isnan(value_between(coarse, -1.0, 3.0))
    assert np.isnan(value_between(coarse, np.nan, 3.0))


@settings(max_examples=20, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(7, 13), st.floats(0, 6.28))
def test_peaks_are_found_between_pixels_with_their_phase(x, y, phase):
    profiles = sinc_profiles([(x, y, -1.0)], rail(31), [[np.exp(1j * phase)]], oversampling=4)
    grid = ground(np.arange(-3, 3, 0.08), np.arange(4, 17, 0.3), z=-1.0)
    (peak,) = find_peaks(backproject(profiles, grid)[0], grid, 1)
    # A hundredth of the cells (0.2 m and 1.7 m), and the phase of a place so far off: 2 k dy.
    assert (peak.x_m, peak.y_m) == pytest.approx((x, y), abs=0.012)
    assert abs(peak.value) == pytest.approx(1.0, abs=5e-3)


def test_peaks_come_strongest_first_without_side_lobes():
    targets, amplitudes = [(-2.0, 8.0, -1.069), (2.0, 8.0, -1.069), (0.0, 14.0, -1.069)], [[0.5, 1.0, 0.8]]
    grid = ground(np.arange(-4, 4, 0.05), np.arange(5, 18, 0.25))
    image = backproject(sinc_profiles(targets, rail(), amplitudes), grid)[0]
    image[:, :5] = np.nan
    found = find_peaks(image, grid, 3, separation_m=(1.5, 4.0))
    assert [round(peak.x_m) for peak in found] == [2, 0, -2]
    assert [peak.level_db for peak in found] == pytest.approx([0.0, -1.94, -6.02], abs=0.5)
    assert find_peaks(np.full(grid.shape, np.nan), grid) == []
    assert len(find_peaks(image, grid, 50, floor_db=-1.0, separation_m=(1.5, 4.0))) == 1
    with pytest.raises(DataError, match="does not fit"):
        find_peaks(image[1:], grid)


def test_cuts_that_end_too_soon_are_undefined():
    falling = np.concatenate([np.linspace(0.8, 1, 20), np.linspace(1, 0.8, 20)[1:]])
    cut = measure_cut(falling, 0.1)
    assert np.isnan([cut.width_m, cut.peak_sidelobe_db, cut.integrated_sidelobe_db]).all()
    with pytest.raises(DataError, match="nothing is defined"):
        point_response(np.full((9, 9), np.nan), ground(np.arange(9), np.arange(9)), 4, 4, reach_m=(2, 2))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.complex_numbers(min_magnitude=0.1, max_magnitude=10))
def test_correlation_is_one_for_scaled_images_and_below_for_others(seed, scale):
    rng = np.random.default_rng(seed)
    a, b = (rng.normal(size=(8, 8)) + 1j * rng.normal(size=(8, 8)) for _ in range(2))
    assert complex_correlation(scale * a, a) == pytest.approx(scale / abs(scale), abs=1e-9)
    assert abs(complex_correlation(a, b)) < 1
    assert complex_correlation(a, b) == pytest.approx(np.conj(complex_correlation(b, a)), abs=1e-12)


def test_correlation_looks_at_the_common_support_only():
    a = np.array([1, 2, np.nan, 1j])
    b = np.array([1, 2, 3, -7.0])
    assert complex_correlation(a, b, np.array([True, True, True, False])) == pytest.approx(1.0)
    with pytest.raises(DataError, match="shapes"):
        complex_correlation(a, b[:2])
    with pytest.raises(DataError, match="no common support"):
        complex_correlation(a, b, np.zeros(4, dtype=bool))


def test_grating_lobes_of_two_inch_steps_begin_at_38_degrees():
    # Field notes, section 9: 2 in are 0.41 wavelength, grating lobes beyond 38 degrees.
    assert np.degrees(alias_free_angle_rad(0.0508, WAVELENGTH)) == pytest.approx(37.9, abs=0.1)
    assert alias_free_angle_rad(WAVELENGTH / 4, WAVELENGTH) == pytest.approx(np.pi / 2)
    near, far = ground([-8.0, 8.0], [3.0, 20.0]), ground([-1.0, 1.0], [10.0, 20.0])
    assert "38 degrees" in grating_lobe_warning(0.0508, WAVELENGTH, rail(), near)
    assert grating_lobe_warning(0.0508, WAVELENGTH, rail(), far) == ""
    assert grating_lobe_warning(0.02, WAVELENGTH, rail(), near) == ""
    # Farthest end of the rail to the opposite corner: atan(9.524 / hypot(3, 1.069)).
    assert widest_angle_rad(rail(), near) == pytest.approx(np.arctan(9.524 / np.hypot(3, HEIGHT_M)), rel=1e-4)
    with pytest.raises(DataError, match="positive"):
        alias_free_angle_rad(0.0, 0.1)


def test_a_grating_lobe_appears_where_the_step_says():
    # A target abreast is repeated where the two-way phase of one step is a whole turn: sin = wavelength / 2 d.
    step = 0.1016
    data = sinc_profiles([(0.0, 200.0, 0.0)], rail(31, step), [[1.0]], last_m=240.0)
    angle = np.arcsin(WAVELENGTH / (2 * step))
    along = np.radians(np.arange(30, 46, 0.2))
    ring = [abs(backproject(data, ground([200 * np.sin(a)], [200 * np.cos(a)], z=0.0))[0, 0, 0]) for a in along]
    assert along[int(np.argmax(ring))] == pytest.approx(angle, abs=np.radians(0.2))
    # Range still agrees to some of the cell, so that it is nearly as bright as the target.
    assert max(ring) > 0.5
    assert alias_free_angle_rad(step, WAVELENGTH) < angle
