"""The command line as a whole: it starts fast, explains every command, and speaks as promised."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from polfuse_lab.cli import COMMANDS

POLFUSE = [sys.executable, "-m", "polfuse_lab.cli"]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*POLFUSE, *arguments], capture_output=True, text=True, timeout=60, check=False)


def test_help_imports_nothing_heavy() -> None:
    # The start-up time itself (under 0.3 s) depends on the machine; what makes it slow does not.
    code = "import sys, polfuse_lab.cli as c; c.build(); print('\\n'.join(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    heavy = {"numpy", "scipy", "numba", "h5py", "matplotlib", "pydantic", "zmq", "sounddevice", "harvesters", "sklearn"}
    assert heavy.isdisjoint(loaded.stdout.split())


def test_help_starts_fast() -> None:
    # Best of five: 0.3 s is promised on an idle machine, and other work may run beside the tests.
    seconds = []
    for _ in range(5):
        begin = time.perf_counter()
        assert run("--help").returncode == 0
        seconds.append(time.perf_counter() - begin)
    assert min(seconds) < 0.3


@pytest.mark.parametrize("name", [name for _, _, name in COMMANDS])
def test_each_command_explains_itself_with_an_example(name: str) -> None:
    outcome = run(name, "--help")
    assert outcome.returncode == 0
    assert f"polfuse {name}" in outcome.stdout
    assert "Example" in outcome.stdout
    assert "--json" in outcome.stdout


def test_wrong_usage_is_status_2() -> None:
    assert run("collect").returncode == 2
    assert run("no-such-command").returncode == 2


def test_failed_work_is_status_1_and_one_sentence(tmp_path: Path) -> None:
    outcome = run("info", str(tmp_path / "none.h5"), "--json")
    assert outcome.returncode == 1
    assert outcome.stdout == ""
    lines = outcome.stderr.strip().splitlines()
    assert len(lines) == 1
    assert str(tmp_path / "none.h5") in lines[0]


def test_debug_adds_the_traceback(tmp_path: Path) -> None:
    assert "Traceback" in run("info", str(tmp_path / "none.h5"), "--debug").stderr


def test_json_is_one_object(tmp_path: Path) -> None:
    outcome = run("init", str(tmp_path / "field"), "--json")
    assert outcome.returncode == 0, outcome.stderr
    answer = json.loads(outcome.stdout)
    assert Path(answer["rig"]).is_file()
    assert Path(answer["plan"]).is_file()
    planned = json.loads(run("plan", answer["rig"], answer["plan"], "--json").stdout)
    assert planned["limits_ok"] is True
    assert planned["problems"] == []
