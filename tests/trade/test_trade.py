"""The table of speed against accuracy: its front, its choices, its command; predictions against what is measured."""

from __future__ import annotations

import itertools
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from benchmarks.__main__ import names
from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.tolerances import NAMES, TOLERANCES_DB, as_db, tolerance_db
from polfuse_lab.trade import Row, pareto, settle, trade
from polfuse_lab.trade.focusing import SIZES, Points, planned
from polfuse_lab.trade.knobs import KNOBS
from polfuse_lab.trade.rows import EXACT_DB, relative_db
from processing.sar.backprojection import backproject
from processing.sar.planner import choose


@given(
    st.lists(st.tuples(st.floats(1e-6, 10), st.floats(-150, 0)), min_size=1, max_size=12),
)
def test_the_front_is_what_nothing_beats(points: list[tuple[float, float]]) -> None:
    rows = settle([Row("t", str(n), s, e) for n, (s, e) in enumerate(points)], "focus")
    front = [row for row in rows if row.pareto]
    assert front
    # On the front a faster setting is always worse, strictly; off it somebody is as fast and as good.
    ordered = sorted(front, key=lambda row: row.seconds)
    assert all(a.error_db > b.error_db for a, b in itertools.pairwise(ordered))
    for row in rows:
        if not row.pareto:
            assert any(one.seconds <= row.seconds and one.error_db <= row.error_db for one in front)
    for name, limit in TOLERANCES_DB["focus"].items():
        fitting = [row.seconds for row in rows if row.error_db <= limit]
        chosen = [row for row in rows if name in row.chosen_for]
        assert len(chosen) == bool(fitting)
        assert not chosen or chosen[0].seconds == min(fitting)


def test_equal_settings_and_undefined_pixels() -> None:
    same = pareto([Row("t", "a", 1.0, -30.0), Row("t", "b", 1.0, -30.0)])
    assert [row.pareto for row in same] == [True, False]
    assert relative_db([3.0, np.nan, 4.0], [3.0, 1.0, np.nan]) == EXACT_DB
    assert relative_db([1.1, 0.0], [1.0, 0.0]) == pytest.approx(-20.0)


def test_names_of_tolerances() -> None:
    for kind, limits in TOLERANCES_DB.items():
        assert tuple(limits) == NAMES
        assert sorted(limits.values(), reverse=True) == list(limits.values()), kind
    assert tolerance_db("paper") == -80.0
    with pytest.raises(PolfuseError, match="preview, field, paper"):
        tolerance_db("perfect")
    assert as_db("paper", "estimate") == TOLERANCES_DB["estimate"]["paper"]
    assert as_db("-37.5") == -37.5
    for bad in ("0", "12", "nan", "-inf", "nearly"):
        with pytest.raises(PolfuseError, match="paper"):
            as_db(bad)


def test_every_knob_is_measured_somewhere() -> None:
    """By a task of the table or by a benchmark; and no task is without a knob."""
    tasks = {"focus", "ranging.padding", "ranging.window", "optics.demosaic", "optics.precision", "optics.debias",
             "raytrace", "speckle", "decompose.window", "decompose.precision", "storage.frames"}  # fmt: skip
    benchmarks = set(names())
    for knob in KNOBS:
        assert knob.measured in tasks | benchmarks, f"{knob.name}: {knob.measured} measures nothing"
    assert tasks <= {knob.measured for knob in KNOBS}


@pytest.mark.parametrize("size", SIZES[:2], ids=lambda size: size.name)
@pytest.mark.parametrize("tolerance", [-30.0, -50.0, -80.0])
def test_the_planners_choice_keeps_its_tolerance(size: object, tolerance: float) -> None:
    """Back-projection as chosen: within a factor of two of the expectation, and below the tolerance."""
    points = Points(size)  # type: ignore[arg-type]
    choice = choose(planned(points), tolerance, "bp")
    image = backproject(points.profiles(int(choice.oversampling)), points.grid, interpolator=choice.interpolator)
    error = relative_db(image[0], points.exact())
    assert error <= tolerance
    assert abs(error - choice.predicted_error_db) < 6.02


def test_small_groups_and_their_errors() -> None:
    rows, kinds = trade(("ranging", "optics.debias"), quick=True)
    assert set(kinds) == {"ranging.padding", "ranging.window", "optics.debias"}
    padding = {row.setting: row.error_db for row in rows if row.task == "ranging.padding"}
    # A Hann main lobe at half a bin: 1 - sinc(d) / (1 - d^2), d = 1 / 2p cells.
    for p in (1, 2, 4, 8):
        d = 0.5 / p
        expected = 20 * math.log10(1 - np.sinc(d) / (1 - d * d))
        assert padding[f"x{p}"] == pytest.approx(expected, abs=0.6)
    leak = {row.setting: row.error_db for row in rows if row.task == "ranging.window"}
    assert leak["hann"] < leak["taylor"] < leak["rectangular"]
    bias = {row.setting: row.error_db for row in rows if row.task == "optics.debias"}
    assert bias["MAS"] < bias["none"] - 10
    # Rice's distribution at two sds: mean 2.272, 13.6 % too large (Abramowitz and Stegun 13.1).
    assert bias["none"] == pytest.approx(20 * math.log10(0.136), abs=0.5)


def test_the_command(tmp_path: Path) -> None:
    arguments = ["trade", "--quick", "--task", "ranging", "-o", str(tmp_path / "plots"), "--json"]
    done = CliRunner().invoke(build(), arguments)
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert {"task", "setting", "seconds", "error_db", "chosen_for"} <= set(told["rows"][0])
    assert len(told["knobs"]) == len(KNOBS)
    assert [Path(path).name for path in told["figures"]] == ["ranging.padding.png", "ranging.window.png"]
    assert all(Path(path).read_bytes()[:4] == b"\x89PNG" for path in told["figures"])
    refused = CliRunner().invoke(build(), ["trade", "--task", "coffee"])
    assert refused.exit_code == 1
    assert "focus, ranging" in refused.stderr
    listed = CliRunner().invoke(build(), ["trade", "--knobs"])
    assert len(re.findall("\n", listed.stdout)) == len(KNOBS)
