"""The engine's process and its clients: attach, detach, die; the writer's death; prompts; the command line."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from polfuse_lab.engine import EngineClient, collect, running_engines
from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import info, open_session, recover

POLFUSE = (sys.executable, "-c", "from polfuse_lab.cli import main; main()")


def wait_for(condition, timeout_s: float = 40.0):
    """Poll until the condition's value is true; return it."""
    end = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)
    return value


def children(pid: int) -> list[int]:
    """Process ids of a process's children (Linux)."""
    found = []
    for task in os.listdir(f"/proc/{pid}/task"):
        with contextlib.suppress(OSError), open(f"/proc/{pid}/task/{task}/children") as file:
            found += [int(child) for child in file.read().split()]
    return found


def test_hand_operated_trolley_asks_and_waits(bench):
    bench.write(trolley_driver="by_hand_fake")
    asked = []

    def answer(client: EngineClient, prompt) -> None:
        asked.append(prompt.text)
        client.answer(prompt.ticket)

    outcome = collect(bench.rig, bench.plan, bench.session, on_prompt=answer)
    assert outcome.state == "finished"
    assert asked == [f"move the trolley to {x:.3f} m" for x in (-0.5, 0.0, 0.5)]


def test_nobody_to_ask_ends_the_collect(bench):
    bench.write(trolley_driver="by_hand_fake")
    outcome = collect(bench.rig, bench.plan, bench.session)
    assert outcome.state == "aborted"
    assert "move the trolley to -0.500 m" in outcome.reason


def test_second_client_attaches_and_a_stranger_is_refused(bench, monkeypatch):
    bench.write(settle=30.0)
    with bench.start() as client:
        (directory,) = running_engines()
        with EngineClient.attach(directory) as second:
            second.abort("stopped from the window")
        (directory / "token").write_text("guess")
        with pytest.raises(PolfuseError, match=r"wrong token|does not answer|no engine"):
            EngineClient.attach(directory)
        assert client.wait().reason == "stopped from the window"
    assert running_engines() == []


def test_engine_directory_is_private(bench):
    bench.write(settle=30.0)
    with bench.start() as client:
        (directory,) = running_engines()
        assert directory.stat().st_mode & 0o777 == 0o700
        assert directory.parent.stat().st_mode & 0o777 == 0o700
        client.abort()
        client.wait()


def recording(client: EngineClient, sweeps: int) -> None:
    wait_for(lambda: client.poll(0.02) and client.status.sweeps >= sweeps)


def test_preview_reaches_the_client(bench):
    bench.write(sweeps=20)
    with bench.start() as client:
        wait_for(lambda: client.poll(0.02) and client.status.preview)
        preview = client.status.preview
        client.abort()
        client.wait()
    # 1 kHz for a ramp of 80 MHz in 20 ms: 2 R / c = 1000 / (80e6 / 0.02), R = 37.5 m.
    levels = np.frombuffer(preview.level_db, "<f4")
    assert abs(levels.argmax() * preview.step_m - 299_792_458 / 2 * 1000 / 4e9) <= preview.step_m


def test_killed_client_does_not_end_the_collect(bench):
    bench.write(settle=0.3)
    command = [*POLFUSE, "collect", bench.rig, bench.plan, "-o", bench.session]
    client = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for(lambda: bench.session.with_name("s.h5.partial").exists())
    client.kill()
    client.wait(5)
    wait_for(bench.session.exists)
    found = info(bench.session)
    assert (found["complete"], found["positions"], found["problems"]) == (True, 3, [])
    wait_for(lambda: not running_engines())


def test_killed_engine_leaves_a_clean_file(bench):
    # The fake radar kills the process that it runs in, the engine, in its sixth record (the first is the probe).
    bench.write(aperture=2.0, radar={"fault": "kill_engine"})
    with bench.start() as client, pytest.raises(PolfuseError, match="engine's process ended unexpectedly"):
        client.wait()
    wait_for(bench.session.exists)
    with open_session(bench.session) as session:
        assert (session.state, session.complete) == ("engine lost", False)
        assert len(session.sweeps) == 4
        assert session.audio(3).shape[1] == 2
    assert not list(bench.folder.glob("*.partial"))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="finds the writer in /proc")
def test_killed_writer_stops_the_engine_with_the_reason(bench):
    bench.write(settle=0.3)
    with bench.start() as client:
        recording(client, 3)
        writers = [
            pid for pid in children(client.pid) if b"writer_process" in Path(f"/proc/{pid}/cmdline").read_bytes()
        ]
        assert len(writers) == 1
        os.kill(writers[0], signal.SIGKILL)
        outcome = client.wait()
    assert outcome.state == "failed"
    assert "the writer's process ended unexpectedly" in outcome.reason
    assert "polfuse recover" in outcome.reason
    partial = bench.session.with_name("s.h5.partial")
    assert outcome.session == str(partial)
    # Every checkpoint's records had been flushed: position 0 at least.
    rescued = recover(partial, bench.folder / "rescued.h5")
    found = info(rescued.session)
    assert found["sweeps"] >= 2
    assert rescued.lost_records == 0


def command(*arguments, **options) -> subprocess.CompletedProcess:
    return subprocess.run(
        [*POLFUSE, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        **options,
    )


def test_commands_from_plan_to_info(bench):
    bench.write(radar={"speed": 5.0})
    planned = json.loads(command("plan", bench.rig, bench.plan, "--json").stdout)
    assert planned["limits_ok"] is True
    # 3 positions of MoveTo, 2 x (SelectChannel, RecordSweeps), Checkpoint.
    assert planned["steps"] == 18
    examined = command("doctor", bench.rig, "--json")
    assert examined.returncode == 0, examined.stderr
    assert [d["ok"] for d in json.loads(examined.stdout)["devices"]] == [True, True, True]
    done = command("collect", bench.rig, bench.plan, "-o", bench.session, "--json")
    assert done.returncode == 0, done.stderr
    outcome = json.loads(done.stdout)
    assert set(outcome) >= {
        "session", "positions", "sweeps", "frames", "samples_lost", "frames_lost", "sync_rms_s", "state", "reason",
        "seconds"}  # fmt: skip
    assert (outcome["state"], outcome["positions"], outcome["sweeps"]) == ("finished", 3, 6)
    seen = json.loads(command("info", outcome["session"], "--json").stdout)
    assert (seen["complete"], seen["positions"], seen["channels"], seen["sweeps"]) == (True, 3, ["HH", "HV"], 6)
    # The session is there now: a second collect must not touch it.
    again = command("collect", bench.rig, bench.plan, "-o", bench.session)
    assert again.returncode == 1
    assert again.stderr.count("\n") == 1
    assert "exists and is never overwritten" in again.stderr


def test_ctrl_c_ends_a_collect_cleanly(bench):
    bench.write(settle=30.0)
    run = subprocess.Popen(
        [*POLFUSE, "collect", bench.rig, bench.plan, "-o", bench.session, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for(lambda: bench.session.with_name("s.h5.partial").exists())
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=20)
    assert run.returncode == 1
    assert "Traceback" not in err
    assert json.loads(out)["state"] == "aborted"
    assert open_session(bench.session).state == "aborted"


def test_doctor_names_the_fault_and_the_mend(bench):
    bench.write(trolley={"fault": "open"}, radar={"fault": "silent"})
    examined = command("doctor", bench.rig, "--json")
    assert examined.returncode == 1
    devices = {d["kind"]: d for d in json.loads(examined.stdout)["devices"]}
    assert devices["trolley"] == {
        "name": "fake", "kind": "trolley", "ok": False, "detail": "nobody answers", "advice": "plug it in"}  # fmt: skip
    assert "both channels are silent" in devices["radar"]["detail"]
    assert devices["switches"]["ok"]
