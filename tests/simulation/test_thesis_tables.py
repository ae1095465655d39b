"""A target in Table 6.1's geometry and a moving point in Table 8.1's, at length in ``accuracy.thesis_tables``."""

from __future__ import annotations

import pytest

from benchmarks.accuracy_thesis_tables import LEVEL_DB, PHASE_DEG, SHIFT_M, WIDTH, shifted, standing


def test_a_dihedral_in_the_geometry_of_table_61() -> None:
    found = standing("dihedral")
    assert found.level_db == pytest.approx(0.0, abs=LEVEL_DB)
    assert found.phase_deg == pytest.approx(0.0, abs=PHASE_DEG)
    assert found.widths == pytest.approx((1.0, 1.0), abs=WIDTH)


def test_a_point_that_moves_in_range_in_the_geometry_of_table_81() -> None:
    found, told = shifted(3.0)
    # R v_r / V: 21.2 km, 2.12 m/s, 240 m/s.
    assert told == pytest.approx(-187.5, abs=0.1)
    assert found == pytest.approx(told, abs=SHIFT_M)
