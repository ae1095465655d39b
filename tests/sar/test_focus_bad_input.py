"""What collects get wrong: a defined result or a clear error, by back-projection and by its factorized form."""

from dataclasses import replace

import numpy as np
import pytest
from rail_data import CELL_M, CENTRE_HZ, C, ground, rail, sinc_profiles

from processing.errors import DataError
from processing.sar.backprojection import LiveImage, backproject, backproject_reference
from processing.sar.factorized import factorized

GRID = ground(np.linspace(-2, 2, 24), np.linspace(6, 12, 30), z=0.0)
METHODS = pytest.mark.parametrize("method", [backproject, backproject_reference, factorized])
EXACT = pytest.mark.parametrize("method", [backproject, backproject_reference])


def data(antenna=None):
    return sinc_profiles([(0.3, 8.0, 0.0)], rail(21) if antenna is None else antenna, [[1.0]], last_m=60.0)


def relative(image, truth):
    """Root mean square error over the image; all of it has to be defined."""
    return np.linalg.norm(image - truth) / np.linalg.norm(truth)


@EXACT
def test_nan_samples_stay_where_they_are_read(method):
    full = data()
    values = full.values.copy()
    spoiled = int(np.argmin(np.abs(full.range_m - 9.0)))
    values[0, 10, spoiled] = np.nan
    image, clean = (method(replace(full, values=v), GRID, interpolator="sinc8")[0] for v in (values, full.values))
    away = np.hypot(GRID.x_m[None, :] - full.antenna_m[10, 0], GRID.y_m[:, None])
    read = np.abs(away - full.range_m[spoiled]) < 3.9 * full.range_step_m
    far = np.abs(away - full.range_m[spoiled]) > 4.1 * full.range_step_m
    assert np.isnan(image[read]).all()
    np.testing.assert_array_equal(image[far], clean[far])


def test_nan_samples_are_refused_where_they_would_spread():
    values = data().values.copy()
    values[0, 10, 100] = np.nan
    with pytest.raises(DataError, match="single NaN"):
        factorized(replace(data(), values=values), GRID)


@METHODS
def test_one_position_is_an_image_of_ranges(method):
    image = method(data(rail(1)), GRID)[0]
    away = np.hypot(GRID.x_m[None, :], GRID.y_m[:, None])
    true = np.hypot(0.3, 8.0)
    expected = np.sinc((away - true) / CELL_M) * np.exp(4j * np.pi * CENTRE_HZ / C * (away - true))
    # -50 dB, the factorized default; the others are at -115 dB and below.
    assert relative(image, expected) < (3.2e-3 if method is factorized else 2e-6)


@METHODS
def test_an_aperture_of_no_length_is_one_position(method):
    many = method(data(np.zeros((9, 3))), GRID)[0]
    one = method(data(rail(1)), GRID)[0]
    # The same sum nine times over nine; grids of parts may be laid otherwise.
    assert relative(many, one) < (3.2e-3 if method is factorized else 3e-6)


@METHODS
def test_positions_in_any_order_and_repeated_count_as_they_are(method):
    full = data()
    order = np.random.default_rng(0).permutation(21)
    shuffled = method(full.at_positions(order), GRID)
    assert relative(shuffled, method(full, GRID)) < (3.2e-3 if method is factorized else 3e-6)
    twice = method(full.at_positions(np.repeat(np.arange(21), 2)), GRID)
    assert relative(twice, method(full, GRID)) < (3.2e-3 if method is factorized else 3e-6)


def test_behind_the_track_is_its_mirror_image_or_refused():
    behind = ground(GRID.x_m, -GRID.y_m[::-1], z=0.0)
    # A straight track cannot tell one side from the other.
    for method in (backproject, backproject_reference):
        np.testing.assert_allclose(method(data(), behind)[0][::-1], method(data(), GRID)[0], atol=1e-5)
        assert np.isnan(method(data(), behind, beamwidth_rad=1.2)).all()
    # Parts of the aperture look to one side: they are laid for the image's, whichever it is; both at once are refused.
    both = ground(GRID.x_m, np.linspace(-8, 8, 30), z=0.0)
    with pytest.raises(DataError, match="one side"):
        factorized(data(), both)


@METHODS
@pytest.mark.parametrize("axes", [([], [8.0]), ([0.0], []), ([np.nan], [8.0]), ([0.0], [np.inf])])
def test_a_grid_without_pixels_is_refused(method, axes):
    with pytest.raises(DataError, match="grid"):
        method(data(), ground(*axes))


@METHODS
def test_ranges_outside_the_profiles_are_undefined(method):
    far = ground(np.linspace(-2, 2, 8), np.linspace(70, 80, 8), z=0.0)
    assert np.isnan(method(data(), far)).all()


def test_a_live_image_takes_no_position_twice_as_strong():
    live = LiveImage(GRID)
    one = data().at_positions(np.array([4]))
    for _ in range(3):
        live.add(one)
    np.testing.assert_allclose(live.image(), backproject(one, GRID), atol=1e-6)
