"""Registration corrected by reflectors and by what both pictures show."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy_registration import CELL_M, GROUND_M, _pair
from polfuse_lab.products.fuse_sources import shift_of_pictures
from processing.errors import DataError
from processing.fusion.registration import GeometryErrors, registration_error
from processing.fusion.registration_refine import (
    point_errors,
    point_range_sd_m,
    shift_by_pictures,
    shift_by_points,
)
from processing.optics.camera_model import Pinhole


def test_a_points_place_in_its_cell_is_known_as_well_as_the_bound_says() -> None:
    # Matched filter of a flat band in white noise, by Monte Carlo: phases over frequency of a unit echo, the envelope's
    # peak.
    random = np.random.default_rng(1)
    count, trials, snr = 64, 400, 10 ** (25 / 10)
    frequency = (np.arange(count) - (count - 1) / 2) / count
    noise = random.normal(size=(2, trials, count))
    echoes = 1 + np.sqrt(count / snr / 2) * (noise[0] + 1j * noise[1])
    offsets = np.linspace(-0.15, 0.15, 301)
    envelope = np.abs(echoes @ np.exp(-2j * np.pi * np.outer(frequency, offsets)))
    scatter = float(np.std(offsets[np.argmax(envelope, axis=1)]))
    # 400 trials: 3.5 % each side for one sd; the bound is met above 20 dB.
    assert scatter == pytest.approx(point_range_sd_m(1.0, 25.0), rel=0.12)


def test_points_below_two_pixels_where_cells_are_not() -> None:
    camera = Pinhole(0.008, 8.3e-6, 782, 582, depression_rad=float(np.radians(10)))
    points = point_errors(CELL_M, 0.3, 40.0, angle_rad=3e-4, height_m=0.0)
    cells = GeometryErrors(CELL_M / np.sqrt(12), 0.3 / np.sqrt(12), 3e-4, 0.0)
    y = np.arange(5.0, 17.0)
    assert registration_error(camera, [0.0], y, GROUND_M, points).total.max() < 2
    assert (registration_error(camera, [0.0], y, GROUND_M, cells).total > 2).all()


def test_shift_by_points_is_the_mean_with_its_scatter() -> None:
    u, v = np.array([10.0, 200.0, 400.0]), np.array([50.0, 60.0, 90.0])
    told = shift_by_points(u, v, u + np.array([4.0, 5.0, 6.0]), v - 3.0)
    assert (told.right_px, told.down_px) == (5.0, -3.0)
    assert told.right_sd_px == pytest.approx(1 / np.sqrt(3))
    assert told.down_sd_px == pytest.approx(0.0, abs=1e-12)
    # rms of distances: sqrt((16 + 25 + 36 + 27) / 2) over 1 pixel squared twice.
    assert told.gain == pytest.approx(np.sqrt(104 / 2))
    assert told.size_px == pytest.approx(np.hypot(5, 3))
    with pytest.raises(DataError, match="two or more"):
        shift_by_points([1.0], [1.0], [2.0], [2.0])


@pytest.mark.parametrize("measure", ["mutual_information", "cfog"])
def test_pictures_of_other_contrasts_tell_their_shift(measure) -> None:
    span_db, picture, u, v, truth = _pair(3)
    told = shift_by_pictures(span_db, picture, u, v, measure=measure, largest_px=15.0)
    # Cells of a pixel and four looks: within 4 of its own sds, and 2 pixels.
    error = np.hypot(told.right_px - truth[0], told.down_px - truth[1])
    assert error < min(4 * np.hypot(told.right_sd_px, told.down_sd_px), 2.0)
    assert told.gain > 1.2


def test_a_shift_beyond_the_search_is_said_to_be_unknown() -> None:
    span_db, picture, u, v, truth = _pair(1)
    told = shift_by_pictures(span_db, picture, u + truth[0] + 25, v + truth[1], largest_px=9.0)
    assert np.hypot(told.right_sd_px, told.down_sd_px) > 3 or np.isinf(told.right_sd_px)
    with pytest.raises(DataError, match="no measure"):
        shift_by_pictures(span_db, picture, u, v, measure="likeness")  # type: ignore[arg-type]
    with pytest.raises(DataError, match="400"):
        shift_by_pictures(span_db[:5, :5], picture, u[:5, :5], v[:5, :5])
    with pytest.raises(DataError, match="camera pixel"):
        shift_by_pictures(span_db, picture, u[:5], v)


def test_fusion_takes_the_shift_only_where_it_tells_more_than_the_rig() -> None:
    span_db, picture, u, v, truth = _pair(3)
    span = 10 ** (span_db / 10)
    notes: list[str] = []
    shift = shift_of_pictures(span, picture, (u, v), 0.5, 10.0, notes)
    assert shift is not None
    assert notes == []
    assert np.hypot(shift.right_px - truth[0], shift.down_px - truth[1]) < 2
    # A direction that is known better, a cell that is too long, and a picture that is too small.
    assert shift_of_pictures(span, picture, (u, v), 0.1, 0.2, notes) is None
    assert shift_of_pictures(span, picture, (u, v), 35.0, 10.0, notes) is None
    assert shift_of_pictures(span[:4, :4], picture, (u[:4, :4], v[:4, :4]), 0.5, 10.0, notes) is None
    assert len(notes) == 3
    assert all("by geometry alone" in note for note in notes)
