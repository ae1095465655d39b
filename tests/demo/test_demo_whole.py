"""The whole demo over real wires: green, the same to the last bit for one seed, and nothing left behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from polfuse_lab.products.store import Products

COMMAND = [sys.executable, "-c", "from polfuse_lab.cli import main; main()", "demo"]

pytestmark = [
    pytest.mark.timeout(400),
    pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals"),
]


def run(out: Path, *more: str) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, "--quick", "--json", "--out", str(out), *more]
    return subprocess.run(command, capture_output=True, text=True, timeout=180)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("demo")


@pytest.fixture(scope="module")
def first(folder: Path) -> subprocess.CompletedProcess[str]:
    return run(folder / "first", "--seed", "11")


def test_it_is_green_and_says_what_it_made(first: subprocess.CompletedProcess[str]) -> None:
    assert first.returncode == 0, first.stderr
    (line,) = first.stdout.splitlines()
    made = json.loads(line)
    assert set(made) == {"session", "products", "report", "figures", "checks", "ok", "seconds"}
    assert made["ok"] is True
    for path in (made["session"], made["products"], made["report"], *made["figures"]):
        assert Path(path).stat().st_size > 1000
    checks = made["checks"]
    assert all(check["ok"] for check in checks.values())
    assert {"value", "expected", "tolerance", "ok"} <= set(checks["dihedral_rcs"])
    # Every kind of check that the demo promises is there.
    for name in (
        "place_trihedral", "dihedral_rcs", "resolution_range", "resolution_cross_range", "isolation_hv", "dolp_plate",
        "samples_lost", "frames_lost", "rma_peaks", "rma_correlation", "thesis_trihedral_rcs", "thesis_positions",
    ):  # fmt: skip
        assert name in checks


def test_one_seed_gives_one_result_to_the_last_bit(first: subprocess.CompletedProcess[str], folder: Path) -> None:
    assert first.returncode == 0, first.stderr
    second = run(folder / "second", "--seed", "11")
    assert second.returncode == 0, second.stderr
    one, two = (Products(folder / name / "products.h5") for name in ("first", "second"))
    assert one.stages() == two.stages()
    for stage in one.stages():
        # The recordings began at other instants; the arrays are the same nevertheless.
        assert one.provenance(stage)["sha256"] == two.provenance(stage)["sha256"], stage
    figures = sorted(path.name for path in (folder / "first" / "figures").iterdir())
    for name in figures:
        pictures = [(folder / run_ / "figures" / name).read_bytes() for run_ in ("first", "second")]
        assert pictures[0] == pictures[1], name


def test_what_is_there_is_not_overwritten(first: subprocess.CompletedProcess[str], folder: Path) -> None:
    session = folder / "first" / "session.h5"
    before = session.stat().st_mtime_ns
    again = run(folder / "first")
    assert (again.returncode, again.stdout) == (1, "")
    assert "holds session.h5 already" in again.stderr
    assert session.stat().st_mtime_ns == before


def descendants(pid: int) -> set[int]:
    listing = subprocess.run(["ps", "-eo", "pid,ppid"], capture_output=True, text=True, timeout=10).stdout
    pairs = [tuple(map(int, line.split())) for line in listing.splitlines()[1:]]
    found, fresh = set(), {pid}
    while fresh:
        found |= fresh
        fresh = {child for child, parent in pairs if parent in fresh} - found
    return found - {pid}


def alive(pids: set[int]) -> set[int]:
    left = set()
    for pid in pids:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
        except OSError:
            continue
        if state != "Z":
            left.add(pid)
    return left


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
def test_ctrl_c_ends_it_cleanly(folder: Path) -> None:
    process = subprocess.Popen(
        [*COMMAND, "--quick", "--json", "--out", str(folder / "stopped")],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    children: set[int] = set()
    limit = time.monotonic() + 60
    while not (folder / "stopped" / "session.h5.partial").exists() and time.monotonic() < limit:
        assert process.poll() is None
        children |= descendants(process.pid)
        time.sleep(0.1)
    time.sleep(2)
    children |= descendants(process.pid)
    # As a terminal does: the signal goes to every process of the group.
    os.killpg(process.pid, signal.SIGINT)
    out, errors = process.communicate(timeout=30)
    assert process.returncode == 130, errors
    assert out == ""
    assert "stopped by the user" in errors
    assert "Traceback" not in errors
    limit = time.monotonic() + 10
    while alive(children) and time.monotonic() < limit:
        time.sleep(0.1)
    assert alive(children) == set()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
def test_a_killed_demo_leaves_no_process(folder: Path) -> None:
    process = subprocess.Popen(
        [*COMMAND, "--quick", "--out", str(folder / "killed")], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    children: set[int] = set()
    limit = time.monotonic() + 60
    while not (folder / "killed" / "sky.h5.partial").exists() and time.monotonic() < limit:
        assert process.poll() is None
        children |= descendants(process.pid)
        time.sleep(0.05)
    children |= descendants(process.pid)
    process.kill()
    process.wait(10)
    # The engine goes on without its client until its short plan is done, or its devices are gone.
    limit = time.monotonic() + 45
    while alive(children) and time.monotonic() < limit:
        time.sleep(0.2)
    assert alive(children) == set()
