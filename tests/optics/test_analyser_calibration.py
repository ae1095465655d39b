"""Calibration of analysers against made-up ones, and what it makes of polarization."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.optics.analyser import least_squares, measurement_matrix
from processing.optics.analyser_calibration import fit_analysers

NOMINAL = np.radians([0.0, 45.0, 90.0, 135.0])
SOURCE = np.radians(np.arange(0.0, 180.0, 15.0))


def made_up(offsets_deg: np.ndarray, transmittance: np.ndarray, extinction: np.ndarray) -> np.ndarray:
    """(4, 3) rows of four analysers: q (1 + 1/E) / 2 and so on, thesis 2.18 for imperfect polarizers."""
    rows = [
        t * measurement_matrix([angle + math.radians(offset)], e)[0]
        for angle, offset, t, e in zip(NOMINAL, offsets_deg, transmittance, extinction, strict=True)
    ]
    return np.array(rows)


def seen(rows: np.ndarray, level: float, source_extinction: float = math.inf) -> np.ndarray:
    """(J, 4) intensities of an unpolarized lamp behind its turning polarizer."""
    return level * 2 * measurement_matrix(SOURCE, source_extinction) @ rows.T


ROWS = made_up(np.array([0.6, -0.4, 1.1, -0.9]), np.array([1.0, 0.96, 1.03, 0.99]), np.array([300.0, 150.0, 80.0, 500]))


def test_made_up_analysers_are_found() -> None:
    light = np.broadcast_to(seen(ROWS, 2e4, 800.0)[:, :, None, None], (len(SOURCE), 4, 6, 8))
    found = fit_analysers(light, SOURCE, NOMINAL, source_extinction=800.0)
    np.testing.assert_allclose(np.degrees(found.offset_rad[:, 0, 0]), [0.6, -0.4, 1.1, -0.9], atol=1e-9)
    # Only ratios are known: the mean of the rows' first numbers is one half.
    scale = 0.5 / ROWS[:, 0].mean()
    np.testing.assert_allclose(found.rows[:, :, 0, 0], scale * ROWS, atol=1e-12)
    np.testing.assert_allclose(found.extinction_ratio[:, 0, 0], [300, 150, 80, 500], rtol=1e-6)
    np.testing.assert_allclose(found.transmittance[:, 0, 0], scale * np.array([1.0, 0.96, 1.03, 0.99]), rtol=1e-9)


def test_sds_are_those_of_many_calibrations() -> None:
    random = np.random.default_rng(3)
    light = random.poisson(seen(ROWS, 3e3)[:, :, None, None], (len(SOURCE), 4, 60, 50)).astype(float)
    found = fit_analysers(light, SOURCE, NOMINAL, region_px=1)
    # 3,000 single-pixel calibrations: their spread is known to 1.3 %. Sds are from 9 spare readings each, on average.
    spread = np.std(found.angle_rad, axis=(1, 2))
    told = np.sqrt(np.mean(found.angle_sd_rad**2, axis=(1, 2)))
    # Shot noise differs between the readings, the fit takes it to be equal: sds are right within some 30 %.
    np.testing.assert_allclose(told, spread, rtol=0.35)
    assert np.all(np.abs(np.degrees(found.offset_rad.mean(axis=(1, 2))) - [0.6, -0.4, 1.1, -0.9]) < 0.1)


def test_calibrated_analysers_give_the_true_polarization() -> None:
    # Without it, a wrong transmittance of 3 % alone is a false DOLP of 1 to 2 %.
    calibration = fit_analysers(
        np.broadcast_to(seen(ROWS, 2e4)[:, :, None, None], (len(SOURCE), 4, 2, 2)), SOURCE, NOMINAL
    )
    state = np.array([1000.0, 120.0, -75.0])
    light = np.broadcast_to((ROWS @ state)[:, None, None], (4, 2, 2))
    ideal = least_squares(measurement_matrix(NOMINAL))
    raw = np.tensordot(ideal, light, 1)[:, 0, 0]
    corrected = np.tensordot(ideal, calibration.idealised(light), 1)[:, 0, 0]
    np.testing.assert_allclose(corrected[1:] / corrected[0], state[1:] / state[0], atol=1e-12)
    assert np.max(np.abs(raw[1:] / raw[0] - state[1:] / state[0])) > 0.01


def test_regions_are_calibrated_on_their_own_and_joined_smoothly() -> None:
    shape = (32, 48)
    offset = np.linspace(-1.0, 1.0, shape[1])
    light = np.empty((len(SOURCE), 4, *shape))
    for column in range(shape[1]):
        light[..., column] = seen(made_up(np.full(4, offset[column]), np.ones(4), np.full(4, 300.0)), 1e4)[:, :, None]
    found = fit_analysers(light, SOURCE, NOMINAL, region_px=8)
    assert found.rows.shape == (4, 3, 4, 6)
    np.testing.assert_allclose(np.degrees(found.offset_rad[0, 0]), offset.reshape(6, 8).mean(axis=1), atol=1e-3)
    state = np.array([1000.0, 400.0, 300.0])
    image = np.empty((4, *shape))
    for column in range(shape[1]):
        rows = made_up(np.full(4, offset[column]), np.ones(4), np.full(4, 300.0))
        image[:, :, column] = (rows @ state)[:, None]
    stokes = np.tensordot(least_squares(measurement_matrix(NOMINAL)), found.idealised(image), 1)
    aop = np.degrees(0.5 * np.arctan2(stokes[2], stokes[1]))
    # Between the middles of the regions the offset is a straight line, as it was made; at the rims it is held.
    np.testing.assert_allclose(aop[:, 4:-4], np.degrees(0.5 * math.atan2(300, 400)), atol=2e-3)


# Numbers are drawn slowly on a busy machine; that is no fault of the test.
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.floats(-5, 5), st.floats(0.5, 1.5), st.floats(5, 1e4), st.floats(-80, 80))
def test_turning_source_and_analysers_together_changes_no_offset(
    offset: float, transmittance: float, extinction: float, turn: float
) -> None:
    turned = math.radians(turn)
    rows = made_up(np.full(4, offset), np.full(4, transmittance), np.full(4, extinction))
    light = np.broadcast_to(seen(rows, 1e4)[:, :, None, None], (len(SOURCE), 4, 1, 1))
    found = fit_analysers(light, SOURCE + turned, NOMINAL + turned)
    np.testing.assert_allclose(np.degrees(found.offset_rad[:, 0, 0]), offset, atol=1e-8)


@pytest.mark.parametrize("degrees", [(0.0, 90.0), (0.0, 90.0, 180.0, 270.0), (10.0,)])
def test_sources_that_do_not_turn_enough_are_refused(degrees: tuple[float, ...]) -> None:
    with pytest.raises(DataError, match="do not determine"):
        fit_analysers(np.ones((len(degrees), 4, 2, 2)), np.radians(degrees), NOMINAL)


def test_mistakes_are_answered() -> None:
    light = np.broadcast_to(seen(ROWS, 1e4)[:, :, None, None], (len(SOURCE), 4, 4, 4)).copy()
    with pytest.raises(DataError, match="shape"):
        fit_analysers(light[:, :3], SOURCE, NOMINAL)
    with pytest.raises(DataError, match="no light"):
        fit_analysers(0 * light, SOURCE, NOMINAL)
    light[..., 0, 0] = np.nan
    with pytest.raises(DataError, match="no defined pixel"):
        fit_analysers(light, SOURCE, NOMINAL, region_px=1)
    found = fit_analysers(light, SOURCE, NOMINAL)
    with pytest.raises(DataError, match="calibration is of"):
        found.idealised(np.ones((4, 5, 4)))
    three = fit_analysers(light[:9:4], SOURCE[:9:4], NOMINAL)
    assert np.isnan(three.angle_sd_rad).all()
