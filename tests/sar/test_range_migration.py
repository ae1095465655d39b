from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rail_data import CELL_M, Frequencies, ground, hann, rail, relative_db, sinc_profiles

from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.sar.aperture import aperture_window, two_way_gain
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid, PolarGrid
from processing.sar.peak_search import find_peaks
from processing.sar.planner import MIGRATION_ERROR_DB
from processing.sar.quality import complex_correlation
from processing.sar.range_migration import range_migration
from processing.sar.range_migration_reference import range_migration_reference
from processing.sar.stolt import FILTERS, Mapping, smooth_step, stolt, stolt_reference
from processing.sar.straight_track import pattern_sum, straight_track

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
        (WIDE, {}, MIGRATION_ERROR_DB[False][2]),
        (WIDE, PATTERN, MIGRATION_ERROR_DB[True][2]),
    ],
)
def test_image_is_that_of_back_projection_in_amplitude_and_phase(profiles, grid, pattern, promised_db):
    # Both are the same sum; the transform's stationary-phase expansion and interpolation differ. The promise is the
    # planner's own table; sixteen-tap back-projection is exact to -139 dB in comparison.
    expected = backproject(profiles, grid, interpolator="sinc16", **pattern)[0]
    image = range_migration(profiles, grid, **pattern)[0]
    assert relative_db(image, expected) < promised_db + 1
    assert abs(complex_correlation(image, expected)) > 0.9999


def test_peaks_agree_with_back_projection_within_a_hundredth_of_a_cell(profiles):
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


def test_positions_may_stand_anywhere_on_the_rail():
    # Unequal steps, a repeated position, one position alone: back-projection's sum has no step, and neither has this.
    rng = np.random.default_rng(1)
    uneven = rail()
    uneven[:, 0] += 0.4 * 0.0508 * rng.uniform(-1, 1, 61)
    uneven[7] = uneven[6]
    for antenna in (uneven, rail()[::7], rail()[:1]):
        data = Frequencies(TARGETS, antenna).profiles(8)
        assert relative_db(range_migration(data, AHEAD)[0], backproject(data, AHEAD, interpolator="sinc16")[0]) < -60


def test_positions_off_the_line_are_an_error_that_is_told_or_refused(profiles):
    # Two-way phase 4 pi / wavelength times the rms deviation toward the scene: 1 mm is 0.1 rad, -20 dB.
    wavy = rail() + np.outer((-1.0) ** np.arange(61), [0, 1e-3, 0])
    track = straight_track(wavy, profiles.wavelength_m)
    assert track.residual_m == pytest.approx(1e-3, rel=1e-3)
    moved = Frequencies(TARGETS, wavy).profiles(8)
    error = relative_db(range_migration(moved, AHEAD)[0], backproject(moved, AHEAD, interpolator="sinc16")[0])
    assert error == pytest.approx(20 * np.log10(4 * np.pi / profiles.wavelength_m * 1e-3), abs=3)
    for antenna in (wavy + np.outer(np.arange(61) == 3, [0, 0, 0.01]), rail() @ [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]):
        with pytest.raises(DataError, match="back-projection"):
            range_migration(replace(profiles, antenna_m=antenna), AHEAD)


def test_images_and_data_that_do_not_suit_are_refused(profiles):
    with pytest.raises(DataError, match="in front of the rail"):
        range_migration(profiles, ground([0.0, 1.0], [-5.0, 5.0]))
    with pytest.raises(DataError, match="no Stolt filter"):
        range_migration(profiles, AHEAD, taps="linear")
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


@pytest.mark.parametrize("pattern", [{}, PATTERN])
def test_fast_image_follows_the_float64_reference(pattern):
    # Kernels of six taps at 1.5 times the terms: -94 dB each (Fessler and Sutton's bound), three of them, and a table.
    # Few positions and bins: direct sums take their time.
    grid = ground([-1.0, 0.3, 0.4, 1.0], np.arange(8.0, 11.0, 0.7))
    data = Frequencies(TARGETS, rail()[::4]).profiles(4)
    small = replace(data, values=np.concatenate([data.values, 0.5j * data.values]), channels=("HH", "HV"))
    weights = aperture_window("taylor", 16)
    plain = range_migration_reference(small, grid, weights=weights, **pattern)
    fast = range_migration(small, grid, weights=weights, **pattern)
    assert relative_db(fast, plain) < -85
    assert relative_db(plain, backproject(small, grid, weights=weights, interpolator="sinc16", **pattern)) < -60


@pytest.mark.parametrize(
    "x_m",
    [np.arange(-3, 3, 0.1), np.arange(3, -3, -0.1), np.linspace(0.2, 0.9, 40), np.array([-2.0, -1.9, 0.1, 2.2]), [0.0]],
)
def test_columns_stand_where_they_are_asked_for(profiles, x_m):
    # Equal steps are read directly, fine ones and unequal ones by a kernel; all are the same image.
    grid = ground(x_m, np.arange(8, 20, 0.7))
    expected = backproject(profiles, grid, interpolator="sinc16")[0]
    assert relative_db(range_migration(profiles, grid)[0], expected) < -60


def mapping_of(exponent=0.0):
    along = np.linspace(-40, 40, 70)
    first = np.floor(np.sqrt(np.maximum(90.0**2 - along**2, 0)) / 0.02).astype(np.int64)
    return Mapping(along, 90.0, 0.05, 95.0, 11.0, first, 0.02, 300, 10.0, 0.92, 0.88, exponent)


@pytest.mark.parametrize(("name", "error_db"), [("kaiser-bessel", -88), ("cubic-spline", -66), ("sinc8", -88)])
def test_stolt_filters_follow_the_closed_form(name, error_db):
    # Terms exp(-j (k - centre) r), r within the share of the period that the filter's oversampling leaves; their value
    # at any k is known. The filters' worst term: six Kaiser-Bessel taps at 1.5, four of a cubic spline at 4 (aliases
    # (1/7)^4 = -68 dB), eight windowed taps at 4 (field notes, section 9: -94 dB).
    mapping, taps = mapping_of(), FILTERS[name]
    rng = np.random.default_rng(0)
    period = 2 * np.pi / mapping.k_step
    ranges = rng.uniform(-0.5, 0.5, (70, 4)) * period / taps.oversampling * 0.98
    k = mapping.k_first + mapping.k_step * np.arange(300)
    terms = np.exp(-1j * (k - mapping.centre)[:, None, None] * ranges) / taps.response(ranges / period)
    spectrum = terms.sum(axis=2)
    mapped = stolt_reference(spectrum, mapping, taps)
    across = mapping.across_step * (mapping.across_first + np.arange(300)[:, None])
    wanted = np.hypot(across, mapping.along)
    edge = smooth_step(np.clip((across / wanted - 0.88) / 0.04, 0, 1))
    turned = np.exp(1j * (mapping.middle_m * across - mapping.bulk_m * (wanted - mapping.centre)))
    exact = np.exp(-1j * (wanted - mapping.centre)[:, :, None] * ranges).sum(axis=2)
    exact *= edge * np.sqrt(2 * np.pi / across) * turned
    inside = (wanted >= k[taps.taps // 2]) & (wanted <= k[-taps.taps // 2 - 1])
    assert inside.mean() > 0.3
    assert relative_db(mapped[inside], exact[inside]) < error_db
    assert (mapped[(wanted < k[0]) | (wanted > k[-1])] == 0).all()


@pytest.mark.parametrize("exponent", [0.0, 1.7])
@pytest.mark.parametrize("name", list(FILTERS))
def test_stolt_kernel_follows_its_reference(name, exponent):
    rng = np.random.default_rng(2)
    spectrum = (rng.normal(size=(400, 70)) + 1j * rng.normal(size=(400, 70))).astype(np.complex64)
    plain = stolt_reference(spectrum, mapping_of(exponent), FILTERS[name])
    # Nearest of 8192 entries of the table: a slope of at most about 2 per sample, over 16384.
    np.testing.assert_allclose(
        stolt(spectrum, mapping_of(exponent), FILTERS[name]), plain, atol=1e-3 * np.abs(plain).max()
    )
    assert relative_db(stolt(spectrum, mapping_of(exponent), FILTERS[name]), plain) < -75


@settings(max_examples=8, deadline=None)
@given(a=st.complex_numbers(max_magnitude=5), b=st.complex_numbers(max_magnitude=5), seed=st.integers(0, 100))
def test_it_is_linear(a, b, seed):
    rng = np.random.default_rng(seed)
    grid = ground(np.linspace(-2, 2, 9), np.linspace(6, 12, 8))
    data = sinc_profiles([(1.0, 8.0, -1.069)], rail(21), [[1.0]])
    one, two = (rng.normal(size=data.values.shape) + 1j * rng.normal(size=data.values.shape) for _ in range(2))
    first, second, both = (range_migration(replace(data, values=v), grid) for v in (one, two, a * one + b * two))
    size = (abs(a) + abs(b) + 1e-3) * np.abs(first).max()
    # complex64 through four transforms.
    np.testing.assert_allclose(both, a * first + b * second, atol=2e-5 * size)


@settings(max_examples=8, deadline=None)
@given(x=st.floats(-50, 50), y=st.floats(-50, 50), z=st.floats(-5, 5))
def test_scene_and_rail_may_stand_anywhere(x, y, z):
    data = sinc_profiles([(1.0, 8.0, -1.069)], rail(21), [[1.0]])
    grid = ground(np.linspace(-2, 2, 9), np.linspace(6, 12, 8))
    moved = replace(data, antenna_m=data.antenna_m + np.array([x, y, z]))
    there = ImageGrid(grid.x_m + x, grid.y_m + y, grid.z_m + z)
    np.testing.assert_allclose(range_migration(moved, there), range_migration(data, grid), atol=2e-5)


def test_sum_of_the_pattern_is_that_of_every_position():
    # Chebyshev nodes against the plain sum of the antennas' pattern over the positions.
    track = straight_track(rail(), 0.125)
    weights = aperture_window("taylor", 61)
    grid = ground(np.linspace(-9, 9, 300), np.linspace(2.5, 30, 200))
    plain = sum(
        w * two_way_gain(place, grid, np.radians(70), np.radians(17)) ** 2
        for place, w in zip(rail(), weights, strict=True)
    )
    made = pattern_sum(track, weights, grid, np.radians(70), np.radians(17))
    np.testing.assert_allclose(made, plain, rtol=1e-5, atol=1e-7 * plain.max())
