"""A collect over real wires: simulated serial devices, sound card and camera behind the product's own drivers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hw_mocks.rig import SimulatedRig
from polfuse_lab.doctor import examine
from polfuse_lab.engine import collect
from polfuse_lab.live import sync_problem
from polfuse_lab.session import info, open_session

SCENE = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "field.toml"
PLAN = """\
aperture_m = 0.1016
step_m = 0.0508
sweeps_per_channel = 2
move_settle_s = 0.0
[optics]
frames_per_angle = 1
settle_s = 0.0
"""


def test_collect_on_the_simulated_rig_is_whole(tmp_path):
    with SimulatedRig(SCENE, tmp_path / "rig", seed=1) as rig:
        path = rig.write_rig(tmp_path / "rig.toml")
        assert [(f.kind, f.ok, f.advice) for f in examine(path) if not f.ok] == []
        plan = tmp_path / "plan.toml"
        plan.write_text(PLAN)
        outcome = collect(path, plan, tmp_path / "s.h5")
    assert outcome.state == "finished", outcome.reason
    assert (outcome.positions, outcome.sweeps, outcome.frames) == (3, 12, 4)
    assert (outcome.samples_lost, outcome.frames_lost) == (0, 0)
    found = info(tmp_path / "s.h5")
    assert (found["complete"], found["problems"]) == (True, [])
    with open_session(tmp_path / "s.h5") as session:
        # GRBL reports positions to a micrometre.
        np.testing.assert_allclose(np.unique(session.sweeps["x_m"]), [-0.0508, 0, 0.0508], atol=2e-6)
        np.testing.assert_allclose(np.degrees(session.frames["angle_rad"]), [0, 45, 90, 135], atol=0.05)
        assert session.rig is not None
        for index in range(len(session.sweeps)):
            assert sync_problem(session.rig, session.audio(index), session.sample_rate_hz) is None
