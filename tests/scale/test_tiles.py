"""Tiles have the bits of the whole: what has to hold for that, and what breaks it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.radar.profiles import RangeProfiles
from processing.sar import backprojection
from processing.sar.backprojection import LiveImage, backproject, pulses_in_block
from processing.sar.grid import HeightMapGrid, ImageGrid, PolarGrid
from processing.sar.tiles import ALIGNMENT, GridTile, square_tiles, tiles

PULSES, BINS = 150, 200
GRID = ImageGrid(np.linspace(-6, 6, 70), np.linspace(24, 36, 53), -10.0)


def noise_profiles(seed=3, channels=2):
    """Random profiles: every bit of every pixel depends on order and rounding."""
    rng = np.random.default_rng(seed)
    values = rng.standard_normal((channels, PULSES, BINS)) + 1j * rng.standard_normal((channels, PULSES, BINS))
    antenna = np.column_stack([np.linspace(-4, 4, PULSES), 0.03 * np.sin(np.arange(PULSES)), np.zeros(PULSES)])
    names = ("HH", "VV", "HV", "VH")[:channels]
    return RangeProfiles(values.astype(np.complex64), 20 + 0.125 * np.arange(BINS), antenna, names, 9.6e9, 300e6)


PROFILES = noise_profiles()


def bits(image):
    return np.ascontiguousarray(image).view(np.uint32)


def by_tiles(profiles, grid, pieces, **options):
    image = np.zeros((len(profiles.channels), *grid.shape), dtype=np.complex64)
    for tile in pieces:
        image[:, tile.rows, tile.columns] = backproject(profiles, tile, **options)
    return image


@given(st.integers(16, 80), st.integers(16, 80), st.sampled_from([None, 0.8]))
@settings(max_examples=6, deadline=None)
def test_any_tiles_give_the_bits_of_the_whole(rows, columns, beamwidth):
    whole = backproject(PROFILES, GRID, beamwidth_rad=beamwidth)
    pieces = tiles(GRID, rows, columns)
    np.testing.assert_array_equal(bits(by_tiles(PROFILES, GRID, pieces, beamwidth_rad=beamwidth)), bits(whole))


@pytest.mark.parametrize("kind", ["heights", "polar", "two antennas"])
def test_other_grids_and_bistatic_channels_have_tiles_too(kind):
    profiles, grid = PROFILES, GRID
    if kind == "heights":
        grid = HeightMapGrid(GRID.x_m, GRID.y_m, np.sin(np.arange(53 * 70)).reshape(53, 70) - 10)
    elif kind == "polar":
        grid = PolarGrid(np.linspace(26, 38, 45), np.linspace(-0.2, 0.2, 61), -10.0)
    else:
        profiles = replace(
            PROFILES, pairs=(AntennaPair((0.1, 0, 0), (0.1, 0, 0)), AntennaPair((0.1, 0, 0), (-0.2, 0, 0)))
        )
    whole = backproject(profiles, grid)
    np.testing.assert_array_equal(bits(by_tiles(profiles, grid, tiles(grid, 32, 16))), bits(whole))


@pytest.mark.parametrize("times", [1, 2])
def test_pulses_in_blocks_give_the_bits_of_all_at_once(monkeypatch, times):
    # Tables of a few pulses, so that there are several blocks; weights that no sum in float64 adds exactly.
    monkeypatch.setattr(backprojection, "TABLE_BYTES", 600_000)
    weights = np.linspace(0.1, 1, PULSES) ** 2
    whole = backproject(PROFILES, GRID, weights=weights)
    step = times * pulses_in_block(PROFILES)
    assert step < PULSES / 2
    live = LiveImage(GRID, track_m=PROFILES.antenna_m)
    for first in range(0, PULSES, step):
        some = slice(first, first + step)
        part = replace(PROFILES, values=PROFILES.values[:, some], antenna_m=PROFILES.antenna_m[some])
        live.add(part, weights=weights[some])
    np.testing.assert_array_equal(bits(live.finish()), bits(whole))


def test_blocks_depend_on_the_profiles_alone():
    assert pulses_in_block(PROFILES) == pulses_in_block(replace(PROFILES, values=PROFILES.values[:, :1]))
    assert pulses_in_block(PROFILES) % 128 == 0


def test_pieces_beside_the_patches_do_differ():
    # What alignment is for: the same pixels from a grid that begins five pixels further are equal to rounding only.
    whole = backproject(PROFILES, GRID)[:, :, 5:]
    apart = backproject(PROFILES, ImageGrid(GRID.x_m[5:], GRID.y_m, GRID.z_m))
    assert not np.array_equal(bits(apart), bits(whole))
    # 1.5e-5: float32 phases within a patch are good to 4e-6 turns (SMALL_TURNS), 2.5e-5 rad at worst.
    np.testing.assert_allclose(apart, whole, atol=2.5e-5 * np.abs(whole).max())


@given(st.integers(1, 200), st.integers(1, 200), st.integers(256, 5000))
def test_square_tiles_cover_every_pixel_once(height, width, pixels):
    grid = ImageGrid(np.arange(float(width)), np.arange(float(height)), 0.0)
    covered = np.zeros(grid.shape, dtype=int)
    for tile in square_tiles(grid, pixels):
        covered[tile.rows, tile.columns] += 1
        assert tile.shape[0] * tile.shape[1] <= max(pixels, ALIGNMENT * max(tile.shape)) or tile.shape == grid.shape
        assert tile.places_m()[0].shape == tile.shape
    assert (covered == 1).all()


@pytest.mark.parametrize("place", [(8, 0, 16, 16), (0, 0, 20, 16), (0, 0, 0, 16), (48, 0, 16, 16), (-16, 0, 16, 16)])
def test_what_is_no_tile_is_refused(place):
    with pytest.raises(DataError, match="no tile of the grid"):
        GridTile(GRID, *place)


def test_tiles_too_small_and_empty_grids_are_refused():
    with pytest.raises(DataError, match="too small"):
        tiles(GRID, 15, 64)
    with pytest.raises(DataError, match="too small"):
        square_tiles(GRID, 100)
    with pytest.raises(DataError, match="empty"):
        tiles(ImageGrid(np.zeros(0), np.zeros(3), 0.0), 16, 16)


def test_a_grid_of_one_pixel_is_one_tile():
    one = ImageGrid(np.array([0.5]), np.array([30.0]), -10.0)
    (tile,) = tiles(one, 16, 16)
    np.testing.assert_array_equal(bits(backproject(PROFILES, tile)), bits(backproject(PROFILES, one)))
