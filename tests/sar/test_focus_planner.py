import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rail_data import Frequencies, ground, rail, relative_db

from processing.errors import DataError
from processing.sar.backprojection import backproject
from processing.sar.planner import (
    BACKPROJECTION_ERROR_DB,
    OVERSAMPLINGS,
    Task,
    backprojection_error_db,
    choices,
    choose,
    migration_error_db,
)

RAIL = {
    "pixels": 100_000,
    "pulses": 61,
    "channels": 4,
    "oversampling": 8,
    "wavelength_m": 0.125,
    "furthest_m": 40.0,
    "widest_rad": np.radians(72),
    "residual_m": 0.0,
    "compensated": True,
}


@pytest.mark.parametrize("column", range(len(OVERSAMPLINGS)))
def test_the_table_of_errors_is_what_is_measured(column):
    # The scenario of the field notes' table; 1 dB for the grid.
    targets = [(0.0, 10.0, 0.0), (3, 10, 0), (-5, 20, 0), (0, 30, 0), (8, 30, 0), (-12, 40, 0), (2, 5, 0)]
    data, grid = Frequencies(targets, rail()), ground(np.arange(-16, 16, 0.3), np.arange(3, 45, 0.8), z=0.0)
    truth, profiles = data.matched_filter(grid), data.profiles(OVERSAMPLINGS[column])
    for interpolator, row in BACKPROJECTION_ERROR_DB.items():
        measured = relative_db(backproject(profiles, grid, interpolator=interpolator)[0], truth)
        assert measured == pytest.approx(row[column], abs=1.0)


@pytest.mark.parametrize("oversampling", [3, 6])
def test_between_the_measured_oversamplings_the_prediction_holds_within_three_db(oversampling):
    data, grid = (
        Frequencies([(0.0, 10.0, 0.0), (3, 20, 0)], rail()),
        ground(np.arange(-8, 8, 0.4), np.arange(5, 30, 1.0), z=0.0),
    )
    truth = data.matched_filter(grid)
    for interpolator in ("linear", "cubic", "lagrange4"):
        measured = relative_db(backproject(data.profiles(oversampling), grid, interpolator=interpolator)[0], truth)
        assert measured == pytest.approx(backprojection_error_db(interpolator, oversampling), abs=3.0)


@given(st.floats(-160, -1), st.sampled_from(["auto", "bp", "rma"]), st.floats(1, 32), st.booleans())
def test_the_choice_is_the_cheapest_within_the_tolerance(tolerance, method, oversampling, even):
    task = Task(**{**RAIL, "oversampling": oversampling, "residual_m": 0.0 if even or method == "rma" else None})
    chosen = choose(task, tolerance, method)
    offered = [choice for choice in choices(task) if method in ("auto", choice.method)]
    fitting = [choice for choice in offered if choice.predicted_error_db <= tolerance]
    if fitting:
        assert chosen.predicted_error_db <= tolerance
        assert chosen.seconds == min(choice.seconds for choice in fitting)
    else:
        assert chosen.predicted_error_db == min(choice.predicted_error_db for choice in offered)
        assert "most exact" in chosen.reason


def test_tighter_tolerances_take_longer_filters():
    at = {tolerance: choose(Task(**RAIL), tolerance, "bp").interpolator for tolerance in (-40, -75, -100, -130)}
    assert at == {-40: "linear", -75: "lagrange4", -100: "sinc8", -130: "sinc16"}


def test_large_images_are_migrated_and_small_ones_summed():
    # Range migration costs its spectrum whatever the pixels; back-projection pixels times pulses.
    narrow = {**RAIL, "widest_rad": np.radians(35)}
    assert choose(Task(**{**narrow, "pixels": 4_000_000, "pulses": 600}), -50).method == "rma"
    assert choose(Task(**{**narrow, "pixels": 10_000}), -50).method == "bp"


def test_uneven_positions_are_paid_for_in_range_migration():
    # Two-way phase 4 pi / wavelength times the residual: 0.1005 rad at 1 mm, -19.96 dB.
    assert migration_error_db(Task(**{**RAIL, "residual_m": 1e-3})) == pytest.approx(-19.96, abs=0.05)
    assert migration_error_db(Task(**RAIL)) < -45
    assert choose(Task(**{**RAIL, "residual_m": None}), -10).method == "bp"


def test_reference_is_chosen_only_when_asked_for():
    assert choose(Task(**RAIL), -300).method != "reference"
    assert choose(Task(**RAIL), -50, "reference").interpolator == "sinc16"


@pytest.mark.parametrize(
    ("task", "tolerance", "method", "words"),
    [
        ({}, -50, "ffbp", "no focusing method"),
        ({}, 3.0, "auto", "tolerance"),
        ({}, float("nan"), "auto", "tolerance"),
        ({"residual_m": None}, -50, "rma", "not even enough"),
        ({"oversampling": 0.5}, -50, "bp", "lose information"),
    ],
)
def test_what_cannot_be_chosen_is_refused(task, tolerance, method, words):
    with pytest.raises(DataError, match=words):
        choose(Task(**{**RAIL, **task}), tolerance, method)
