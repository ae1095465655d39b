"""The guard makes switches and trolley safe when the engine is killed, and keeps out of the way otherwise."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from hw_mocks.grbl import start_grbl
from hw_mocks.switch_box import start_switch_box
from hw_mocks.world import World
from polfuse_lab.engine.guard import Guard, secure
from polfuse_lab.rig import load_rig

LIMIT_S = 2.0
"""A rig must be safe within this time after the scheduler's crash."""

RIG = """\
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = 1.069
[radar]
driver = "fake"
[switches]
driver = "dowkey_ms"
settle_s = 0.02
options = {{port = "{switches}"}}
[trolley]
driver = "grbl"
length_m = 3.2
speed_m_s = 0.2
options = {{port = "{trolley}", feed_m_s = 0.2}}
"""
PLAN = """\
aperture_m = 2.0
step_m = 1.0
sweeps_per_channel = 1
move_settle_s = 0.0
channels = ["HH", "VV"]
"""


def wait_for(ready: Callable[[], object], what: str, timeout_s: float = 40.0) -> None:
    end_s = time.monotonic() + timeout_s
    while not ready():
        assert time.monotonic() < end_s, f"waited in vain for {what}"
        time.sleep(0.005)


def moving(world: World) -> bool:
    before = world.trolley_x_m.at()
    time.sleep(0.02)
    return world.trolley_x_m.at() != before


@pytest.mark.skipif(os.name != "posix", reason="kills process groups")
def test_killed_engine_leaves_switches_at_hh_and_the_trolley_standing(bench, capsys):
    world = World()
    with start_switch_box(world) as switches, start_grbl(world, length_m=3.2) as trolley:
        bench.rig.write_text(RIG.format(switches=switches.url, trolley=trolley.url))
        bench.plan.write_text(PLAN)
        with bench.start() as client:
            # On the way to the second position, the switches still at VV.
            wait_for(lambda: world.transmit.at() == "V" and world.trolley_x_m.at() > -0.9, "the second move")
            os.killpg(os.getpgid(client.pid), signal.SIGKILL)
            killed_s = time.monotonic()
            wait_for(lambda: not moving(world), "a trolley at rest", 10)
            stopped_s = time.monotonic() - killed_s
            wait_for(lambda: world.transmit.at() + world.receive.at() == "HH", "the switches", 10)
            safe_s = max(stopped_s, time.monotonic() - killed_s)
            x_m = world.trolley_x_m.at()
            assert -0.9 < x_m < -0.1
            assert safe_s < LIMIT_S
            with capsys.disabled():
                print(f" [safe {safe_s:.2f} s after the kill]", end="")
            time.sleep(0.3)
            assert world.trolley_x_m.at() == x_m


def test_a_run_that_ends_by_itself_is_left_alone(bench):
    bench.write()
    with bench.start() as client:
        assert client.wait().state == "finished"
    time.sleep(0.3)
    # Opened once, made safe once, closed once by the engine; not again by its guard.
    assert [what for _, what in bench.events() if what.startswith(("switches", "trolley"))].count("trolley open") == 1
    assert [what for _, what in bench.events()].count("switches safe") == 1


def test_a_device_that_did_not_confirm_its_safe_state_is_left_to_the_guard(bench):
    bench.write(aperture=0.5, switches={"fault": "slow_safe"})
    with bench.start() as client:
        outcome = client.wait()
    assert outcome.state == "finished"
    assert "the switches did not confirm its safe state" in outcome.warnings
    # The guard opens switches and trolley once more, and makes them safe.
    wait_for(lambda: [what for _, what in bench.events()].count("switches safe") == 2, "the guard", 20)
    wait_for(lambda: [what for _, what in bench.events()].count("trolley safe") == 2, "the guard", 20)


def test_a_crash_before_the_devices_were_opened_is_harmless(bench):
    bench.write()
    guard = Guard(bench.rig.read_text(), str(bench.rig))
    assert guard._process.stdin is not None
    guard._process.stdin.close()  # as when the engine dies
    guard._process.wait(10)
    said = [what for _, what in bench.events()]
    assert sorted(said) == sorted(
        f"{kind} {what}" for kind in ("switches", "trolley") for what in ("open", "safe", "close")
    )


def test_a_goodbye_ends_the_guard_without_touching_anything(bench):
    bench.write()
    guard = Guard(bench.rig.read_text(), str(bench.rig))
    guard.dismiss()
    guard.dismiss()
    assert guard._process.poll() == 0
    assert bench.events() == []


def test_signals_do_not_end_the_guard(bench):
    bench.write()
    guard = Guard(bench.rig.read_text(), str(bench.rig))
    time.sleep(1.0)  # until it has begun to ignore them
    for number in (signal.SIGINT, signal.SIGTERM):
        os.kill(guard.pid, number)
    time.sleep(0.1)
    assert guard._process.poll() is None
    guard.dismiss()


def test_a_guard_that_died_does_not_hold_up_the_engine(bench):
    bench.write()
    guard = Guard(bench.rig.read_text(), str(bench.rig))
    guard._process.kill()
    guard._process.wait(5)
    started = time.monotonic()
    guard.dismiss()
    assert time.monotonic() - started < 1


def test_each_device_is_secured_whatever_becomes_of_the_other(bench):
    bench.write(switches={"fault": "open"}, trolley={"fault": "slow_open"})
    results = {result.kind: result for result in secure(load_rig(bench.rig), bench.rig, limit_s=3.0)}
    assert "nobody answers" in results["switches"].trouble
    assert results["trolley"].trouble == "no answer within 3 s"
    assert "could not be made safe: no answer within 3 s" in str(results["trolley"])


def test_a_person_needs_no_guard(bench):
    bench.write(trolley_driver="by_hand_fake", switches={"fault": "bug"})
    results = {result.kind: result for result in secure(load_rig(bench.rig), bench.rig)}
    assert results["trolley"].trouble is None
    assert results["switches"].trouble == "RuntimeError: portaudio library not found"
    assert bench.events() == [] or all("trolley" not in what for _, what in bench.events())


def test_a_port_still_in_use_is_tried_again(tmp_path: Path):
    """The system may take a moment to take back the ports of a dead process."""
    world = World()
    with start_switch_box(world, kind="pty") as switches, start_grbl(world, length_m=3.2, kind="pty") as trolley:
        path = tmp_path / "rig.toml"
        path.write_text(
            RIG.format(switches=switches.url, trolley=trolley.url).replace('driver = "fake"', 'driver = "sounddevice"')
        )
        hold = (
            "import sys, time, serial\n"
            "port = serial.serial_for_url(sys.argv[1], exclusive=True)\n"
            "port.write(b':SWITCH2 2\\r\\n'); print('held', flush=True); time.sleep(0.6)\n"
        )
        holder = subprocess.Popen([sys.executable, "-c", hold, switches.url], stdout=subprocess.PIPE)
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        results = secure(load_rig(path), path)
        holder.stdout.close()
        holder.wait(5)
    assert [result.trouble for result in results] == [None, None]
    assert world.receive.at() == "H"
