"""The producer, built anew, and programs run in a network namespace that holds nothing but a loopback interface."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SOURCES = ROOT / "drivers" / "camera" / "gentl"


@pytest.fixture(scope="session")
def producer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for tool in ("cc", "make", "pkg-config"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed, which building the GenTL producer needs")
    flags = subprocess.run(["pkg-config", "--cflags", "aravis-0.8"], capture_output=True, text=True, timeout=20)
    if flags.returncode:
        pytest.skip("the headers of Aravis are not installed: libaravis-dev and libusb-1.0-0-dev")
    out = tmp_path_factory.mktemp("gentl")
    # Warnings are errors there: this is a test of the sources as well.
    made = subprocess.run(
        ["make", "-C", str(SOURCES), f"OUT={out}"], capture_output=True, text=True, timeout=110, check=False
    )
    assert made.returncode == 0, made.stderr
    return out / "polfuse-aravis.cti"


@pytest.fixture(scope="session")
def alone() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs a command where no other camera and no other network is; 127.0.0.1 is the only address asked."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0 or not shutil.which("unshare") or not shutil.which("ip"):
        pytest.skip("needs root, unshare and ip for a network namespace of its own")

    def run(*command: str, **variables: str) -> subprocess.CompletedProcess[str]:
        script = 'ip link set lo up && exec "$@"'
        return subprocess.run(
            ["unshare", "--net", "--kill-child", "--fork", "sh", "-c", script, "sh", *command],
            capture_output=True,
            text=True,
            timeout=110,
            check=False,
            env={**os.environ, "POLFUSE_GENTL_CAMERAS": "127.0.0.1", "PYTHONPATH": str(ROOT), **variables},
        )

    return run


@pytest.fixture(scope="session")
def fake_camera() -> str:
    found = shutil.which("arv-fake-gv-camera-0.8")
    if found is None:
        pytest.skip("Aravis' fake camera is not installed: aravis-tools-cli")
    return found


@pytest.fixture(scope="session")
def program(alone: Callable[..., subprocess.CompletedProcess[str]]) -> Callable[..., dict]:
    """Runs one of the programs beside this file; gives what it told on its last line."""

    def run(name: str, *arguments: str) -> dict:
        done = alone(sys.executable, str(HERE / name), *arguments)
        assert done.returncode == 0, done.stderr[-3000:]
        # Aravis complains there about calls that it does not understand.
        assert "CRITICAL" not in done.stderr
        told: dict = json.loads(done.stdout.strip().splitlines()[-1])
        return told

    return run
