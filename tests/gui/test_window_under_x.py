"""The window on a real X server, which the other tests go without: a collect from the start page to the report."""

from __future__ import annotations

import ctypes.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

XVFB = shutil.which("Xvfb")
LIBRARIES = ("xcb-cursor", "xcb-icccm", "xcb-image", "xcb-keysyms", "xcb-render-util", "xcb-shape", "xkbcommon-x11")
"""What Qt's own plug-in for X needs besides."""
RUN = "test_window_collect.py::test_from_the_start_page_to_the_report"
LONGEST_S = 380

pytestmark = [
    pytest.mark.skipif(XVFB is None, reason="Xvfb is not installed (scripts/system-packages test)"),
    pytest.mark.skipif(
        not all(map(ctypes.util.find_library, LIBRARIES)),
        reason=f"Qt needs the libraries {', '.join(LIBRARIES)} to speak to an X server (scripts/system-packages test)",
    ),
]


@pytest.fixture
def display() -> Iterator[str]:
    """An X server of our own with the screen of a small laptop."""
    server = subprocess.Popen(
        [str(XVFB), "-displayfd", "1", "-screen", "0", "1366x768x24", "-nolisten", "tcp"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    try:
        assert server.stdout is not None
        yield f":{server.stdout.readline().strip()}"
    finally:
        server.terminate()
        server.wait(10)
        assert server.stdout is not None
        server.stdout.close()


@pytest.mark.timeout(LONGEST_S + 20)
def test_a_collect_from_the_start_page_to_the_report_under_x(display: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(Path(__file__).with_name(RUN))],
        capture_output=True, text=True, timeout=LONGEST_S, check=False,
        env={**os.environ, "DISPLAY": display, "QT_QPA_PLATFORM": "xcb", "POLFUSE_UNDER_X": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert "1 passed" in done.stdout
