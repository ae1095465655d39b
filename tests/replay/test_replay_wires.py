"""A collect over the simulated rig's wires, replayed by the command: the copy and what is made of it are the same."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from hw_mocks.rig import SimulatedRig
from polfuse_lab.cli import build
from polfuse_lab.engine import collect
from polfuse_lab.products.focus import focus
from polfuse_lab.products.optics import optics
from polfuse_lab.products.store import Products
from polfuse_lab.session import open_session

SCENE = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "field.toml"
PLAN = """\
aperture_m = 0.1016
step_m = 0.0508
sweeps_per_channel = 1
move_settle_s = 0.0
[optics]
frames_per_angle = 1
settle_s = 0.0
auto_exposure = true
"""


@pytest.fixture(scope="module")
def session(tmp_path_factory, request):
    folder = tmp_path_factory.mktemp("wires")
    with SimulatedRig(SCENE, folder / "rig", audio="tcp", seed=1) as rig:
        path = rig.write_rig(folder / "rig.toml")
        (folder / "plan.toml").write_text(PLAN)
        outcome = collect(path, folder / "plan.toml", folder / "s.h5")
    assert outcome.state == "finished", outcome.reason
    return folder / "s.h5"


def polfuse(*words: object):
    return CliRunner().invoke(build(), [str(word) for word in words])


def test_command_and_products(session, tmp_path):
    for name, words in {"fast": (), "twenty": ("--speed", 20)}.items():
        answer = polfuse("replay", session, "-o", tmp_path / f"{name}.h5", "--json", *words)
        assert answer.exit_code == 0, answer.output
        values = json.loads(answer.stdout)
        assert (values["identical"], values["differences"]) == (True, [])
        assert values["seconds"] > 0
    with open_session(session) as original:
        # Every device took part, and the search for the exposure was gone through again.
        assert {bytes(kind) for kind in original.events["kind"]} >= {b"look", b"exposure", b"finished"}
        assert len(original.clocks) >= 2
        assert len(original.polarizer) >= 8
    for made in (session, tmp_path / "fast.h5"):
        products = tmp_path / f"{made.stem}-products.h5"
        focus(made, products, method="rma")
        optics(made, products)
    first, second = (Products(tmp_path / f"{name}-products.h5") for name in ("s", "fast"))
    for stage in ("ranging", "focus", "optics"):
        assert first.provenance(stage)["sha256"] == second.provenance(stage)["sha256"]
        for name, array in first.read(stage).items():
            np.testing.assert_array_equal(array, second.read(stage)[name])


def test_command_says_what_differs(session, tmp_path):
    changed = tmp_path / "changed.h5"
    changed.write_bytes(session.read_bytes())
    with h5py.File(changed, "r+") as file:
        row = file["sweeps"][2]
        row["attempt"] = 5
        file["sweeps"][2] = row
    answer = polfuse("replay", changed, "-o", tmp_path / "copy.h5", "--json")
    assert answer.exit_code == 1
    values = json.loads(answer.stdout)
    assert values["identical"] is False
    assert values["differences"] == ["sweeps: 1 rows differ, the first at row 2, attempt 5 and 0"]
    assert "the copy is not identical" in answer.stderr
    assert polfuse("replay", session, "-o", tmp_path / "copy.h5").exit_code == 1  # the name is taken
    assert polfuse("replay", session, "-o", tmp_path / "new.h5", "--speed", 0).exit_code == 2
    assert polfuse("replay", tmp_path / "none.h5", "-o", tmp_path / "new.h5").exit_code == 1
