"""Set-up mode over real wires: lights, hands, live view; refused while held; handed over; safe when its window dies."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hw_mocks.rig import SimulatedRig
from polfuse_lab.bench import BenchClient
from polfuse_lab.engine import EngineClient, engines
from polfuse_lab.errors import PolfuseError

pytestmark = pytest.mark.realtime

SCENE = Path("polfuse_lab/demo/scene.toml")
PLAN = "aperture_m = 0.1\nstep_m = 0.1\nsweeps_per_channel = 1\nmove_settle_s = 0.0\n"


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    with SimulatedRig(SCENE, tmp_path_factory.mktemp("bench") / "rig", seed=3, audio="tcp") as rig:
        yield rig, rig.write_rig()


def until(client, condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        client.poll(0.05)
        assert time.monotonic() < end, client.status


def test_look_ask_and_hand_over(simulated, tmp_path):
    _, rig = simulated
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    client = BenchClient.start(rig)
    view = client.live()
    until(client, lambda: client.status and all(device.light == "ok" for device in client.status.devices))
    assert [device.kind for device in client.status.devices] == [
        "radar",
        "switches",
        "trolley",
        "camera",
        "polarizer",
    ]
    client.select("HV")
    client.turn(90.0)
    client.move_to(0.2)
    until(client, lambda: client.status.switches.channel == "HV")
    until(client, lambda: client.status.polarizer.angle_deg == pytest.approx(90.0, abs=0.1))
    until(client, lambda: client.status.trolley.x_m == pytest.approx(0.2, abs=0.002))
    until(client, lambda: view.newest("profile.HV") is not None and view.newest("camera.090.0") is not None)
    until(client, lambda: "sync found" in client.status.devices[0].what)
    client.move_to(9.0)
    refused: list[str] = []
    until(client, lambda: refused.extend(client.status.refused) or refused)
    assert "beyond the rail" in refused[0]
    # One engine holds the devices; another window may look at it.
    with pytest.raises(PolfuseError, match="in use by set-up mode"):
        BenchClient.start(rig)
    with pytest.raises(PolfuseError, match="in use by set-up mode"):
        EngineClient.start(rig, plan, tmp_path / "s.h5")
    (running,) = engines()
    assert running.mode == "bench"
    with BenchClient.attach(running.directory) as other:
        assert other.status is not None
    collect = client.hand_over(plan, tmp_path / "s.h5")
    assert client.closed is not None
    assert client.closed.unsafe == []
    with collect:
        with pytest.raises(PolfuseError, match="in use by the collect of"):
            BenchClient.start(rig)
        assert collect.wait().state == "finished"
    assert engines() == []


WINDOW = """
import sys
from polfuse_lab.bench import BenchClient
client = BenchClient.start(sys.argv[1])
while client.status is None or client.status.trolley is None:
    client.poll(0.1)
client.move_to(-1.5)
while not client.status.trolley.moving:
    client.poll(0.05)
print("moving", flush=True)
while True:
    client.poll(0.1)
"""


@pytest.mark.skipif(os.name != "posix", reason="kills a process")
def test_everything_is_safe_when_the_window_dies(simulated):
    rig, path = simulated
    window = subprocess.Popen([sys.executable, "-c", WINDOW, str(path)], stdout=subprocess.PIPE)
    assert window.stdout is not None
    assert window.stdout.readline() == b"moving\n"
    window.kill()
    window.wait(10)
    window.stdout.close()
    end = time.monotonic() + 60
    while engines():
        assert time.monotonic() < end
        time.sleep(0.1)
    # It stands, and stays where it stands.
    place = rig.world.trolley_x_m.at()
    time.sleep(0.3)
    assert rig.world.trolley_x_m.at() == place
