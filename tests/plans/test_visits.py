"""Visits of one place are averaged when they are read, and targets of a series are told apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rail_session import write_session

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import Visit, parse_plan
from polfuse_lab.products.ranging import range_profiles
from polfuse_lab.products.visits import average_visits, target_positions, targets
from polfuse_lab.session import open_session

TARGET = [((0.5, 8.0, -1.0), 10 * np.eye(2))]


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 4), st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_averages_are_means_over_the_visits_that_are_there(places: int, visits: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    shape = (2, places * visits, 6)
    values = random.normal(size=shape) + 1j * random.normal(size=shape)
    noise = random.uniform(1, 2, shape[:2])
    missing = random.random(shape[1]) < 0.3
    values[0, missing], noise[0, missing] = np.nan, np.nan
    antenna = random.normal(size=(shape[1], 3))
    visited = [Visit(n, 0.0, n % places) for n in range(shape[1])]
    merged, merged_noise, at = average_visits(values, noise, antenna, visited)
    assert merged.shape == (2, places, 6)
    for place in range(places):
        # By NumPy's mean without NaN, and the variance of a mean of independent terms.
        there = np.isfinite(values[0, place::places, 0])
        if there.any():
            np.testing.assert_allclose(merged[0, place], values[0, place::places][there].mean(axis=0), rtol=1e-13)
            expected = noise[0, place::places][there].sum() / there.sum() ** 2
            assert merged_noise[0, place] == pytest.approx(expected, rel=1e-13)
        else:
            assert np.isnan(merged[0, place]).all()
            assert np.isnan(merged_noise[0, place])
        np.testing.assert_allclose(merged[1, place], values[1, place::places].mean(axis=0), rtol=1e-13)
        np.testing.assert_allclose(at[place], antenna[place::places].mean(axis=0), rtol=1e-13)


def test_what_is_visited_once_is_left_as_it_is() -> None:
    values = np.ones((1, 2, 3), complex)
    noise, antenna = np.ones((1, 2)), np.zeros((2, 3))
    found = average_visits(values, noise, antenna, [Visit(0, 0.0, 0), Visit(1, 0.1, 1)])
    assert found[0] is values
    # Positions of no plan (foreign recordings, passes) are never thrown together.
    assert average_visits(values, noise, antenna, [None, None])[0] is values


def test_passes_of_a_serpentine_are_read_as_one_track(tmp_path: Path) -> None:
    plan = 'aperture_m = 0.2\nstep_m = 0.1\npasses = 2\ntrack_order = "serpentine"\nchannels = ["HH"]'
    x = parse_plan(plan, "plan.toml").positions_m
    twice = write_session(tmp_path / "twice.h5", TARGET, x, (Channel.HH,), plan=plan)
    once = write_session(tmp_path / "once.h5", TARGET, sorted(set(x)), (Channel.HH,))
    found, alone = range_profiles(twice, max_range_m=20.0), range_profiles(once, max_range_m=20.0)
    np.testing.assert_allclose(found.antenna_m, alone.antenna_m, atol=1e-12)
    # Both passes see the same target from the same places; profiles are complex64.
    np.testing.assert_allclose(found.values, alone.values, rtol=1e-5, atol=1e-6 * np.abs(alone.values).max())


SERIES = """
kind = "calibration_series"
channels = ["HH", "VV"]
repeats = 2
[[targets]]
name = "corner"
kind = "trihedral_square"
edge_m = 0.6
range_m = 8.0
[[targets]]
name = "plate"
kind = "plate"
edge_m = 0.6
range_m = 8.0
"""


def test_records_of_a_series_go_to_their_targets(tmp_path: Path) -> None:
    path = write_session(tmp_path / "s.h5", TARGET, [0.0] * 4, (Channel.HH, Channel.VV), plan=SERIES)
    with open_session(path) as session:
        assert [target.name for target in targets(session)] == ["corner", "plate"]
        # Repeats of one target follow each other: numbers 0 and 1, then 2 and 3.
        assert target_positions(session, "plate") == {2, 3}
        profiles = range_profiles(session, positions=target_positions(session, "corner"))
        assert profiles.values.shape[:2] == (2, 1)
        with pytest.raises(PolfuseError, match=r"holds no target called 'sphere'; choose from corner, plate"):
            target_positions(session, "sphere")
    rail = write_session(tmp_path / "r.h5", TARGET, [0.0, 0.1], (Channel.HH,), plan="")
    with open_session(rail) as session, pytest.raises(PolfuseError, match="is no calibration series"):
        target_positions(session, "corner")
