from dataclasses import replace

import numpy as np
import pytest
from rail_data import CELL_M, Frequencies, ground, hann, rail, relative_db, sinc_profiles

from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.sar.aperture import aperture_window, even_track
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid, PolarGrid
from processing.sar.peak_search import find_peaks
from processing.sar.planner import MIGRATION_ERROR_DB
from processing.sar.quality import complex_correlation
from processing.sar.range_migration import range_migration
from processing.sar.stolt import stolt, stolt_reference

TARGETS = [(0.0, 10.0, -1.069), (3, 10, -1.069), (-5, 20, -1.069), (2, 5, -1.069), (-6.5, 8, -1.069)]
WIDE = ground(np.arange(-8, 8, 0.1), np.arange(3, 25, 0.25))
"""Seen under up to 72 degrees."""
AHEAD = ground(np.arange(-3, 3, 0.1), np.arange(6, 25, 0.25))
"""Seen under up to 36 degrees."""
PATTERN = {"beamwidth_rad": np.radians(70), "depression_rad": np.radians(17)}


@pytest.fixture(scope="module")
def profiles():
    return Frequencies(TARGETS, rail(), amplitudes=[1, 0.7j, -1.2, 0.4, 0.9]).profiles(8)


@pytest.mark.parametrize(
    ("grid", "pattern", "promised_db"),
    [
        (AHEAD, {}, MIGRATION_ERROR_DB[False][0]),
        (AHEAD, PATTERN, MIGRATION_ERROR_DB[True][0]),
        (WIDE, {}, MIGRATION_ERROR_DB[False][1]),
        (WIDE, PATTERN, MIGRATION_ERROR_DB[True][1]),
    ],
)
def test_image_is_that_of_back_projection_in_amplitude_and_phase(profiles, grid, pattern, promised_db):
    # Both are the same sum; the transform's stationary-phase expansion and interpolation differ. The promise is the
    # planner's own table; sixteen-tap back-projection is exact to -139 dB in comparison.
    expected = backproject(profiles, grid, interpolator="sinc16", **pattern)[0]
    image = range_migration(profiles, grid, **pattern)[0]
    assert relative_db(image, expected) < promised_db + 1
    assert abs(complex_correlation(image, expected)) > 0.9999


def test_peaks_agree_with_back_projection_within_a_tenth_of_a_cell(profiles):
    by_migration, by_sum = range_migration(profiles, WIDE)[0], backproject(profiles, WIDE)[0]
    for a, b in zip(find_peaks(by_migration, WIDE, 3), find_peaks(by_sum, WIDE, 3), strict=True):
        assert abs(a.y_m - b.y_m) < 0.01 * CELL_M
        # Narrowest cell across the rail: 0.886 wavelength R / 2 L, 0.1 m at 5 m.
        assert abs(a.x_m - b.x_m) < 0.01 * 0.1
        assert a.value == pytest.approx(b.value, rel=2e-3)


def test_windows_missing_positions_and_channels_follow_back_projection(profiles):
    values = np.concatenate([profiles.values, 0.5j * profiles.values])
    values[1, 20:24] = np.nan
    both = replace(profiles, values=values, channels=("HH", "HV"))
    weights = aperture_window("taylor", 61)
    expected = backproject(both, AHEAD, weights=weights, interpolator="sinc16")
    image = range_migration(both, AHEAD, weights=weights)
    for a, b in zip(image, expected, strict=True):
        assert relative_db(a, b) < -60


def test_weighted_ramp_agrees_better_still():
    # A Hann window leaves the band's edges empty, so that nothing is lost at the borders of the profiles.
    data = Frequencies(TARGETS, rail(), window=hann).profiles(8, window="hann")
    assert relative_db(range_migration(data, AHEAD)[0], backproject(data, AHEAD, interpolator="sinc16")[0]) < -70


def test_order_of_positions_and_height_of_the_rail_do_not_matter(profiles):
    order = np.random.default_rng(3).permutation(61)
    shuffled = replace(profiles, values=profiles.values[:, order], antenna_m=profiles.antenna_m[order])
    np.testing.assert_allclose(range_migration(shuffled, AHEAD), range_migration(profiles, AHEAD), atol=1e-5)
    raised = replace(profiles, antenna_m=profiles.antenna_m + np.array([0.0, -2.0, 1.0]))
    grid = ImageGrid(AHEAD.x_m, AHEAD.y_m - 2.0, AHEAD.z_m + 1.0)
    np.testing.assert_allclose(range_migration(raised, grid), range_migration(profiles, AHEAD), atol=1e-5)


def test_pixels_off_the_range_axis_are_undefined_as_in_back_projection(profiles):
    grid = ground(np.arange(-4, 4, 0.5), np.arange(90.0, 116.0, 0.5))
    a, b = range_migration(profiles, grid)[0], backproject(profiles, grid)[0]
    np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
    assert np.isnan(a).any()
    assert np.isfinite(a).any()


def test_positions_within_a_hundredth_of_the_step_are_taken_and_others_refused(profiles):
    rng = np.random.default_rng(1)
    for fraction, fine in ((0.009, True), (0.05, False)):
        moved = profiles.antenna_m.copy()
        moved[:, 0] += fraction * 0.0508 * rng.uniform(-1, 1, 61)
        uneven = replace(profiles, antenna_m=moved)
        if fine:
            # Two-way phase of the deviations, k times their rms: 0.027 rad or -31 dB.
            assert relative_db(range_migration(uneven, AHEAD)[0], backproject(uneven, AHEAD)[0]) < -28
        else:
            with pytest.raises(DataError, match="back-projection"):
                range_migration(uneven, AHEAD)


def test_even_track_finds_steps_gaps_and_residuals():
    antenna = rail(11, 0.1)[[0, 1, 2, 3, 5, 6, 9, 10]] + [7.0, 1.0, 2.0]
    track = even_track(antenna)
    assert (track.first_m, track.step_m) == pytest.approx((6.5, 0.1))
    np.testing.assert_array_equal(track.index, [0, 1, 2, 3, 5, 6, 9, 10])
    assert (track.y_m, track.z_m) == (1.0, 2.0)
    assert track.residual_m < 1e-12
    # rms of +-d alternating in z is d.
    wavy = rail(10, 0.1) + np.outer((-1.0) ** np.arange(10), [0, 0, 5e-4])
    assert even_track(wavy).residual_m == pytest.approx(5e-4, rel=1e-6)


@pytest.mark.parametrize(
    ("antenna", "words"),
    [
        (rail(1), "no aperture"),
        (np.zeros((5, 3)), "no aperture"),
        (np.concatenate([rail(9), rail(9)]), "repeated"),
        (rail(9) ** 2 * np.sign(rail(9)), "repeated or uneven|deviate"),
        (rail(9) + np.outer(np.arange(9) ** 2, [0, 1e-3, 0]), "deviate"),
    ],
)
def test_tracks_that_are_no_even_rail_are_refused(antenna, words):
    with pytest.raises(DataError, match=words):
        even_track(antenna)


def test_images_and_data_that_do_not_suit_are_refused(profiles):
    with pytest.raises(DataError, match="in front of the rail"):
        range_migration(profiles, ground([0.0, 1.0], [-5.0, 5.0]))
    with pytest.raises(DataError, match="not uniform"):
        range_migration(profiles, ground([0.0, 1.0, 3.0], [5.0]))
    with pytest.raises(DataError, match="outside the profiles"):
        range_migration(profiles, ground([0.0, 1.0], [500.0]))
    spoiled = profiles.values.copy()
    spoiled[0, 3, 40] = np.nan
    with pytest.raises(DataError, match="single NaN"):
        range_migration(replace(profiles, values=spoiled), AHEAD)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"start_m": np.full(61, 1.0)}, "first ranges"),
        ({"pairs": (AntennaPair((0.5, 0.0, 0.0), (0.0, 0.0, 0.0)),)}, "stand apart"),
        ({"velocity_m_s": np.full((61, 3), 5.0), "ramp_s": 0.02}, "motion within the sweeps"),
    ],
)
def test_geometry_that_is_not_modelled_is_refused(profiles, changed, words):
    with pytest.raises(DataError, match=words):
        range_migration(replace(profiles, **changed), AHEAD)
    with pytest.raises(DataError, match="on a plane"):
        range_migration(profiles, PolarGrid(np.array([10.0]), np.array([0.0]), -1.0))


def test_one_pixel_and_one_row_are_images_too():
    data = sinc_profiles([(1.0, 8.0, -1.069)], rail(), [[1.0]], last_m=60.0)
    assert range_migration(data, ground([1.0], [8.0]))[0, 0, 0] == pytest.approx(1.0, abs=3e-3)


def test_stolt_kernel_follows_its_reference_and_the_closed_form():
    # Content turning as exp(-j k r), r within a quarter of the period: its value at any k is known.
    rng = np.random.default_rng(0)
    step, columns = 0.05, 200
    k = 90 + step * np.arange(columns)
    places = rng.uniform(-0.25, 0.25, (6, 4)) * np.pi / step / 2
    along = np.linspace(-40, 40, 6)
    across = np.linspace(80, 96, 300)
    spectrum = np.exp(-1j * places[:, :, None] * k).sum(axis=1)
    plain = stolt_reference(spectrum, along, 90.0, step, across, 4)
    kernel = stolt(spectrum.astype(np.complex64), along, 90.0, step, across, 4)
    np.testing.assert_allclose(kernel, plain, atol=2e-5)
    wanted = np.sqrt(across**2 + along[:, None] ** 2)
    inside = (wanted > k[4]) & (wanted < k[-5])
    exact = np.exp(-1j * places[:, :, None] * wanted[:, None]).sum(axis=1)
    # Eight Kaiser taps at four times Nyquist: -94 dB (field notes, section 9), four terms.
    np.testing.assert_allclose(plain[inside], exact[inside], atol=4 * 10 ** (-88 / 20))
    assert (plain[(wanted < k[0]) | (wanted > k[-1])] == 0).all()
