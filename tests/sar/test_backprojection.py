import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rail_data import (
    BANDWIDTH_HZ,
    CELL_M,
    CENTRE_HZ,
    C,
    Frequencies,
    distances,
    ground,
    rail,
    relative_db,
    sinc_profiles,
)

from processing.errors import DataError
from processing.radar.profiles import RangeProfiles
from processing.sar.aperture import aperture_window
from processing.sar.backprojection import backproject, backproject_reference
from processing.sar.interpolation import INTERPOLATOR_TAPS, tap_table, tap_weights

TARGETS = [(0.0, 10.0), (3, 10), (-5, 20), (0, 30), (8, 30), (-12, 40), (2, 5)]
"""Of the field's accuracy table: rail in the plane of the targets."""
GRID = ground(np.arange(-16, 16, 0.3), np.arange(3, 45, 0.8), z=0.0)


@pytest.fixture(scope="module")
def table_data():
    return Frequencies([(x, y, 0.0) for x, y in TARGETS], rail())


@pytest.fixture(scope="module")
def truth(table_data):
    return table_data.matched_filter(GRID)


# Field notes, section 9: back-projection against an exact float64 matched filter, thesis's rail, whole dB.
TABLE_DB = {
    2: {"linear": -20, "cubic": -30, "lagrange4": -31, "sinc8": -67},
    4: {"linear": -32, "cubic": -51, "lagrange4": -54, "sinc8": -94},
    8: {"linear": -44, "cubic": -71, "lagrange4": -78, "sinc8": -106},
    16: {"linear": -56, "cubic": -89, "lagrange4": -102, "sinc8": -114},
}


@pytest.mark.parametrize("oversampling", TABLE_DB)
def test_error_against_the_exact_matched_filter_is_that_of_the_table(table_data, truth, oversampling):
    profiles = table_data.profiles(oversampling)
    for interpolator, expected in TABLE_DB[oversampling].items():
        error = relative_db(backproject(profiles, GRID, interpolator=interpolator)[0], truth)
        # Half a decibel for the table's own rounding, where the filter is the same; eight taps have no excuse.
        assert error < (expected if interpolator == "sinc8" else expected + 0.5)


def test_kaisers_window_is_what_the_table_was_measured_with(table_data, truth):
    for oversampling, expected in {2: -67, 4: -93.5, 8: -106, 16: -114}.items():
        image = backproject(table_data.profiles(oversampling), GRID, interpolator="kaiser8")[0]
        assert relative_db(image, truth) == pytest.approx(expected, abs=1.0)


def test_sixteen_taps_reach_single_precision(table_data, truth):
    # complex64 samples and table entries: rounding of 6e-8 relative, about -140 dB; the tables' own error is below.
    error = relative_db(backproject(table_data.profiles(8), GRID, interpolator="sinc16")[0], truth)
    assert error < -135


def test_reference_reaches_double_precision_of_its_filter(table_data, truth):
    # Kaiser's design of 16 taps at 8 bins per cell leaves below -190 dB.
    assert relative_db(backproject_reference(table_data.profiles(8), GRID)[0], truth) < -190


@pytest.mark.parametrize("interpolator", INTERPOLATOR_TAPS)
@pytest.mark.parametrize("beamwidth", [None, 1.22])
def test_kernel_follows_the_reference(table_data, interpolator, beamwidth):
    # Same filter on both sides: what differs is float32 samples and weights (-135 dB), sharpest where g is small.
    profiles = table_data.profiles(4)
    kernel = backproject(profiles, GRID, interpolator=interpolator, beamwidth_rad=beamwidth, depression_rad=0.3)
    plain = backproject_reference(
        profiles, GRID, interpolator=interpolator, beamwidth_rad=beamwidth, depression_rad=0.3
    )
    # The tables' linear interpolation between 512 entries is exact for "linear" and below -118 dB for the others.
    assert relative_db(kernel, plain) < -118


def test_a_target_shows_its_amplitude_and_phase_at_its_place():
    # Definition of the normalisation: |image| = sqrt(sigma), phase that of S, whatever range and channel.
    places = [(0.0, 8.0, -1.069), (-4.0, 15.0, -1.069)]
    s = np.array([[2.0, 0.5], [0.3j, 1.0], [-0.3j, 0.0], [1.5 * np.exp(1j), -1.0]])
    for index, place in enumerate(places):
        alone = sinc_profiles([place], rail(), s[:, index : index + 1])
        image = backproject(alone, ground([place[0]], [place[1]]), interpolator="sinc16")[:, 0, 0]
        np.testing.assert_allclose(image, s[:, index], atol=2e-6)


def test_one_position_gives_the_profile_at_the_pixels_range():
    # Unweighted band-limited data: the envelope is a sinc of c/2B, carrier removed.
    profiles = sinc_profiles([(0.0, 12.0, 0.0)], rail(1), [[1.0]])
    y = np.arange(10, 14, 0.05)
    image = backproject(profiles, ground([0.0], y, z=0.0), interpolator="sinc16")[0, :, 0]
    expected = np.sinc((y - 12) / CELL_M) * np.exp(4j * np.pi * CENTRE_HZ / C * (y - 12))
    np.testing.assert_allclose(image, expected, atol=2e-6)


def test_pattern_compensation_restores_what_the_antennas_weakened():
    # One-way power pattern cos^n with half power at half the beam width: written out here.
    beamwidth, depression = np.radians(70), np.radians(17)
    n = np.log(0.5) / np.log(np.cos(beamwidth / 2))
    axis = np.array([0, np.cos(depression), -np.sin(depression)])

    def gains(antenna, target):
        sight = np.asarray(target) - antenna
        return (sight @ axis / np.linalg.norm(sight, axis=1)) ** n

    place = (4.0, 7.0, -1.069)
    profiles = sinc_profiles([place], rail(), [[1.0]], gains=gains)
    grid = ground([place[0]], [place[1]])
    mended = backproject(profiles, grid, interpolator="sinc16", beamwidth_rad=beamwidth, depression_rad=depression)
    np.testing.assert_allclose(mended, 1.0, atol=3e-6)
    plain = backproject(profiles, grid, interpolator="sinc16")
    np.testing.assert_allclose(plain, gains(rail(), place).mean(), atol=3e-6)


def test_behind_the_antennas_nothing_is_defined_when_the_pattern_is_compensated():
    profiles = sinc_profiles([(0.0, 8.0, 0.0)], rail(), [[1.0]])
    grid = ground([0.0], [-8.0, 8.0], z=0.0)
    assert np.isnan(backproject(profiles, grid, beamwidth_rad=1.2)[0, 0, 0])
    # Without a pattern a rail cannot tell left from right: the mirror image is what the data say.
    plain = backproject(profiles, grid)[0, :, 0]
    assert plain[0] == pytest.approx(plain[1], abs=1e-6)


def test_pixels_off_the_range_axis_are_undefined():
    profiles = sinc_profiles([(0.0, 8.0, 0.0)], rail(), [[1.0]], last_m=20.0)
    image = backproject(profiles, ground([0.0], [10.0, 19.9, 60.0], z=0.0))[0, :, 0]
    assert np.isfinite(image[0])
    assert np.isnan(image[1:]).all()


def test_missing_profiles_are_left_out_and_the_scale_kept():
    full = sinc_profiles([(1.0, 8.0, -1.069)], rail(), [[1.0], [1.0]])
    values = full.values.copy()
    values[1, 10:20] = np.nan
    image = backproject(replace(full, values=values), ground([1.0], [8.0]), interpolator="sinc16")
    np.testing.assert_allclose(image[:, 0, 0], 1.0, atol=2e-6)


def test_a_single_undefined_sample_spoils_the_pixels_that_touch_it_and_no_others():
    full = sinc_profiles([(0.0, 8.0, 0.0)], rail(), [[1.0]])
    values = full.values.copy()
    spoiled = int(np.argmin(np.abs(full.range_m - 12.0)))
    values[0, 30, spoiled] = np.nan
    y = np.arange(6.0, 18.0, 0.25)
    image = backproject(replace(full, values=values), ground([0.0], y, z=0.0))[0, :, 0]
    reads = np.abs(y - full.range_m[spoiled]) < 4 * full.range_step_m
    assert np.isnan(image[reads]).all()
    clean = np.abs(y - full.range_m[spoiled]) > 5 * full.range_step_m
    np.testing.assert_array_equal(image[clean], backproject(full, ground([0.0], y, z=0.0))[0, clean, 0])


def test_repeated_positions_are_averaged():
    once = sinc_profiles([(0.0, 8.0, 0.0)], rail(), [[1.0]])
    twice = replace(
        once, values=np.concatenate([once.values] * 2, axis=1), antenna_m=np.concatenate([once.antenna_m] * 2)
    )
    grid = ground(np.linspace(-2, 2, 9), np.linspace(6, 12, 9), z=0.0)
    np.testing.assert_allclose(backproject(twice, grid), backproject(once, grid), atol=1e-6)


def test_the_window_along_the_aperture_weighs_the_pulses():
    data = sinc_profiles([(0.0, 10.0, 0.0)], rail(), [[1.0]])
    weights = aperture_window("taylor", 61)
    grid = ground([0.0, 0.7, 1.4], [10.0], z=0.0)
    image = backproject(data, grid, weights=weights, interpolator="sinc16")[0, 0]
    # Closed form: the weighted mean of every pulse's sinc and phase at the pixel's range.
    for x, pixel in zip(grid.x_m, image, strict=True):
        away, true = distances(rail(), (x, 10.0, 0.0)), distances(rail(), (0.0, 10.0, 0.0))
        pulses = np.sinc((away - true) / CELL_M) * np.exp(4j * np.pi * CENTRE_HZ / C * (away - true))
        assert pixel == pytest.approx(np.sum(weights * pulses) / weights.sum(), abs=2e-6)


def test_results_do_not_depend_on_the_number_of_threads():
    script = """
import hashlib, numba, numpy as np, sys
from processing.radar.profiles import RangeProfiles
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid
from processing.sar.range_migration import range_migration
numba.set_num_threads(int(sys.argv[1]))
rng = np.random.default_rng(5)
values = (rng.normal(size=(2, 31, 160)) + 1j * rng.normal(size=(2, 31, 160))).astype(np.complex64)
antenna = np.column_stack([np.linspace(-0.75, 0.75, 31), np.zeros((31, 2))])
profiles = RangeProfiles(values, 0.23 * np.arange(160), antenna, ("HH", "VV"), 2.4e9, 80e6)
grid = ImageGrid(np.linspace(-5, 5, 300), np.linspace(4, 20, 33), -1.0)
image = backproject(profiles, grid, beamwidth_rad=1.2, depression_rad=0.3)
other = range_migration(profiles, grid, beamwidth_rad=1.2, depression_rad=0.3)
print(hashlib.sha256(image.tobytes() + other.tobytes()).hexdigest())
"""
    import numba

    most = numba.config.NUMBA_NUM_THREADS
    counts = {1, most} if most > 1 else {1}
    prints = {
        subprocess.run(
            [sys.executable, "-c", script, str(n)], capture_output=True, text=True, timeout=100, check=True
        ).stdout
        for n in sorted(counts)
    }
    assert len(prints) == 1


@settings(max_examples=15, deadline=None)
@given(st.complex_numbers(max_magnitude=5), st.complex_numbers(max_magnitude=5), st.integers(0, 2**31))
def test_focusing_is_linear(a, b, seed):
    rng = np.random.default_rng(seed)
    p, q = (rng.normal(size=(1, 9, 120)) + 1j * rng.normal(size=(1, 9, 120)) for _ in range(2))
    grid = ground(np.linspace(-3, 3, 7), np.linspace(5, 15, 5))

    def image(values):
        axis = CELL_M / 8 * np.arange(120)
        return backproject(RangeProfiles(values, axis, rail(9), ("HH",), CENTRE_HZ, BANDWIDTH_HZ), grid)

    # Noise of unit variance: float32 rounding of each of the three images, about 1e-6 of the sums' size.
    np.testing.assert_allclose(image(a * p + b * q), a * image(p) + b * image(q), atol=2e-5 * (1 + abs(a) + abs(b)))


@settings(max_examples=15, deadline=None)
@given(st.floats(-3, 3), st.floats(0.05, 4))
def test_moving_rail_and_target_along_x_moves_the_image(shift, x):
    antenna = rail(21)
    here = sinc_profiles([(x, 9.0, -1.0)], antenna, [[1.0]])
    moved = replace(here, antenna_m=antenna + np.array([shift, 0, 0]))
    columns = np.linspace(-2, 5, 15)
    a = backproject(here, ground(columns, [8.0, 9.0]))
    b = backproject(moved, ground(columns + shift, [8.0, 9.0]))
    # Equal but for rounding of the shifted coordinates (1e-15 m, no phase) and of float32 filters.
    np.testing.assert_allclose(a, b, atol=1e-6)


@pytest.mark.parametrize("name", INTERPOLATOR_TAPS)
def test_filters_pass_samples_through_and_their_tables_agree(name):
    taps = INTERPOLATOR_TAPS[name]
    at_sample = np.zeros(taps)
    at_sample[taps // 2 - 1] = 1
    if name == "sinc8":
        # Designed for the band, not for the samples: what is in the band is passed through, to -115 dB in the mean
        # and some 20 dB more at its edges.
        waves = np.exp(2j * np.pi * np.outer(np.arange(-3, 5), np.linspace(-0.5, 0.5, 33) / 8))
        np.testing.assert_allclose(tap_weights(name, 0.0, 8) @ waves, 1.0, atol=3e-5)
    else:
        np.testing.assert_allclose(tap_weights(name, 0.0, 8), at_sample, atol=1e-15)
    # A constant is kept: exactly by polynomials, within the pass band's ripple by the sincs.
    np.testing.assert_allclose(tap_weights(name, np.linspace(0, 1, 33), 8).sum(axis=-1), 1.0, atol=2e-5)
    np.testing.assert_allclose(tap_table(name, 8)[256], tap_weights(name, 0.5, 8), atol=6e-8)
    # A place that is none has no weights, and nothing warns of it (warnings are errors here).
    nowhere = tap_weights(name, [np.nan, np.inf, -np.inf, 0.25], 8)
    assert np.isnan(nowhere[:3]).all()
    np.testing.assert_array_equal(nowhere[3], tap_weights(name, 0.25, 8))


def bad(**changes):
    return replace(sinc_profiles([(0.0, 8.0, 0.0)], rail(5), [[1.0]]), **changes)


@pytest.mark.parametrize(
    ("profiles", "words"),
    [
        (lambda: bad(values=np.zeros((5, 40), complex)), "shape"),
        (lambda: bad(antenna_m=np.zeros((4, 3))), "antenna places"),
        (lambda: bad(antenna_m=np.full((5, 3), np.nan)), "antenna places"),
        (lambda: bad(range_m=bad().range_m[::-1]), "range axis"),
        (
            lambda: bad(range_m=np.sort(np.abs(bad().range_m) ** 1.5) + 0.01 * np.arange(len(bad().range_m))),
            "not uniform",
        ),
        (lambda: bad(values=np.full_like(bad().values, np.inf)), "infinite"),
        (lambda: bad(values=np.full_like(bad().values, np.nan)), "no profile"),
        (lambda: bad(values=bad().values[..., :6], range_m=bad().range_m[:6]), "fewer than"),
    ],
)
def test_unusable_profiles_are_refused(profiles, words):
    for method in (backproject, backproject_reference):
        with pytest.raises(DataError, match=words):
            method(profiles(), ground([0.0], [8.0]), interpolator="sinc8")


def test_unusable_settings_are_refused():
    profiles, grid = bad(), ground([0.0], [8.0])
    with pytest.raises(DataError, match="interpolator"):
        backproject(profiles, grid, interpolator="nearest")
    for weights in ([1, 1], [1, 1, -1, 1, 1], [1, np.nan, 1, 1, 1]):
        with pytest.raises(DataError, match="weights"):
            backproject(profiles, grid, weights=np.array(weights, dtype=float))
    with pytest.raises(DataError, match="no profile with any weight"):
        backproject(profiles, grid, weights=np.zeros(5))
    with pytest.raises(DataError, match="grid"):
        backproject(profiles, ground([], [8.0]))
    with pytest.raises(DataError, match="height"):
        backproject(profiles, ground([0.0], [8.0], z=np.nan))
    with pytest.raises(DataError, match="beamwidth"):
        backproject(profiles, grid, beamwidth_rad=4.0)
    with pytest.raises(DataError, match="window"):
        aperture_window("square", 5)
