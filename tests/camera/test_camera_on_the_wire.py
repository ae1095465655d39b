"""Our driver, harvesters and the open GenTL producer against the simulated GigE Vision camera, over real UDP."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("harvesters", reason="install with: pip install 'polfuse-lab[camera]'")

HERE = Path(__file__).resolve()
ROOT = HERE.parents[2]
CTI = Path(os.environ.get("POLFUSE_GENTL_CTI", ROOT / "build" / "gentl" / "polfuse-aravis.cti"))


@pytest.fixture(scope="module")
def told() -> dict[str, object]:
    """What the program saw, in a network namespace that holds nothing but a loopback interface."""
    if not CTI.is_file():
        pytest.skip("the open GenTL producer is not built (make gentl)")
    if not hasattr(os, "geteuid") or os.geteuid() != 0 or not shutil.which("unshare") or not shutil.which("ip"):
        pytest.skip("needs root, unshare and ip for a network namespace of its own")
    command = 'ip link set lo up && exec "$@"'
    done = subprocess.run(
        [
            "unshare",
            "--net",
            "sh",
            "-c",
            command,
            "sh",
            sys.executable,
            str(HERE.with_name("wire_program.py")),
            str(CTI),
        ],
        capture_output=True,
        text=True,
        timeout=90,
        cwd=ROOT,
        env={**os.environ, "POLFUSE_GENTL_CAMERAS": "127.0.0.1", "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr[-3000:]
    found: dict[str, object] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def test_every_format_arrives_pixel_by_pixel(told: dict) -> None:
    # Each frame of the pattern is told from all others by every one of its pixels.
    assert set(told["numbers"]) == {"Mono16", "Mono12p", "Mono12Packed", "Mono12", "Mono10p", "Mono10", "Mono8"}
    for name, numbers in told["numbers"].items():
        assert None not in numbers, f"{name}: a frame is none of the pattern's"
    # One trigger, one frame: numbers of a 16-bit series follow one another.
    first = told["numbers"]["Mono16"]
    assert first == [first[0], first[0] + 1, first[0] + 2]
    assert "software trigger" in told["detail"]
    assert "lacks" not in told["detail"]


def test_frames_and_clock_fixes_share_the_cameras_clock(told: dict) -> None:
    for before_s, frame_s, after_s in told["clock"]:
        assert before_s < frame_s < after_s


def test_the_exposure_is_the_one_asked_for(told: dict) -> None:
    assert told["exposure_s"] == pytest.approx(0.0025)


def test_an_unplugged_camera_is_lost_within_its_time_and_comes_back(told: dict) -> None:
    assert told["lost"].startswith("DeviceLost: ")
    # Exposure and half a second until it is asked for, then the watchdog's 1.5 s, although a frame may take 20 s.
    assert told["lost_after_s"] < 3.0
    assert told["after_return"] == [64, 96]
