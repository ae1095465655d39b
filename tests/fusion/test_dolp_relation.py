"""DOLP against Pauli components: the thesis's cases, canonical targets, and where the relations part."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.errors import DataError
from processing.fusion.dolp_relation import agreement_phase, relation
from processing.optics.jones import mueller

PARTS = st.floats(-1.0, 1.0)


def test_canonical_targets() -> None:
    # HH, HV, VV of: trihedral, dihedral, horizontal dipole, dipole at 45 degrees, dihedral at 45 degrees.
    targets = np.array([[1, 0, 1], [1, 0, -1], [1, 0, 0], [0.5, 0.5, 0.5], [0, 1, 0]], dtype=complex)
    told = relation(*targets.T)
    np.testing.assert_allclose(told.exact, [0, 0, 1, 1, 0], atol=1e-12)
    # A dipole at 45 degrees has all of its polarization in S2, which received powers do not show.
    np.testing.assert_allclose(told.printed, [0, 0, 1, 0, 0], atol=1e-12)
    # A dihedral is all red and shows no DOLP: the two relations are opposite there.
    np.testing.assert_allclose(told.even_share, [0, 1, 0.5, 0, 0], atol=1e-12)


def test_the_thesis_ratios() -> None:
    # 5.5: received VV/HH of 0.43 (dihedral) and 0.80 (trihedral) make (1 - .43) / 1.43 and 0.2 / 1.8.
    for power, expected in ((0.43, 0.57 / 1.43), (0.80, 0.2 / 1.8)):
        told = relation(1.0, 0.0, math.sqrt(power))
        assert float(told.printed) == pytest.approx(expected)
        assert float(told.exact) == pytest.approx(expected)


@given(a=PARTS, b=PARTS, c=PARTS, d=PARTS, e=PARTS, f=PARTS)
def test_exact_is_the_first_column_of_the_mueller_matrix(
    a: float, b: float, c: float, d: float, e: float, f: float
) -> None:
    hh, hv, vv = complex(a, b), complex(c, d), complex(e, f)
    if abs(hh) ** 2 + 2 * abs(hv) ** 2 + abs(vv) ** 2 < 1e-6:
        return
    told = relation(hh, hv, vv)
    column = mueller(np.array([[hh, hv], [hv, vv]]))[:, 0]
    assert float(told.exact) == pytest.approx(math.hypot(column[1], column[2]) / column[0], abs=1e-9)
    assert float(told.printed) == pytest.approx(abs(column[1]) / column[0], abs=1e-9)
    assert told.printed <= told.exact + 1e-12


@given(g=st.floats(1 / 3, 1.0))
def test_where_red_equals_dolp(g: float) -> None:
    told = relation(1.0, 0.0, g * np.exp(1j * agreement_phase(g)))
    assert float(told.even_share) == pytest.approx(float(told.exact), abs=1e-9)


def test_no_agreement_and_no_target() -> None:
    assert math.isnan(float(agreement_phase(0.3)))
    assert math.isnan(float(relation(0.0, 0.0, 0.0).exact))
    with pytest.raises(DataError):
        agreement_phase(1.5)
