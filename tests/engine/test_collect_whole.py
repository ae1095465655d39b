"""A collect with small devices in a real engine process, end to end."""

from __future__ import annotations

import numpy as np
from fake_devices import audio

from polfuse_lab.engine import collect
from polfuse_lab.session import info, open_session


def test_collect_records_every_position_and_channel(bench):
    bench.write(optics=True, radar={"speed": 10.0})
    outcome = collect(bench.rig, bench.plan, bench.session)
    assert (outcome.state, outcome.reason) == ("finished", "all steps carried out")
    # 1 m in steps of 0.5 m are 3 positions; 2 channels each; 4 default angles of 2 frames each.
    assert (outcome.positions, outcome.sweeps, outcome.frames) == (3, 6, 8)
    found = info(bench.session)
    assert found["complete"]
    assert found["problems"] == []
    assert found["channels"] == ["HH", "HV"]
    with open_session(bench.session) as session:
        np.testing.assert_allclose(session.sweeps["x_m"], [-0.5, -0.5, 0, 0, 0.5, 0.5], atol=1e-12)
        # The fake radar counts its records and the device's frames in 100,000 for each; the probe was the first.
        for index, row in enumerate(session.sweeps):
            np.testing.assert_array_equal(session.audio(index), audio(row["samples"], first=row["device_frame"]))
        assert session.sweeps["device_frame"].tolist() == [(n + 2) * 100_000 for n in range(6)]
        assert [int(session.frame(i)[0, 0]) for i in range(8)] == list(range(1, 9))
        np.testing.assert_allclose(session.frames["angle_rad"], np.repeat(np.radians([0, 45, 90, 135]), 2), rtol=1e-12)
        assert session.rig is not None
        assert session.rig_toml == bench.rig.read_text()
        assert session.plan_toml == bench.plan.read_text()
        assert [i["kind"] for i in session.config["identities"]] == [
            "radar", "switches", "trolley", "camera", "polarizer"]  # fmt: skip
    # Every device was made safe and closed, in this order.
    last = [what for _, what in bench.events()][-10:]
    assert sorted(last[:5]) == sorted(f"{k} safe" for k in ("radar", "switches", "trolley", "camera", "polarizer"))
    assert sorted(last[5:]) == sorted(f"{k} close" for k in ("radar", "switches", "trolley", "camera", "polarizer"))
