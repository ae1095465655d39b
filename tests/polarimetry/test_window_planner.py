"""The window that a tolerance asks for: foretold against measured error on random scenes, and choices that keep it."""

from __future__ import annotations

import numpy as np
import pytest

from polfuse_lab.trade.rows import relative_db
from processing.errors import DataError
from processing.polarimetry.averaging import window_average
from processing.polarimetry.matrices import planes_of_matrix
from processing.polarimetry.speckle.simulation import speckled
from processing.polarimetry.window_planner import WINDOWS, choose_window, speckle_error_db


def random_truth(rng: np.random.Generator, size: int = 36) -> np.ndarray:
    """Even ground of any coherency, one to three mechanisms, up to 30 dB apart."""
    vectors = rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3))
    powers = 10.0 ** -rng.uniform(0, 3, 3) * rng.uniform(0.1, 10)
    matrix = np.einsum("m,mi,mj->ij", powers, vectors, vectors.conj()) + 1e-4 * np.eye(3)
    return np.broadcast_to(planes_of_matrix(matrix)[:, None, None], (9, size, size)).copy()


def test_expected_errors_on_two_hundred_random_scenes() -> None:
    """Within a factor of two in 95 %, never optimistic by more than 6 dB, and the tolerance kept where promised."""
    rng = np.random.default_rng(11)
    off, kept = [], []
    for _ in range(200):
        truth, looks = random_truth(rng), int(rng.integers(1, 9))
        seen = speckled(truth, looks, rng)
        tolerance = float(rng.uniform(-22, -4))
        choice = choose_window(seen, tolerance, looks=looks)
        error = relative_db(window_average(seen, choice.window), truth)
        off.append(error - choice.predicted_error_db)
        if choice.predicted_error_db <= tolerance - 0.5:
            kept.append(error <= tolerance + 1.5)  # 36 x 36 pixels hold few wide windows: borders, chance
    assert np.mean(np.abs(off) <= 6.02) >= 0.95
    assert max(off) <= 6.0
    assert np.mean(kept) >= 0.95


def test_one_mechanism_by_hand() -> None:
    """T = diag(1, 0, 0): the variance of one exponential power is its square, 0 dB for one look."""
    planes = np.zeros((9, 9, 9))
    planes[0] = 1.0
    assert speckle_error_db(planes, 1e9) == pytest.approx(-90, abs=1e-6)
    choice = choose_window(planes, -19.0, looks=4.0)
    # 4 looks: -6.02 + 0.04 dB (the pilot's share); 5 x 5 pixels 13.98 dB more reaches -19.5.
    assert choice.window == 5
    assert choice.predicted_error_db == pytest.approx(-20.0, abs=0.1)
    assert choice.explain()[0].startswith("window 5: the smallest within -19 dB")
    assert len(choice.explain()) == 3


def test_what_cannot_be_chosen() -> None:
    planes = np.zeros((9, 9, 9))
    planes[[0, 5, 8]] = 1.0
    assert choose_window(planes, -200.0).window == WINDOWS[-1]
    assert "nothing on offer" in choose_window(planes, -200.0).reason
    for bad in (0.0, 3.0, float("nan"), -float("inf")):
        with pytest.raises(DataError, match="negative number"):
            choose_window(planes, bad)
    with pytest.raises(DataError, match="power"):
        choose_window(planes * 0, -10.0)
    with pytest.raises(DataError, match="positive"):
        choose_window(planes, -10.0, looks=0.0)
    with pytest.raises(DataError, match="pixels"):
        choose_window(np.zeros((9, 0, 0)), -10.0)
