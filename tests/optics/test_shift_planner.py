"""How a tolerance has a turning polarizer's images put in place: closed forms, measured errors, choices, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from benchmarks.shifted_scenes import random_series
from polfuse_lab.trade.rows import relative_db
from processing.errors import DataError
from processing.fusion.resampling import DEGREES, passed, passed_at, power_between
from processing.optics.pieces import spread_pieces
from processing.optics.shift_planner import (
    LEFT,
    PIECE_PX,
    PIECES,
    SAFETY_DB,
    choose_registration,
    image_spectra,
    misplaced_power,
)
from processing.optics.shifts import NOTHING_KNOWN, Shift, mask_back, measure_shift, put_back, shift_back
from processing.optics.spectra import above_noise, folded_shares, power_spectrum

ALONE = {(0, 0): np.ones((16, 9))}
"""Nothing is folded."""


def one_wave(row: int, column: int) -> np.ndarray:
    """The spectrum of a wave of power 1, in a piece of 16 x 16 pixels."""
    spectrum = np.zeros((16, 9))
    spectrum[row, column] = 1.0
    return spectrum


def unclear(light: np.ndarray) -> np.ndarray:
    return np.zeros(light.shape[1:], dtype=bool)


@given(st.integers(-7, 7), st.integers(0, 7), st.floats(-3, 3), st.floats(-3, 3), st.floats(0, 0.5), st.floats(0, 0.5))
def test_a_wave_left_displaced_by_hand(i, k, down, right, down_sd, right_sd) -> None:
    """2 (1 - cos of the phase, times the mean of a normal phase's cosine)."""
    nu, mu = i / 16, k / 16
    phase = 2 * math.pi * (nu * down + mu * right)
    mean = math.exp(-2 * math.pi**2 * ((nu * down_sd) ** 2 + (mu * right_sd) ** 2))
    found = misplaced_power(one_wave(i, k), ALONE, Shift(down, right, down_sd, right_sd), LEFT)
    assert found == pytest.approx(2 * (1 - math.cos(phase) * mean), abs=1e-12)
    if not down_sd and not right_sd:
        assert found == pytest.approx(abs(1 - np.exp(-1j * phase)) ** 2, abs=1e-12)


def test_a_wave_put_back_by_hand() -> None:
    # Half-way between two pixels straight lines take a wave times cos(pi nu), without turning it.
    for k in range(8):
        found = misplaced_power(one_wave(0, k), ALONE, Shift(0.0, 0.5, 0.0, 0.0), 1)
        assert found == pytest.approx((1 - math.cos(math.pi * k / 16)) ** 2, abs=1e-12)
    # Whole pixels are undone without error by all, and what is left is the doubt.
    for degree in DEGREES:
        assert misplaced_power(one_wave(3, 2), ALONE, Shift(2.0, -1.0, 0.0, 0.0), degree) < 1e-12
        found = misplaced_power(one_wave(3, 0), ALONE, Shift(2.0, -1.0, 0.1, 0.0), degree)
        assert found == pytest.approx(2 * (1 - math.exp(-2 * (math.pi * 3 / 16 * 0.1) ** 2)), rel=1e-9)


@pytest.mark.parametrize("degree", DEGREES)
def test_splines_at_all_places_have_the_known_means(degree: int) -> None:
    """The mean over places is ``m``, that of the power ``q``: the closed forms of Unser and of Blu."""
    nu = np.linspace(0, 1.4, 15)
    places = (np.arange(200) + 0.5) / 200
    made = np.array([passed_at(degree, nu, place) for place in places])
    turned = made * np.exp(-2j * np.pi * nu * places[:, None])
    np.testing.assert_allclose(turned.mean(axis=0), passed(degree, nu), atol=2e-5)
    np.testing.assert_allclose((np.abs(made) ** 2).mean(axis=0), power_between(degree, nu), atol=2e-5)
    np.testing.assert_allclose(passed_at(degree, nu, -1.3), passed_at(degree, nu, 0.7) * np.exp(-4j * np.pi * nu))


@pytest.mark.parametrize(("degree", "down", "right"), [(0, 0.3, -0.2), (1, 0.5, 1.25), (3, -0.4, 0.5), (5, 0.5, 0.5)])
def test_waves_are_foretold_as_they_turn_out(degree: int, down: float, right: float) -> None:
    """Waves of known frequencies, displaced in closed form; cut out of more, so that no border is near."""
    y, x = np.mgrid[0:160, 0:160].astype(float)
    waves = [(0.05, 0.11, 30.0), (-0.21, 0.3, 12.0), (0.33, 0.02, 7.0)]

    def seen(a: float, b: float) -> np.ndarray:
        return 100 + sum(p * np.sin(2 * np.pi * (f * (y - a) + g * (x - b)) + f) for f, g, p in waves)

    shift = Shift(down, right, 0.0, 0.0)
    moved = seen(down, right)
    spectra = image_spectra(moved[None], [(slice(0, 160), slice(0, 160))])
    alone = {place: float(place == (0, 0)) * np.ones_like(share) for place, share in spectra.shares.items()}
    foretold = misplaced_power(spectra.spectra[0], alone, shift, degree)
    placed = moved if degree == LEFT else shift_back(moved, shift, degree)
    inner = np.s_[24:-24, 24:-24]
    # The window's taper smears each wave over a few bins; their crests do not fit the window.
    assert 10 * math.log10(foretold / np.mean((placed - seen(0, 0))[inner] ** 2)) == pytest.approx(0, abs=0.5)
    assert spectra.powers[0] == pytest.approx(100**2 + sum(p**2 / 2 for *_, p in waves), rel=0.01)


def test_noise_is_no_scene() -> None:
    """A smooth scene under white noise: beyond it the fitted fall stands in, a thousandth of the noise or less."""
    rng = np.random.default_rng(2)
    scene = 3000 * gaussian_filter(rng.normal(size=(128, 128)), 3.0)
    _, spectrum = power_spectrum((scene + rng.normal(0, 50, scene.shape))[None], 2500.0)
    _, bare = power_spectrum(scene[None], 0.0)
    clear = above_noise(spectrum, 2500.0)
    high = np.hypot(np.fft.fftfreq(128)[:, None], np.arange(65) / 128) > 0.25
    assert abs(spectrum[high].sum()) > 3 * bare[high].sum()
    assert 0 <= clear[high].sum() < 2.5
    assert clear.sum() == pytest.approx(bare.sum(), rel=0.02)
    np.testing.assert_array_equal(above_noise(bare, 0.0), bare)
    for noise in (0.0, 2500.0):
        shares = folded_shares(clear, noise)
        np.testing.assert_allclose(sum(shares.values()), 1.0)
    nothing = above_noise(power_spectrum(rng.normal(0, 50, (1, 64, 64)), 2500.0)[1], 2500.0)
    assert abs(nothing.sum()) < 0.05 * 2500


@pytest.mark.parametrize("seed", [10_002, 10_014, 10_045])
def test_tighter_tolerances_are_kept_by_dearer_ways(seed: int) -> None:
    series = random_series(seed, (96,))
    last = None
    for tolerance in range(-12, -85, -18):
        choice = choose_registration(series.light, unclear(series.light), float(tolerance), variance=series.variance)
        assert choice.kept == (choice.predicted_error_db <= tolerance)
        assert choice.considered[choice.way.name] == choice.predicted_error_db
        if choice.kept and last is not None:
            assert choice.predicted_error_db <= last.predicted_error_db
            assert choice.way.seconds >= last.way.seconds
        if not choice.kept:
            assert choice.predicted_error_db <= min(choice.considered.values()) + 0.5
        placed, _ = put_back(series.bare, unclear(series.light), choice.shifts, choice.way.undo, choice.way.degree or 3)
        # Within a factor of two of what was foretold, but for shifts that are smaller than their doubt.
        assert relative_db(placed, series.truth) <= choice.predicted_error_db + 6.02
        last = choice
    assert last is not None
    assert "nothing on offer" in last.explain()[0]


def test_pieces_are_enough_until_their_doubt_matters() -> None:
    """A picture of eleven times the pieces' pixels: the whole is measured only for what pieces do not tell."""
    rng = np.random.default_rng(5)
    over = 760
    field = np.fft.rfft2(1000 + 150 * gaussian_filter(rng.normal(size=(over, over)), 2.0) / 0.14)
    turn = np.exp(-2j * np.pi * (np.fft.fftfreq(over)[:, None] * 0.7 - np.fft.rfftfreq(over) * 0.4))
    bare = np.stack([np.fft.irfft2(plane)[:720, :720] for plane in (field, field * turn)])
    light = bare + rng.normal(0, 60, bare.shape)
    pieces = choose_registration(light, unclear(light), -36.0, variance=3600.0)
    assert not pieces.way.whole
    assert pieces.kept
    assert "6 pieces of 96 x 96 pixels" in pieces.explain()[1]
    assert any("after measuring the whole picture" in line and "times as long" in line for line in pieces.explain())
    whole = choose_registration(light, unclear(light), -68.0, variance=3600.0)
    assert (whole.way.whole, whole.way.degree, whole.kept) == (True, 3, True)
    assert any(line.startswith("not by cubic splines by what the pieces tell: -") for line in whole.explain())
    # Eleven times the pixels, a third of the doubt, by chance more or less.
    ratio = math.sqrt(light[0].size / (PIECES * PIECE_PX**2))
    for a, b in (
        (pieces.shifts[1].down_sd, whole.shifts[1].down_sd),
        (pieces.shifts[1].right_sd, whole.shifts[1].right_sd),
    ):
        assert a / b == pytest.approx(ratio, rel=0.3)
    for choice in (pieces, whole):
        found = choice.shifts[1]
        assert abs(found.down - 0.7) < 4 * found.down_sd
        assert abs(found.right + 0.4) < 4 * found.right_sd
        placed, _ = put_back(bare, unclear(light), choice.shifts, choice.way.undo, choice.way.degree)
        still = np.stack([bare[0], bare[0]])
        # Straight lines err by what they are; the whole picture's shift by its doubt, of which four sds may come.
        more = relative_db(placed, still) - choice.predicted_error_db
        assert abs(more) < 1 if choice is pieces else more < 12.04


def test_images_that_are_in_place_stay_as_they_are() -> None:
    series = random_series(10_001, (96,))
    light = np.stack([series.light[0], series.bare[0], series.light[2]])
    choice = choose_registration(light, unclear(light), -45.0, variance=[series.variance[0], 0.0, series.variance[2]])
    assert choice.way.undo == (False, False, True)
    assert "1 of 2 are undone" in choice.explain()[1]


def test_what_nobody_can_tell_is_told() -> None:
    rng = np.random.default_rng(1)
    for _ in range(3):  # noise alone has nothing in common, wherever its peaks meet by chance
        noise = 1000 + rng.normal(0, 10, (2, 96, 96))
        assert measure_shift(*noise) == NOTHING_KNOWN
    choice = choose_registration(noise, unclear(noise), -50.0, variance=100.0)
    # Uniform light: wherever it was, the images are the same.
    assert (choice.kept, choice.way.degree) == (True, LEFT)
    assert "1 of 1 shifts could not be measured" in choice.explain()[1]
    others = 1000 + 200 * np.stack([gaussian_filter(rng.normal(size=(96, 96)), 2.0) / 0.14 for _ in range(2)])
    unlike = choose_registration(others, unclear(others), -30.0)
    # Not one scene: 200 in 1000, twice the power in one of two images, in whatever place they look least unlike.
    assert not unlike.kept
    assert unlike.predicted_error_db == pytest.approx(20 * math.log10(0.2), abs=3)
    alone = choose_registration(noise[:1], unclear(noise), -30.0, variance=100.0)
    assert alone.kept
    assert "there is one image alone" in alone.explain()[1]


def test_pieces_tell_the_same_shift() -> None:
    series = random_series(10_018, (256,))
    windows = tuple(spread_pieces((256, 256), PIECE_PX, PIECES))
    for image, (down, right) in zip(series.light[1:], series.steps[1:], strict=True):
        found = measure_shift(image, series.light[0], windows=windows)
        assert abs(found.down - down) < 4 * found.down_sd
        assert abs(found.right - right) < 4 * found.right_sd
        again = measure_shift(image, series.light[0], begin=(found.down, found.right))
        whole = measure_shift(image, series.light[0])
        # Iterations end within 1e-4 pixels of one another.
        assert (again.down, again.right) == (pytest.approx(whole.down, abs=1e-3), pytest.approx(whole.right, abs=1e-3))


@given(st.sampled_from(DEGREES), st.floats(-3, 3), st.floats(-3, 3), st.integers(0, 23), st.integers(0, 19))
@settings(max_examples=30)
def test_every_degree_masks_what_it_depends_on(degree, down, right, row, column) -> None:
    mask = np.zeros((24, 20), dtype=bool)
    mask[row, column] = True
    image = np.where(mask, np.nan, 1.0)
    spoilt = ~np.isfinite(shift_back(image, Shift(down, right, 0.0, 0.0), degree))
    np.testing.assert_array_equal(spoilt, mask_back(mask, Shift(down, right, 0.0, 0.0), degree))
    # By its definition, pixel by pixel.
    reach = degree // 2
    i, k = np.mgrid[0:24, 0:20]
    top, left = i + math.floor(down), k + math.floor(right)
    inside = (top - reach >= 0) & (top + reach + 1 < 24) & (left - reach >= 0) & (left + reach + 1 < 20)
    near = (row >= top - reach) & (row <= top + reach + 1) & (column >= left - reach) & (column <= left + reach + 1)
    np.testing.assert_array_equal(spoilt, near | ~inside)


def test_what_cannot_be_chosen() -> None:
    light = np.ones((3, 32, 32))
    for bad in (0.0, 3.0, math.nan, -math.inf):
        with pytest.raises(DataError, match="negative number"):
            choose_registration(light, unclear(light), bad)
    for dark in (light * 0, light * np.nan):
        with pytest.raises(DataError, match="without light"):
            choose_registration(dark, unclear(light), -20.0)
    with pytest.raises(DataError, match="without light"):
        choose_registration(light, ~unclear(light), -20.0)
    with pytest.raises(DataError, match="at least 16"):
        choose_registration(light[:, :14], unclear(light)[:14], -20.0)
    with pytest.raises(DataError, match="take one of 1, 3, 5"):
        shift_back(light[0], NOTHING_KNOWN, 2)
    assert choose_registration(light, unclear(light), -20.0).predicted_error_db < -20 - SAFETY_DB
