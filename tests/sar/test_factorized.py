from dataclasses import replace

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rail_data import Frequencies, ground, rail, relative_db, sinc_profiles
from spotlight_data import flight, profiles, scattered, square

from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.sar.aperture import aperture_window
from processing.sar.backprojection import backproject_reference
from processing.sar.factorized import factorized
from processing.sar.factorized_settings import STAGE_ERROR_DB, expected_error_db, settings_for
from processing.sar.grid import HeightMapGrid, ImageGrid, PolarGrid
from processing.sar.patch_sum import TABLE_STEPS, column_table, patch_sum_reference, patches_sum, row_table

PIXELS, STEP = 96, 0.16
SPAN = PIXELS * STEP


@pytest.fixture(scope="module")
def spotlight():
    return profiles(scattered(20, SPAN), flight(256), SPAN)


@pytest.fixture(scope="module")
def truth(spotlight):
    return backproject_reference(spotlight, square(PIXELS))[0]


# -50 dB is the default, -70 dB the finest promise; the reference's own filter is exact to -120 dB at four bins a cell.
@pytest.mark.parametrize("tolerance", [-50.0, -60.0, -70.0])
def test_error_stays_within_the_tolerance(spotlight, truth, tolerance):
    assert relative_db(factorized(spotlight, square(PIXELS), tolerance_db=tolerance)[0], truth) < tolerance


def test_measured_error_is_that_of_the_table(spotlight, truth):
    # The table holds what a merging costs at most; this aperture may need one merging less than its pulses allow.
    for chosen in STAGE_ERROR_DB:
        error = relative_db(factorized(spotlight, square(PIXELS), settings=chosen)[0], truth)
        predicted = expected_error_db(chosen, 256, 4.0)
        assert predicted - 6 < error < predicted + 1


def test_near_a_rail_that_sees_under_seventy_degrees():
    # Nothing here is far or narrow: the aperture is as long as the distance to the nearest pixels.
    targets = [(0.0, 10.0, -1.069), (3, 10, -1.069), (-5, 20, -1.069), (2, 5, -1.069), (-6.5, 8, -1.069)]
    data = Frequencies(targets, rail(), amplitudes=[1, 0.7j, -1.2, 0.4, 0.9]).profiles(8)
    grid = ground(np.arange(-8, 8, 0.25), np.arange(3, 25, 0.5))
    pattern = {"beamwidth_rad": np.radians(70), "depression_rad": np.radians(17)}
    expected = backproject_reference(data, grid)[0]
    assert relative_db(factorized(data, grid)[0], expected) < -50
    # Compensation divides by the pattern, and so raises errors beyond the beam, which products hide.
    ahead = ground(np.arange(-3, 3, 0.25), np.arange(6, 25, 0.5))
    expected = backproject_reference(data, ahead, **pattern)[0]
    assert relative_db(factorized(data, ahead, **pattern)[0], expected) < -50
    weights = aperture_window("taylor", 61)
    expected = backproject_reference(data, grid, weights=weights)[0]
    assert relative_db(factorized(data, grid, weights=weights)[0], expected) < -50


def wavy(antenna):
    """A track that nobody flies: bent by metres, uneven steps."""
    part = np.linspace(-1, 1, len(antenna))
    uneven = antenna[:, 0] * (1 + 0.05 * np.sin(9 * part))
    return np.column_stack([uneven, antenna[:, 1] + 20 * part**2, antenna[:, 2] + 5 * np.sin(4 * part)])


def circle(pulses, radians):
    angle = np.linspace(0, radians, pulses) + 0.3
    return np.column_stack([7000 * np.cos(angle), 7000 * np.sin(angle), np.full(pulses, 7300.0)])


@pytest.mark.parametrize(
    "antenna",
    [
        wavy(flight(200)),
        flight(200, squint_rad=0.6),
        circle(200, 0.05),
        circle(240, 0.2)[np.random.default_rng(1).permutation(240)],
        flight(200, range_m=1e6, height_m=5e5),
    ],
    ids=["bent", "squinted", "circle", "circle in any order", "from orbit"],
)
def test_any_track(antenna):
    data = profiles(scattered(12, 8.0, seed=2), antenna, 8.0)
    grid = square(48)
    assert relative_db(factorized(data, grid)[0], backproject_reference(data, grid)[0]) < -50


def test_a_whole_circle_is_summed_of_parts():
    antenna = circle(480, 2 * np.pi * 479 / 480)
    data = profiles(scattered(6, 4.0, seed=2), antenna, 4.0, centre_hz=1e9, bandwidth_hz=200e6)
    grid = square(40, 0.08)
    assert relative_db(factorized(data, grid)[0], backproject_reference(data, grid)[0]) < -50


def test_channels_with_antennas_of_their_own():
    pairs = (AntennaPair(), AntennaPair((-3.0, 0.0, 0.5), (3.0, 0.5, 0.0)), AntennaPair(), AntennaPair())
    data = profiles(scattered(8, 8.0), flight(128), 8.0, pairs=pairs)
    values = data.values.copy()
    values[2] *= 0.5j
    values[3, 40:50] = np.nan
    data = replace(data, values=values)
    expected = backproject_reference(data, square(48))
    for image, truth in zip(factorized(data, square(48)), expected, strict=True):
        assert relative_db(image, truth) < -50


def test_polar_grids_and_planes_of_any_height(spotlight):
    slant = np.arange(7995, 8005, 0.2)
    angle = np.linspace(-4e-4, 4e-4, 30)
    origin = (0.0, -np.sqrt(8e3**2 - 3e3**2), 3e3)
    polar = PolarGrid(slant, angle, 0.0, origin)
    assert relative_db(factorized(spotlight, polar)[0], backproject_reference(spotlight, polar)[0]) < -50
    raised = ImageGrid(np.arange(-4, 4, 0.2), np.arange(-4, 4, 0.2), 2.0)
    assert relative_db(factorized(spotlight, raised)[0], backproject_reference(spotlight, raised)[0]) < -50


def test_pixels_whose_range_is_off_the_profiles_are_undefined(spotlight):
    far = ImageGrid(np.arange(-4, 4, 0.5), np.arange(-20, 20, 0.5), 0.0)
    image, expected = factorized(spotlight, far)[0], backproject_reference(spotlight, far)[0]
    assert np.isnan(expected).any()
    assert np.isnan(image[np.isnan(expected)]).all()
    # Interpolation reaches some eight cells of 0.2 m over the ground further than back-projection does.
    lost = np.isnan(image) & ~np.isnan(expected)
    assert lost.sum() < 2 * 8 * 0.25 / 0.5 * len(far.x_m)
    assert relative_db(image, expected) < -50


def test_bits_do_not_depend_on_the_number_of_threads(spotlight):
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = factorized(spotlight, square(64))
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(factorized(spotlight, square(64)), alone)


def test_few_pulses_and_few_pixels():
    one = sinc_profiles([(1.0, 8.0, -1.069)], rail(1), [[1.0]], last_m=60.0)
    grid = ground([1.0, 1.2], np.arange(6, 12, 0.25))
    assert relative_db(factorized(one, grid)[0], backproject_reference(one, grid)[0]) < -50
    three = sinc_profiles([(1.0, 8.0, -1.069)], rail(3), [[1.0]], last_m=60.0)
    assert factorized(three, ground([1.0], [8.0]))[0, 0, 0] == pytest.approx(1.0, abs=3e-3)
    pattern = {"beamwidth_rad": 1.2, "depression_rad": 0.3}
    for x, y in (([1.0], [8.0]), ([1.0], np.arange(6, 12, 0.25)), ([0.8, 1.0, 1.2], [7.0, 8.0])):
        small = ground(x, y)
        image, expected = (method(three, small, **pattern)[0] for method in (factorized, backproject_reference))
        assert relative_db(image, expected) < -50


def test_what_is_not_taken_is_refused_with_advice(spotlight):
    spoiled = spotlight.values.copy()
    spoiled[0, 3, 40] = np.nan
    with pytest.raises(DataError, match="single NaN"):
        factorized(replace(spotlight, values=spoiled), square(8))
    abreast = ImageGrid(np.arange(-4, 4, 1.0), np.arange(-7500, -7300, 10.0), 0.0)
    with pytest.raises(DataError, match="one side of the track"):
        factorized(spotlight, abreast)
    with pytest.raises(DataError, match="no plane"):
        factorized(spotlight, HeightMapGrid(np.arange(3.0), np.arange(2.0), np.arange(6.0).reshape(2, 3)))
    with pytest.raises(DataError, match="empty"):
        factorized(spotlight, ImageGrid(np.array([]), np.array([1.0]), 0.0))
    with pytest.raises(DataError, match="meets its plane"):
        factorized(spotlight, PolarGrid(np.array([1.0]), np.array([0.0]), 0.0, (0.0, 0.0, 50.0)))
    moving = replace(spotlight, velocity_m_s=np.full((256, 3), 200.0), ramp_s=1e-2)
    with pytest.raises(DataError, match="motion within the sweeps"):
        factorized(moving, square(8))
    with pytest.raises(DataError, match="negative"):
        factorized(spotlight, square(8), tolerance_db=3.0)
    with pytest.raises(DataError, match="too few"):
        factorized(replace(spotlight, values=spotlight.values[..., :9], range_m=spotlight.range_m[:9]), square(8))


@settings(deadline=None)
@given(tolerance=st.floats(-120, -1), pulses=st.integers(1, 100_000), oversampling=st.floats(2, 32))
def test_settings_promise_what_is_asked_or_the_best_there_is(tolerance, pulses, oversampling):
    choice = settings_for(tolerance, pulses, oversampling)
    best = settings_for(-300.0, pulses, oversampling)
    assert choice.predicted_error_db <= tolerance or choice == best
    assert choice.predicted_error_db >= best.predicted_error_db


@numba.njit
def read(samples, begin, pitch, along, across, place, entries, parts, phase, out):
    for i in range(out.shape[0]):
        out[i, 0], out[i, 1] = patches_sum(
            samples, begin, pitch, 8, along, across, place, entries, parts, phase, 3, out.shape[0], i, 2
        )


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_patches_follow_their_float64_definition(seed):
    rng = np.random.default_rng(seed)
    count, shapes = 7, ((30, 40), (20, 25))
    arrays = [(rng.normal(size=s) + 1j * rng.normal(size=s)).astype(np.complex64) for s in shapes]
    begin, pitch = np.array([0, 1200]), np.array([40, 25])
    at = rng.random((2, 2, count)) * 0.999
    rows, columns = rng.integers(0, 12, (2, count)), rng.integers(0, 17, (2, count))
    phase = rng.normal(size=(2, 2, count)).astype(np.float32)
    padded = [np.zeros((2, 3, count), kind) for kind in (np.int32, np.float32, np.float32)]
    padded[0][:, :2], padded[1][:, :2] = np.floor(at * TABLE_STEPS), (at * TABLE_STEPS) % 1
    padded[2][:, :2] = phase
    place = np.zeros((3, count), np.int32)
    place[:2] = rows * pitch[:, None] + columns
    out = np.empty((count, 2), np.float32)
    flat = np.concatenate([a.ravel() for a in arrays]).view(np.float32)
    read(flat, begin, pitch, row_table(8, 2.0).ravel(), column_table(1.8).ravel(), place, *padded, out)
    for i in range(count):
        expected = sum(
            patch_sum_reference(a[r : r + 8, c : c + 8], at[0, k, i], at[1, k, i], (2.0, 1.8))
            * complex(*phase[:, k, i])
            for k, (a, r, c) in enumerate(zip(arrays, rows[:, i], columns[:, i], strict=True))
        )
        # Tables: linear between 256 steps, pi^2 / 8 / 256^2 of sixteen samples of size one or two, two axes.
        assert complex(*out[i]) == pytest.approx(expected, abs=1e-3)
