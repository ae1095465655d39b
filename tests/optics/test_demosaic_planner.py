"""The demosaicer that a tolerance asks for: foretold against measured errors, and choices that keep the tolerance."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.planner_scenes import random_mosaic
from polfuse_lab.trade.light import scene
from polfuse_lab.trade.rows import relative_db
from processing.errors import DataError
from processing.optics.demosaic import METHODS, demosaic_by
from processing.optics.demosaic_planner import NOISE_SHARE, choose_demosaicer, demosaic_errors_db
from processing.optics.mosaic import parse_mosaic, through_planes

MOSAIC = parse_mosaic("90-45-135-0")


def test_expected_errors_on_random_scenes() -> None:
    """All within a factor of two; the whole campaign is the benchmark ``accuracy.planners``."""
    off = []
    for seed in range(8):
        seen = random_mosaic(seed, sizes=(96, 128))
        foretold = demosaic_errors_db(seen.image, seen.mosaic, seen.variance)
        for method in METHODS:
            planes = demosaic_by(method, seen.image, seen.mosaic)
            off.append(relative_db(planes, seen.truth) - foretold[method])
    assert np.abs(off).max() <= 6.02


def test_on_the_scenes_of_the_measured_table() -> None:
    """Another make of scene, of which pieces are looked at: the fastest that keeps each tolerance is found."""
    truth = scene(320)
    image = np.rint(through_planes(truth, MOSAIC))
    errors = {name: relative_db(demosaic_by(name, image, MOSAIC), truth) for name in METHODS}
    assert errors["residual"] < errors["newton"] - 1 < errors["bilinear"] - 2
    for name, error in errors.items():
        choice = choose_demosaicer(image, MOSAIC, error + 3.0, variance=1 / 12)
        assert choice.kept
        assert choice.considered[name] == pytest.approx(error, abs=2.5)
        # These discs have harder edges than they show: all three forecasts are 1 to 2 dB too good.
        assert relative_db(demosaic_by(choice.method, image, MOSAIC), truth) <= error + 3.0 + 1.5


def test_noise_alone_by_hand() -> None:
    """Uniform light of 1e4 counts with an sd of 100 has noise at -40 dB, of which 9/16 stay: -42.5 dB, in any method
    about alike; so that nothing is gained by the slower ones, and that is said."""
    rng = np.random.default_rng(3)
    image = 1e4 + 100 * rng.normal(size=(128, 128))
    errors = demosaic_errors_db(image, MOSAIC, 1e4)
    truth = np.full((4, 128, 128), 1e4)
    for method in METHODS:
        assert errors[method] == pytest.approx(-40 + 10 * np.log10(NOISE_SHARE[method]), abs=0.35)
        assert relative_db(demosaic_by(method, image, MOSAIC), truth) == pytest.approx(errors[method], abs=0.35)
    choice = choose_demosaicer(image, MOSAIC, -60.0, variance=1e4)
    assert (choice.method, choice.kept) == ("bilinear", False)
    assert "nothing on offer keeps -60 dB" in choice.explain()[0]
    assert choice.noise_db == pytest.approx(-42.5, abs=0.1)


def test_undefined_pixels_are_left_out() -> None:
    truth = scene(96)
    image = through_planes(truth, MOSAIC)
    whole = demosaic_errors_db(image, MOSAIC)
    image[20:23, 30:32] = np.nan
    for name, error in demosaic_errors_db(image, MOSAIC).items():
        assert error == pytest.approx(whole[name], abs=0.5)


@pytest.mark.parametrize("shape", [(16, 4000), (4000, 18), (640, 64), (16, 16)])
def test_pictures_of_any_shape(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(1).uniform(1, 2, size=shape)
    assert set(METHODS) <= set(demosaic_errors_db(image, MOSAIC))


def test_what_cannot_be_chosen() -> None:
    image = np.ones((32, 32))
    for bad in (0.0, 3.0, float("nan"), -float("inf")):
        with pytest.raises(DataError, match="negative number"):
            choose_demosaicer(image, MOSAIC, bad)
    with pytest.raises(DataError, match="without light"):
        choose_demosaicer(image * 0, MOSAIC, -20.0)
    with pytest.raises(DataError, match="without light"):
        choose_demosaicer(image * np.nan, MOSAIC, -20.0)
    with pytest.raises(DataError, match="at least 16"):
        choose_demosaicer(image[:14], MOSAIC, -20.0)
