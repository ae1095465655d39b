"""Niceness of a process and of its session, as the system tells them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

TOLD = """
import os
from pathlib import Path
from polfuse_lab.priority import give_way
give_way(6)
print(os.nice(0), Path("/proc/self/autogroup").read_text().split()[-1])
"""


@pytest.mark.skipif(
    not Path("/proc/self/autogroup").exists(), reason="this system has no groups of processes by session"
)
@pytest.mark.parametrize("own_session", [True, False])
def test_who_leads_a_session_lowers_all_of_it(own_session: bool) -> None:
    """sched(7): within an autogroup niceness counts among its members only; the group has a niceness of its own."""
    before = Path("/proc/self/autogroup").read_text().split()[-1]
    done = subprocess.run(
        [sys.executable, "-c", TOLD], capture_output=True, text=True, check=True, start_new_session=own_session
    )
    assert done.stdout.split() == [str(os.nice(0) + 6), "6" if own_session else before]
