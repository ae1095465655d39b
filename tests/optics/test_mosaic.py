"""Polarization mosaics: names and phases, splitting, demosaicing against its definition and closed forms."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics.analyser import least_squares, measurement_matrix
from processing.optics.demosaic import demosaic, demosaic_reference
from processing.optics.mosaic import ANGLES_DEG, Mosaic, parse_mosaic, split, spread, through_mosaic

SONY = parse_mosaic("90-45-135-0")
EVERY = [Mosaic(((a, b), (c, d))) for a, b, c, d in itertools.permutations(ANGLES_DEG)]


def test_names_are_read_row_by_row() -> None:
    assert SONY.angles_deg == ((90, 45), (135, 0))
    assert SONY.name == "90-45-135-0"
    assert [SONY.place(angle) for angle in ANGLES_DEG] == [(1, 1), (0, 1), (0, 0), (1, 0)]
    assert all(parse_mosaic(mosaic.name) == mosaic for mosaic in EVERY)


@pytest.mark.parametrize("name", ["", "none", "90-45-135", "90-45-135-1", "90-90-0-45", "90/45/135/0", "90-45-135-0-0"])
def test_other_names_are_refused(name: str) -> None:
    with pytest.raises(DataError, match="mosaic"):
        parse_mosaic(name)


@given(mosaic=st.sampled_from(EVERY), rows=st.integers(0, 3), columns=st.integers(0, 3))
def test_a_region_has_the_phase_of_where_it_begins(mosaic: Mosaic, rows: int, columns: int) -> None:
    # Each pixel of the sensor carries its own angle as its value; the region must find the same angle there.
    sensor = np.tile(np.array(mosaic.angles_deg), (5, 5))
    region = sensor[rows : rows + 4, columns : columns + 4]
    planes = split(region, mosaic.shifted(rows, columns))
    for plane, angle in zip(planes, ANGLES_DEG, strict=True):
        assert np.all(plane == angle)


# No deadline: the kernel is compiled on its first call.
@settings(deadline=None)
@given(mosaic=st.sampled_from(EVERY), rows=st.integers(1, 6), columns=st.integers(1, 6), seed=st.integers(0, 2**32 - 1))
def test_the_kernel_is_its_definition(mosaic: Mosaic, rows: int, columns: int, seed: int) -> None:
    image = np.random.default_rng(seed).integers(0, 65_536, (2 * rows, 2 * columns), dtype=np.uint16)
    # Three additions and a scaling of float32, each with relative error 2^-24 at most.
    np.testing.assert_allclose(demosaic(image, mosaic), demosaic_reference(image, mosaic), rtol=4 * 2.0**-24)


@pytest.mark.parametrize("mosaic", EVERY, ids=lambda mosaic: mosaic.name)
def test_pixels_keep_their_own_value_and_planes_are_interpolated_exactly(mosaic: Mosaic) -> None:
    # Bilinear interpolation is exact for a + b x + c y; whole numbers below 2^24 are exact in float32.
    y, x = np.mgrid[0:8, 0:10]
    image = 4 * (100 + 7 * x + 11 * y)
    planes = demosaic(image, mosaic)
    for plane, angle in zip(planes, ANGLES_DEG, strict=True):
        i, k = mosaic.place(angle)
        np.testing.assert_array_equal(plane[i::2, k::2], image[i::2, k::2])
        np.testing.assert_array_equal(plane[1:-1, 1:-1], image[1:-1, 1:-1])
    np.testing.assert_array_equal(demosaic_reference(image, mosaic)[:, 1:-1, 1:-1], np.stack([image[1:-1, 1:-1]] * 4))


def test_a_lost_pixel_is_lost_where_it_is_used_and_nowhere_else() -> None:
    image = np.ones((8, 8), dtype=np.float32)
    image[3, 4] = np.nan
    lost = np.isnan(demosaic(image, SONY)).any(axis=0)
    np.testing.assert_array_equal(lost, np.isnan(demosaic_reference(image, SONY)).any(axis=0))
    np.testing.assert_array_equal(lost, spread(np.isnan(image)))
    assert lost.sum() == 9


@pytest.mark.parametrize("shape", [(3, 4), (4, 5), (4,), (0, 4), (2, 2, 2)])
def test_images_that_are_no_mosaic_are_refused(shape: tuple[int, ...]) -> None:
    for function in (split, demosaic, demosaic_reference):
        with pytest.raises(DataError, match="mosaic image has shape"):
            function(np.zeros(shape), SONY)


@pytest.mark.parametrize("mosaic", EVERY, ids=lambda mosaic: mosaic.name)
def test_uniform_polarized_light_comes_back_from_each_phase(mosaic: Mosaic) -> None:
    ratio = 300.0
    stokes = np.array([1000.0, 300.0, -200.0])
    image = through_mosaic(np.broadcast_to(stokes[:, None, None], (3, 6, 8)).copy(), mosaic, ratio)
    # Malus' law with leakage, written out: pixel behind 45 degrees.
    i, k = mosaic.place(45)
    assert image[i, k] == pytest.approx(0.5 * ((1 + 1 / ratio) * 1000 + (1 - 1 / ratio) * -200), rel=1e-12)
    solution = least_squares(measurement_matrix(np.radians(ANGLES_DEG), ratio))
    for planes in (demosaic_reference(image, mosaic), split(image, mosaic)):
        found = np.tensordot(solution, planes.astype(np.float64), axes=1)
        np.testing.assert_allclose(found, np.broadcast_to(stokes[:, None, None], found.shape), rtol=1e-10)
