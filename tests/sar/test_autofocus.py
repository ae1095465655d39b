"""Errors of known size on closed-form data; residuals are measured at the true targets."""

from dataclasses import replace

import numpy as np
import pytest
from rail_data import rail

from benchmarks.autofocus_scenes import random_scene, without_points
from processing.errors import DataError
from processing.sar.autofocus import (
    FOCUSED_RAD,
    LARGEST_MOVE_CELLS,
    SHARPENED,
    apply_correction,
    autofocus,
    shift_basis,
)
from processing.sar.autofocus_chips import Chips
from processing.sar.autofocus_entropy import entropy_and_slopes
from processing.sar.autofocus_gradient import without_shift
from processing.sar.backprojection import backproject
from processing.sar.sharpness import image_entropy

SMALL = {"positions": 41}


@pytest.fixture(scope="module")
def focused():
    return random_scene(0, "none", **SMALL)


@pytest.mark.parametrize(
    ("error", "method"),
    [
        ("slow phase", "phase-gradient"),
        ("slow phase", "minimum-entropy"),
        ("random phase", "minimum-entropy"),
        ("trolley", "track"),
    ],
)
def test_known_errors_are_taken_off(error, method):
    scene = random_scene(1, error, **SMALL)
    found = autofocus(scene.profiles, scene.grid, method=method)
    assert found.applied, found.reason
    assert found.method == method
    assert found.entropy_after < found.entropy_before
    # Points interfere: the least entropy is not exactly at the truth. 0.3 rad costs a peak 0.4 dB.
    assert scene.residual_rad() > 0.4
    assert scene.residual_rad(found) < min(0.3, 0.5 * scene.residual_rad())
    # What it says of the image is what the image does.
    image = backproject(found.corrected(scene.profiles), scene.grid)
    assert image_entropy(image) == pytest.approx(found.entropy_after, abs=1e-6)


def test_auto_finds_which_kind_of_error_it_is():
    for error, kind in (("random phase", "minimum-entropy"), ("trolley", "track")):
        scene = random_scene(1, error, **SMALL)
        found = autofocus(scene.profiles, scene.grid)
        assert (found.applied, found.method) == (True, kind)


@pytest.mark.parametrize("method", ["phase-gradient", "minimum-entropy", "track", "auto"])
def test_focused_data_come_to_no_harm(focused, method):
    found = autofocus(focused.profiles, focused.grid, method=method)
    corrected = found.corrected(focused.profiles)
    before, after = (image_entropy(backproject(p, focused.grid)) for p in (focused.profiles, corrected))
    assert after <= before
    assert not found.applied or found.largest_move_cells < LARGEST_MOVE_CELLS
    if not found.applied:
        assert corrected is focused.profiles
        assert found.reason


def test_noise_is_not_sharpened(focused):
    found = autofocus(without_points(focused, 3).profiles, focused.grid)
    assert not found.applied
    assert found.reason.startswith(("refused", "focused already"))


def test_an_image_without_points_is_left_alone(focused):
    flat = replace(focused.profiles, values=np.zeros_like(focused.profiles.values))
    with pytest.raises(DataError, match="no defined pixel"):
        autofocus(flat, focused.grid)


def test_gaps_and_channels_with_own_positions():
    scene = random_scene(1, "trolley", **SMALL)
    values = np.concatenate([scene.profiles.values, 0.7j * scene.profiles.values])
    values[0, 5:7] = np.nan
    gaps = replace(scene.profiles, values=values, channels=("HH", "VV"))
    assert scene.residual_rad(autofocus(gaps, scene.grid, method="track")) < 0.6 * scene.residual_rad()
    values = values.copy()
    values[0, ::2], values[1, 1::2] = np.nan, np.nan
    apart = replace(gaps, values=values)
    with pytest.raises(DataError, match="share no phase"):
        autofocus(apart, scene.grid, method="phase-gradient")
    assert autofocus(apart, scene.grid).method == "track"


def test_slopes_of_entropy_are_its_differences():
    # Central differences of 1e-5: their own error is 1e-10 times third derivatives of order one.
    rng = np.random.default_rng(2)
    terms = rng.normal(size=(2, 6, 3, 4)) + 1j * rng.normal(size=(2, 6, 3, 4))
    chips = Chips(terms, rng.normal(size=(3, 4, 3)) + np.array([0, 9, 0]), rail(6), 100.0, (0.3, 1.0))
    turn = rng.normal(size=(6, 3, 4))
    _, slope = entropy_and_slopes(chips, turn)
    for place in ((0, 0, 0), (2, 1, 3), (5, 2, 0)):
        step = np.zeros_like(turn)
        step[place] = 1e-5
        change = entropy_and_slopes(chips, turn + step)[0] - entropy_and_slopes(chips, turn - step)[0]
        assert slope[place] == pytest.approx(change / 2e-5, abs=1e-7)
    shift = rng.normal(size=6) * 0.01
    axis = np.array([1.0, 0, 0])
    by = chips.slope_of_shift(shift, axis)
    more, less = (chips.turn_of_shift(shift + d, axis) for d in (1e-6, -1e-6))
    np.testing.assert_allclose(by, (more - less) / 2e-6, rtol=1e-5, atol=1e-4)


def test_turns_of_shifted_positions_are_differences_of_ranges():
    places = np.array([[[1.0, 9.0, -1.0], [-4.0, 12.0, -1.0]]])
    chips = Chips(np.ones((1, 9, 1, 2), dtype=complex), places, rail(9), 100.6, (0.3, 1.0))
    shift, axis = np.linspace(-0.05, 0.08, 9), np.array([0.6, 0.8, 0.0])
    moved = rail(9) + shift[:, None] * axis
    away = [np.linalg.norm(places[None] - at[:, None, None], axis=-1) for at in (moved, rail(9))]
    np.testing.assert_allclose(chips.turn_of_shift(shift, axis), 100.6 * (away[0] - away[1]), atol=1e-10)


def test_what_only_moves_the_image_is_not_part_of_a_correction(focused):
    antenna = focused.profiles.antenna_m
    straight = 3.0 + 2.0 * antenna[:, 0]
    np.testing.assert_allclose(without_shift(straight, antenna), 0, atol=1e-12)
    basis = shift_basis(antenna)
    np.testing.assert_allclose(basis.mean(axis=0), 0, atol=1e-15)
    assert np.linalg.matrix_rank(basis) == basis.shape[1]
    same = apply_correction(focused.profiles, np.zeros(41), np.zeros(41), (1.0, 0.0, 0.0))
    assert same.values is focused.profiles.values
    assert same.antenna_m is focused.profiles.antenna_m


def test_thresholds_are_those_told():
    # exp(-sigma^2) of a peak's power is left: 0.17 dB at 0.2 rad.
    assert -10 * np.log10(np.exp(-(FOCUSED_RAD**2))) == pytest.approx(0.17, abs=0.005)
    assert SHARPENED > 0


@pytest.mark.parametrize(
    ("change", "options", "words"),
    [
        ({}, {"method": "pga"}, "no autofocus"),
        ({}, {"axis": (0.0, 0.0, 0.0)}, "no direction"),
        ({}, {"axis": (np.nan, 0.0, 0.0)}, "no direction"),
        ({"few": 5}, {}, "too few"),
        ({"few": 1}, {}, "too few"),
        ({"same": True}, {}, "too few"),
        ({"nan": True}, {}, "no profile"),
    ],
)
def test_bad_input_is_refused(focused, change, options, words):
    profiles = focused.profiles
    if "few" in change:
        profiles = replace(profiles, values=profiles.values[:, : change["few"]],
                           antenna_m=profiles.antenna_m[: change["few"]])  # fmt: skip
    if "same" in change:
        profiles = replace(profiles, antenna_m=np.zeros_like(profiles.antenna_m))
    if "nan" in change:
        profiles = replace(profiles, values=np.full_like(profiles.values, np.nan))
    with pytest.raises(DataError, match=words):
        autofocus(profiles, focused.grid, **options)
